"""The recorded motion of the rover, from the present pose back to a past one."""

import cmath
from collections import deque
from dataclasses import dataclass

from controllers.estimation.filter.measurement_model import Array
from controllers.estimation.filter.state_layout import YAW, X, Y
from controllers.motion.planar import wrap_angle
from drivers.clock import NANOSECONDS_PER_SECOND, nanoseconds
from drivers.record import record

HISTORY_NS = 2 * NANOSECONDS_PER_SECOND


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
        measured_s: Time in which gyro or wheels measured `turn_rad`: of several steps at once, or of none.
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
    measured_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class WayBack:
    """Past pose in the present body frame, and the variances of the motion since.

    Attributes:
        rolled_m: Motion of rolling wheels since then, in the present body frame, left imaginary.
        covered_s: Time since then over which the gyro's bias entered: the turn since falls by it per rad/s.
        place_s_m: Derivative of the past place over the bias, in the present body frame, left imaginary.
        bias_rad: What the biases of that time have turned the rover by, to be replaced by the present one.
        bias_m: Likewise of the past place.
        measured_s: Time in which gyro or wheels measured the turn since then.
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
    measured_s: float = 0.0

    def with_bias(self, bias_rad_s: float) -> tuple[complex, float]:
        """Return what another bias adds to the past place, in the present body frame, and to the past yaw."""
        return bias_rad_s * self.place_s_m - self.bias_m, bias_rad_s * self.covered_s - self.bias_rad


AT_START = WayBack(x_m=0.0, y_m=0.0, turned_rad=0.0, position_m2=0.0, yaw_rad2=0.0)


def pose_then(state: Array, way_back: WayBack) -> tuple[complex, float]:
    """Return place and yaw of the rover in the local frame at exposure."""
    yaw_rad = state.item(YAW)
    arm_m = complex(way_back.x_m, way_back.y_m) * cmath.rect(1.0, yaw_rad)
    return complex(state.item(X), state.item(Y)) + arm_m, yaw_rad - way_back.turned_rad


class MotionHistory:
    """The motion of the last two seconds, to lead a late reading back to the time when it was measured.

    Dead reckoning is separate from the estimate, so that corrections by other measurements do not count as
    motion. Recording costs little, because it is done in each cycle; the way back is summed where it is asked
    for.

    Attributes:
        start_ns: Begin of the first recorded motion, before which the rover was at the start; None before it,
            and when that is forgotten.
    """

    def __init__(self) -> None:
        self._steps: deque[tuple[int, int, Step]] = deque()
        self._has_begun = False
        self.start_ns: int | None = None

    def move(self, t_ns: int, step: Step) -> None:
        """Record the step that ended at `t_ns`; after a gap the motion starts anew."""
        steps = self._steps
        start_ns = t_ns - nanoseconds(step.duration_s)
        # Durations are rounded to less than a microsecond.
        if steps and abs(steps[-1][1] - start_ns) <= 1000:
            start_ns = steps[-1][1]
        else:
            steps.clear()
            self.start_ns = None if self._has_begun else start_ns
            self._has_begun = True
        steps.append((start_ns, t_ns, step))
        while len(steps) > 1 and steps[0][0] < t_ns - HISTORY_NS:
            steps.popleft()
            self.start_ns = None

    @property
    def first_ns(self) -> int | None:
        """Time from which the motion is recorded; None before the first."""
        return self._steps[0][0] if self._steps else None

    @property
    def known_ns(self) -> int | None:
        """Time up to which the motion is recorded; None before the first."""
        return self._steps[-1][1] if self._steps else None

    def way_back(self, then_ns: int, from_ns: int | None = None) -> WayBack | None:
        """Return the motion from the present pose back to a past one; None outside the recorded motion.

        Before the first recorded motion the rover is where it was.

        Args:
            then_ns: Time of the past pose.
            from_ns: Time of a later past pose from which the motion is seen; None for the present one.
        """
        steps = self._steps
        if not self._has_begun:
            return AT_START
        if not steps or not steps[0][0] <= then_ns <= steps[-1][1]:
            return None
        last_ns = steps[-1][1] if from_ns is None else from_ns
        place_m = rolled_m = place_s_m = bias_m = 0j
        turned_rad = position_m2 = yaw_rad2 = covered_s = bias_rad = measured_s = 0.0
        for start_ns, end_ns, step in reversed(steps):
            if end_ns <= then_ns:
                break
            if start_ns >= last_ns:
                continue
            # The chord of the whole step, also where only a part of it is needed.
            share = (min(end_ns, last_ns) - max(start_ns, then_ns)) / (end_ns - start_ns)
            chord = share * cmath.rect(1.0, -turned_rad - 0.5 * step.turn_rad)
            moved_m = chord * complex(step.x_m, step.y_m)
            step_bias_rad = step.bias_rad_s * step.covered_s
            place_m -= moved_m
            rolled_m += chord * step.rolled_m
            # Seen from the present pose, which stays, the path since then turns with the bias.
            place_s_m -= 1j * moved_m * (covered_s + 0.5 * step.covered_s)
            bias_m -= 1j * moved_m * (bias_rad + 0.5 * step_bias_rad)
            turned_rad += share * step.turn_rad
            position_m2 += share * step.position_m2
            yaw_rad2 += share * step.yaw_rad2
            covered_s += share * step.covered_s
            bias_rad += share * step_bias_rad
            measured_s += share * step.measured_s
        return WayBack(
            x_m=place_m.real,
            y_m=place_m.imag,
            turned_rad=wrap_angle(turned_rad),
            position_m2=position_m2,
            yaw_rad2=yaw_rad2,
            rolled_m=rolled_m,
            covered_s=covered_s,
            place_s_m=place_s_m,
            bias_rad=bias_rad,
            bias_m=bias_m,
            measured_s=measured_s,
        )
