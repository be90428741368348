"""Slip of each wheel from its effort, and the motion of the body without it."""

import cmath
import math
from collections.abc import Sequence
from dataclasses import replace

from controllers.estimation.filter.slip_states import SlipEstimate
from controllers.estimation.ground.travel import GroundPair, GroundReport
from controllers.estimation.slip_compensator import SlipEstimator, SlipEvidence
from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.motion.body_motion import BodyMotion
from controllers.motion.kinematics import Kinematics
from controllers.motion.rover_geometry import OmniRoverSettings
from controllers.roles import DeviceRoles
from controllers.slip.effort.excited_slip import UNKNOWN_GYRO, ExcitedSlip, RoverSlip
from controllers.slip.effort.free_force import FreeForce
from controllers.slip.effort.ground_knowledge import SlipSource
from controllers.slip.effort.labelled_windows import LabelledReading
from controllers.slip.effort.open_window import OpenWindow
from controllers.slip.effort.settings import YAW_PROBE, SlipSettings
from controllers.slip.effort.slip_by_surface import SlipBySurface, WindowSlip, same_slip
from controllers.slip.effort.slip_labels import SlipLabels
from controllers.slip.effort.slip_sharing import share_slip
from controllers.slip.effort.torque_correction import TorqueCorrection
from controllers.slip.effort.wheel_efforts import WheelEfforts
from controllers.slip.effort.wheel_slips import WheelSlip, WheelSlips
from drivers.clock import seconds
from drivers.record import record
from drivers.samples import PoseFixSample, RateSample, Sample, WheelSample


@record(frozen=True, slots=True, kw_only=True)
class SlipReport:
    """Slip of all wheels.

    Attributes:
        map: Name of the map in use.
        surface: The recognised surface; None where it is unknown.
        drift_rad: Angle from the encoders' course to the true course, positive to the left.
        wheels: One after the other.
        rover: Slip of the rover, its uncertainty and where it comes from.
        label: Reading of the yaw excitation that fixes or a camera have labelled since the last increment.
    """

    map: str
    surface: str | None
    drift_rad: float
    wheels: tuple[WheelSlip, ...]
    rover: RoverSlip | None = None
    label: LabelledReading | None = None


MEASURED_BY_FIXES = "pose fixes measure the slip"


