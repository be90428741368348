"""Slip of each wheel from its effort, and the motion of the body without it."""

import cmath
import math
import operator
from collections.abc import Sequence
from typing import NamedTuple

from controllers.estimation.ground_travel import GroundPair
from controllers.estimation.odometry import BodyIncrement
from controllers.estimation.slip_states import SlipEstimate
from controllers.motion.body_motion import BodyMotion
from controllers.motion.kinematics import Kinematics
from controllers.motion.rover_geometry import OmniRoverSettings
from controllers.roles import DeviceRoles
from controllers.slip.effort.current_owners import CurrentOwners
from controllers.slip.effort.excited_slip import UNKNOWN_GYRO, ExcitedSlip, RoverSlip
from controllers.slip.effort.free_force import FreeForce
from controllers.slip.effort.ground_knowledge import GroundKnowledge, KnownSlip, SlipSource
from controllers.slip.effort.labelled_windows import LabelledReading, LabelledWindows
from controllers.slip.effort.motor_model import EffortFlag
from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.settings import YAW_PROBE, SlipSettings
from controllers.slip.effort.slip_by_fixes import SlipByFixes
from controllers.slip.effort.slip_by_ground import SlipByGround
from controllers.slip.effort.slip_map import wheel_slip
from controllers.slip.effort.slip_sharing import share_slip
from controllers.slip.effort.stuck_wheels import StuckWheels
from controllers.slip.effort.surface_map import NO_TRAVEL, SurfaceTracker, Travel
from controllers.slip.effort.torque_correction import TorqueCorrection
from controllers.slip.effort.travel_range import direction_problem
from controllers.slip.effort.wheel_efforts import WheelEfforts
from controllers.slip.effort.wheel_map_check import WheelMapCheck, travel_slip
from drivers.clock import seconds
from drivers.record import record
from drivers.samples import PoseFixSample, RateSample, Sample, WheelSample


@record(frozen=True, slots=True, kw_only=True)
class WheelSlip:
    """Effort and slip of one wheel.

    Attributes:
        current_a: Signed, filtered.
        paper_torque_nm: M of paper 003, at the motor.
        wheel_torque_nm: Torque at the wheel.
        slip: Slip ratio that the odometry uses, -1 to 1.
        valid: False where the slip is held, and outside the training range of the map.
        reason: Why it is not valid; empty where it is.
    """

    current_a: float
    paper_torque_nm: float
    wheel_torque_nm: float
    slip: float
    valid: bool
    reason: str


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


class _WindowSlip(NamedTuple):
    """Slips of the wheels in a window; None where they can only be held. Valid where `reason` is empty."""

    slips: tuple[float, ...] | None
    drift_rad: float
    reason: str


