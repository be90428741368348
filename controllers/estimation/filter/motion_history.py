"""Late absolute fixes: each gets the motion from the present pose back to the pose at exposure."""

import cmath
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from controllers.estimation.filter.measurement_model import Array
from controllers.estimation.filter.state_layout import YAW, X, Y
from controllers.motion.planar import Pose, move, wrap_angle
from drivers.clock import NANOSECONDS_PER_SECOND, nanoseconds
from drivers.record import record
from drivers.samples import PoseFixSample

HISTORY_NS = 2 * NANOSECONDS_PER_SECOND
MOST_WAITING = 8


@record(frozen=True, slots=True, kw_only=True)
class Step:
    """One step of the motion model: an increment in the body frame and the variances it adds.

    Attributes:
        x_m: Forward.
        y_m: To the left.
        turn_rad: Free of the gyro's bias.
        position_m2: Variance added to the position along its most uncertain axis.
        yaw_rad2: Variance added to the yaw.
        rolled_m: What rolling wheels would have moved, to the left as imaginary part.
        slip_sd: Standard deviation of the slip that remains, as a share of it.
        covered_s: Time over which the gyro's bias entered `turn_rad`; 0 for a turn by the wheels.
        bias_rad_s: The bias that was taken off.
    """

    x_m: float
    y_m: float
    turn_rad: float
    duration_s: float
    position_m2: float
    yaw_rad2: float
    rolled_m: complex = 0j
    slip_sd: float = 0.0
    covered_s: float = 0.0
    bias_rad_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class WayBack:
    """Past pose in the present body frame, and the variances of the motion since.

    Attributes:
        rolled_m: Motion of rolling wheels since then, in the present body frame, left imaginary.
        covered_s: Time since then over which the gyro's bias entered: the turn since falls by it per rad/s.
        place_s_m: Derivative of the past place over the bias, in the present body frame, left imaginary.
        bias_rad: What the biases of that time have turned the rover by, to be replaced by the present one.
        bias_m: Likewise of the past place.
    """

    x_m: float
    y_m: float
    turned_rad: float
    position_m2: float
    yaw_rad2: float
    rolled_m: complex = 0j
    covered_s: float = 0.0
    place_s_m: complex = 0j
    bias_rad: float = 0.0
    bias_m: complex = 0j

    def with_bias(self, bias_rad_s: float) -> tuple[complex, float]:
        """Return what another bias adds to the past place, in the present body frame, and to the past yaw."""
        return bias_rad_s * self.place_s_m - self.bias_m, bias_rad_s * self.covered_s - self.bias_rad


def pose_then(state: Array, way_back: WayBack) -> tuple[complex, float]:
    """Return place and yaw of the rover in the local frame at exposure."""
    yaw_rad = state.item(YAW)
    arm_m = complex(way_back.x_m, way_back.y_m) * cmath.rect(1.0, yaw_rad)
    return complex(state.item(X), state.item(Y)) + arm_m, yaw_rad - way_back.turned_rad


@dataclass(frozen=True, slots=True, kw_only=True)
class _Mark:
    """Sums of the motion up to a time: the pose of pure dead reckoning, and the variances.

    Attributes:
        rolled_m: Place by rolling wheels with the same yaw.
        covered_s: Time over which the gyro's bias entered; the yaw falls by it per rad/s of bias.
        place_s_m: Derivative of the place over the bias.
        bias_rad: Turn that the biases have taken off.
        bias_m: Likewise of the place.
    """

    t_ns: int
    pose: Pose
    position_m2: float
    yaw_rad2: float
    rolled_m: complex = 0j
    covered_s: float = 0.0
    place_s_m: complex = 0j
    bias_rad: float = 0.0
    bias_m: complex = 0j


