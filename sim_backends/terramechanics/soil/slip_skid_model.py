"""Sinkage, torque and drawbar pull of a wheel, piecewise linear in the slip ratio (paper 002, eqs 7-23).

The lines are fits to one wheel on one soil at one load; they hold for that wheel and soil and a similar load.
Paper 002 measured slip ratios from -1 to 0.6; beyond 0.6 the last line is extrapolated to 1.
"""

import functools
import tomllib
from importlib import resources
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, TypeAdapter

from drivers.errors import ModelError
from drivers.settings import Settings
from sim_backends.arrays import Array

TESTED_LOAD_N = 85.0
"""Mean normal force of paper 002's tests."""
RESISTANCE_LIMIT = 0.6
"""Greatest slip or skid ratio to which eq 16 was fitted."""


class Line(NamedTuple):
    """A straight line over the slip ratio: slope and value at slip ratio 0."""

    slope: float
    intercept: float

    def at(self, slip_ratio: Array) -> Array:
        """Return the line's values."""
        return self.slope * slip_ratio + self.intercept


class ThreeLines(Settings):
    """A quantity over the slip ratio: one line in skid, one around zero, one in slip (eqs 17, 20, 21).

    Attributes:
        skid: Valid from -1 to `skid_transition`.
        middle: Valid between the transitions.
        slip: Valid from `slip_transition` to 1.
    """

    skid: Line
    middle: Line
    slip: Line

    @property
    def skid_transition(self) -> float:
        """Slip ratio at which the skid line meets the middle one (eqs 19, 22, 23)."""
        return (self.skid.intercept - self.middle.intercept) / (self.middle.slope - self.skid.slope)

    @property
    def slip_transition(self) -> float:
        """Slip ratio at which the slip line meets the middle one (eqs 19, 22, 23)."""
        return (self.slip.intercept - self.middle.intercept) / (self.middle.slope - self.slip.slope)

    def at(self, slip_ratio: ArrayLike) -> Array:
        """Return the value at slip ratios from -1 to 1, shaped as they are; continuous.

        Raises:
            ModelError: A slip ratio is outside [-1, 1] or not a number.
        """
        slip = checked_slip_ratio(slip_ratio)
        above = np.where(slip > self.slip_transition, self.slip.at(slip), self.middle.at(slip))
        return np.where(slip < self.skid_transition, self.skid.at(slip), above)


class ResistanceLines(Settings):
    """Resistance coefficient lambda_RC over slip and skid (eq 16).

    Attributes:
        intercept: Value at slip ratio 0.
        slip_slope: Per slip ratio.
        skid_slope: Per skid ratio.
    """

    intercept: Annotated[float, Field(ge=0, le=1)]
    slip_slope: Annotated[float, Field(ge=0, le=5)]
    skid_slope: Annotated[float, Field(ge=0, le=5)]

    def at(self, slip_ratio: ArrayLike) -> Array:
        """Return lambda_RC at slip ratios from -1 to 1; fitted up to `RESISTANCE_LIMIT` either way (eq 16).

        Raises:
            ModelError: A slip ratio is outside [-1, 1] or not a number.
        """
        slip = checked_slip_ratio(slip_ratio)
        slope = np.where(slip < 0, self.skid_slope, self.slip_slope)
        return slope * np.abs(slip) + self.intercept


class SlipSkidWheel(Settings):
    """A wheel with its fitted lines on one soil.

    Attributes:
        radius_m: Radius without lugs.
        width_m: Width of the rim.
        lug_height_m: 0 for a smooth wheel.
        shearing_fraction: lambda_s, the share of the lug height in the shearing radius (eq 8).
        resistance: lambda_RC (eq 16).
        sinkage_mm: Sinkage in mm (eq 17); None where it was not fitted.
        moment: M_DR / (F_N r_s) (eq 20), the tractive coefficient lambda_TC.
        drawbar_pull: F_DP / F_N (eq 21), the drawbar pull coefficient lambda_PC.
    """

    radius_m: Annotated[float, Field(gt=0, le=5)]
    width_m: Annotated[float, Field(gt=0, le=5)]
    lug_height_m: Annotated[float, Field(ge=0, le=1)]
    shearing_fraction: Annotated[float, Field(ge=0, le=1)]
    resistance: ResistanceLines
    sinkage_mm: ThreeLines | None = None
    moment: ThreeLines
    drawbar_pull: ThreeLines

    @property
    def shearing_radius_m(self) -> float:
        """Radius r_s at which the soil shears (eq 8)."""
        return self.radius_m + self.shearing_fraction * self.lug_height_m