class EffortCompensator(SlipEstimator[SlipReport]):
    """Turns wheel increments into body increments of a slipping rover.

    The slip is found for windows of half a second: by the surface (`SlipBySurface`), or by the excitation
    (`ExcitedSlip`). `WheelSlips` gives it to the wheels. The end of a window corrects the motion that was
    reported during it with the slip before (`OpenWindow`). `SlipLabels` is what fixes and a camera measure.

    Args:
        settings: Maps and which of them to use.
        rover: Geometry of the wheels.
        kinematics: Of the same rover.
        roles: Which device is what.
        travel_m_s: Speed of the mission; None without one.

    Attributes:
        excited: Slip by the yaw excitation; None where another map is in use.
        free_force: Compares the drive force with that of free driving.
    """

    def __init__(
        self,
        settings: SlipSettings,
        rover: OmniRoverSettings,
        kinematics: Kinematics,
        roles: DeviceRoles,
        travel_m_s: float | None = None,
    ) -> None:
        count = kinematics.wheel_count
        self._excites_beside = settings.excite_beside_ground
        self._map = settings.use
        self._kinematics = kinematics
        self._device, self._gyro = roles.wheels, roles.gyro
        self._gyro_ns: int | None = None
        self._report: SlipReport | None = None
        self._efforts = WheelEfforts(settings.maps.motor, count)
        self._surface = SlipBySurface(settings, kinematics, rover.base_radius_m)
        self._wheels = WheelSlips(settings, kinematics, self._surface, self._efforts)
        ground = self._surface.ground if settings.learn else None
        self._labels = SlipLabels(roles.fixes, settings.excitation.window_s, ground, self._efforts)
        self.free_force = FreeForce(rover.base_radius_m)
        self.excited = (
            ExcitedSlip(
                settings.excitation,
                rover,
                kinematics,
                gyro=settings.gyro_response,
                learned=settings.learned_bracket,
                wheel_age_s=roles.wheel_age_s,
                travel_m_s=travel_m_s,
                rest_s=settings.excitation_rest_s,
                proves_gyro=not roles.fixes,
            )
            if settings.use == YAW_PROBE
            else None
        )
        correction = settings.torque_correction
        self._correction = None if correction is None else TorqueCorrection(rover, correction)
        self._open = OpenWindow(kinematics)
        self._window_slip = WindowSlip(None, 0.0, "too little way so far")
        if self.excited is not None:
            self._window_slip = same_slip(count, 0.0, self.excited.slip.reason)
        self._slips = [self._surface.prior_slip] * count

    @property
    def states(self) -> None:
        """None: the slip is estimated outside of the pose filter."""
        return

    @property
    def unsettled_m(self) -> complex:
        """Standard deviation of the travel since the last window.

        From one window to the next the slip changes by about the standard deviation that it is reported with.
        """
        slip_sd = self._slip_sd()
        if self._surface.wheel_map is not None or slip_sd is None:
            return 0j
        x_m, y_m, _ = self._open.rolled()
        return slip_sd * complex(x_m, y_m)

    @property
    def knows_force(self) -> bool:
        """Whether the torques of all wheels are known."""
        return self._efforts.are_torques_known

    def forget_gyro(self) -> None:
        """Forget the slip by the excitation, and what was learned from it or between fixes."""
        self._surface.ground.forget_gyro()
        self._labels.forget_gyro()
        if self.excited is not None:
            self.excited.forget_gyro()
            slip = 0.0 if self._labels.are_fixes_recent else self.excited.slip.slip
            self._window_slip = same_slip(len(self._slips), slip, self.excited.slip.reason)

    def follow(self, estimate: SlipEstimate) -> None:
        """Follow nothing: there are no states in the pose filter."""

    @property
    def evidence(self) -> SlipEvidence:
        """What the excitation and the drive force show."""
        excited, force = self.excited, self.free_force
        return SlipEvidence(
            slip=None if excited is None or excited.slip.reason else excited.slip.slip,
            slip_sd=1.0 if excited is None else excited.slip.sd,
            lost_response="" if excited is None else excited.lost_response,
            # Fixes measure the slip themselves.
            unknown_share=(
                0.0 if excited is None or self._labels.are_fixes_recent else excited.unknown_share
            ),
            unanswered_m=0.0 if excited is None else excited.unanswered_m,
            unusual_force=force.reason,
            unusual_force_m=force.far_m,
        )

    def report(self, ground: GroundReport | None = None) -> SlipReport | None:
        """Return the slip as of the newest increment; None before the first."""
        if self._report is None or ground is None or ground.slip is None or ground.slip_sd is None:
            return self._report
        measured = RoverSlip(slip=ground.slip, sd=ground.slip_sd, source=SlipSource.GROUND, reason="")
        return replace(self._report, rover=measured)

    def excite(
        self, now_s: float, twist: BodyMotion, *, is_turning: bool, is_measured: bool
    ) -> tuple[BodyMotion, float]:
        """Return the twist with the yaw excitation, and the yaw rate of that, see `SlipEstimator`."""
        excited, (x_m_s, y_m_s, yaw_rate_rad_s) = self.excited, twist
        if excited is None:
            return twist, 0.0
        if is_turning or (is_measured and not self._excites_beside):
            excited.leave_out(now_s)
            return twist, 0.0
        in_place = excited.in_place
        turn_rad_s = None if in_place is None else in_place.yaw_rate_rad_s(now_s, yaw_rate_rad_s)
        if turn_rad_s is not None:
            return (0.0, 0.0, turn_rad_s), turn_rad_s
        added_rad_s = excited.yaw_rate_rad_s(now_s)
        return (x_m_s, y_m_s, excited.swing.without_swing(now_s, yaw_rate_rad_s) + added_rad_s), added_rad_s

    def feed(self, sample: Sample, t_ns: int) -> None:
        """Take the current of one wheel as of `t_ns`, unless it is missing, not finite or not newer."""
        if isinstance(sample, PoseFixSample):
            self._labels.take_fix(sample, t_ns)
        elif isinstance(sample, RateSample):
            is_newer = self._gyro_ns is None or t_ns > self._gyro_ns
            if sample.device == self._gyro and is_newer:
                self._gyro_ns = t_ns
        elif isinstance(sample, WheelSample) and sample.device == self._device:
            self._efforts.feed(sample, t_ns)

    def take_ground(self, pair: GroundPair) -> None:
        """Take a motion over the ground: it labels the readings of the excitation."""
        self._labels.take_ground(pair)

    def body_motion(self, wheel_values: Sequence[float]) -> BodyMotion:
        """Return the body's motion for wheel speeds or angles, by the newest slip."""
        return self._motion(wheel_values, self._slips, self._window_slip.drift_rad)

    def compensate(
        self, increment: BodyIncrement, set_speed_rad_s: Sequence[float], gyro_rate_rad_s: float | None
    ) -> BodyIncrement:
        """Return the increment of the body for an increment of rolling wheels, see `SlipCompensator`.

        Surface and excitation are evaluated over windows of half a second. The end of a window corrects the
        motion that was reported during it with the slip before.
        """
        self._efforts.observe(increment, set_speed_rad_s)
        owners = self._wheels.owners
        owners.check(self._efforts.newest, increment.duration_s)
        self._surface.ground.move(increment.duration_s, math.hypot(increment.x_m, increment.y_m))
        self._labels.move(increment, gyro_rate_rad_s)
        correction_m = self._update(increment, gyro_rate_rad_s)
        wheels = self._wheels.find(self._window_slip, increment.duration_s, set_speed_rad_s)
        self._slips = [wheel.slip for wheel in wheels]
        moved = self.body_motion(increment.turned_rad)
        x_m, y_m, turn_rad = moved
        work_j = self._efforts.work_but_for_sign_j(increment)
        self.free_force.move(increment, None if owners.reason else work_j)
        self._open.add(increment, work_j, complex(x_m, y_m))
        self._report = SlipReport(
            map=self._map,
            surface=self._surface.name,
            drift_rad=self._window_slip.drift_rad,
            wheels=tuple(wheels),
            rover=(
                self._wheels.of_rover(wheels, increment.turned_rad, moved)
                if self.excited is None
                else self.excited.slip
            ),
            label=self._labels.label(),
        )
        return BodyIncrement(
            x_m=x_m + correction_m.real,
            y_m=y_m + correction_m.imag,
            turn_rad=turn_rad,
            duration_s=increment.duration_s,
            turned_rad=increment.turned_rad,
            is_sure=self._wheels.are_sure(wheels, set_speed_rad_s),
            steering_rad=increment.steering_rad,
            rolled_m=complex(increment.x_m, increment.y_m),
            slip_sd=self._slip_sd(),
            # Without the gyro's constants the reading is the least slip that the gyro may show.
            is_slip_one_sided=self.excited is not None and self.excited.slip.unsure == UNKNOWN_GYRO,
        )

    def set_point_changes(self, commanded_twist: BodyMotion) -> tuple[float, ...] | None:
        """Return what the torque correction adds to each setpoint, rad/s.

        Args:
            commanded_twist: Velocity x, y in m/s and yaw rate in rad/s.

        Returns:
            None without torque correction, and while the torque of any wheel is unknown.
        """
        if self._correction is None or not self.knows_force:
            return None
        torques_nm = [effort.wheel_torque_nm for effort in self._efforts.newest]
        return self._correction.set_point_changes(torques_nm, commanded_twist)

    def _slip_sd(self) -> float | None:
        """Return the standard deviation of the slip; None where it is not valid."""
        rover = None if self._report is None else self._report.rover
        return None if rover is None or rover.reason else rover.sd

    def _motion(self, wheel_values: Sequence[float], slips: Sequence[float], drift_rad: float) -> BodyMotion:
        rolled = [value * (1.0 - slip) for value, slip in zip(wheel_values, slips, strict=True)]
        x, y, turn = self._kinematics.body_motion(rolled)
        moved = complex(x, y) * cmath.rect(1.0, drift_rad)
        return moved.real, moved.imag, turn

    def _update(self, increment: BodyIncrement, gyro_rate_rad_s: float | None) -> complex:
        """Update the slip of the window; return the correction of the motion reported since the last one."""
        found = self._surface.step(increment, self._efforts, self._window_slip.drift_rad)
        if self.excited is not None:
            found = self._slip_by_excitation(self.excited, increment, gyro_rate_rad_s)
        if found is None or self._surface.wheel_map is not None:
            return 0j
        self._window_slip = found
        reported_m, turned_rad = self._open.reported_m, self._open.turned_rad
        self._open.begin()
        if found.slips is None:
            return 0j
        x_m, y_m, _ = self._motion(turned_rad, found.slips, found.drift_rad)
        return complex(x_m, y_m) - reported_m

    def _slip_by_excitation(
        self, excited: ExcitedSlip, increment: BodyIncrement, gyro_rate_rad_s: float | None
    ) -> WindowSlip | None:
        count = self._kinematics.wheel_count
        rate_rad_s = increment.turn_rad / increment.duration_s
        in_place = excited.in_place
        if in_place is not None and in_place.is_turning:
            in_place.take(increment.duration_s, rate_rad_s, gyro_rate_rad_s)
            excited.excitation.start_window()
            return same_slip(count, 0.0, in_place.reason)
        # By how much the gyro's time stamp is after that of the wheels.
        after_s = 0.0 if self._gyro_ns is None else seconds(self._gyro_ns - self._efforts.positions_ns)
        response = excited.excitation.step(increment.duration_s, rate_rad_s, gyro_rate_rad_s, after_s)
        if response is None:
            return None
        x_m, y_m, _ = self._open.rolled()
        known = self._surface.by_force(self._open.travel())
        found = excited.take(response, complex(x_m, y_m), self._open.force_n(), known)
        if excited.reading is not None:
            self._labels.add(*excited.reading)
        if found.source is SlipSource.EXCITATION:
            self._surface.ground.learn(found.slip)
        if self._labels.are_fixes_recent:
            return same_slip(count, 0.0, found.reason or MEASURED_BY_FIXES)
        if found.source is not SlipSource.EXCITATION:
            return same_slip(count, found.slip, found.reason)
        missing_rad_s = (1.0 - found.slip) * response.wheel_rate_rad_s - response.gyro_rate_rad_s
        slips = share_slip(
            self._kinematics, self._open.turned_rad, found.slip, missing_rad_s * self._open.duration_s
        )
        return WindowSlip(slips, excited.drift_rad, "")
