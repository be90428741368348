"""A small yaw excitation, and the response of the body to it.

Drive force alone cannot separate a soft surface that slips from a stiff one with high resistance: at the same
force slip differs by a factor of ten. A small sinusoid on the commanded yaw rate passes through the same
contacts as the travel. What the body makes of it is compared with what the wheels do; `slip_bracket` reads
the slip from it.
"""

import cmath
import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from controllers.matrices import product, solve
from controllers.slip.effort.gyro_response import GyroResponse
from controllers.slip.effort.parameters import EFFORT
from drivers.settings import Settings

SPRINGS = "the contact springs at the frequency of the excitation, which pauses"
TOO_FEW_READINGS = "too few readings of the gyro for the frequency of the excitation"
WHEELS_DO_NOT_FOLLOW = "the wheels do not follow the excitation"
OTHER_TURNS = "the yaw rate changes too much besides the excitation"
Array = NDArray[np.float64]
LONGEST_CYCLE_S = 0.1
"""After a silence a cycle counts as no longer than this."""
SAME_READING_S = 0.005
"""Readings this close are one reading: its time stamp comes from those of the wheels, which jitter."""


class ExcitationSettings(Settings):
    """The yaw excitation, and the rover that it turns.

    Attributes:
        frequency_hz: Of the excitation.
        rim_speed_m_s: Amplitude, as the speed that it adds to the rims of the wheels; None for 0.2 of the
            mission's speed, at most 0.04 m/s.
        mass_kg: Of the rover with its load.
        body_radius_m: Of the disc that the yaw inertia is computed from; None for the distance of the
            outermost point of the wheels.
        yaw_inertia_kg_m2: About the centre; known to 15 %. None for that of a disc of `mass_kg` and
            `body_radius_m`. Too small a value does less harm than too large a one.
    """

    frequency_hz: Annotated[float, Field(ge=1.0, le=5.0)] = 2.0
    rim_speed_m_s: Annotated[float | None, Field(ge=0.005, le=0.04)] = None
    mass_kg: Annotated[float, Field(ge=0.5, le=500.0)] = 12.0
    body_radius_m: Annotated[float | None, Field(ge=0.02, le=3.0)] = None
    yaw_inertia_kg_m2: Annotated[float | None, Field(ge=0.0001, le=1000.0)] = None

    @property
    def window_s(self) -> float:
        """Time over which wheels and gyro are compared: whole periods."""
        return EFFORT.excitation.periods / self.frequency_hz

    def rim_m_s(self, travel_m_s: float | None) -> float:
        """Return the amplitude at the rims for the speed of a mission; None without one."""
        numbers = EFFORT.excitation
        if self.rim_speed_m_s is not None:
            return self.rim_speed_m_s
        if travel_m_s is None:
            return numbers.usual_rim_m_s
        return min(max(numbers.rim_share * travel_m_s, numbers.least_rim_m_s), numbers.greatest_rim_m_s)

    def inertia_kg_m2(self, outermost_m: float) -> float:
        """Return the yaw inertia, given the distance of the outermost point of the wheels."""
        if self.yaw_inertia_kg_m2 is not None:
            return self.yaw_inertia_kg_m2
        radius_m = outermost_m if self.body_radius_m is None else self.body_radius_m
        return 0.5 * self.mass_kg * radius_m**2


class SwingFilter:
    """Takes the answer to the body's own swing out of the yaw rate that the path follower commands.

    The follower works against the swing, with the delay of the drives: at 2 Hz that may double it. A notch at
    the frequency of the excitation, as an adaptive canceller (Widrow et al. 1975).

    Args:
        frequency_hz: Of the excitation.
    """

    def __init__(self, frequency_hz: float) -> None:
        self._turning = math.tau * frequency_hz
        self._sine = self._cosine = 0.0
        self._before_s: float | None = None
        self._known_s = 0.0

    def without_swing(self, t_s: float, yaw_rate_rad_s: float) -> float:
        """Return a commanded yaw rate without its part at the frequency, as of a time that increases."""
        sine, cosine = math.sin(self._turning * t_s), math.cos(self._turning * t_s)
        rest_rad_s = yaw_rate_rad_s - self._sine * sine - self._cosine * cosine
        elapsed_s = 0.0 if self._before_s is None else min(t_s - self._before_s, LONGEST_CYCLE_S)
        self._known_s = min(self._known_s + elapsed_s, EFFORT.excitation.notch_s)
        # An average over all that was seen, up to the time constant: it begins fast.
        gain = 2.0 * elapsed_s / max(self._known_s, LONGEST_CYCLE_S)
        self._sine += gain * rest_rad_s * sine
        self._cosine += gain * rest_rad_s * cosine
        self._before_s = t_s
        return rest_rad_s


class ExcitationResponse(NamedTuple):
    """Response of the body in one window.

    Attributes:
        share: The gyro's excitation over the wheels', as a complex number, the response of the sensors taken
            out; a negative angle is a lag.
        noise: Standard deviation of each part of `share`, by the scatter of both rates about their sinusoids.
        wheel_rate_rad_s: Mean yaw rate of rolling wheels, without the excitation.
        gyro_rate_rad_s: Mean yaw rate of the gyro, without the excitation.
        reason: Why there is no result; empty where there is one.
    """

    share: complex
    noise: float
    wheel_rate_rad_s: float
    gyro_rate_rad_s: float
    reason: str


NO_SHARE = ExcitationResponse(0j, 0.0, 0.0, 0.0, "")


