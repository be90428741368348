"""Noise of the gyro as its readings show it, never less than the configured one."""

import math
from collections import deque
from statistics import NormalDist, fmean, mode

from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.settings import FilterSettings
from controllers.estimation.wheels.turn_evidence import WheelTurn
from controllers.fault import Cause, Fault, Severity
from drivers.clock import nanoseconds

WINDOW_S = 0.5
"""Noise that successive readings share is in their means over so long, and the bias has not changed."""

DITHERED = 0.68
"""Noise of half a step changes a third of the readings: their mean then shows also slower rates."""

LEAST_BESIDE = 100
"""So many readings beside that of standstill show how close to it they come."""

LONGER_SD = 1.0
"""Of a gyro that is noisier than configured, longer means count beyond this many standard deviations."""

REPORTED = 2.0
"""Noise beyond this multiple of the configured one is reported."""


class _Squares:
    """Squares of independent errors with one variance; `count` of them are free."""

    def __init__(self) -> None:
        self.sum, self.count = 0.0, 0

    def add(self, squares: float, count: int) -> None:
        self.sum, self.count = self.sum + squares, self.count + count

    @property
    def variance(self) -> float:
        return self.sum / self.count if self.count else 0.0

    def quantile(self, deviate: float) -> float:
        """Return what chance makes of the sum for a variance of 1: chi-square, Wilson and Hilferty (1931)."""
        if not self.count:
            return 0.0
        part = 2.0 / (9.0 * self.count)
        return self.count * max(0.0, 1.0 - part + deviate * math.sqrt(part)) ** 3


