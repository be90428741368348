"""What a motion that was measured wrongly, or not at all, leaves uncertain."""

import math

from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.filter.slip_compensator import SlipCompensator
from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.wheels.unobserved_motion import UnseenMotion
from controllers.motion.body_motion import BodyMotion


class Doubts:
    """Widens the pose filter, and keeps account of what was doubted already.

    A gyro that was wrong has also misled the slip compensation: a gyro without a signal looks like wheels
    that slip wholly. So a doubt of the yaw also widens the position by the travel that compensation has
    removed, and the slip states; the compensator forgets what the gyro has taught.

    Args:
        pose_filter: Is widened.
        unseen: Counts what was not measured.
        slip: Compensator; None without one.
    """

    def __init__(
        self, pose_filter: PoseFilter, unseen: UnseenMotion, slip: SlipCompensator[object] | None
    ) -> None:
        self._filter, self._unseen, self._slip = pose_filter, unseen, slip
        self._compensated_m = (0.0, 0.0)
        self._undecided_rad2 = self._doubted_to_m = 0.0
        self._open_m = self._open_rad = 0.0

    @property
    def undecided_rad(self) -> float:
        """Standard deviation of the yaw by doubts that are no unseen motion."""
        return math.sqrt(self._undecided_rad2)

    def note_compensation(self, duration_s: float, removed_x_m: float, removed_y_m: float) -> None:
        """Add up the travel that slip compensation has removed, with a fading memory."""
        kept = math.exp(-duration_s / ESTIMATION.pose.doubted_slip_s)
        x_m, y_m = self._compensated_m
        self._compensated_m = (kept * x_m + removed_x_m, kept * y_m + removed_y_m)

    def add(
        self,
        moved_m: complex,
        yaw_rad: float,
        by_wheels_rad: float,
        *,
        is_unseen: bool,
        driven_m: float,
        path_m: float,
    ) -> None:
        """Widen by the greatest errors of travel and yaw.

        Args:
            moved_m: Of the travel, to the left as imaginary part.
            yaw_rad: Of the yaw.
            by_wheels_rad: Of the turn by the wheels; 0 where the gyro measures it.
            is_unseen: Whether the doubt counts as motion that was not measured.
            driven_m: Distance driven since the start.
            path_m: Distance driven before, on which the yaw may have become wrong.
        """
        x_m, y_m = moved_m.real, moved_m.imag
        if yaw_rad:
            x_m, y_m = x_m + abs(self._compensated_m[0]), y_m + abs(self._compensated_m[1])
            self._compensated_m = (0.0, 0.0)  # doubted once
            self._filter.doubt_slip()
            if self._slip is not None:
                self._slip.doubt_gyro()
        if path_m:
            chord_m = min(path_m, driven_m - self._doubted_to_m)  # the path before is doubted already
            chord_m *= 2.0 * math.sin(0.5 * min(yaw_rad, math.pi))
            x_m, y_m, self._doubted_to_m = x_m + chord_m, y_m + chord_m, driven_m
        greatest = (x_m, y_m, yaw_rad + by_wheels_rad)
        if is_unseen:
            self.widen(greatest)
            return
        # No yaw is more uncertain than one that may be any.
        added_rad2 = min(greatest[2] ** 2 / 3.0, max(0.0, math.pi**2 / 3.0 - self._undecided_rad2))
        self._filter.widen(x_m, y_m, math.sqrt(3.0 * added_rad2))
        self._undecided_rad2 += added_rad2

    def leave_open(self, rolled_m: float) -> None:
        """Widen so that the yaw may be any, and the rover anywhere within what its wheels have rolled."""
        added_m, added_rad = added(rolled_m, self._open_m), added(math.pi, self._open_rad)
        self._open_m, self._open_rad = max(rolled_m, self._open_m), math.pi
        if added_m or added_rad:
            self._filter.widen(math.sqrt(3.0) * added_m, math.sqrt(3.0) * added_m, added_rad)

    def widen(self, greatest: BodyMotion) -> None:
        """Widen by a motion that was not measured, and count it as unseen."""
        position_m2, yaw_rad2 = self._variances()
        self._filter.widen(*greatest)
        wide_m2, wide_rad2 = self._variances()
        self._unseen.add(wide_m2 - position_m2, wide_rad2 - yaw_rad2)

    def limit(self) -> None:
        """Count no more as unseen or doubted than the filter has left after corrections."""
        position_m2, yaw_rad2 = self._variances()
        self._unseen.limit(position_m2, yaw_rad2)
        self._undecided_rad2 = min(self._undecided_rad2, yaw_rad2)

    def _variances(self) -> tuple[float, float]:
        xx, _, _, yy, _, yaw_yaw = self._filter.covariance
        return xx + yy, yaw_yaw


def added(now: float, before: float) -> float:
    """Return what is to be added to an uncertainty to reach a greater one: variances add up."""
    return math.sqrt(max(0.0, now**2 - before**2))
