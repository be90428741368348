"""Slip from a small yaw excitation: how much of it the body loses against the wheels.

Drive force alone cannot separate a soft surface that slips from a stiff one with high resistance: at the same
force slip differs by a factor of ten. A small sinusoid on the commanded yaw rate passes through the same
contacts as the travel. On firm grip the body follows the wheels, on loose grip its amplitude is smaller. The
transmission loss, 1 - amplitude of the body / amplitude of the wheels, gives the slip on any surface.
"""

import cmath
import math
from typing import Annotated, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, model_validator

from controllers.slip.effort.gyro_response import GyroResponse
from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.travel_range import travel_problem
from controllers.slip.interpolation import check_rising, interpolate
from drivers.settings import Settings

SPRINGS = "the contact springs at the frequency of the excitation, which pauses"
TOO_FEW_READINGS = "too few readings of the gyro for the frequency of the excitation"
Array = NDArray[np.float64]
SAME_READING_S = 0.005
"""Readings this close are one reading: its time stamp comes from those of the wheels, which jitter."""
SMALLEST_SHARE = 0.01
"""Of the excitation; below it the slip is that of a rover that does not follow at all."""


class YawExcitationMap(Settings):
    """The excitation, and slip over transmission loss; fitted to drives with known truth.

    Attributes:
        source: The drives that it was fitted to.
        amplitude_rad_s: Of the commanded yaw rate.
        frequency_hz: Of the excitation.
        transmission_losses: 1 - gyro / wheels, increasing; key `lost` in the file.
        slips: Slip of the travel at each, not decreasing.
        slip_sd: Scatter of the slip about the curve.
        reads: What the slip is read from: `loss` is the table; `contact` is the complex response of the body,
            loss and lag, by constants that were fitted to several kinds of simulated contact.
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
    reads: Literal["loss", "contact"] = "loss"
    directions_rad: Annotated[tuple[float, ...], Field(min_length=1)]
    speed_range_m_s: tuple[float, float]

    @model_validator(mode="after")
    def _check_table(self) -> Self:
        check_rising("lost", self.transmission_losses, "slips", self.slips)
        return self


class ExcitationResponse(NamedTuple):
    """Response of the body in one window.

    Attributes:
        transmission_loss: Share of the wheels' excitation that the body does not follow, about 0 to 1, the
            loss in the sensors taken out.
        share: The gyro's excitation over the wheels', as a complex number, the response of the sensors taken
            out; a negative angle is a lag.
        wheel_rate_rad_s: Mean yaw rate of rolling wheels, without the excitation.
        gyro_rate_rad_s: Mean yaw rate of the gyro, without the excitation.
        reason: Why there is no result; empty where there is one.
    """

    transmission_loss: float
    share: complex
    wheel_rate_rad_s: float
    gyro_rate_rad_s: float
    reason: str


NO_SHARE = ExcitationResponse(0.0, 0j, 0.0, 0.0, "")


class YawExcitation:
    """Generates the excitation and measures its transmission loss.

    Args:
        settings: Amplitude and frequency.
        sensors: Response of gyro over wheels to the excitation on ground without slip, see `response`.
    """

    def __init__(self, settings: YawExcitationMap, sensors: complex = 1.0) -> None:
        self._settings = settings
        self._sensors = sensors
        self._rows: list[tuple[float, float, float, float, float]] = []
        self._t_s = 0.0
        self._window_start_s = 0.0

    def yaw_rate_rad_s(self, t_s: float) -> float:
        """Return what to add to the commanded yaw rate at a time."""
        return self._settings.amplitude_rad_s * math.sin(math.tau * self._settings.frequency_hz * t_s)

    def step(
        self,
        elapsed_s: float,
        wheel_rate_rad_s: float,
        gyro_rate_rad_s: float | None,
        gyro_after_s: float = 0.0,
    ) -> ExcitationResponse | None:
        """Take one reading; return the response when the window is full, else None.

        Args:
            elapsed_s: Time since the reading before.
            wheel_rate_rad_s: Mean yaw rate of rolling wheels in that time.
            gyro_rate_rad_s: Yaw rate of the gyro, bias removed; None without a fresh one.
            gyro_after_s: Time stamp of the gyro's reading after that of the wheels'.
        """
        self._t_s += elapsed_s
        if gyro_rate_rad_s is not None:
            gyro_s = self._t_s + gyro_after_s
            self._rows.append((self._t_s, elapsed_s, wheel_rate_rad_s, gyro_s, gyro_rate_rad_s))
        if self._t_s - self._window_start_s < EFFORT.excitation.window_s:
            return None
        rows, self._rows, self._window_start_s = self._rows, [], self._t_s
        return self._compare(rows)

    def _compare(self, rows: list[tuple[float, float, float, float, float]]) -> ExcitationResponse:
        parameters, frequency_hz = EFFORT.excitation, self._settings.frequency_hz
        if _readings(rows) < parameters.least_readings * parameters.window_s * frequency_hz:
            return NO_SHARE._replace(reason=TOO_FEW_READINGS)
        t_s, elapsed_s, wheels, gyro_s, gyro = np.array(rows).T
        # A mean over a time is the rate in the middle of that time, a little smaller than it.
        wheel_fit, wheel_rest = _fit_sinusoid(frequency_hz, t_s - 0.5 * elapsed_s, wheels)
        gyro_fit, _ = _fit_sinusoid(frequency_hz, gyro_s, gyro)
        wheel_amplitude = complex(wheel_fit[0], -wheel_fit[1]) / float(
            np.sinc(frequency_hz * elapsed_s.mean())
        )
        gyro_amplitude = complex(gyro_fit[0], -gyro_fit[1])
        size_rad_s = parameters.least_amplitude * self._settings.amplitude_rad_s
        if abs(gyro_amplitude) > max(size_rad_s, parameters.resonance * abs(wheel_amplitude)):
            return NO_SHARE._replace(reason=SPRINGS)
        if abs(wheel_amplitude) < size_rad_s:
            return NO_SHARE._replace(reason="the wheels do not shake as asked")
        if wheel_rest > parameters.greatest_residual * abs(wheel_amplitude):
            return NO_SHARE._replace(reason="the yaw rate changes too much besides the shake")
        share = gyro_amplitude / wheel_amplitude / self._sensors
        return ExcitationResponse(1.0 - abs(share), share, float(wheel_fit[2]), float(gyro_fit[2]), "")


def _readings(rows: list[tuple[float, float, float, float, float]]) -> int:
    """Return how many readings of the gyro there are: a cycle without a new one repeats the last."""
    count, newest_s = 0, -math.inf
    for gyro_s in sorted(row[3] for row in rows):
        if gyro_s - newest_s > SAME_READING_S:
            count, newest_s = count + 1, gyro_s
    return count


def _fit_sinusoid(frequency_hz: float, t_s: Array, values: Array) -> tuple[Array, float]:
    """Return cosine, sine, constant and trend by least squares, and the amplitude of what is left."""
    phase = math.tau * frequency_hz * t_s
    columns = np.column_stack((np.cos(phase), np.sin(phase), np.ones(len(t_s)), t_s - t_s.mean()))
    found, *_ = np.linalg.lstsq(columns, values, rcond=None)
    return found, math.sqrt(2.0 * float(np.mean((values - columns @ found) ** 2)))


def sensor_response(settings: YawExcitationMap, gyro: GyroResponse | None, wheel_age_s: float) -> complex:
    """Return gyro over wheels for an oscillation without slip.

    Args:
        settings: The excitation.
        gyro: Constants of the gyro; None for one that is fast and right.
        wheel_age_s: Age of the wheels' positions at their time stamp: by this the gyro is ahead.
    """
    frequency_hz = settings.frequency_hz
    ahead = cmath.exp(1j * math.tau * frequency_hz * wheel_age_s)
    if gyro is not None:
        return ahead * gyro.at(frequency_hz)
    return ahead * (EFFORT.contact.gain if settings.reads == "contact" else 1.0)


class ContactSlip(NamedTuple):
    """Slip of the travel and its standard deviation."""

    slip: float
    sd: float


def contact_slip(share: complex, speed_m_s: float, unsure_rad: float, unsure_gain: float) -> ContactSlip:
    """Return the slip for a complex response of the body, by `EFFORT.contact`.

    Linearised, 1 / share = 1 + drag / grip - w^2 tau_c tau_s + j w tau_c. What is missing in phase is drag
    over the slope of the grip, which is the slip while both are small; the lag is inertia over that slope. A
    relaxation length (tau_s) makes the body swing further, and leaves the lag as it is.

    Args:
        share: Of the wheels' excitation that the body follows, see `ExcitationResponse`.
        speed_m_s: Of the travel.
        unsure_rad: Standard deviation of the angle of the sensors' response.
        unsure_gain: Standard deviation of their gain.
    """
    numbers = EFFORT.contact
    slip = _slip_by_contact(share, speed_m_s)
    by_angle = abs(_slip_by_contact(share * cmath.exp(-1j * unsure_rad), speed_m_s) - slip)
    by_gain = abs(_slip_by_contact(share * (1.0 - unsure_gain), speed_m_s) - slip)
    springs = (1.0 / _away_from_zero(share)).real < 1.0 - numbers.springing_sd
    tangent = min(numbers.sd + numbers.sd_share * slip, numbers.greatest_sd)
    sd = math.hypot(tangent, by_angle, by_gain, numbers.springing_sd if springs else 0.0)
    return ContactSlip(slip, sd)


def _slip_by_contact(share: complex, speed_m_s: float) -> float:
    numbers = EFFORT.contact
    inverse = 1.0 / _away_from_zero(share)
    faster = numbers.speed_m_s / max(speed_m_s, numbers.least_speed_m_s)
    in_phase = math.atan(max(0.0, inverse.real - 1.0)) * 2.0 / math.pi
    lagging = math.atan(max(0.0, inverse.imag * faster)) * 2.0 / math.pi
    slip = (
        numbers.in_phase * in_phase
        + numbers.lagging * lagging
        + numbers.product * in_phase * lagging
        + numbers.lagging_square * lagging**2
    )
    return min(max(slip, 0.0), 1.0)


def _away_from_zero(share: complex) -> complex:
    return share if abs(share) > SMALLEST_SHARE else complex(SMALLEST_SHARE)


def range_problem(settings: YawExcitationMap, transmission_loss: float, travelled_m: complex) -> str:
    """Return why the table does not hold for a loss and the wheels' travel in that window; else empty."""
    losses = settings.transmission_losses
    low_m_s, high_m_s = settings.speed_range_m_s
    if settings.reads == "contact":
        low_m_s = 0.0  # the lag of a contact is proportional to the speed, which is known
    elif not losses[0] <= transmission_loss <= losses[-1]:
        return f"lost share of {transmission_loss:.2f} is outside the training range"
    if abs(travelled_m) < EFFORT.excitation.least_distance_m:
        return ""
    direction_rad, speed_m_s = cmath.phase(travelled_m), abs(travelled_m) / EFFORT.excitation.window_s
    return travel_problem(settings.directions_rad, (low_m_s, high_m_s), direction_rad, speed_m_s)


def slip_of(settings: YawExcitationMap, transmission_loss: float) -> float:
    """Return the slip for a transmission loss; held at the ends of the table."""
    return interpolate(settings.transmission_losses, settings.slips, transmission_loss)