class GyroNoise:
    """Takes the readings of a gyro and the rotation by the wheels; states how wrong the gyro may be.

    The noise is the greatest of three that chance does not explain:

        configured
        at standstill   half the mean square of differences of successive readings, times their interval
                        (Allan variance); then of means over 2, 4, 8 ... of them and over 0.5 s, where chance
                        does not explain the difference: with more noise than the shorter ones the readings
                        share it, with less they only vibrate
        while driving   -cov(d1, d2) / 0.5 s, with the change d1 of the rotation from one window of 0.5 s to
                        the next, and d2 from that to the third

    White noise in one window makes two successive changes of opposite signs. A rotation that the wheels do
    not show, since they slip or the ground moves the rover, goes on or changes smoothly: then successive
    changes have one sign, and the covariance is not negative. Of each product, one factor is the difference
    to the wheels, so that their own errors do not count, and neither does a change that both measure. Slip
    is a share of the motion, so only windows count in which the wheels are steady. A rover that is shaken at
    random by the ground is limited by the readings: white noise of them is at most what their second
    differences show. Noise that readings share, seen in no standstill, is therefore not found while driving.

    A gyro that rounds, or sends one value at all rates below a limit (dead band), shows no noise at
    standstill, and no slow rate. Its error is the same as long as the rate is: it grows with time, not with
    its root. So the bias is never known better than that.

    Args:
        settings: What is configured.
    """

    def __init__(self, settings: FilterSettings) -> None:
        self._settings = settings
        self._deviate = NormalDist().inv_cdf(0.5 * (1.0 + settings.gate_probability))
        self._readings: deque[tuple[int, float]] = deque()
        self._by_length: list[_Squares] = []
        self._of_windows = _Squares()
        self._interval_s = 0.0
        self._mean_before: float | None = None
        self._rest = _RestValue()
        self._driven = _Driven(settings.gyro_noise_rad_sqrt_s)
        self._covered_s = self._added_rad2 = 0.0

    @property
    def noise_rad_sqrt_s(self) -> float:
        """Standard deviation of the integrated readings after one second, at least the configured one."""
        least = self._seen(self._settings.gyro_noise_rad_sqrt_s**2)
        return math.sqrt(max(least, self._driven.variance(least, self._deviate)))

    @property
    def reading_rad_s(self) -> float:
        """Standard deviation of a reading at standstill, as if independent; at least the configured one."""
        least = self._settings.gyro_rate_noise_rad_s
        if not self._interval_s:
            return least
        return math.sqrt(self._seen(least**2 * self._interval_s) / self._interval_s)

    @property
    def hidden_rad_s(self) -> float:
        """Standard deviation of a rate that readings do not show; 0 where their noise makes them show it."""
        return self._rest.hidden_rad_s

    @property
    def fault(self) -> Fault | None:
        """That the noise is more than twice the configured one; None while it is not."""
        times = self.noise_rad_sqrt_s / self._settings.gyro_noise_rad_sqrt_s
        if times <= REPORTED:
            return None
        text = f"gyro noise {times:.0f} times the configured one: set gyro_noise_rad_sqrt_s of [filter]"
        return Fault("gyro", Cause.GYRO_NOISE, text, Severity.WARNING)

    def scatter_rad_s(self, rates_rad_s: list[float]) -> float:
        """Return the standard deviation of a reading as above, at least that of recent ones at standstill."""
        least, now = self.reading_rad_s, _Squares()
        if rates_rad_s:
            mean = fmean(rates_rad_s)
            now.add(sum((rate - mean) ** 2 for rate in rates_rad_s), len(rates_rad_s) - 1)
        return math.sqrt(now.variance) if now.sum > least**2 * now.quantile(self._deviate) else least

    def take(self, t_ns: int, rate_rad_s: float) -> None:
        """Take a reading."""
        self._readings.append((t_ns, rate_rad_s))
        self._rest.take(rate_rad_s)

    def follow(self, still_ns: int | None) -> None:
        """Take what the readings at standstill show.

        Those of the last `standstill_s` wait: the rover may have begun to move.

        Args:
            still_ns: When the standstill began; None while the rover may move.
        """
        readings, window_ns = self._readings, nanoseconds(WINDOW_S)
        wait_ns = nanoseconds(self._settings.standstill_s)
        if still_ns is None:
            self._mean_before = None
            still_ns = readings[-1][0] - 2 * wait_ns if readings else 0
            self._drop(still_ns)
            return
        self._drop(still_ns)
        while readings and readings[-1][0] - readings[0][0] >= window_ns + wait_ns:
            end_ns = readings[0][0] + window_ns
            self._compare([rate for t_ns, rate in readings if t_ns < end_ns])
            self._drop(end_ns)

    def add(self, gyro_rad: float, covered_s: float, unobserved_rad2: float, wheels: WheelTurn) -> float:
        """Take a rotation while driving; return the variance by noise beyond the configured one.

        Noise that is found late is added for the whole drive.

        Args:
            gyro_rad: By the gyro, free of its bias.
            covered_s: Time over which it is known.
            unobserved_rad2: Its variance by second differences of readings, see `GyroIntegrator`.
            wheels: By the wheels.
        """
        self._driven.add(gyro_rad, covered_s, unobserved_rad2, wheels)
        self._covered_s += covered_s
        excess_rad2_s = self.noise_rad_sqrt_s**2 - self._settings.gyro_noise_rad_sqrt_s**2
        added_rad2 = max(0.0, excess_rad2_s * self._covered_s - self._added_rad2)
        self._added_rad2 += added_rad2
        return added_rad2

    def interrupt(self) -> None:
        """Take that a part of the rotation was not measured."""
        self._driven.begin()

    def _seen(self, configured: float) -> float:
        """Return the variance over time at standstill where chance does not explain it, else `configured`."""
        seen, is_more = configured, False
        for squares in (*self._by_length, self._of_windows):
            if squares.sum > seen * squares.quantile(LONGER_SD if is_more else self._deviate):
                seen, is_more = squares.variance, True
            elif is_more and squares.sum < seen * squares.quantile(-self._deviate):
                seen = max(configured, squares.variance)
        return seen

    def _compare(self, rates_rad_s: list[float]) -> None:
        if len(rates_rad_s) < 2:
            return
        self._interval_s = WINDOW_S / len(rates_rad_s)
        self._rest.settle(rates_rad_s)
        means, length_s, level = rates_rad_s, self._interval_s, 0
        while len(means) > 1:
            pairs = list(zip(means[::2], means[1::2], strict=False))
            if level == len(self._by_length):
                self._by_length.append(_Squares())
            self._by_length[level].add(sum(_variance(length_s, *pair) for pair in pairs), len(pairs))
            means, length_s, level = [0.5 * (a + b) for a, b in pairs], 2.0 * length_s, level + 1
        mean, before = fmean(rates_rad_s), self._mean_before
        self._mean_before = mean if before is None else None
        if before is not None:
            self._of_windows.add(_variance(WINDOW_S, before, mean), 1)

    def _drop(self, until_ns: int) -> None:
        while self._readings and self._readings[0][0] < until_ns:
            self._readings.popleft()


