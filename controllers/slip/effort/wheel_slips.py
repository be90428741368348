"""Slip of each wheel: by the map in use, held, or stuck."""

import math
from collections.abc import Sequence

from controllers.motion.body_motion import BodyMotion
from controllers.motion.kinematics import Kinematics
from controllers.slip.effort.current_owners import CurrentOwners
from controllers.slip.effort.excited_slip import RoverSlip
from controllers.slip.effort.ground_knowledge import SlipSource
from controllers.slip.effort.motor_model import EffortFlag
from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.settings import YAW_PROBE, SlipSettings
from controllers.slip.effort.slip_by_surface import SlipBySurface, WindowSlip
from controllers.slip.effort.slip_map import wheel_slip
from controllers.slip.effort.stuck_wheels import StuckWheels
from controllers.slip.effort.travel_range import direction_problem
from controllers.slip.effort.wheel_efforts import WheelEfforts
from controllers.slip.effort.wheel_map_check import travel_slip
from drivers.record import record


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


class WheelSlips:
    """Gives each wheel the slip of a map of single wheels or of the last window.

    A wheel without either holds its slip, which fades to that of the ground; a stuck wheel slips wholly.

    Args:
        settings: Maps and motor.
        kinematics: Of the wheels.
        surface: Slip without any other knowledge, and the map of single wheels.
        efforts: Of the wheels.

    Attributes:
        owners: Whether the currents are those of their wheels.
    """

    def __init__(
        self, settings: SlipSettings, kinematics: Kinematics, surface: SlipBySurface, efforts: WheelEfforts
    ) -> None:
        self._kinematics, self._surface, self._efforts = kinematics, surface, efforts
        self._is_excited = settings.use == YAW_PROBE
        self._directions_rad = settings.maps.surfaces.directions_rad
        self.owners = CurrentOwners(settings.maps.motor)
        self._stuck = StuckWheels(settings.maps.motor, kinematics.wheel_count)
        self._held = [surface.prior_slip] * kinematics.wheel_count

    def find(self, window: WindowSlip, elapsed_s: float, set_speed_rad_s: Sequence[float]) -> list[WheelSlip]:
        """Return the slip of every wheel; to be called once per increment.

        Args:
            window: Slip of the last window.
            elapsed_s: Duration of the increment.
            set_speed_rad_s: Setpoints of the wheels in that time.
        """
        return [
            self._find(wheel, window, elapsed_s, set_speed_rad_s[wheel])
            for wheel in range(len(self._efforts.newest))
        ]

    def are_sure(self, wheels: Sequence[WheelSlip], set_speed_rad_s: Sequence[float]) -> bool:
        """Return whether the slip of every wheel is valid, or the wheel at rest."""
        return all(
            wheel.valid or self._is_at_rest(index, set_speed_rad_s[index])
            for index, wheel in enumerate(wheels)
        )

    def of_rover(
        self, wheels: Sequence[WheelSlip], turned_rad: Sequence[float], moved: BodyMotion
    ) -> RoverSlip:
        """Return the slip of the rover by a map.

        Args:
            wheels: Slip of every wheel.
            turned_rad: Angles that the wheels turned.
            moved: Motion of the body for these angles with that slip.
        """
        known = self._surface.ground.known
        slip = travel_slip(self._kinematics, turned_rad, moved)
        reason = next((one.reason for one in wheels if one.reason not in ("", EffortFlag.SLOW)), "")
        if not reason and not any(one.valid for one in wheels):
            reason = EffortFlag.SLOW.value
        if reason:
            source = SlipSource.HELD if abs(slip) > EFFORT.hold.encoders_below else SlipSource.ENCODERS
            return RoverSlip(slip=slip, sd=1.0, source=source, reason=reason)
        off = 0.0 if self._surface.wheel_map is None else self._surface.map_check.slip - known.slip
        return RoverSlip(slip=slip, sd=math.hypot(known.sd, off), source=known.source, reason="")

    def _find(self, wheel: int, window: WindowSlip, elapsed_s: float, set_speed_rad_s: float) -> WheelSlip:
        effort = self._efforts.newest[wheel]
        slip, reason = self._by_map(wheel, window)
        if self.owners.reason and not self._is_excited:
            slip, reason = None, self.owners.reason
        if self._stuck.check(wheel, effort, elapsed_s, set_speed_rad_s):
            slip, reason = 1.0, "stuck"
        elif slip is not None:
            self._held[wheel] = slip
        else:
            share = elapsed_s / (EFFORT.hold.hold_s + elapsed_s)
            self._held[wheel] += (self._surface.prior_slip - self._held[wheel]) * share
            slip = self._held[wheel]
        return WheelSlip(
            current_a=effort.current_a,
            paper_torque_nm=effort.paper_torque_nm,
            wheel_torque_nm=effort.wheel_torque_nm,
            slip=slip,
            valid=not reason,
            reason=reason,
        )

    def _by_map(self, wheel: int, window: WindowSlip) -> tuple[float | None, str]:
        """Return the slip by the map in use, None where it gives none, and why it is not valid."""
        surface = self._surface
        if surface.wheel_map is not None:
            effort, problem = self._efforts.newest[wheel], surface.map_check.problem
            found = wheel_slip(surface.wheel_map, effort)
            reason = found.reason or problem or self._direction_problem()
            is_usable = not effort.flags and (surface.uses_map_anywhere or not problem)
            return (found.slip if is_usable else None), reason
        return (None if window.slips is None else window.slips[wheel]), window.reason

    def _direction_problem(self) -> str:
        """Return why a wheel map does not hold for this direction of travel; else empty."""
        x_m_s, y_m_s, _ = self._kinematics.body_motion(
            [effort.speed_rad_s for effort in self._efforts.newest]
        )
        if math.hypot(x_m_s, y_m_s) < EFFORT.hold.least_speed_m_s:
            return ""
        return direction_problem(self._directions_rad, math.atan2(y_m_s, x_m_s))

    def _is_at_rest(self, wheel: int, set_speed_rad_s: float) -> bool:
        """Return True for a wheel at rest as commanded; wheel maps do not apply to it."""
        is_commanded = abs(set_speed_rad_s) < EFFORT.motor.slowest_rad_s
        return (
            self._surface.wheel_map is not None
            and is_commanded
            and self._efforts.newest[wheel].flags == (EffortFlag.SLOW,)
        )