class EffortCompensator:
    """Turns wheel increments into body increments of a slipping rover.

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
        surfaces = settings.maps.surfaces
        if settings.known_surfaces:
            surfaces = surfaces.only(settings.known_surfaces)
        self._report: SlipReport | None = None
        self._ground = GroundKnowledge(
            surfaces, are_named=bool(settings.known_surfaces), learns=settings.learn
        )
        self._learns, self._fixes = settings.learn, roles.fixes
        self._fix_ns: int | None = None
        self._by_fixes, self._by_ground = SlipByFixes(), SlipByGround()
        self.free_force = FreeForce(rover.base_radius_m)
        self._windows = LabelledWindows(settings.excitation.window_s)
        self._device = roles.wheels
        self._gyro = roles.gyro
        self._gyro_ns: int | None = None
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
        self._settings = settings
        # The excitation falls back by rules of its own.
        self._uses_map_anywhere = settings.unknown_ground == "map" or self.excited is not None
        self._wheel_map = settings.maps.wheel_maps.get(settings.use)
        self._owners = CurrentOwners(settings.maps.motor)
        self._stuck = StuckWheels(settings.maps.motor, count)
        self._kinematics = kinematics
        self._tracker = SurfaceTracker(surfaces, rover.base_radius_m)
        self._surface = self._tracker.step(NO_TRAVEL)
        self._efforts = WheelEfforts(settings.maps.motor, count)
        self._window_slip = _WindowSlip(None, 0.0, "too little way so far")
        if self.excited is not None:
            self._window_slip = _WindowSlip((0.0,) * count, 0.0, self.excited.slip.reason)
        self._slips = [self._prior_slip] * count
        self._held = [self._prior_slip] * count
        self._window_rad = [0.0] * count
        self._map_check = WheelMapCheck(settings.use, kinematics, self._ground.known.reason)
        self._window_s = 0.0
        self._window_work_j: float | None = 0.0
        self._reported_m = 0j

    @property
    def _prior_slip(self) -> float:
        """Slip of a wheel without any other knowledge."""
        known = self._ground.known
        if not known.reason:
            return known.slip
        if not self._uses_map_anywhere:
            return 0.0
        return self._tracker.prior_slip if self._surface.surface is None else self._surface.slip

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
        if self._wheel_map is not None or slip_sd is None:
            return 0j
        x_m, y_m, _ = self._kinematics.body_motion(self._window_rad)
        return slip_sd * complex(x_m, y_m)

    def _slip_sd(self) -> float | None:
        """Return the standard deviation of the slip; None where it is not valid."""
        rover = None if self._report is None else self._report.rover
        return None if rover is None or rover.reason else rover.sd

    def doubt_gyro(self) -> None:
        """Forget the slip by the excitation, and what was learned from it or between fixes."""
        self._ground.doubt_gyro()
        self._by_fixes = SlipByFixes()
        if self.excited is not None:
            self.excited.doubt_gyro()
            self._window_slip = _WindowSlip((0.0,) * len(self._slips), 0.0, self.excited.slip.reason)

    def correct(self, estimate: SlipEstimate) -> None:
        """Correct nothing: there are no states in the pose filter."""

    def report(self) -> SlipReport | None:
        """Return the slip as of the newest increment; None before the first."""
        return self._report

    def feed(self, sample: Sample, t_ns: int) -> None:
        """Take the current of one wheel as of `t_ns`, unless it is missing, not finite or not newer."""
        if isinstance(sample, PoseFixSample) and sample.device in self._fixes:
            self._fix_ns = t_ns
            found = self._by_fixes.take(sample)
            if found is not None and self._learns and found.force_n is not None:
                self._ground.learn(found.slip, found.force_n)
            if found is not None:
                self._windows.wait(found)
        elif isinstance(sample, RateSample) and sample.device == self._gyro and self._is_newer(t_ns):
            self._gyro_ns = t_ns
        elif isinstance(sample, WheelSample) and sample.device == self._device:
            self._efforts.feed(sample, t_ns)

    def take_ground(self, pair: GroundPair) -> None:
        """Take a motion over the ground: it labels the readings of the excitation."""
        found = self._by_ground.take(pair)
        if found is not None:
            self._windows.wait(found)

    def _is_newer(self, gyro_ns: int) -> bool:
        return self._gyro_ns is None or gyro_ns > self._gyro_ns

    def body_motion(self, wheel_values: Sequence[float]) -> BodyMotion:
        """Return the body's motion for wheel speeds or angles, by the newest slip."""
        return self._motion(wheel_values, self._slips, self._window_slip.drift_rad)

    def _motion(self, wheel_values: Sequence[float], slips: Sequence[float], drift_rad: float) -> BodyMotion:
        rolled = [value * (1.0 - slip) for value, slip in zip(wheel_values, slips, strict=True)]
        x, y, turn = self._kinematics.body_motion(rolled)
        moved = complex(x, y) * cmath.rect(1.0, drift_rad)
        return moved.real, moved.imag, turn

    def compensate(
        self, increment: BodyIncrement, set_speed_rad_s: Sequence[float], gyro_rate_rad_s: float | None
    ) -> BodyIncrement:
        """Return the increment of the body for an increment of rolling wheels, see `SlipCompensator`.

        Surface and excitation are evaluated over windows of half a second. The end of a window corrects the
        motion that was reported during it with the slip before.
        """
        self._efforts.observe(increment, set_speed_rad_s)
        self._owners.check(self._efforts.newest, increment.duration_s)
        self._ground.move(increment.duration_s, math.hypot(increment.x_m, increment.y_m))
        if self._fixes:
            self._move_between_fixes(increment, gyro_rate_rad_s)
        correction_m = self._update(increment, gyro_rate_rad_s)
        wheels = [
            self._wheel_slip(wheel, increment.duration_s, set_speed_rad_s[wheel])
            for wheel in range(len(self._efforts.newest))
        ]
        self._slips = [wheel.slip for wheel in wheels]
        x_m, y_m, turn_rad = self.body_motion(increment.turned_rad)
        self._window_rad = list(map(operator.add, self._window_rad, increment.turned_rad))
        self._window_s += increment.duration_s
        work_j = self._efforts.work_but_for_sign_j(increment)
        self.free_force.move(increment, None if self._owners.reason else work_j)
        self._window_work_j = (
            None if self._window_work_j is None or work_j is None else self._window_work_j + work_j
        )
        self._reported_m += complex(x_m, y_m)
        self._report = SlipReport(
            map=self._settings.use,
            surface=self._surface.surface,
            drift_rad=self._window_slip.drift_rad,
            wheels=tuple(wheels),
            rover=(
                self._rover_slip(wheels, increment.turned_rad) if self.excited is None else self.excited.slip
            ),
            label=self._windows.label(self._efforts.positions_ns),
        )
        return BodyIncrement(
            x_m=x_m + correction_m.real,
            y_m=y_m + correction_m.imag,
            turn_rad=turn_rad,
            duration_s=increment.duration_s,
            turned_rad=increment.turned_rad,
            is_sure=all(
                wheel.valid or self._is_at_rest(index, set_speed_rad_s[index])
                for index, wheel in enumerate(wheels)
            ),
            steering_rad=increment.steering_rad,
            rolled_m=complex(increment.x_m, increment.y_m),
            slip_sd=self._slip_sd(),
            # Without the gyro's constants the reading is the least slip that the gyro may show.
            is_slip_one_sided=self.excited is not None and self.excited.slip.unsure == UNKNOWN_GYRO,
        )

    def _rover_slip(self, wheels: Sequence[WheelSlip], turned_rad: Sequence[float]) -> RoverSlip:
        """Return the slip of the rover by a map, from the angles that the wheels turned."""
        known = self._ground.known
        slip = travel_slip(self._kinematics, turned_rad, self.body_motion(turned_rad))
        reason = next((one.reason for one in wheels if one.reason not in ("", EffortFlag.SLOW)), "")
        if not reason and not any(one.valid for one in wheels):
            reason = EffortFlag.SLOW.value
        if reason:
            source = SlipSource.HELD if abs(slip) > EFFORT.hold.encoders_below else SlipSource.ENCODERS
            return RoverSlip(slip=slip, sd=1.0, source=source, reason=reason)
        off = 0.0 if self._wheel_map is None else self._map_check.slip - known.slip
        return RoverSlip(slip=slip, sd=math.hypot(known.sd, off), source=known.source, reason="")

    def _is_at_rest(self, wheel: int, set_speed_rad_s: float) -> bool:
        """Return True for a wheel at rest as commanded; wheel maps do not apply to it."""
        is_commanded = abs(set_speed_rad_s) < EFFORT.motor.slowest_rad_s
        return (
            self._wheel_map is not None
            and is_commanded
            and self._efforts.newest[wheel].flags == (EffortFlag.SLOW,)
        )

    @property
    def knows_force(self) -> bool:
        """Whether the torques of all wheels are known."""
        return self._efforts.are_torques_known

    def set_point_changes(self, commanded_twist: Sequence[float]) -> tuple[float, ...] | None:
        """Return what the torque correction adds to each set-point, rad/s.

        Args:
            commanded_twist: Velocity x, y in m/s and yaw rate in rad/s.

        Returns:
            None without torque correction, and while the torque of any wheel is unknown.
        """
        if self._correction is None or not self.knows_force:
            return None
        torques_nm = [effort.wheel_torque_nm for effort in self._efforts.newest]
        return self._correction.set_point_changes(torques_nm, commanded_twist)

    def _update(self, increment: BodyIncrement, gyro_rate_rad_s: float | None) -> complex:
        """Update the slip of the window; return the correction of the motion reported since the last one."""
        found = self._slip_by_surface(increment)
        if self.excited is not None:
            found = self._slip_by_excitation(increment, gyro_rate_rad_s)
        if found is None or self._wheel_map is not None:
            return 0j
        self._window_slip = found
        reported_m, window_rad = self._reported_m, self._window_rad
        self._reported_m, self._window_rad, self._window_s = 0j, [0.0] * len(window_rad), 0.0
        self._window_work_j = 0.0
        if found.slips is None:
            return 0j
        x_m, y_m, _ = self._motion(window_rad, found.slips, found.drift_rad)
        return complex(x_m, y_m) - reported_m

    def _move_between_fixes(self, increment: BodyIncrement, gyro_rate_rad_s: float | None) -> None:
        turn_rad = increment.turn_rad if gyro_rate_rad_s is None else gyro_rate_rad_s * increment.duration_s
        is_known = self._efforts.unknown_work is None
        work_j = self._efforts.work_j(increment) if is_known else None
        # The odometry is known up to the oldest of the newest positions.
        self._by_fixes.move(self._efforts.positions_ns, increment, turn_rad, work_j)

    def _slip_by_surface(self, increment: BodyIncrement) -> _WindowSlip | None:
        unknown = self._efforts.unknown_work
        if unknown is not None:
            self._tracker.interrupt()
            self._map_check.begin()
            return _WindowSlip(None, self._window_slip.drift_rad, unknown.value)
        if self._wheel_map is not None:
            self._map_check.add(self._wheel_map, self._efforts.newest, increment.turned_rad)
        work_j = self._efforts.work_j(increment)
        before = self._surface
        self._surface = self._tracker.step(
            Travel(increment.duration_s, increment.x_m, increment.y_m, increment.turn_rad, work_j)
        )
        if self._surface is before or self._tracker.window is None:
            return None
        known = self._ground.known
        if self.excited is None:
            known = self._ground.step(self._tracker.window)
        self._map_check.compare(known, has_map=self._wheel_map is not None)
        if known.reason and not self._uses_map_anywhere:
            return _WindowSlip(None, 0.0, known.reason)
        count = self._kinematics.wheel_count
        if known.reason:
            return _WindowSlip((self._surface.slip,) * count, self._surface.drift_rad, known.reason)
        return _WindowSlip((known.slip,) * count, known.drift_rad, "")

    def _slip_by_excitation(
        self, increment: BodyIncrement, gyro_rate_rad_s: float | None
    ) -> _WindowSlip | None:
        if self.excited is None:
            return None
        rate_rad_s = increment.turn_rad / increment.duration_s
        in_place = self.excited.in_place
        if in_place is not None and in_place.is_turning:
            in_place.take(increment.duration_s, rate_rad_s, gyro_rate_rad_s)
            self.excited.excitation.start_window()
            return _WindowSlip((0.0,) * self._kinematics.wheel_count, 0.0, in_place.reason)
        response = self.excited.excitation.step(
            increment.duration_s, rate_rad_s, gyro_rate_rad_s, self._gyro_after_s()
        )
        if response is None:
            return None
        x_m, y_m, turn_rad = self._kinematics.body_motion(self._window_rad)
        known = self._slip_by_excited_force(x_m, y_m, turn_rad)
        found = self.excited.take(response, complex(x_m, y_m), self._window_force_n(x_m, y_m), known)
        if self.excited.reading is not None:
            self._windows.add(self._efforts.positions_ns, *self.excited.reading)
        if found.source is SlipSource.EXCITATION:
            self._ground.learn(found.slip)
        if self._is_measured_by_fixes():
            return _WindowSlip((0.0,) * self._kinematics.wheel_count, 0.0, found.reason or MEASURED_BY_FIXES)
        if found.source is not SlipSource.EXCITATION:
            return _WindowSlip((found.slip,) * self._kinematics.wheel_count, 0.0, found.reason)
        missing_rad_s = (1.0 - found.slip) * response.wheel_rate_rad_s - response.gyro_rate_rad_s
        slips = share_slip(self._kinematics, self._window_rad, found.slip, missing_rad_s * self._window_s)
        return _WindowSlip(slips, self.excited.drift_rad, "")

    def _is_measured_by_fixes(self) -> bool:
        """Return whether the newest fix is recent."""
        if self._fix_ns is None:
            return False
        return seconds(self._efforts.positions_ns - self._fix_ns) < EFFORT.fixes.absent_s

    def _window_force_n(self, x_m: float, y_m: float) -> float | None:
        """Return the mean drive force in the open window; None where currents or travel do not give it."""
        distance_m = math.hypot(x_m, y_m)
        if self._window_work_j is None or distance_m < EFFORT.excitation.least_distance_m:
            return None
        return self._window_work_j / distance_m

    def _slip_by_excited_force(self, x_m: float, y_m: float, turn_rad: float) -> KnownSlip | None:
        """Return the slip by the drive force of the open window; None where currents are not to be used.

        With the excitation each set-point falls below the speed four times in a second. Where the sign of a
        current is then unknown, it is taken to drive the wheel: on average the motors hardly brake.
        """
        if not (self._settings.known_surfaces or self._settings.learn):
            return None
        if self._window_work_j is not None:
            travel = Travel(self._window_s, x_m, y_m, turn_rad, self._window_work_j)
            self._ground.step(self._tracker.force_window(travel))
        return self._ground.known

    def _gyro_after_s(self) -> float:
        """Return by how much the gyro's time stamp is after that of the wheels."""
        return 0.0 if self._gyro_ns is None else seconds(self._gyro_ns - self._efforts.positions_ns)

    def _wheel_slip(self, wheel: int, elapsed_s: float, set_speed_rad_s: float) -> WheelSlip:
        effort = self._efforts.newest[wheel]
        slip, reason = self._found_slip(wheel)
        if self._owners.reason and self.excited is None:
            slip, reason = None, self._owners.reason
        if self._stuck.check(wheel, effort, elapsed_s, set_speed_rad_s):
            slip, reason = 1.0, "stuck"
        elif slip is not None:
            self._held[wheel] = slip
        else:
            share = elapsed_s / (EFFORT.hold.hold_s + elapsed_s)
            self._held[wheel] += (self._prior_slip - self._held[wheel]) * share
            slip = self._held[wheel]
        return WheelSlip(
            current_a=effort.current_a,
            paper_torque_nm=effort.paper_torque_nm,
            wheel_torque_nm=effort.wheel_torque_nm,
            slip=slip,
            valid=not reason,
            reason=reason,
        )

    def _found_slip(self, wheel: int) -> tuple[float | None, str]:
        """Return the slip by the map in use, None where it gives none, and why it is not valid."""
        if self._wheel_map is not None:
            effort = self._efforts.newest[wheel]
            found = wheel_slip(self._wheel_map, effort)
            reason = found.reason or self._map_check.problem or self._direction_problem()
            is_usable = not effort.flags and (self._uses_map_anywhere or not self._map_check.problem)
            return (found.slip if is_usable else None), reason
        slips = self._window_slip.slips
        return (None if slips is None else slips[wheel]), self._window_slip.reason

    def _direction_problem(self) -> str:
        """Return why a wheel map does not hold for this direction of travel; else empty."""
        x_m_s, y_m_s, _ = self._kinematics.body_motion(
            [effort.speed_rad_s for effort in self._efforts.newest]
        )
        if math.hypot(x_m_s, y_m_s) < EFFORT.hold.least_speed_m_s:
            return ""
        return direction_problem(self._settings.maps.surfaces.directions_rad, math.atan2(y_m_s, x_m_s))
