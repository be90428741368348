"""How much of the secant reading and of the bracket's width this rover takes on its own ground.

m = p S + q W, with the secant reading S and the width W of the bracket, see `slip_bracket`. For a contact
whose traction depends on the slip ratio p = 1 and q = 0; the formula takes 1 and 1/2. `rover-hil commission`
learns both where pose fixes have measured the slip. With many labels p and q also change with response, speed
and drive force, in proportion. They hold on that ground, within what was driven.
"""

import math
import operator
from itertools import product
from typing import Annotated, NamedTuple, Self

from pydantic import Field, model_validator

from controllers.slip.effort.gyro_response import GyroResponse
from controllers.slip.effort.slip_bracket import DrivenTravel, SlipReading, width_of
from controllers.slip.effort.yaw_excitation import ExcitationSettings
from drivers.settings import Settings

MARGIN = 0.25
"""Of the range of what was driven, by which a reading may lie outside; chosen by hand."""

Deviation = Annotated[float, Field(ge=0.0, le=1.0)]
Range = tuple[float, float]
PLAIN, SMOOTH = 2, 7
"""Number of weights: of p and q alone, and with their changes."""


def conditions_of(excitation: ExcitationSettings, gyro: GyroResponse | None) -> str:
    """Return what a reading depends on beside the ground, in words: excitation, inertia and gyro."""
    inertia = (excitation.yaw_inertia_kg_m2, excitation.body_radius_m)
    known = ", ".join(f"{value:g}" for value in (excitation.mass_kg, *inertia) if value is not None)
    words = f"excitation {excitation.frequency_hz:g} Hz of {known}"
    if gyro is None:
        return f"{words}, gyro unknown"
    return (
        f"{words}, gyro gain {gyro.gain:.2f}, delay {1e3 * gyro.delay_s:.0f} ms, {gyro.bandwidth_hz:.0f} Hz"
    )


class Driven(NamedTuple):
    """Ranges of what was driven.

    Attributes:
        secant: Secant readings.
        width: Widths of the bracket.
        speed_m_s: Speeds by the wheels.
        force_n: Drive forces; None where they were not known all the time.
    """

    secant: Range
    width: Range
    speed_m_s: Range
    force_n: Range | None

    def terms(self, secant: float, width: float, travel: DrivenTravel, count: int) -> list[float]:
        """Return what the weights are multiplied with, `count` of them.

        S and W, then S times the place of the secant reading in its range, -1 to 1, then S and W times that
        of the speed, then times that of the drive force, where it is known.
        """
        speed = _place(travel.speed_m_s, self.speed_m_s)
        force = (
            0.0 if self.force_n is None or travel.force_n is None else _place(travel.force_n, self.force_n)
        )
        smooth = [secant * _place(secant, self.secant)]
        smooth += [secant * speed, width * speed, secant * force, width * force]
        return [secant, width, *smooth][:count]


class LearnedBracket(Settings):
    """What was learned on a ground, and where it holds.

    Attributes:
        source: The drives that it was learned from.
        learned_on: Day, as 2026-01-31.
        windows: Number of labelled readings.
        weights: How much of the secant reading (p; the formula takes 1) and of the bracket's width (q; the
            formula takes 1/2); with many labels also of the five other terms of `Driven`.
        covariance: Of the weights, row by row.
        residual_sd: Standard deviation of a reading that was left out, about what the others give for it.
        secant_range: Secant readings that were seen.
        width_range: Widths that were seen.
        speed_range_m_s: Speeds by the wheels that were driven.
        force_range_n: Drive forces; None where they were not known all the time.
        conditions: Excitation and gyro that they were read with, see `conditions_of`; empty where not stated.
        drift_per_slip: Angle from the course of the wheels to the true one over the slip, left positive, rad.
        drift_sd_rad: Standard deviation of the drift about it.
    """

    source: str
    learned_on: str
    windows: Annotated[int, Field(ge=1)]
    weights: tuple[float, ...]
    covariance: tuple[float, ...]
    residual_sd: Deviation
    secant_range: Range
    width_range: Range
    speed_range_m_s: Range
    force_range_n: Range | None = None
    conditions: str = ""
    drift_per_slip: Annotated[float, Field(ge=-1.5, le=1.5)] = 0.0
    drift_sd_rad: Annotated[float, Field(ge=0.0, le=3.2)] = 0.0

    @model_validator(mode="after")
    def _check_sizes(self) -> Self:
        count = len(self.weights)
        if count not in (PLAIN, SMOOTH) or len(self.covariance) != count**2:
            raise ValueError(
                f"weights and covariance must have {PLAIN} and {PLAIN**2} numbers, or {SMOOTH} and "
                f"{SMOOTH**2}: take a file of `rover-hil commission` as it is"
            )
        return self

    @property
    def driven(self) -> Driven:
        """Ranges of what was driven."""
        return Driven(self.secant_range, self.width_range, self.speed_range_m_s, self.force_range_n)

    def problem(self, secant: float, width: float, travel: DrivenTravel) -> str:
        """Return why a reading lies outside of what was learned; empty where it does not."""
        outside = [
            name
            for name, value, seen in (
                ("response", secant, self.secant_range),
                ("lag", width, self.width_range),
                ("speed", travel.speed_m_s, self.speed_range_m_s),
                ("drive force", travel.force_n, self.force_range_n),
            )
            if seen is not None and value is not None and not _is_within(value, seen)
        ]
        return f"{' and '.join(outside)} outside of what was learned on the rover" if outside else ""

    def other_conditions(self, now: str) -> str:
        """Return that it was learned under other conditions than now; empty where it was not."""
        if self.conditions in ("", now):
            return ""
        return f"learned reading not used: learned with {self.conditions}; now {now}: commission again"

    def read(self, found: SlipReading, travel: DrivenTravel) -> tuple[SlipReading, str]:
        """Return a reading by what was learned, and "", or the reading as it is, and why."""
        width = width_of(found.secant, found.bound)
        problem = found.problem or self.problem(found.secant, width, travel)
        if problem:
            return found, problem
        count = len(self.weights)
        terms = self.driven.terms(found.secant, width, travel, count)
        slip = sum(map(operator.mul, self.weights, terms))
        variance = sum(
            self.covariance[row * count + column] * terms[row] * terms[column]
            for row, column in product(range(count), repeat=2)
        )
        sd = math.hypot(self.residual_sd, math.sqrt(max(0.0, variance)))
        return found._replace(slip=min(max(slip, 0.0), 1.0), sd=sd), ""


def _is_within(value: float, seen: Range) -> bool:
    low, high = seen
    margin = MARGIN * (high - low)
    return low - margin <= value <= high + margin


def _place(value: float, seen: Range) -> float:
    """Return the place of a value in a range, -1 to 1 inside; 0 in one without width."""
    low, high = seen
    return (2.0 * value - low - high) / (high - low) if high > low else 0.0
