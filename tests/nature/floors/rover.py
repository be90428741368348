"""Python side that all rovers share: set-points that arrive late, the time grid, and the true state.

The integration runs on a fixed grid of steps counted from the start, so how often a caller asks does not
change the result. `truth` carries the place on from the last grid point by less than one step.
"""

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from sim_backends.world.plant import Truth
from tests.nature.floors.machine import (
    BOARD_RATE_HZ,
    NANOSECONDS,
    OMNI_ANGLE_RAD,
    Floats,
    Machine,
    board_voltage,
    centre_motion,
    motor_current,
    supply_voltage,
    wheel_speed,
)
from tests.nature.floors.patchwork import Floor

__all__ = ["Drive", "OmniPlant", "RoverPlant", "drive_wheel", "run_board", "slip_ratio"]

_DRIVING_M_S: Final = 2e-3
"""Below this rim speed slip is no meaningful number."""


class Drive(NamedTuple):
    """State of motors and board, one entry per wheel (`supply_v` has one entry for all)."""

    speed_rad_s: Floats
    angle_rad: Floats
    current_a: Floats
    voltage_v: Floats
    ticks: Floats
    integral_rad: Floats
    target_rad_s: Floats
    supply_v: Floats


@njit(cache=True)
def run_board(machine: Machine, drive: Drive) -> None:
    """Run one period of the board: the battery's voltage, then the speed loop of every motor."""
    drive.supply_v[0] = supply_voltage(machine, drive.voltage_v, drive.current_a, drive.supply_v[0])
    for wheel in range(drive.speed_rad_s.size):
        drive.voltage_v[wheel] = board_voltage(
            machine,
            wheel,
            drive.angle_rad[wheel],
            drive.target_rad_s[wheel],
            drive.supply_v[0],
            drive.ticks,
            drive.integral_rad,
        )


@njit(cache=True)
def drive_wheel(
    machine: Machine, drive: Drive, wheel: int, load_nm: float, friction_nm: float, step_s: float
) -> None:
    """Advance one motor and its wheel by a step."""
    drive.current_a[wheel] = motor_current(
        machine, drive.current_a[wheel], drive.voltage_v[wheel], drive.speed_rad_s[wheel], step_s
    )
    drive.speed_rad_s[wheel] = wheel_speed(
        machine, drive.speed_rad_s[wheel], drive.current_a[wheel], load_nm, friction_nm, step_s
    )
    drive.angle_rad[wheel] += step_s * drive.speed_rad_s[wheel]


def slip_ratio(rim_m_s: float, ground_m_s: float) -> float:
    """Return 1 - v / (r omega) of a driving wheel, 0 of one that stands, coasts or brakes."""
    if abs(rim_m_s) < _DRIVING_M_S:
        return 0.0
    return max(0.0, 1.0 - ground_m_s / rim_m_s)


