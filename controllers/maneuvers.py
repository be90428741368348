"""What the rover does beside its mission, where the user wants it: back out once, turn to find out."""

import cmath
import math
from collections import deque

from controllers.fault import Cause
from controllers.motion.missions.mission import Guidance, Mobility
from controllers.motion.planar import Pose, wrap_angle
from controllers.safety.entrapment import PROGRESS_CAUSES
from controllers.safety.settings import SafetySettings
from controllers.slip.effort.gyro_in_place import GyroInPlace
from drivers.clock import seconds

STEP_M = 0.01
"""Distance of the places that are remembered: as far as a corner is reached."""

REST_S = 0.5
"""Before a turn to find out the rover rests: what it turns while it brakes is not of that turn."""

AHEAD_M = 0.05
"""The rover steers to the place at this distance behind it."""


class BackOut:
    """Drives back along the rover's own path, once in a mission, after a stop because it does not get on.

    The path is that of the estimate, without what fixes have taken back. It ends after `back_out_m`, or when
    the wheels have travelled as far, whether the rover moves or not. Every stop rule holds meanwhile.

    Args:
        greatest_m: How far; 0 for never.
        speed_m_s: Of the mission.
        mobility: Of the rover.
        remembered_m: Travel of the wheels until such a stop, which fixes may take back.
    """

    def __init__(self, greatest_m: float, speed_m_s: float, mobility: Mobility, remembered_m: float) -> None:
        self._greatest_m = greatest_m
        self._speed_m_s = speed_m_s
        self._moves_sideways = mobility.moves_sideways
        self._path: deque[Pose] = deque(maxlen=math.ceil((remembered_m + greatest_m) / STEP_M))
        self._targets: list[Pose] = []
        self._driven_m = 0.0
        self._is_due = self._is_over = False

    @property
    def announcement(self) -> str:
        """What it is about to do, or does; empty for nothing."""
        if not (self._is_due or self._targets):
            return ""
        return f"rover: backs out along the last {self._greatest_m:g} m of its path"

    def stop(self, cause: Cause | None) -> None:
        """Take the cause of a stop: where the rover does not get on it backs out when it may move again."""
        if self._targets:
            self._targets, self._is_over = [], True
        self._is_due |= bool(self._greatest_m) and not self._is_over and cause in PROGRESS_CAUSES

    def guide(self, pose: Pose, distance_m: float) -> Guidance | None:
        """Return the way back; None while the mission leads.

        Args:
            pose: By the estimate.
            distance_m: Travel of the wheels since the cycle before.
        """
        if self._is_due:
            self._is_due, self._targets = False, self._way_back(pose)
            self._is_over = True
        elif self._targets:
            self._driven_m += distance_m
        else:
            self._remember(pose)
        while self._targets and _distance_m(self._targets[0], pose) < AHEAD_M and len(self._targets) > 1:
            self._targets.pop(0)
        if not self._targets:
            return None
        is_there = len(self._targets) == 1 and _distance_m(self._targets[0], pose) < STEP_M
        if is_there or self._driven_m >= self._greatest_m:
            self._targets = []
            return None
        return self._steer(pose, self._targets[0])

    def _remember(self, pose: Pose) -> None:
        """Add a place to the path; where a fix has put the rover back, forget where it was not."""
        path = self._path
        while len(path) > 1 and _distance_m(path[-2], pose) <= _distance_m(path[-1], pose):
            path.pop()
        if not path or _distance_m(path[-1], pose) >= STEP_M:
            path.append(pose)

    def _way_back(self, pose: Pose) -> list[Pose]:
        """Return the places of the path, the newest first, as far as the rover is to go."""
        self._remember(pose)
        back, length_m = [pose], 0.0
        for place in reversed(self._path):
            length_m += _distance_m(back[-1], place)
            if length_m > self._greatest_m:
                break
            back.append(place)
        return back

    def _steer(self, pose: Pose, target: Pose) -> Guidance:
        toward = complex(target.x_m - pose.x_m, target.y_m - pose.y_m) * cmath.rect(1.0, -pose.yaw_rad)
        course_rad = cmath.phase(toward)
        if self._moves_sideways:
            velocity = cmath.rect(self._speed_m_s, course_rad)
            turn_rad = wrap_angle(target.yaw_rad - pose.yaw_rad)
        else:  # backwards, the nose away from the target
            turn_rad = wrap_angle(course_rad - math.pi)
            velocity = complex(-self._speed_m_s * max(0.0, math.cos(turn_rad)), 0.0)
        return Guidance(velocity_x_m_s=velocity.real, velocity_y_m_s=velocity.imag, yaw_rate_rad_s=turn_rad)


