"""A slip compensator fed by hand."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from controllers.estimation.wheels.odometry import BodyIncrement
from controllers.motion.kinematics import OmniKinematics
from controllers.slip.effort.compensator import EffortCompensator, SlipReport
from controllers.slip.effort.gyro_response import GyroResponse
from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.settings import SlipSettings
from controllers.slip.effort.surface_map import TOO_SLOW, TURNING
from drivers.samples import PoseFixSample, WheelSample
from tests.controllers.simulated import OMNI, ROLES
from tests.controllers.slip_maps import ALL_AROUND, make_maps

PERIOD_S = 0.02
KINEMATICS = OmniKinematics(OMNI)
PRIOR = 0.3
"""Mean of the two surfaces, 0.1 and 0.5."""
GROUND_REASONS = ("", "too little way so far", "surface not yet recognised", TURNING, TOO_SLOW)
BOTH = ("firm", "soft")


@dataclass
class Bench:
    """A compensator fed by hand.

    Attributes:
        use: Which map.
        is_signed: What the current sensors tell.
        unknown_ground: What is used on unknown ground; every wheel has a reason there.
        learn: Whether slip over force is learned.
        rest_s: How long the excitation may rest.
        fixes: Devices that measure the pose.
        slip_per_a: Of the wheel map.
        way: Sum of what it told, x + i y.
    """

    use: str = "surfaces"
    is_signed: bool = True
    drift_rad: float = 0.0
    directions_rad: tuple[float, ...] = ALL_AROUND
    known: tuple[str, ...] = ()
    unknown_ground: Literal["encoders", "map"] = "encoders"
    learn: bool = False
    rest_s: float = 0.0
    fixes: tuple[str, ...] = ()
    slip_per_a: float = 0.5
    gyro_response: GyroResponse | None = None
    t_ns: int = 0
    way: complex = 0j
    told: BodyIncrement = field(init=False)

    def __post_init__(self) -> None:
        maps = make_maps(self.drift_rad, self.directions_rad, self.slip_per_a)
        slip = SlipSettings(
            maps=maps,
            use=self.use,
            known_surfaces=self.known,
            gyro_response=self.gyro_response,
            unknown_ground=self.unknown_ground,
            learn=self.learn,
            excitation_rest_s=self.rest_s,
        )
        self.slip = EffortCompensator(slip, OMNI, KINEMATICS, replace(ROLES, fixes=self.fixes))

    @property
    def report(self) -> SlipReport:
        report = self.slip.report()
        assert report is not None
        return report

    def step(
        self,
        speeds: Sequence[float],
        currents: Sequence[float | None],
        *,
        set_points: Sequence[float] | None = None,
        gyro_rate_rad_s: float | None = None,
    ) -> SlipReport:
        """Turn the wheels for one period."""
        self.t_ns += round(PERIOD_S * 1e9)
        for wheel, current_a in enumerate(currents):
            self.slip.feed(
                WheelSample(
                    device="wheels",
                    t_ns=self.t_ns,
                    wheel=wheel,
                    position_rad=0.0,
                    current_a=current_a,
                    current_is_signed=self.is_signed,
                ),
                self.t_ns,
            )
        turned = tuple(speed * PERIOD_S for speed in speeds)
        x_m, y_m, turn_rad = KINEMATICS.body_motion(turned)
        increment = BodyIncrement(x_m=x_m, y_m=y_m, turn_rad=turn_rad, duration_s=PERIOD_S, turned_rad=turned)
        self.told = self.slip.compensate(
            increment, speeds if set_points is None else set_points, gyro_rate_rad_s
        )
        self.way += complex(self.told.x_m, self.told.y_m)
        return self.report

    def fix(self, x_m: float) -> None:
        """Take a pose fix of now, on the x axis."""
        sample = PoseFixSample(
            device="overhead",
            t_ns=self.t_ns,
            x_m=x_m,
            y_m=0.0,
            yaw_rad=0.0,
            position_std_m=0.003,
            yaw_std_rad=0.01,
            t_capture_ns=self.t_ns,
        )
        self.slip.feed(sample, self.t_ns)

    def drive(
        self,
        force_n: float,
        duration_s: float,
        *,
        direction_rad: float = 0.4,
        speed_m_s: float = 0.2,
        fault: dict[int, float | None] | None = None,
    ) -> SlipReport:
        """Go straight against a force; `fault` replaces the currents of some wheels."""
        speeds = wheel_speeds(direction_rad, speed_m_s)
        currents: list[float | None] = list(currents_for(force_n, direction_rad, speeds))
        for wheel, current_a in (fault or {}).items():
            currents[wheel] = current_a
        if not self.is_signed:
            currents = [None if each is None else abs(each) for each in currents]
        for _ in range(round(duration_s / PERIOD_S)):
            report = self.step(speeds, currents)
        return report


def line_bench(*, is_signed: bool = True) -> Bench:
    """Return a bench with the wheel map, which it uses on every ground."""
    return Bench(use="line", is_signed=is_signed, unknown_ground="map")


def own_reasons(report: SlipReport) -> list[str]:
    """Return why the wheels are not valid, for reasons other than the ground."""
    return ["" if wheel.reason in GROUND_REASONS else wheel.reason for wheel in report.wheels]


def wheel_speeds(direction_rad: float, speed_m_s: float) -> tuple[float, ...]:
    return KINEMATICS.wheel_speeds(
        speed_m_s * math.cos(direction_rad), speed_m_s * math.sin(direction_rad), 0.0
    )


def currents_for(force_n: float, direction_rad: float, speeds: Sequence[float]) -> list[float]:
    """Return the currents with which the wheels push with `force_n` in the direction of travel."""
    angles = np.radians(OMNI.wheel_angles_deg)
    along = np.cos(direction_rad) * -np.sin(angles) + np.sin(direction_rad) * np.cos(angles)
    motor = make_maps().motor
    dry_nm = motor.coulomb_torque_nm * np.clip(np.array(speeds) / EFFORT.motor.slowest_rad_s, -1.0, 1.0)
    torque_nm = OMNI.wheel_radius_m * 2.0 / 3.0 * force_n * along
    found: list[float] = ((torque_nm / motor.gear_ratio + dry_nm) / motor.torque_constant_nm_a).tolist()
    return found