@functools.cache
def shipped_wheels() -> dict[str, SlipSkidWheel]:
    """Return the wheels of paper 002, Tables II to V: Wh31 (15 mm lugs), Wh32 (10 mm) and Wh34 (smooth)."""
    text = (resources.files("sim_backends.terramechanics.soil") / "slip_skid_wheels.toml").read_text("utf-8")
    return TypeAdapter(dict[str, SlipSkidWheel]).validate_python(tomllib.loads(text)["wheels"])


def sinkage_m(wheel: SlipSkidWheel, slip_ratio: ArrayLike) -> Array:
    """Return the sinkage in m at slip ratios from -1 to 1 (eq 17).

    Raises:
        ModelError: The wheel has no fitted sinkage, or a slip ratio is outside [-1, 1].
    """
    if wheel.sinkage_mm is None:
        raise ModelError("the wheel has no sinkage lines (paper 002 fitted none for Wh32): use Wh31 or Wh34")
    return wheel.sinkage_mm.at(slip_ratio) / 1000.0


def resistance_moment_nm(
    wheel: SlipSkidWheel, slip_ratio: ArrayLike, normal_force_n: float = TESTED_LOAD_N
) -> Array:
    """Return the required drive moment M_DR in N m, shaped as the slip ratio (eq 20).

    Args:
        wheel: Wheel with its lines.
        slip_ratio: From -1 to 1.
        normal_force_n: Normal force above 0; the lines were fitted near 85 N.

    Raises:
        ModelError: A slip ratio or the normal force is out of range.
    """
    return wheel.moment.at(slip_ratio) * checked_load(normal_force_n) * wheel.shearing_radius_m


def drawbar_pull_n(
    wheel: SlipSkidWheel, slip_ratio: ArrayLike, normal_force_n: float = TESTED_LOAD_N
) -> Array:
    """Return the drawbar pull F_DP in N, shaped as the slip ratio; negative in skid (eq 21).

    Args:
        wheel: Wheel with its lines.
        slip_ratio: From -1 to 1.
        normal_force_n: Normal force above 0; the lines were fitted near 85 N.

    Raises:
        ModelError: A slip ratio or the normal force is out of range.
    """
    return wheel.drawbar_pull.at(slip_ratio) * checked_load(normal_force_n)


def slope_rad(wheel: SlipSkidWheel, slip_ratio: ArrayLike) -> Array:
    """Return the slope in rad that the wheel climbs (+) or descends (-) steadily at a slip ratio (eq 15).

    Raises:
        ModelError: A slip ratio is outside [-1, 1].
    """
    return np.arctan(wheel.drawbar_pull.at(slip_ratio))


def slip_ratio_on_slope(wheel: SlipSkidWheel, slope_angle_rad: float) -> float | None:
    """Return the least slip or skid with which the wheel climbs (+) or descends (-) a slope (eqs 14, 21).

    Args:
        wheel: Wheel with its lines.
        slope_angle_rad: From -pi/2 to pi/2.

    Returns:
        The slip ratio from -1 to 1; None where the slope is steeper than the wheel can hold.

    Raises:
        ModelError: The slope is out of range.
    """
    if not abs(slope_angle_rad) < np.pi / 2:
        raise ModelError(f"slope_angle_rad = {slope_angle_rad} must lie between -pi/2 and pi/2 rad")
    required = float(np.tan(slope_angle_rad))
    lines = wheel.drawbar_pull
    corners = np.array([-1.0, lines.skid_transition, 0.0, lines.slip_transition, 1.0])
    pulls = lines.at(corners)
    branch = slice(2, None) if required >= 0 else slice(2, None, -1)
    return _first_crossing(corners[branch], pulls[branch], required)


def checked_slip_ratio(slip_ratio: ArrayLike) -> Array:
    """Return the slip ratios as an array.

    Raises:
        ModelError: One is outside [-1, 1] or not a number.
    """
    slip = np.asarray(slip_ratio, dtype=np.float64)
    is_outside = ~(np.abs(slip) <= 1)
    if np.any(is_outside):
        raise ModelError(
            f"slip_ratio = {slip[is_outside].flat[0]} must lie between -1 (locked) and 1 (spinning)"
        )
    return slip


def checked_load(normal_force_n: float) -> float:
    """Return the normal force.

    Raises:
        ModelError: It is not positive and finite.
    """
    if not 0 < normal_force_n < np.inf:
        raise ModelError(f"normal_force_n = {normal_force_n} N must be positive and finite")
    return normal_force_n


def _first_crossing(slips: Array, pulls: Array, required: float) -> float | None:
    """Return where a piecewise linear function first reaches the required value."""
    for at, pull, next_at, next_pull in zip(slips, pulls, slips[1:], pulls[1:], strict=False):
        if abs(next_pull) >= abs(required) and next_pull != pull:
            return float(at + (required - pull) / (next_pull - pull) * (next_at - at))
    return None
