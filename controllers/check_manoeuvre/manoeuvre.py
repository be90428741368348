"""Drives the check manoeuvre before the mission, and judges the sources at its end."""

import math

from controllers.check_manoeuvre.comparison import compare
from controllers.check_manoeuvre.path import Leg
from controllers.check_manoeuvre.tracks import Tracks
from controllers.check_manoeuvre.verdict import SourceCheck
from controllers.estimation.ground.travel import GroundPair
from controllers.estimation.settings import FilterSettings
from controllers.motion.missions.mission import Guidance
from controllers.motion.planar import Pose
from controllers.roles import DeviceRoles
from drivers.clock import seconds
from drivers.samples import Sample

REST_S = 0.6
"""Standstill between two legs, and at the end: readings that lag catch up."""
LONGEST_STOP_S = 10.0
"""A stop that lasts longer does not end by itself."""
GAP_S = 0.5
"""Between cycles that are farther apart the rover was stopped or paused: that time counts for no leg."""
SLOWER = 3.0
SPARE_S = 5.0
"""A leg may take `SLOWER` times as long as planned, and `SPARE_S` more."""


class CheckManoeuvre:
    """A short motion that ends where it began. Every stop rule holds meanwhile.

    Where a stop rule ends it, or keeps the rover stopped for `LONGEST_STOP_S`, the sources are compared over
    what was driven until then, and the mission does not begin.

    A leg ends by the odometry of the wheels, not by the filtered pose, which other sources correct. After
    a stop the leg goes on.

    Args:
        legs: What to drive; empty for no manoeuvre.
        roles: Which device is what.
        settings: Noise of the sources.
        skids: Whether the wheels skid in every rotation.

    Attributes:
        is_over: Whether the mission may begin.
        result: What the comparison shows; empty before.
        failure: Why the mission must not begin; empty where it may.
    """

    def __init__(
        self, legs: tuple[Leg, ...], roles: DeviceRoles, settings: FilterSettings, *, skids: bool = False
    ) -> None:
        self._legs, self._roles, self._skids = legs, roles, skids
        self._tracks = Tracks(roles, settings)
        self._number = 0
        self._from: Pose | None = None
        self._yaw_rad = self._travel_m = 0.0
        self._leg_s = self._rested_s = 0.0
        self._last_s: float | None = None
        self._stopped_s: float | None = None
        self._is_taken = False
        self.is_over = not legs
        self.result: tuple[SourceCheck, ...] = ()
        self.failure = ""

    @property
    def is_driving(self) -> bool:
        """Whether it has begun and is not over."""
        return not self.is_over and self._from is not None

    def take(self, sample: Sample, t_ns: int) -> None:
        """Take one sample as of `t_ns`."""
        if self.is_driving:
            self._tracks.take(sample, t_ns)

    def guide(
        self, now_ns: int, odometry: Pose, odometry_ns: int | None, pairs: tuple[GroundPair, ...]
    ) -> Guidance:
        """Return the motion of a cycle in which the rover may move, until `is_over`.

        Args:
            now_ns: Time of the cycle.
            odometry: Pose by the wheels alone.
            odometry_ns: Its time; None while it is not known.
            pairs: Motions over the ground that a camera has measured since the last cycle.
        """
        elapsed_s = 0.0 if self._last_s is None else seconds(now_ns) - self._last_s
        elapsed_s = elapsed_s if elapsed_s <= GAP_S else 0.0
        self._last_s, self._stopped_s = seconds(now_ns), None
        if odometry_ns is None:
            return Guidance(waits=True)
        self._follow(odometry)
        self._tracks.take_wheels(odometry_ns, odometry)
        if self._is_travelling:
            self._tracks.take_ground(pairs)
        if self._rested_s < REST_S or self._number == len(self._legs):
            self._rested_s += elapsed_s
            if self._number == len(self._legs) and self._rested_s >= REST_S:
                self.judge()
            return Guidance(waits=True)
        leg = self._legs[self._number]
        self._leg_s += elapsed_s
        if self._leg_s > SLOWER * leg.planned_s + SPARE_S:
            self._fail(f"its leg {self._number + 1} took longer than {self._leg_s:.0f} s: check the wheels")
            return Guidance(waits=True)
        if self._is_done(leg):
            self._number += 1
            self._leg_s = self._rested_s = 0.0
            return Guidance(waits=True)
        return Guidance(velocity_x_m_s=leg.velocity_m_s, yaw_rate_rad_s=leg.yaw_rate_rad_s)

    def wait(self, now_ns: int) -> None:
        """Count a cycle in which a stop rule keeps the rover stopped."""
        if not self.is_driving:
            return
        self._stopped_s = seconds(now_ns) if self._stopped_s is None else self._stopped_s
        if seconds(now_ns) - self._stopped_s >= LONGEST_STOP_S:
            self.judge()
            if not self.failure:
                self._fail(f"the rover was stopped for {LONGEST_STOP_S:g} s")

    def take_result(self) -> tuple[SourceCheck, ...] | None:
        """Return the result once; None before and after."""
        if self._is_taken or not self.result:
            return None
        self._is_taken = True
        return self.result

    def judge(self) -> None:
        """Compare the sources over what was driven, and end; where nothing was driven there is no result."""
        if self.is_over:
            return
        self.is_over = True
        if self._from is None:
            return
        self.result = compare(self._tracks, self._roles, skids=self._skids)
        wrong = [check.text for check in self.result if check.verdict.is_refused]
        if wrong:
            self._fail("; ".join(wrong))

    def _fail(self, why: str) -> None:
        self.is_over = True
        self.failure = f"check manoeuvre: {why}"

    def _follow(self, odometry: Pose) -> None:
        """Add the motion of the wheels since the cycle before."""
        before = self._from or odometry
        middle_rad = before.yaw_rad + 0.5 * math.remainder(odometry.yaw_rad - before.yaw_rad, math.tau)
        step = complex(odometry.x_m - before.x_m, odometry.y_m - before.y_m)
        self._travel_m += step.real * math.cos(middle_rad) + step.imag * math.sin(middle_rad)
        self._yaw_rad += math.remainder(odometry.yaw_rad - before.yaw_rad, math.tau)
        self._from = odometry

    @property
    def _is_travelling(self) -> bool:
        """Whether the ground moves by travel.

        In a rotation on the spot it is what the swing of the camera leaves, which a wrong rig gives any
        direction.
        """
        is_moving = self._number < len(self._legs) and self._rested_s >= REST_S
        return is_moving and self._legs[self._number].velocity_m_s != 0.0

    def _is_done(self, leg: Leg) -> bool:
        if leg.yaw_rad is not None:
            return (self._yaw_rad - leg.yaw_rad) * leg.yaw_rate_rad_s >= 0.0
        return leg.travel_m is None or (self._travel_m - leg.travel_m) * leg.velocity_m_s >= 0.0