class RoverPlant(ABC):
    """A rover without its contact law.

    Args:
        floor: The ground and the rover's constants.
        rng: Source of what differs between two runs on one floor.
        start_ns: Time of the start.
        substeps: Steps of integration per period of the board.
        lifted: Whether the rover hangs with its wheels in the air.
        start_yaw_rad: Heading at the start.
    """

    wheel_count: int = 3

    def __init__(
        self,
        floor: Floor,
        rng: np.random.Generator,
        start_ns: int,
        *,
        substeps: int = 4,
        lifted: bool = False,
        start_yaw_rad: float = 0.0,
    ) -> None:
        self.floor = floor
        self.machine = floor.machine
        self._substeps = substeps
        self._lifted = lifted
        self._rate_hz = BOARD_RATE_HZ * substeps
        self._step_s = 1.0 / self._rate_hz
        self._start_ns = start_ns
        self._t_ns = start_ns
        self._steps = 0
        self._late: deque[tuple[int, tuple[float, ...]]] = deque()
        count = self.wheel_count
        speed, angle, current, voltage, ticks, integral, target = np.zeros((7, count))
        self.drive = Drive(
            speed, angle, current, voltage, ticks, integral, target, np.array([self.machine.battery_v])
        )
        com_x_m, com_y_m = self.machine.com_x_m, self.machine.com_y_m
        cosine, sine = math.cos(start_yaw_rad), math.sin(start_yaw_rad)
        self.body = np.array(
            [
                cosine * com_x_m - sine * com_y_m,
                sine * com_x_m + cosine * com_y_m,
                start_yaw_rad,
                0.0,
                0.0,
                0.0,
            ]
        )
        # Where in its turn each wheel starts: nobody sets the wheels before a run.
        self.phase_rad = rng.uniform(0.0, 2.0 * math.pi, count)
        self._prepare()

    @property
    @abstractmethod
    def kinematics(self) -> Floats:
        """Rim speeds (m/s) per body velocity x, y (m/s) and yaw rate (rad/s), if all wheels roll rigidly."""

    @abstractmethod
    def _prepare(self) -> None:
        """Make the state of the contacts, at rest."""

    @abstractmethod
    def _integrate(self, steps: int) -> None:
        """Advance by whole steps with the set-points as they are."""

    def _tilt(self) -> tuple[float, float]:
        """Return roll and pitch; a rover on stiff ground has none."""
        return 0.0, 0.0

    def set_wheel_speeds(self, speed_rad_s: Sequence[float]) -> None:
        """Set the set-points, effective after the rover's delay."""
        if len(speed_rad_s) != self.wheel_count:
            raise ValueError(f"{len(speed_rad_s)} set-points for {self.wheel_count} wheels")
        due_ns = self._t_ns - self._start_ns + round(self.machine.delay_s * NANOSECONDS)
        due_step = -(-due_ns * self._rate_hz // NANOSECONDS)
        self._late.append((due_step, tuple(float(speed) for speed in speed_rad_s)))

    def advance(self, t_ns: int) -> None:
        """Integrate to the last step at or before `t_ns`."""
        if t_ns <= self._t_ns:
            return
        self._t_ns = t_ns
        end = (t_ns - self._start_ns) * self._rate_hz // NANOSECONDS
        while self._late and self._late[0][0] <= end:
            due_step, speed_rad_s = self._late.popleft()
            self._run_to(due_step)
            self.drive.target_rad_s[:] = speed_rad_s
        self._run_to(end)

    def _run_to(self, step: int) -> None:
        if step > self._steps:
            self._integrate(step - self._steps)
            self._steps = step

    def truth(self) -> Truth:
        """Return the true state at the time reached."""
        rest_s = (self._t_ns - self._start_ns) / NANOSECONDS - self._steps * self._step_s
        x_m, y_m, ahead_m_s, left_m_s, yaw_rate_rad_s = centre_motion(self.machine, self.body)
        yaw_rad = float(self.body[2])
        cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
        roll_rad, pitch_rad = self._tilt()
        speed = self.drive.speed_rad_s
        ground = self.kinematics @ np.array([ahead_m_s, left_m_s, yaw_rate_rad_s])
        rim = self.machine.radius_m * speed
        return Truth(
            t_ns=self._t_ns,
            x_m=x_m + rest_s * (cosine * ahead_m_s - sine * left_m_s),
            y_m=y_m + rest_s * (sine * ahead_m_s + cosine * left_m_s),
            yaw_rad=yaw_rad + rest_s * yaw_rate_rad_s,
            roll_rad=roll_rad,
            pitch_rad=pitch_rad,
            velocity_x_m_s=ahead_m_s,
            velocity_y_m_s=left_m_s,
            yaw_rate_rad_s=yaw_rate_rad_s,
            wheel_position_rad=tuple((self.drive.angle_rad + rest_s * speed).tolist()),
            wheel_speed_rad_s=tuple(speed.tolist()),
            motor_current_a=tuple(self.drive.current_a.tolist()),
            slip=tuple(slip_ratio(float(a), float(b)) for a, b in zip(rim, ground, strict=True)),
            battery_v=float(self.drive.supply_v[0]),
            bumper_pressed=False,
        )


class OmniPlant(RoverPlant):
    """A rover of three omnidirectional wheels, still without its contact law."""

    @property
    def kinematics(self) -> Floats:
        """Rim speeds per body velocity; rim direction (-sin a, cos a)."""
        return np.array([[-math.sin(angle), math.cos(angle), self.machine.arm_m] for angle in OMNI_ANGLE_RAD])
