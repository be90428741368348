"""Stop reasons that no single sample shows: a measurement always rejected, a wheel that does not turn."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from controllers.guarded_filter import Innovation
from controllers.safety.settings import SafetySettings
from drivers.clock import nanoseconds, seconds


class StopReason(NamedTuple):
    """Why the rover must not move, or why it may soon have to stop.

    Attributes:
        cause: What keeps its name when the same stop happens again.
        text: The reason in words, with its numbers.
        must_stop: False while this is a mere suspicion.
    """

    cause: str
    text: str
    must_stop: bool = True


class InnovationMonitor:
    """Measures for how long the filter has rejected every value of each measurement.

    A filter that is sure of itself and wrong rejects every good reading: it would go on driving, blind. A gap
    between two rejections counts for at most half of `contradiction_s`: the evidence is three rejections or
    more, however sparse the sensor. A measurement that could not be compared is no evidence either way.
    """

    def __init__(self, settings: SafetySettings) -> None:
        self._limit_ns = nanoseconds(settings.contradiction_s)
        self._rejected: dict[str, tuple[int, int]] = {}

    def check(self, now_ns: int, innovations: Sequence[Innovation]) -> Iterator[StopReason]:
        """Take the innovations of a cycle; return a reason for every measurement that was rejected last."""
        for innovation in innovations:
            if innovation.accepted:
                self._rejected.pop(innovation.name, None)
            elif innovation.residual is not None:
                last_ns, rejected_ns = self._rejected.get(innovation.name, (now_ns, 0))
                gap_ns = min(now_ns - last_ns, (self._limit_ns + 1) // 2)
                self._rejected[innovation.name] = (now_ns, rejected_ns + gap_ns)
        for name, (_, rejected_ns) in self._rejected.items():
            text = f"{name}: contradicts the estimate, rejected for {seconds(self._limit_ns):g} s"
            yield StopReason(name, text, rejected_ns >= self._limit_ns)


class StallMonitor:
    """Watches whether wheels turn when they are commanded to.

    A wheel is stalled when it was commanded for `stall_s` with at least `stall_set_point_rad_s` and has not
    turned meanwhile with `stall_ratio` of that: it is jammed, not powered, or its encoder has failed. Smaller
    set-points neither count nor clear it; motion clears it, and so does a rover commanded to rest.
    """

    def __init__(self, settings: SafetySettings, wheel_count: int) -> None:
        self._limit_ns = nanoseconds(settings.stall_s)
        self._set_point_rad_s = settings.stall_set_point_rad_s
        self._ratio = settings.stall_ratio
        self._stalled_ns = [0] * wheel_count
        self._checked_ns: int | None = None

    def check(
        self, now_ns: int, commanded_rad_s: Sequence[float], measured_rad_s: Sequence[float]
    ) -> Iterator[StopReason]:
        """Return a reason for every wheel that does not follow the set-points of the last cycle."""
        elapsed_ns = 0 if self._checked_ns is None else now_ns - self._checked_ns
        # After a pause of the loop the set-points have expired: it must not pass for a stall.
        elapsed_ns = min(elapsed_ns, (self._limit_ns + 1) // 2)
        self._checked_ns = now_ns
        if not any(commanded_rad_s):
            self._stalled_ns = [0] * len(self._stalled_ns)
        for wheel, (commanded, measured) in enumerate(zip(commanded_rad_s, measured_rad_s, strict=True)):
            if abs(measured) > self._ratio * max(abs(commanded), self._set_point_rad_s):
                self._stalled_ns[wheel] = 0
            elif abs(commanded) >= self._set_point_rad_s:
                self._stalled_ns[wheel] += elapsed_ns
            stalled_ns = self._stalled_ns[wheel]
            if stalled_ns:
                text = (
                    f"wheel {wheel}: has not followed its set-point for {seconds(self._limit_ns):g} s: "
                    f"commanded {commanded:.2f} rad/s, measured {measured:.2f} rad/s"
                )
                yield StopReason("stall", text, stalled_ns >= self._limit_ns)
