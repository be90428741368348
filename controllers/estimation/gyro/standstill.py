"""Whether gyro and accelerometer confirm that the rover stands while its wheels report no motion.

An encoder that has died repeats its count: by the wheels alone the rover then seems parked.
"""

import math
from collections import deque
from collections.abc import Sequence
from enum import StrEnum
from statistics import NormalDist, fmean
from typing import NamedTuple

from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.settings import FilterSettings
from drivers.clock import nanoseconds, seconds
from drivers.samples import AccelerationSample, RateSample

REPORT_NS = nanoseconds(ESTIMATION.odometry.arrival_jitter_s)
LEAST_READINGS = 3
"""A scatter needs at least three readings of the accelerometer."""


class Witness(StrEnum):
    """What may report motion while the wheels do not."""

    GYRO = "gyro"
    ACCELEROMETER = "accelerometer"
    SPEED = "reported speed"
    CAMERA = "camera"


class Standstill(NamedTuple):
    """What is known of a standstill of the wheels.

    Attributes:
        moving: What has reported motion since the wheels stopped; empty where nothing has.
        holds: Whether nothing does now.
        is_contradicted: Whether something has for long enough to count.
        is_offset: Whether only the gyro does and the accelerometer is quiet.
        is_turning: Whether both gyro and accelerometer do.
        unknown_s: Time for which the motion of the rover is unknown, since the wheels stopped.
        turned_rad: Turn by the gyro in that time that no accelerometer confirms.
    """

    moving: tuple[Witness, ...] = ()
    holds: bool = True
    is_contradicted: bool = False
    is_offset: bool = False
    is_turning: bool = False
    unknown_s: float = 0.0
    turned_rad: float = 0.0


class InertialReadings:
    """Recent readings of gyro and accelerometer, and what they say about motion.

    Args:
        settings: Noise of the readings, and the time over which they are compared.
    """

    def __init__(self, settings: FilterSettings) -> None:
        self._settings = settings
        self._window_ns = nanoseconds(settings.standstill_s)
        self._deviate = NormalDist().inv_cdf(0.5 * (1.0 + settings.gate_probability))
        self._rates: deque[tuple[int, float]] = deque()
        self._accelerations: deque[tuple[int, tuple[float, float, float]]] = deque()

    def take(self, sample: RateSample | AccelerationSample, t_ns: int) -> None:
        """Take a reading; one that is not finite has no effect."""
        if isinstance(sample, RateSample):
            if math.isfinite(sample.rate_z_rad_s):
                self._rates.append((t_ns, sample.rate_z_rad_s))
                _trim(self._rates, t_ns - self._window_ns)
        elif math.isfinite(sample.x_m_s2 + sample.y_m_s2 + sample.z_m_s2):
            self._accelerations.append((t_ns, (sample.x_m_s2, sample.y_m_s2, sample.z_m_s2)))
            _trim(self._accelerations, t_ns - self._window_ns)

    def rates_rad_s(self, since_ns: int) -> list[float]:
        """Return the recent readings of the gyro since then."""
        return [rate for t_ns, rate in self._rates if t_ns > since_ns]

    def rate_rad_s(self, since_ns: int) -> float | None:
        """Return the mean reading of the gyro; None without one since then."""
        rates = self.rates_rad_s(since_ns)
        return fmean(rates) if rates else None

    def turns(self, since_ns: int, bias_rad_s: float, bias_rad2_s2: float) -> bool:
        """Return whether the mean reading is too far from the bias to be one at standstill."""
        rate_rad_s = self.rate_rad_s(since_ns)
        if rate_rad_s is None:
            return False
        sd_rad_s = math.sqrt(bias_rad2_s2 + self._settings.gyro_rate_noise_rad_s**2)
        return abs(rate_rad_s - bias_rad_s) > self._deviate * sd_rad_s

    def shakes(self, since_ns: int) -> bool | None:
        """Return whether the acceleration scatters more than at standstill; None where it is not measured.

        Readings that do not differ at all are no measurement: many nodes send zeros or a constant. The
        quantile of chi-square is that of Wilson and Hilferty (1931).
        """
        readings = [reading for t_ns, reading in self._accelerations if t_ns > since_ns]
        count = len(readings)
        if count < LEAST_READINGS:
            return None
        squares = sum(_squares(axis) for axis in zip(*readings, strict=True))
        if squares == 0.0:
            return None
        freedom = 3.0 * (count - 1)
        part = 2.0 / (9.0 * freedom)
        quantile = freedom * (1.0 - part + self._deviate * math.sqrt(part)) ** 3
        return squares > quantile * self._settings.acceleration_noise_m_s2**2


def _squares(values: Sequence[float]) -> float:
    mean = fmean(values)
    return sum((value - mean) ** 2 for value in values)


def _trim(
    readings: "deque[tuple[int, float]] | deque[tuple[int, tuple[float, float, float]]]", from_ns: int
) -> None:
    while len(readings) > LEAST_READINGS and readings[0][0] < from_ns:
        readings.popleft()