class TurnToFindOut:
    """Turns the rover slowly back and forth in place by at most 10 degrees, once in a mission.

    Gyro and wheels have excluded each other. A slow turn passes through most contacts: a gyro that measures
    it has a signal, and the wheels have slipped. One that does not has none, or the wheels have no grip here.

    Args:
        is_wanted: Whether to turn at all.
        mobility: Of the rover.
        rim_arm_m: Speed of the fastest rim over the yaw rate, in a turn on the spot.
    """

    def __init__(self, mobility: Mobility, rim_arm_m: float, *, is_wanted: bool) -> None:
        self._is_wanted = is_wanted and mobility.turns_on_spot
        self._rim_arm_m = rim_arm_m
        self._turn: GyroInPlace | None = None
        self._has_turned = False
        self._begin_s = 0.0

    @property
    def announcement(self) -> str:
        """What it does; empty for nothing."""
        if self._turn is None:
            return ""
        return (
            "rover: turns by up to 10 deg back and forth to find out whether the gyro or the wheels are wrong"
        )

    def guide(self, now_ns: int, guidance: Guidance, *, is_undecided: bool) -> Guidance:
        """Return the turn instead of the guidance of the mission while it lasts.

        Args:
            now_ns: Time of the cycle.
            guidance: Of the mission.
            is_undecided: Whether gyro and wheels exclude each other, and nothing decides.
        """
        if not self._is_wanted or guidance.finished:
            return guidance
        if self._turn is None:
            if not is_undecided or self._has_turned:
                return guidance
            self._turn, self._has_turned = GyroInPlace(self._rim_arm_m), True
            self._begin_s = seconds(now_ns) + REST_S
        if seconds(now_ns) < self._begin_s:
            return Guidance(waits=True, cross_track_m=guidance.cross_track_m)
        rate_rad_s = self._turn.yaw_rate_rad_s(seconds(now_ns), 0.0)
        if rate_rad_s is None:
            self._turn = None
            return guidance
        return Guidance(yaw_rate_rad_s=rate_rad_s, cross_track_m=guidance.cross_track_m)


class Maneuvers:
    """Both of them, as the settings want them.

    Args:
        settings: Which are wanted.
        speed_m_s: Of the mission.
        mobility: Of the rover.
        rim_arm_m: Speed of the fastest rim over the yaw rate, in a turn on the spot.
    """

    def __init__(
        self, settings: SafetySettings, speed_m_s: float, mobility: Mobility, rim_arm_m: float
    ) -> None:
        remembered_m = settings.entrapment_m + settings.progress_unknown_m
        self.back_out = BackOut(settings.back_out_m, speed_m_s, mobility, min(remembered_m, 10.0))
        self.turn = TurnToFindOut(mobility, rim_arm_m, is_wanted=settings.turn_to_find_out)

    @property
    def announcement(self) -> str:
        """What the rover does beside its mission, or is about to do; empty for nothing."""
        return self.back_out.announcement or self.turn.announcement


def _distance_m(one: Pose, other: Pose) -> float:
    return math.hypot(other.x_m - one.x_m, other.y_m - one.y_m)
