"""How much do the wheels slip? Shake the yaw a little, and compare what wheels and gyro say of it.

Drive force alone cannot tell a soft surface that slips from a stiff one that drags: at one force slip differs
by a factor of ten. A small sinusoid on the commanded yaw rate passes through the same contacts as the travel:
on firm grip the body follows the wheels, on loose grip it lags behind them. The share of the shake that is
lost tells the slip of the travel, whatever the surface.
"""

import cmath
import math
from typing import Annotated, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from controllers.slip.effort.travel_range import travel_problem
from controllers.slip.interpolation import check_rising, interpolate
from drivers.settings import Settings

WINDOW_S = 0.5
"""The shake is compared over this long, at least one period."""

LEAST_AMPLITUDE = 0.3
"""With wheels that shake by less than this share of what was asked for, nothing can be told."""

LEAST_WAY_M = 0.02
"""Less way in a window has no direction, and its slip does not matter."""

LEAST_READINGS = 4.0
"""Readings in a period of the shake."""

GREATEST_RESIDUAL = 0.7
"""What sinusoid and trend do not explain of the wheels' yaw rate, over the sinusoid: more is no shake."""


class YawProbeMap(Settings):
    """The shake, and the slip that a lost share of it means; fitted to drives with known truth.

    Attributes:
        source: The drives that it was fitted to.
        amplitude_rad_s: Of the commanded yaw rate.
        frequency_hz: Of the shake.
        lost: Shares lost, 1 - gyro / wheels, increasing.
        slips: Slip of the travel at each, not decreasing.
        slip_sd: Scatter of the slip about the curve.
        directions_rad: Directions of travel of the drives, in the body frame.
        speed_range_m_s: Their speeds.
    """

    source: str
    amplitude_rad_s: Annotated[float, Field(ge=0.02, le=2.0)]
    frequency_hz: Annotated[float, Field(ge=1.0 / WINDOW_S, le=10.0)]
    lost: Annotated[tuple[float, ...], Field(min_length=2)]
    slips: Annotated[tuple[float, ...], Field(min_length=2)]
    slip_sd: Annotated[float, Field(gt=0.0)]
    directions_rad: Annotated[tuple[float, ...], Field(min_length=1)]
    speed_range_m_s: tuple[float, float]

    @model_validator(mode="after")
    def _check_table(self) -> Self:
        check_rising("lost", self.lost, "slips", self.slips)
        return self


class Shake(NamedTuple):
    """What one window told.

    Attributes:
        lost: Share of the wheels' shake that the body did not follow, about 0 to 1.
        wheel_rate_rad_s: Mean yaw rate by rolling wheels, the shake left out.
        gyro_rate_rad_s: Mean yaw rate by the gyro, likewise.
        reason: Why nothing can be told; empty where it can.
    """

    lost: float
    wheel_rate_rad_s: float
    gyro_rate_rad_s: float
    reason: str


class YawProbe:
    """Asks for the shake and finds what is lost of it.

    Args:
        probe: Amplitude and frequency.
    """

    def __init__(self, probe: YawProbeMap) -> None:
        self._probe = probe
        self._rows: list[tuple[float, float, float]] = []
        self._t_s = 0.0
        self._begun_s = 0.0

    def yaw_rate_rad_s(self, t_s: float) -> float:
        """Return what to add to the commanded yaw rate at a time."""
        return self._probe.amplitude_rad_s * math.sin(math.tau * self._probe.frequency_hz * t_s)

    def step(self, elapsed_s: float, wheel_rate_rad_s: float, gyro_rate_rad_s: float | None) -> Shake | None:
        """Take one reading; return what the window told when it is full, else None.

        Args:
            elapsed_s: Time since the reading before.
            wheel_rate_rad_s: Yaw rate by rolling wheels.
            gyro_rate_rad_s: Yaw rate by the gyro, less its bias; None without a fresh one.
        """
        self._t_s += elapsed_s
        if gyro_rate_rad_s is not None:
            self._rows.append((self._t_s, wheel_rate_rad_s, gyro_rate_rad_s))
        if self._t_s - self._begun_s < WINDOW_S:
            return None
        rows, self._rows, self._begun_s = self._rows, [], self._t_s
        return self._compare(rows)

    def _compare(self, rows: list[tuple[float, float, float]]) -> Shake:
        if len(rows) < LEAST_READINGS * WINDOW_S * self._probe.frequency_hz:
            return Shake(0.0, 0.0, 0.0, "too few readings of the gyro")
        t_s, wheels, gyro = np.array(rows).T
        phase = math.tau * self._probe.frequency_hz * t_s
        columns = np.column_stack((np.cos(phase), np.sin(phase), np.ones(len(t_s)), t_s - t_s.mean()))
        found, *_ = np.linalg.lstsq(columns, np.column_stack((wheels, gyro)), rcond=None)
        wheel_shake, gyro_shake = complex(*found[:2, 0]), complex(*found[:2, 1])
        if abs(wheel_shake) < LEAST_AMPLITUDE * self._probe.amplitude_rad_s:
            return Shake(0.0, 0.0, 0.0, "the wheels do not shake as asked")
        left = math.sqrt(2.0 * float(np.mean((wheels - columns @ found[:, 0]) ** 2)))
        if left > GREATEST_RESIDUAL * abs(wheel_shake):
            return Shake(0.0, 0.0, 0.0, "the yaw rate changes too much besides the shake")
        return Shake(1.0 - abs(gyro_shake / wheel_shake), float(found[2, 0]), float(found[2, 1]), "")


def range_problem(probe: YawProbeMap, lost: float, travelled_m: complex) -> str:
    """Say why the table does not hold for a lost share and the wheels' way in that window; else empty."""
    if not probe.lost[0] <= lost <= probe.lost[-1]:
        return f"lost share of {lost:.2f} is outside the training range"
    if abs(travelled_m) < LEAST_WAY_M:
        return ""
    direction_rad, speed_m_s = cmath.phase(travelled_m), abs(travelled_m) / WINDOW_S
    return travel_problem(probe.directions_rad, probe.speed_range_m_s, direction_rad, speed_m_s)


def slip_of(probe: YawProbeMap, lost: float) -> float:
    """Return the slip for a lost share; held at the ends of the table."""
    return interpolate(probe.lost, probe.slips, lost)
