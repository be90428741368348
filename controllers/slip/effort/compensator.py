"""Slip of each wheel from its effort, and the motion of the body that is left of what the wheels turned."""

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from controllers.estimation.odometry import BodyIncrement
from controllers.motion.kinematics import BodyMotion, Kinematics
from controllers.settings import OmniRoverSettings
from controllers.slip.effort.motor_model import SLOWEST_RAD_S, EffortFlag, EffortObserver, WheelEffort
from controllers.slip.effort.settings import YAW_PROBE, SlipSettings
from controllers.slip.effort.slip_map import wheel_slip
from controllers.slip.effort.slip_sharing import share_slip
from controllers.slip.effort.stuck_wheels import StuckWheels
from controllers.slip.effort.surface_map import NO_TRAVEL, SurfaceTracker, Travel
from controllers.slip.effort.travel_range import direction_problem
from controllers.slip.effort.yaw_excitation import YawProbe, range_problem, slip_of
from drivers.samples import WheelSample

HOLD_S = 1.0
"""A slip that can no longer be found decays to that of the surface with this time constant."""

LEAST_SPEED_M_S = 0.02
"""Slower travel has no direction."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelSlip:
    """Effort and slip of one wheel.

    Attributes:
        current_a: Signed, filtered.
        paper_torque_nm: M of paper 003, at the motor.
        wheel_torque_nm: Torque at the wheel.
        slip: Slip ratio that the odometry uses, -1 to 1.
        valid: False where the slip is held, or beyond what the map was fitted to.
        reason: Why it is not valid; empty where it is.
    """

    current_a: float
    paper_torque_nm: float
    wheel_torque_nm: float
    slip: float
    valid: bool
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class SlipReport:
    """Slip of all wheels.

    Attributes:
        map: Name of the map in use.
        surface: The recognised surface; None where it is unknown.
        drift_rad: How far the true course is taken to lie to the left of the encoders' one.
        wheels: One after the other.
    """

    map: str
    surface: str | None
    drift_rad: float
    wheels: tuple[WheelSlip, ...]


class _Judgement(NamedTuple):
    """Slips of the wheels; None where they can only be held. Valid where `reason` is empty."""

    slips: tuple[float, ...] | None
    drift_rad: float
    reason: str


class SlipCompensator:
    """Turns wheel increments into body increments of a slipping rover.

    Args:
        settings: Maps and which of them to use.
        rover: Geometry of the wheels.
        kinematics: Of the same rover.

    Attributes:
        report: As of the newest increment; None before the first.
        efforts: Of the wheels, alike; empty before the first.
        probe: Shakes the yaw; None where another map is in use.
    """

    def __init__(self, settings: SlipSettings, rover: OmniRoverSettings, kinematics: Kinematics) -> None:
        count = kinematics.wheel_count
        surfaces, probe_map = settings.maps.surfaces, settings.maps.yaw_probe
        if settings.known_surfaces:
            surfaces = surfaces.only(settings.known_surfaces)
        self.report: SlipReport | None = None
        self.efforts: tuple[WheelEffort, ...] = ()
        self.probe = YawProbe(probe_map) if settings.use == YAW_PROBE and probe_map is not None else None
        self._probe_map = probe_map
        self._settings = settings
        self._wheel_map = settings.maps.wheel_maps.get(settings.use)
        self._stuck = StuckWheels(settings.maps.motor, count)
        self._kinematics = kinematics
        self._tracker = SurfaceTracker(surfaces, rover.base_radius_m)
        self._surface = self._tracker.step(NO_TRAVEL)
        self._currents: list[WheelSample | None] = [None] * count
        self._current_ns = [-1] * count
        self._observers: list[EffortObserver] = []
        self._judgement = _Judgement(None, 0.0, "too little way so far")
        self._slips = [self._tracker.prior_slip] * count
        self._held = [self._tracker.prior_slip] * count
        self._window_rad = [0.0] * count
        self._window_s = 0.0
        self._told_m = 0j

    def feed(self, sample: WheelSample, t_ns: int) -> None:
        """Take the current of one wheel as of `t_ns`, unless it is missing, not finite or not newer."""
        if not 0 <= sample.wheel < len(self._currents) or t_ns <= self._current_ns[sample.wheel]:
            return
        if sample.current_a is not None and math.isfinite(sample.current_a):
            self._currents[sample.wheel] = sample
            self._current_ns[sample.wheel] = t_ns

    def body_motion(self, wheel_values: Sequence[float]) -> BodyMotion:
        """Return the body's motion for wheel speeds or angles, by the newest slip."""
        return self._moved(wheel_values, self._slips, self._judgement.drift_rad)

    def _moved(self, wheel_values: Sequence[float], slips: Sequence[float], drift_rad: float) -> BodyMotion:
        rolled = [value * (1.0 - slip) for value, slip in zip(wheel_values, slips, strict=True)]
        x, y, turn = self._kinematics.body_motion(rolled)
        moved = complex(x, y) * cmath.rect(1.0, drift_rad)
        return moved.real, moved.imag, turn

    def compensate(
        self, increment: BodyIncrement, set_speed_rad_s: Sequence[float], gyro_rate_rad_s: float | None
    ) -> BodyIncrement:
        """Return what is left of an increment of rolling wheels.

        Slip is judged at the end of half a second; the difference to what was told meanwhile is made up then.

        Args:
            increment: Of the wheels, as if they rolled.
            set_speed_rad_s: Set-points of the wheels in that time.
            gyro_rate_rad_s: Newest yaw rate of the gyro, less its bias; None without a fresh one.
        """
        self.efforts = tuple(self._observe(increment, set_speed_rad_s))
        made_up_m = self._judge(increment, gyro_rate_rad_s)
        wheels = [
            self._wheel_slip(wheel, increment.duration_s, set_speed_rad_s[wheel])
            for wheel in range(len(self.efforts))
        ]
        self._currents = [None] * len(self._currents)
        self._slips = [wheel.slip for wheel in wheels]
        x_m, y_m, turn_rad = self.body_motion(increment.turned_rad)
        self._window_rad = [sum(pair) for pair in zip(self._window_rad, increment.turned_rad, strict=True)]
        self._window_s += increment.duration_s
        self._told_m += complex(x_m, y_m)
        self.report = SlipReport(
            map=self._settings.use,
            surface=self._surface.surface,
            drift_rad=self._judgement.drift_rad,
            wheels=tuple(wheels),
        )
        return replace(
            increment,
            x_m=x_m + made_up_m.real,
            y_m=y_m + made_up_m.imag,
            turn_rad=turn_rad,
            is_sure=all(
                wheel.valid or self._rests(index, set_speed_rad_s[index])
                for index, wheel in enumerate(wheels)
            ),
        )

    def _rests(self, wheel: int, set_speed_rad_s: float) -> bool:
        """Say whether a wheel map tells nothing of a wheel because it stands as told: it takes no part."""
        is_told_to = abs(set_speed_rad_s) < SLOWEST_RAD_S
        return self._wheel_map is not None and is_told_to and self.efforts[wheel].flags == (EffortFlag.SLOW,)

    def _observe(self, increment: BodyIncrement, set_speed_rad_s: Sequence[float]) -> list[WheelEffort]:
        if not self._observers and all(self._currents):
            self._observers = [
                EffortObserver(self._settings.maps.motor, current_is_signed=sample.current_is_signed)
                for sample in self._currents
                if sample is not None
            ]
        if not self._observers:
            missing = WheelEffort(0.0, 0.0, 0.0, 0.0, (EffortFlag.NO_CURRENT,))
            return [missing] * len(self._currents)
        return [
            observer.step(
                increment.duration_s,
                None if sample is None else sample.current_a,
                turned_rad / increment.duration_s,
                set_rad_s,
            )
            for observer, sample, turned_rad, set_rad_s in zip(
                self._observers, self._currents, increment.turned_rad, set_speed_rad_s, strict=True
            )
        ]

    @property
    def knows_force(self) -> bool:
        """Whether the torques of all wheels are known."""
        return bool(self.efforts) and all(effort.unknown_torque is None for effort in self.efforts)

    def _judge(self, increment: BodyIncrement, gyro_rate_rad_s: float | None) -> complex:
        """Judge surface and slip; return the way to add to what was told since the judgement before."""
        judgement = self._judge_surface(increment)
        if self.probe is not None:
            judgement = self._judge_shake(increment, gyro_rate_rad_s)
        if judgement is None or self._wheel_map is not None:
            return 0j
        self._judgement = judgement
        told_m, window_rad = self._told_m, self._window_rad
        self._told_m, self._window_rad, self._window_s = 0j, [0.0] * len(window_rad), 0.0
        if judgement.slips is None:
            return 0j
        x_m, y_m, _ = self._moved(window_rad, judgement.slips, judgement.drift_rad)
        return complex(x_m, y_m) - told_m

    def _judge_surface(self, increment: BodyIncrement) -> _Judgement | None:
        unknown = next((effort.unknown_work for effort in self.efforts if effort.unknown_work), None)
        if unknown is not None:
            self._tracker.interrupt()
            return _Judgement(None, self._judgement.drift_rad, unknown.value)
        work_j = sum(
            effort.wheel_torque_nm * turned_rad
            for effort, turned_rad in zip(self.efforts, increment.turned_rad, strict=True)
        )
        before = self._surface
        self._surface = self._tracker.step(
            Travel(increment.duration_s, increment.x_m, increment.y_m, increment.turn_rad, work_j)
        )
        if self._surface is before:
            return None
        slips = (self._surface.slip,) * self._kinematics.wheel_count
        return _Judgement(slips, self._surface.drift_rad, self._surface.reason)

    def _judge_shake(self, increment: BodyIncrement, gyro_rate_rad_s: float | None) -> _Judgement | None:
        if self.probe is None or self._probe_map is None:
            return None
        rate_rad_s = increment.turn_rad / increment.duration_s
        shake = self.probe.step(increment.duration_s, rate_rad_s, gyro_rate_rad_s)
        if shake is None:
            return None
        if shake.reason:
            return _Judgement(None, 0.0, shake.reason)
        x_m, y_m, _ = self._kinematics.body_motion(self._window_rad)
        problem = range_problem(self._probe_map, shake.lost, complex(x_m, y_m))
        slip = slip_of(self._probe_map, shake.lost)
        missing_rad_s = (1.0 - slip) * shake.wheel_rate_rad_s - shake.gyro_rate_rad_s
        slips = share_slip(self._kinematics, self._window_rad, slip, missing_rad_s * self._window_s)
        return _Judgement(slips, 0.0, problem)

    def _wheel_slip(self, wheel: int, elapsed_s: float, set_speed_rad_s: float) -> WheelSlip:
        effort = self.efforts[wheel]
        slip, reason = self._found_slip(wheel)
        if self._stuck.check(wheel, effort, elapsed_s, set_speed_rad_s):
            slip, reason = 1.0, "stuck"
        elif slip is not None:
            self._held[wheel] = slip
        else:
            prior = self._tracker.prior_slip if self._surface.surface is None else self._surface.slip
            self._held[wheel] += (prior - self._held[wheel]) * elapsed_s / (HOLD_S + elapsed_s)
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
        """Return the slip that the map tells, None where nothing can be told, and why it is not valid."""
        if self._wheel_map is not None:
            effort = self.efforts[wheel]
            found = wheel_slip(self._wheel_map, effort)
            return (None if effort.flags else found.slip), found.reason or self._direction_problem()
        slips = self._judgement.slips
        return (None if slips is None else slips[wheel]), self._judgement.reason

    def _direction_problem(self) -> str:
        """Say that a map of one wheel was not trained on this direction of travel; else empty."""
        x_m_s, y_m_s, _ = self._kinematics.body_motion([effort.speed_rad_s for effort in self.efforts])
        if math.hypot(x_m_s, y_m_s) < LEAST_SPEED_M_S:
            return ""
        return direction_problem(self._settings.maps.surfaces.directions_rad, math.atan2(y_m_s, x_m_s))