class _RestValue:
    """The reading that a gyro repeats at standstill, and how close others come to it."""

    def __init__(self) -> None:
        self._newest: float | None = None
        self._rest: float | None = None
        self._step_rad_s = self._beside_rad_s = math.inf
        self._beside = self._count = self._equal = 0

    def take(self, rate_rad_s: float) -> None:
        before, self._newest = self._newest, rate_rad_s
        if before is not None and rate_rad_s != before:
            self._step_rad_s = min(self._step_rad_s, abs(rate_rad_s - before))
        if self._rest is not None and rate_rad_s != self._rest:
            self._beside += 1
            self._beside_rad_s = min(self._beside_rad_s, abs(rate_rad_s - self._rest))

    def settle(self, rates_rad_s: list[float]) -> None:
        """Take readings at standstill."""
        self._rest = mode(rates_rad_s)
        self._count += len(rates_rad_s)
        self._equal += rates_rad_s.count(self._rest)

    @property
    def hidden_rad_s(self) -> float:
        """Any rate up to the next reading, less half of what it is rounded to, reads as standstill."""
        if self._equal <= DITHERED * self._count or self._beside < LEAST_BESIDE:
            return 0.0
        return (self._beside_rad_s - 0.5 * self._step_rad_s) / math.sqrt(3.0)


class _Driven:
    """Covariance of successive changes of the rotation in windows in which the wheels are steady."""

    def __init__(self, noise_rad_sqrt_s: float) -> None:
        # The wheels are steady where their slip changes by less than the noise.
        self._greatest_rad = math.sqrt(2.0 * WINDOW_S) * noise_rad_sqrt_s / ESTIMATION.pose.gap_turn_error
        self._sum = self._square = self._limit = 0.0
        self._count = 0
        self.begin()

    def begin(self) -> None:
        self._gyro_rad = self._covered_s = self._unobserved_rad2 = 0.0
        self._wheels = WheelTurn()
        self._window: tuple[float, float, float] | None = None
        self._change: tuple[float, float] | None = None

    def variance(self, least: float, deviate: float) -> float:
        """Return the variance over time where chance does not explain it, else `least`.

        The standard deviation of a product is sqrt(5) times its mean for white noise, more for single events.
        """
        if not self._count:
            return least
        mean = self._sum / self._count
        scatter = 5.0 * least**2 + max(0.0, self._square / self._count - mean**2)
        if mean <= least + deviate * math.sqrt(scatter / self._count):
            return least
        return max(least, min(mean, self._limit / self._count))

    def add(self, gyro_rad: float, covered_s: float, unobserved_rad2: float, wheels: WheelTurn) -> None:
        self._gyro_rad += gyro_rad
        self._covered_s += covered_s
        self._unobserved_rad2 += unobserved_rad2
        self._wheels = WheelTurn(*map(sum, zip(self._wheels, wheels, strict=True)))
        if self._wheels.duration_s < WINDOW_S:
            return
        by_gyro, by_wheels = WINDOW_S / self._covered_s, WINDOW_S / self._wheels.duration_s
        window = (
            by_gyro * self._gyro_rad,
            by_wheels * self._wheels.left_rad,
            by_wheels * self._wheels.right_rad,
        )
        # The interval cancels: the mean square of second differences is 6 variances of a reading.
        limit = 24.0 * self._unobserved_rad2 / self._covered_s
        before, change = self._window, self._change
        self.begin()
        self._window = window
        if before is None:
            return
        gyro_rad, left_rad, right_rad = (now - then for now, then in zip(window, before, strict=True))
        if abs(left_rad) + abs(right_rad) > self._greatest_rad:
            return
        self._change = gyro_rad, gyro_rad - (left_rad - right_rad)
        if change is not None:
            product = -0.5 * (change[0] * self._change[1] + change[1] * self._change[0]) / WINDOW_S
            self._count += 1
            self._sum += product
            self._square += product**2
            self._limit += limit


def _variance(length_s: float, before: float, mean: float) -> float:
    """Return the variance over time by two successive means over so long (Allan)."""
    return 0.5 * length_s * (mean - before) ** 2
