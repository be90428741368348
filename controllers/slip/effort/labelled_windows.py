"""Windows of the excitation, labelled with the slip that pose fixes or a camera measure meanwhile."""

from collections import deque
from typing import NamedTuple

from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.slip_bracket import DrivenTravel, SlipReading, width_of
from controllers.slip.effort.slip_by_fixes import SlipAtForce
from drivers.clock import nanoseconds


class LabelledReading(NamedTuple):
    """Mean reading of some windows, weighted by their travel, and the slip of the rover meanwhile.

    Attributes:
        secant: Secant reading S of `slip_bracket`.
        width: From there to the bound by lag and force, as far as that counts; not negative.
        speed_m_s: By the wheels.
        force_n: Mean drive force along the travel; None where it is unknown in a window.
        slip: By fixes or camera.
        slip_sd: Standard deviation of `slip`.
        drift_rad: Angle from the course of the wheels to the true one, left positive; None where unknown.
    """

    secant: float
    width: float
    speed_m_s: float
    force_n: float | None
    slip: float
    slip_sd: float
    drift_rad: float | None = None


class _Window(NamedTuple):
    """One window: middle, travel by the wheels, and reading."""

    t_ns: int
    travel_m: float
    reading: SlipReading
    travel: DrivenTravel


class LabelledWindows:
    """Collects valid windows, and returns their mean when fixes have given the slip.

    Args:
        duration_s: Of a window.
    """

    def __init__(self, duration_s: float) -> None:
        self._duration_s = duration_s
        self._half_ns = nanoseconds(0.5 * duration_s)
        self._windows: deque[_Window] = deque(maxlen=EFFORT.fixes.most_cycles)
        self._waiting: deque[SlipAtForce] = deque(maxlen=EFFORT.fixes.most_cycles)

    def add(self, end_ns: int, reading: SlipReading, travel: DrivenTravel) -> None:
        """Take a window that ends at a time; one that is not valid has no effect."""
        if not reading.problem:
            travel_m = travel.speed_m_s * self._duration_s
            self._windows.append(_Window(end_ns - self._half_ns, travel_m, reading, travel))

    def wait(self, found: SlipAtForce) -> None:
        """Take a slip; `label` returns it when all windows whose middle lies in its time are known."""
        self._waiting.append(found)

    def label(self, now_ns: int) -> LabelledReading | None:
        """Return the oldest slip that is due at a time, with its readings; None for nothing."""
        if not self._waiting or now_ns <= self._waiting[0].to_ns + self._half_ns:
            return None
        return self._mean(self._waiting.popleft())

    def _mean(self, found: SlipAtForce) -> LabelledReading | None:
        """Return the mean of the windows in the time of a slip; None where they do not cover its travel."""
        while self._windows and self._windows[0].t_ns < found.from_ns:
            self._windows.popleft()
        windows = [window for window in self._windows if window.t_ns <= found.to_ns]
        travel_m = sum(window.travel_m for window in windows)
        if travel_m < EFFORT.fixes.covered_share * found.travel_m:
            return None

        def mean(values: list[float]) -> float:
            return sum(v * w.travel_m for v, w in zip(values, windows, strict=True)) / travel_m

        forces_n = [window.travel.force_n for window in windows]
        known_n = [force_n for force_n in forces_n if force_n is not None]
        return LabelledReading(
            secant=mean([window.reading.secant for window in windows]),
            width=mean([width_of(window.reading.secant, window.reading.bound) for window in windows]),
            speed_m_s=mean([window.travel.speed_m_s for window in windows]),
            force_n=mean(known_n) if len(known_n) == len(forces_n) else None,
            slip=found.slip,
            slip_sd=found.slip_sd,
            drift_rad=found.drift_rad,
        )