class StandstillWatch:
    """Follows a standstill of the wheels: confirmed by the other sensors, or contradicted by them.

    A contradiction counts from twice `standstill_s` after the stop on: a body swings after its wheels have
    stopped, and a reading is filtered. The wheels must have reported after it began that they stand. It ends
    when the wheels move again. The motion is unknown from the last moment at which an accelerometer was
    quiet, without one from that at which the wheels stopped; and until it is quiet, without one until the
    end. Wheels that are commanded to stand are taken to do so while nothing reports motion, also without an
    accelerometer; and motion that is reported for less than twice `standstill_s` is then a touch: the body
    swings.

    Args:
        settings: Noise and times.

    Attributes:
        readings: Of gyro and accelerometer.
    """

    def __init__(self, settings: FilterSettings) -> None:
        self._settings = settings
        self.readings = InertialReadings(settings)
        self._least_ns = nanoseconds(2.0 * settings.standstill_s)
        self._now_ns = 0
        self._has_reported = False
        self._begin(None)

    def _begin(self, still_ns: int | None) -> None:
        self._still_ns = still_ns
        self._confirmed_ns = still_ns or 0
        self._unknown_s = 0.0  # before that
        self._moving_ns: int | None = None
        self._known = Standstill()

    def follow(
        self,
        now_ns: int,
        still_ns: int | None,
        reported_ns: int,
        bias: tuple[float, float],
        *,
        reports_speed: bool,
        is_commanded: bool,
        sees_motion: bool = False,
    ) -> Standstill:
        """Return what is known of the standstill at `now_ns`.

        Args:
            now_ns: Time of the cycle.
            still_ns: When the wheels stopped; None while they move or do not report.
            reported_ns: Time of the newest positions of the wheels.
            bias: Of the gyro in rad/s, and its variance.
            reports_speed: Whether a drive reports a speed although its position stays.
            is_commanded: Whether the wheels are commanded to stand: an accelerometer that shakes alone is
                then no evidence of motion.
            sees_motion: Whether a camera sees the ground move under the rover.
        """
        elapsed_s, self._now_ns = seconds(max(0, now_ns - self._now_ns)), now_ns
        if still_ns is None or self._still_ns is None:
            self._begin(still_ns)
        if self._still_ns is None:
            return self._known
        turns, shakes = self.readings.turns(self._still_ns, *bias), self.readings.shakes(self._still_ns)
        moving = [Witness.GYRO] if turns else []
        if shakes and (turns or not is_commanded):
            moving.append(Witness.ACCELEROMETER)
        if reports_speed:
            moving.append(Witness.SPEED)
        if sees_motion:
            moving.append(Witness.CAMERA)
        if moving:
            turned_rad = self._unconfirmed_turn(elapsed_s, bias[0], shakes=bool(shakes)) if turns else 0.0
            self._moving_ns = now_ns if self._moving_ns is None else self._moving_ns
            self._has_reported = reported_ns > self._moving_ns + REPORT_NS
            is_touch = is_commanded and now_ns - self._moving_ns < self._least_ns
            self._contradict(tuple(moving), turned_rad, is_touch=is_touch)
        else:
            self._confirm(is_known=shakes is False or is_commanded)
        return self._known._replace(
            is_offset=moving == [Witness.GYRO] and shakes is False, is_turning=turns and bool(shakes)
        )

    def _unconfirmed_turn(self, elapsed_s: float, bias_rad_s: float, *, shakes: bool) -> float:
        """Return the turn of this cycle that no accelerometer confirms; at first that of all the readings."""
        since_ns = self._still_ns or 0
        rate_rad_s = (self.readings.rate_rad_s(since_ns) or 0.0) - bias_rad_s
        if self._moving_ns is None or Witness.GYRO not in self._known.moving:
            return rate_rad_s * min(self._settings.standstill_s, seconds(self._now_ns - since_ns))
        return 0.0 if shakes else rate_rad_s * elapsed_s

    def _contradict(self, moving: tuple[Witness, ...], turned_rad: float, *, is_touch: bool) -> None:
        known = self._known
        is_long = self._now_ns - (self._still_ns or 0) >= self._least_ns
        is_contradicted = is_long and self._has_reported
        self._known = Standstill(
            moving=tuple(witness for witness in Witness if witness in {*known.moving, *moving}),
            holds=False,
            is_contradicted=is_contradicted or known.is_contradicted,
            unknown_s=self._unknown_s if is_touch else self._unknown_until_now_s(),
            turned_rad=known.turned_rad + turned_rad,
        )

    def _confirm(self, *, is_known: bool) -> None:
        self._moving_ns = None
        if not self._known.is_contradicted:
            self._known = Standstill()
        elif not is_known:
            self._known = self._known._replace(holds=False, unknown_s=self._unknown_until_now_s())
        else:
            self._known = self._known._replace(holds=True)
        if is_known:
            self._confirmed_ns, self._unknown_s = self._now_ns, self._known.unknown_s

    def _unknown_until_now_s(self) -> float:
        return self._unknown_s + seconds(self._now_ns - self._confirmed_ns)