class YawExcitation:
    """Generates the excitation and measures the response of the body.

    Args:
        settings: Frequency of the excitation.
        amplitude_rad_s: Of the commanded yaw rate.
        sensors: Response of gyro over wheels to the excitation on ground without slip, see `sensor_response`.
    """

    def __init__(self, settings: ExcitationSettings, amplitude_rad_s: float, sensors: complex = 1.0) -> None:
        self._settings = settings
        self._amplitude_rad_s = amplitude_rad_s
        self._sensors = sensors
        self._rows: list[tuple[float, float, float, float, float]] = []
        self._t_s = 0.0
        self._window_start_s = 0.0

    def yaw_rate_rad_s(self, t_s: float) -> float:
        """Return what to add to the commanded yaw rate at a time."""
        return self._amplitude_rad_s * math.sin(math.tau * self._settings.frequency_hz * t_s)

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
        # A reading that ends the window within half of its duration is its last.
        if self._t_s - self._window_start_s < self._settings.window_s - 0.5 * elapsed_s:
            return None
        rows = self._rows
        self.start_window()
        return self._compare(rows)

    def start_window(self) -> None:
        """Begin a new window; what the open one has is lost."""
        self._rows, self._window_start_s = [], self._t_s

    def _compare(self, rows: list[tuple[float, float, float, float, float]]) -> ExcitationResponse:
        numbers, frequency_hz = EFFORT.excitation, self._settings.frequency_hz
        if _readings(rows) < numbers.least_readings * numbers.periods:
            return NO_SHARE._replace(reason=TOO_FEW_READINGS)
        t_s, elapsed_s, wheels, gyro_s, gyro = np.array(rows).T
        # A mean over a time is the rate in the middle of that time, a little smaller than it.
        of_wheels = _fit_sinusoid(frequency_hz, t_s - 0.5 * elapsed_s, wheels)
        of_gyro = _fit_sinusoid(frequency_hz, gyro_s, gyro)
        wheel_amplitude = of_wheels.amplitude / _mean_of_wave(frequency_hz * float(elapsed_s.mean()))
        least_rad_s = numbers.least_amplitude * self._amplitude_rad_s
        if abs(of_gyro.amplitude) > max(least_rad_s, numbers.resonance * abs(wheel_amplitude)):
            return NO_SHARE._replace(reason=SPRINGS)
        if abs(wheel_amplitude) < least_rad_s:
            return NO_SHARE._replace(reason=WHEELS_DO_NOT_FOLLOW)
        if of_wheels.rest > numbers.greatest_residual * abs(wheel_amplitude):
            return NO_SHARE._replace(reason=OTHER_TURNS)
        share = of_gyro.amplitude / wheel_amplitude / self._sensors
        by_gyro = of_gyro.noise / abs(wheel_amplitude * self._sensors)
        by_wheels = abs(share) * of_wheels.noise / abs(wheel_amplitude)
        noise = math.hypot(by_gyro, by_wheels)
        return ExcitationResponse(share, noise, of_wheels.mean, of_gyro.mean, "")


class _Sinusoid(NamedTuple):
    """A sinusoid fitted to a rate, rad/s.

    Attributes:
        amplitude: As a complex number.
        noise: Standard deviation of each of its parts.
        mean: Of the rate, without sinusoid and trend.
        rest: Amplitude of what is left.
    """

    amplitude: complex
    noise: float
    mean: float
    rest: float


def _readings(rows: list[tuple[float, float, float, float, float]]) -> int:
    """Return how many readings of the gyro there are: a cycle without a new one repeats the last."""
    count, newest_s = 0, -math.inf
    for gyro_s in sorted(row[3] for row in rows):
        if gyro_s - newest_s > SAME_READING_S:
            count, newest_s = count + 1, gyro_s
    return count


def _mean_of_wave(periods: float) -> float:
    """Return the amplitude that the mean over some periods leaves of a sinusoid."""
    angle = math.pi * periods
    return math.sin(angle) / angle if angle else 1.0


def _fit_sinusoid(frequency_hz: float, t_s: Array, values: Array) -> _Sinusoid:
    """Return the least-squares fit of a sinusoid with a constant and a trend."""
    phase = math.tau * frequency_hz * t_s
    # Not numpy's sine: its last bits depend on the processor.
    waves = [[math.cos(angle), math.sin(angle)] for angle in phase.tolist()]
    columns = np.column_stack((np.array(waves), np.ones(len(t_s)), t_s - t_s.mean()))
    coefficients = solve(product(columns.T, columns), product(columns.T, values)[:, None])[:, 0]
    square = float(np.mean((values - product(columns, coefficients)) ** 2))
    noise = math.sqrt(2.0 * square / max(1, len(t_s) - columns.shape[1]))
    return _Sinusoid(
        complex(coefficients[0], -coefficients[1]), noise, float(coefficients[2]), math.sqrt(2.0 * square)
    )


def sensor_response(frequency_hz: float, gyro: GyroResponse | None, wheel_age_s: float) -> complex:
    """Return gyro over wheels for an oscillation without slip.

    Args:
        frequency_hz: Of the excitation.
        gyro: Constants of the gyro; None for one that is fast and right.
        wheel_age_s: Age of the wheels' positions at their time stamp: by this the gyro is ahead.
    """
    ahead = cmath.exp(1j * math.tau * frequency_hz * wheel_age_s)
    return ahead if gyro is None else ahead * gyro.at(frequency_hz)
