"""Slip from a small yaw excitation: how much of it the body loses against the wheels.

Drive force alone cannot separate a soft surface that slips from a stiff one with high resistance: at the same
force slip differs by a factor of ten. A small sinusoid on the commanded yaw rate passes through the same
contacts as the travel. On firm grip the body follows the wheels, on loose grip its amplitude is smaller. The
transmission loss, 1 - amplitude of the body / amplitude of the wheels, gives the slip on any surface.
"""

import cmath
import math
from typing import Annotated, NamedTuple, Self

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.travel_range import travel_problem
from controllers.slip.interpolation import check_rising, interpolate
from drivers.settings import Settings


class YawExcitationMap(Settings):
    """The excitation, and slip over transmission loss; fitted to drives with known truth.

    Attributes:
        source: The drives that it was fitted to.
        amplitude_rad_s: Of the commanded yaw rate.
        frequency_hz: Of the excitation.
        transmission_losses: 1 - gyro / wheels, increasing; key `lost` in the file.
        slips: Slip of the travel at each, not decreasing.
        slip_sd: Scatter of the slip about the curve.
        directions_rad: Directions of travel of the drives, in the body frame.
        speed_range_m_s: Their speeds.
    """

    model_config = ConfigDict(populate_by_name=True)

    source: str
    amplitude_rad_s: Annotated[float, Field(ge=0.02, le=2.0)]
    frequency_hz: Annotated[float, Field(ge=1.0 / EFFORT.excitation.window_s, le=10.0)]
    transmission_losses: Annotated[tuple[float, ...], Field(min_length=2, alias="lost")]
    slips: Annotated[tuple[float, ...], Field(min_length=2)]
    slip_sd: Annotated[float, Field(gt=0.0)]
    directions_rad: Annotated[tuple[float, ...], Field(min_length=1)]
    speed_range_m_s: tuple[float, float]

    @model_validator(mode="after")
    def _check_table(self) -> Self:
        check_rising("lost", self.transmission_losses, "slips", self.slips)
        return self


class ExcitationResponse(NamedTuple):
    """Response of the body in one window.

    Attributes:
        transmission_loss: Share of the wheels' excitation that the body does not follow, about 0 to 1.
        wheel_rate_rad_s: Mean yaw rate of rolling wheels, without the excitation.
        gyro_rate_rad_s: Mean yaw rate of the gyro, without the excitation.
        reason: Why there is no result; empty where there is one.
    """

    transmission_loss: float
    wheel_rate_rad_s: float
    gyro_rate_rad_s: float
    reason: str


class YawExcitation:
    """Generates the excitation and measures its transmission loss.

    Args:
        settings: Amplitude and frequency.
    """

    def __init__(self, settings: YawExcitationMap) -> None:
        self._settings = settings
        self._rows: list[tuple[float, float, float]] = []
        self._t_s = 0.0
        self._window_start_s = 0.0

    def yaw_rate_rad_s(self, t_s: float) -> float:
        """Return what to add to the commanded yaw rate at a time."""
        return self._settings.amplitude_rad_s * math.sin(math.tau * self._settings.frequency_hz * t_s)

    def step(
        self, elapsed_s: float, wheel_rate_rad_s: float, gyro_rate_rad_s: float | None
    ) -> ExcitationResponse | None:
        """Take one reading; return the response when the window is full, else None.

        Args:
            elapsed_s: Time since the reading before.
            wheel_rate_rad_s: Yaw rate of rolling wheels.
            gyro_rate_rad_s: Yaw rate of the gyro, bias removed; None without a fresh one.
        """
        self._t_s += elapsed_s
        if gyro_rate_rad_s is not None:
            self._rows.append((self._t_s, wheel_rate_rad_s, gyro_rate_rad_s))
        if self._t_s - self._window_start_s < EFFORT.excitation.window_s:
            return None
        rows, self._rows, self._window_start_s = self._rows, [], self._t_s
        return self._compare(rows)

    def _compare(self, rows: list[tuple[float, float, float]]) -> ExcitationResponse:
        if (
            len(rows)
            < EFFORT.excitation.least_readings * EFFORT.excitation.window_s * self._settings.frequency_hz
        ):
            return ExcitationResponse(0.0, 0.0, 0.0, "too few readings of the gyro")
        t_s, wheels, gyro = np.array(rows).T
        phase = math.tau * self._settings.frequency_hz * t_s
        columns = np.column_stack((np.cos(phase), np.sin(phase), np.ones(len(t_s)), t_s - t_s.mean()))
        found, *_ = np.linalg.lstsq(columns, np.column_stack((wheels, gyro)), rcond=None)
        wheel_amplitude, gyro_amplitude = complex(*found[:2, 0]), complex(*found[:2, 1])
        if abs(wheel_amplitude) < EFFORT.excitation.least_amplitude * self._settings.amplitude_rad_s:
            return ExcitationResponse(0.0, 0.0, 0.0, "the wheels do not shake as asked")
        residual = math.sqrt(2.0 * float(np.mean((wheels - columns @ found[:, 0]) ** 2)))
        if residual > EFFORT.excitation.greatest_residual * abs(wheel_amplitude):
            return ExcitationResponse(0.0, 0.0, 0.0, "the yaw rate changes too much besides the shake")
        loss = 1.0 - abs(gyro_amplitude / wheel_amplitude)
        return ExcitationResponse(loss, float(found[2, 0]), float(found[2, 1]), "")


def range_problem(settings: YawExcitationMap, transmission_loss: float, travelled_m: complex) -> str:
    """Return why the table does not hold for a loss and the wheels' travel in that window; else empty."""
    losses = settings.transmission_losses
    if not losses[0] <= transmission_loss <= losses[-1]:
        return f"lost share of {transmission_loss:.2f} is outside the training range"
    if abs(travelled_m) < EFFORT.excitation.least_distance_m:
        return ""
    direction_rad, speed_m_s = cmath.phase(travelled_m), abs(travelled_m) / EFFORT.excitation.window_s
    return travel_problem(settings.directions_rad, settings.speed_range_m_s, direction_rad, speed_m_s)


def slip_of(settings: YawExcitationMap, transmission_loss: float) -> float:
    """Return the slip for a transmission loss; held at the ends of the table."""
    return interpolate(settings.transmission_losses, settings.slips, transmission_loss)
