"""What all rovers share: steps of motors, wheels and body, setpoints that arrive late, and the true state.

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
    add_body_force,
    board_voltage,
    centre_motion,
    gear_loss,
    motor_current,
    static_load,
    supply_voltage,
    wheel_speed,
)
from tests.nature.floors.patchwork import Floor, Grid, tile_constants

__all__ = [
    "Drive",
    "OmniPlant",
    "Rover",
    "RoverPlant",
    "begin_step",
    "ground_at",
    "ground_under",
    "hub_velocity",
    "push_hub",
    "set_loads",
    "slip_ratio",
    "turn_wheel",
]

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


class Rover(NamedTuple):
    """A rover on a floor as compiled code sees it, without the state of its contacts.

    Attributes:
        body: x, y, yaw of the centre of mass and their rates, in the world frame.
        motion: Centre x, y, velocity ahead and left, yaw rate, cosine and sine of yaw, in this step.
        wrench: Force ahead and left and yaw moment in this step.
        load_n: Of each wheel, and of a castor.
        substeps: Steps per period of the board.
    """

    machine: Machine
    grid: Grid
    drive: Drive
    body: Floats
    motion: Floats
    wrench: Floats
    load_n: Floats
    substeps: int
    step_s: float


@njit(cache=True)
def _run_board(machine: Machine, drive: Drive) -> None:
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
def begin_step(rover: Rover, step: int) -> None:
    """Run the board if its period begins, and set the motion; no force acts yet."""
    if step % rover.substeps == 0:
        _run_board(rover.machine, rover.drive)
    motion = rover.motion
    motion[0], motion[1], motion[2], motion[3], motion[4] = centre_motion(rover.machine, rover.body)
    motion[5], motion[6] = math.cos(rover.body[2]), math.sin(rover.body[2])
    rover.wrench[:] = 0.0


@njit(cache=True)
def turn_wheel(rover: Rover, wheel: int, load_nm: float, sticking: float) -> None:
    """Advance one motor and its wheel by a step.

    Args:
        load_nm: Torque of the ground against positive rotation.
        sticking: Friction of the gear over that of a gear that turns.
    """
    machine, drive, step_s = rover.machine, rover.drive, rover.step_s
    friction_nm = machine.friction_nm * machine.gear_ratio + gear_loss(
        machine, drive.speed_rad_s[wheel], load_nm
    )
    drive.current_a[wheel] = motor_current(
        machine, drive.current_a[wheel], drive.voltage_v[wheel], drive.speed_rad_s[wheel], step_s
    )
    drive.speed_rad_s[wheel] = wheel_speed(
        machine, drive.speed_rad_s[wheel], drive.current_a[wheel], load_nm, friction_nm * sticking, step_s
    )
    drive.angle_rad[wheel] += step_s * drive.speed_rad_s[wheel]


@njit(cache=True)
def ground_at(rover: Rover, at_x_m: float, at_y_m: float) -> Floats:
    """Return the constants of the tile under a place on the rover."""
    motion = rover.motion
    return tile_constants(
        rover.grid,
        motion[0] + motion[5] * at_x_m - motion[6] * at_y_m,
        motion[1] + motion[6] * at_x_m + motion[5] * at_y_m,
    )


@njit(cache=True)
def ground_under(rover: Rover, wheel: int) -> Floats:
    """Return the constants of the tile under an omnidirectional wheel."""
    angle, arm_m = OMNI_ANGLE_RAD[wheel], rover.machine.arm_m
    return ground_at(rover, arm_m * math.cos(angle), arm_m * math.sin(angle))


@njit(cache=True)
def hub_velocity(rover: Rover, wheel: int, arm_m: float) -> tuple[float, float]:
    """Return the velocity of an omnidirectional wheel's hub along its rim and along its axle."""
    cosine, sine = math.cos(OMNI_ANGLE_RAD[wheel]), math.sin(OMNI_ANGLE_RAD[wheel])
    motion = rover.motion
    return -sine * motion[2] + cosine * motion[3] + arm_m * motion[4], cosine * motion[2] + sine * motion[3]


@njit(cache=True)
def push_hub(rover: Rover, wheel: int, arm_m: float, along_n: float, across_n: float) -> None:
    """Add the force on an omnidirectional wheel, along its rim and along its axle, to the body's."""
    cosine, sine = math.cos(OMNI_ANGLE_RAD[wheel]), math.sin(OMNI_ANGLE_RAD[wheel])
    add_body_force(
        rover.machine,
        rover.wrench,
        arm_m * cosine,
        arm_m * sine,
        -sine * along_n + cosine * across_n,
        cosine * along_n + sine * across_n,
    )


@njit(cache=True)
def set_loads(rover: Rover, lifted: bool, moment_x_m: float, moment_y_m: float) -> None:
    """Set the loads of three omnidirectional wheels; further arguments as of `static_load`."""
    arm_m = rover.machine.arm_m
    for wheel in range(3):
        cosine, sine = math.cos(OMNI_ANGLE_RAD[wheel]), math.sin(OMNI_ANGLE_RAD[wheel])
        load_n = static_load(rover.machine, arm_m * cosine, arm_m * sine, moment_x_m, moment_y_m)
        rover.load_n[wheel] = 0.0 if lifted else load_n


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
        self.rover = Rover(
            self.machine,
            floor.grid,
            self.drive,
            self.body,
            np.zeros(7),
            np.zeros(3),
            np.zeros(3),
            substeps,
            self._step_s,
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
        """Advance by whole steps with the setpoints as they are."""

    def _tilt(self) -> tuple[float, float]:
        """Return roll and pitch; a rover on stiff ground has none."""
        return 0.0, 0.0

    def set_wheel_speeds(self, speed_rad_s: Sequence[float]) -> None:
        """Set the setpoints, effective after the rover's delay."""
        if len(speed_rad_s) != self.wheel_count:
            raise ValueError(f"{len(speed_rad_s)} setpoints for {self.wheel_count} wheels")
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