class FixQueue:
    """Waiting fixes, and the motion of the last two seconds.

    Dead reckoning is separate from the estimate, so that corrections by other measurements do not count as
    motion.

    Args:
        devices: Names of the devices that give fixes; others are ignored.
        has_camera: Whether the motion is needed for pairs of frames, too.
    """

    def __init__(self, devices: Sequence[str], *, has_camera: bool = False) -> None:
        self._newest_ns: dict[str, int | None] = dict.fromkeys(devices)
        self._is_recorded = bool(devices) or has_camera
        self._waiting: deque[tuple[int, PoseFixSample]] = deque(maxlen=MOST_WAITING)
        self._marks: deque[_Mark] = deque()

    def add(self, fix: PoseFixSample, t_ns: int) -> None:
        """Take a fix that arrived at `t_ns`; one that is not newer than the last has no effect."""
        if fix.device not in self._newest_ns:
            return
        capture_ns = min(fix.t_capture_ns, t_ns)
        newest_ns = self._newest_ns[fix.device]
        if newest_ns is None or capture_ns > newest_ns:
            self._newest_ns[fix.device] = capture_ns
            self._waiting.append((capture_ns, fix))

    def move(self, t_ns: int, step: Step) -> None:
        """Record the step that ended at `t_ns`; after a gap the motion starts anew."""
        if not self._is_recorded:
            return
        start_ns = t_ns - nanoseconds(step.duration_s)
        marks = self._marks
        # Durations are rounded to less than a microsecond.
        if not marks or abs(marks[-1].t_ns - start_ns) > 1000:
            marks.clear()
            marks.append(_Mark(t_ns=start_ns, pose=Pose(), position_m2=0.0, yaw_rad2=0.0))
        last = marks[-1]
        pose = move(last.pose, step.x_m, step.y_m, step.turn_rad)
        bias_rad = step.bias_rad_s * step.covered_s
        moved_m = complex(pose.x_m - last.pose.x_m, pose.y_m - last.pose.y_m)
        marks.append(
            _Mark(
                t_ns=t_ns,
                pose=pose,
                position_m2=last.position_m2 + step.position_m2,
                yaw_rad2=last.yaw_rad2 + step.yaw_rad2,
                rolled_m=last.rolled_m
                + step.rolled_m * cmath.rect(1.0, last.pose.yaw_rad + 0.5 * step.turn_rad),
                covered_s=last.covered_s + step.covered_s,
                place_s_m=last.place_s_m - 1j * moved_m * (last.covered_s + 0.5 * step.covered_s),
                bias_rad=last.bias_rad + bias_rad,
                bias_m=last.bias_m - 1j * moved_m * (last.bias_rad + 0.5 * bias_rad),
            )
        )
        while marks[0].t_ns < t_ns - HISTORY_NS:
            marks.popleft()

    def take(self) -> list[tuple[PoseFixSample, WayBack | None]]:
        """Return the fixes whose exposure the recorded motion has reached, with the motion back to it.

        The motion is None for a fix from before the recorded motion.
        """
        if not self._marks:
            return []
        known_ns = self._marks[-1].t_ns
        ready = [(capture_ns, fix) for capture_ns, fix in self._waiting if capture_ns <= known_ns]
        for item in ready:
            self._waiting.remove(item)
        return [(fix, self.way_back(capture_ns)) for capture_ns, fix in ready]

    @property
    def known_ns(self) -> int | None:
        """Time up to which the motion is recorded; None before the first."""
        return self._marks[-1].t_ns if self._marks else None

    def way_back(self, then_ns: int) -> WayBack | None:
        """Return the motion from the present pose back to a past one; None outside the recorded motion."""
        marks = self._marks
        if not marks or not marks[0].t_ns <= then_ns <= marks[-1].t_ns:
            return None
        index = len(marks) - 1
        while index > 0 and marks[index - 1].t_ns >= then_ns:
            index -= 1
        then, now = _between(marks[max(index - 1, 0)], marks[index], then_ns), marks[-1]
        x_m, y_m = then.pose.x_m - now.pose.x_m, then.pose.y_m - now.pose.y_m
        cosine, sine = math.cos(now.pose.yaw_rad), math.sin(now.pose.yaw_rad)
        # Seen from the present pose, which stays, the path since then turns with the bias.
        arm_m, to_body = 1j * complex(x_m, y_m), complex(cosine, -sine)
        return WayBack(
            x_m=cosine * x_m + sine * y_m,
            y_m=cosine * y_m - sine * x_m,
            turned_rad=wrap_angle(now.pose.yaw_rad - then.pose.yaw_rad),
            position_m2=now.position_m2 - then.position_m2,
            yaw_rad2=now.yaw_rad2 - then.yaw_rad2,
            rolled_m=(now.rolled_m - then.rolled_m) * cmath.rect(1.0, -now.pose.yaw_rad),
            covered_s=now.covered_s - then.covered_s,
            place_s_m=(then.place_s_m - now.place_s_m + now.covered_s * arm_m) * to_body,
            bias_rad=now.bias_rad - then.bias_rad,
            bias_m=(then.bias_m - now.bias_m + now.bias_rad * arm_m) * to_body,
        )


def _between(before: _Mark, after: _Mark, t_ns: int) -> _Mark:
    """Return the mark at `t_ns`, on the straight line between two."""
    span_ns = after.t_ns - before.t_ns
    share = 1.0 if span_ns == 0 else (t_ns - before.t_ns) / span_ns
    start, end = before.pose, after.pose
    return _Mark(
        t_ns=t_ns,
        pose=Pose(
            x_m=start.x_m + share * (end.x_m - start.x_m),
            y_m=start.y_m + share * (end.y_m - start.y_m),
            yaw_rad=wrap_angle(start.yaw_rad + share * wrap_angle(end.yaw_rad - start.yaw_rad)),
        ),
        position_m2=before.position_m2 + share * (after.position_m2 - before.position_m2),
        yaw_rad2=before.yaw_rad2 + share * (after.yaw_rad2 - before.yaw_rad2),
        rolled_m=before.rolled_m + share * (after.rolled_m - before.rolled_m),
        covered_s=before.covered_s + share * (after.covered_s - before.covered_s),
        place_s_m=before.place_s_m + share * (after.place_s_m - before.place_s_m),
        bias_rad=before.bias_rad + share * (after.bias_rad - before.bias_rad),
        bias_m=before.bias_m + share * (after.bias_m - before.bias_m),
    )
