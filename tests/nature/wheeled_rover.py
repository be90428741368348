"""Simulated drives of third-party rovers on any wheels: ground truth for what encoders, gyro and poses show.

At every moment the contacts balance inertia and the weight along the slope. Each resists sliding by its load,
in proportion to the speed of sliding while that is small (not to the slip ratio), and at most by friction; it
resists rolling by a constant force. It knows nothing of any model or estimator.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from tests.nature.differential_drive import TICK_RAD, Array, Recorded

ROW_S = 0.02
CREEP_M_S, GRAVITY_M_S2 = 1e-4, 9.81
MOST_ROUNDS, CONVERGED = 60, 1e-7


@dataclass(frozen=True, kw_only=True)
class TrueRover:
    """What a rover is, and where it drives; all but its build is hidden.

    Attributes:
        place_m: Of each wheel, forward and to the left.
        radius_m: Of all wheels, as configured.
        steered: Numbers of the wheels that steer, from 0.
        free: Of those without motor and sensor.
        ahead_m: How far ahead the middle of the wheels is in truth; they carry equal loads.
        grip: Resistance against sliding over load and speed of sliding, 1/(m/s).
        friction: Greatest resistance against sliding over load.
        rolling: Resistance against rolling over load.
        radius_share, first_larger: Error of the radius of all wheels, and of the first one.
        wider: Error of the places of the wheels.
        slope_deg, downhill_deg: Of the ground.
        marker: Place of the poses, and their yaw in rad.
        pose_age_s, gyro_gain, gyro_offset: Of the sensors.
        offset_rad, steering_gain: Zero of the first steering, and true over measured angle of all.
    """

    place_m: tuple[tuple[float, float], ...]
    radius_m: float
    steered: tuple[int, ...] = ()
    free: tuple[int, ...] = ()
    ahead_m: float = 0.0
    grip: float = 125.0
    friction: float = 0.7
    rolling: float = 0.01
    radius_share: float = 0.0
    first_larger: float = 0.0
    wider: float = 0.0
    slope_deg: float = 0.0
    downhill_deg: float = 0.0
    marker: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pose_age_s: float = 0.0
    gyro_gain: float = 1.0
    gyro_offset: float = 0.0002
    offset_rad: float = 0.0
    steering_gain: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Driving:
    """How drives are made.

    Attributes:
        headings: Of their starts: all around, or one.
        turns: To both sides, to the left only, or none.
        speed: Changes, or is the same in a drive (apart from start and end).
        is_reversing: Every second drive goes backwards.
    """

    headings: Literal["all", "one"] = "all"
    turns: Literal["both", "left", "none"] = "both"
    speed: Literal["varied", "constant"] = "varied"
    is_reversing: bool = False


def drive(
    rover: TrueRover, driving: Driving, number: int, rng: np.random.Generator, duration_s: float = 20.0
) -> tuple[Recorded, Array]:
    """Return a drive, and the measured steering angles of all wheels in rad."""
    t_s = ROW_S * np.arange(duration_s / ROW_S)
    ahead, turning = _commands(driving, number, t_s, rng)
    place = np.array(rover.place_m)
    x_m_s = ahead[:, None] - turning[:, None] * place[:, 1]
    y_m_s = turning[:, None] * place[:, 0]
    steered = np.isin(np.arange(len(place)), rover.steered)
    sense = np.where(ahead[:, None] < 0.0, -1.0, 1.0)
    angle = np.where(steered, np.arctan2(sense * y_m_s, sense * x_m_s), 0.0)
    rate = (np.cos(angle) * x_m_s + np.sin(angle) * y_m_s) / rover.radius_m
    true_angle = rover.steering_gain * angle
    true_angle[:, rover.steered[:1]] += rover.offset_rad
    start = rng.uniform(-math.pi, math.pi) if driving.headings == "all" else rng.uniform(-0.1, 0.1)
    twist, yaw = _motion(rover, rate, true_angle, start)
    middle = np.exp(1j * yaw)
    velocity = (twist[:, 0] + 1j * twist[:, 1]) * middle
    way = np.concatenate(([0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * ROW_S)))
    way = way + (rover.marker[0] + 1j * rover.marker[1]) * middle
    seen = t_s - rover.pose_age_s
    pose = np.stack(
        [np.interp(seen, t_s, one) for one in (way.real, way.imag, yaw + rover.marker[2])], axis=1
    )
    angles = np.floor(np.cumsum(rate * ROW_S, axis=0) / TICK_RAD) * TICK_RAD
    angles[:, list(rover.free)] = np.nan
    noise = rng.standard_normal((t_s.size, 4)) * (0.0003, 0.0003, 0.0005, 0.002)
    gyro = rover.gyro_gain * twist[:, 2] + rover.gyro_offset + noise[:, 3]
    recorded = Recorded(t_s=t_s, wheels_rad=angles, gyro_rad_s=gyro, pose=pose + noise[:, :3])
    return recorded, angle


def _commands(driving: Driving, number: int, t_s: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return speed ahead and turn that are commanded."""
    last = float(t_s[-1])
    ramp = np.clip(np.minimum(t_s - 0.6, last - 0.6 - t_s) / 0.8, 0.0, 1.0)
    mean = rng.uniform(0.12, 0.25)
    ahead = np.full(t_s.size, mean)
    if driving.speed == "varied":
        ahead = ahead * (1.0 + 0.35 * np.sin(0.9 * t_s + rng.uniform(0.0, 6.0)))
    if driving.is_reversing and number % 2:
        ahead = -ahead
    turning = rng.uniform(0.2, 0.4) * np.sin(0.7 * t_s + rng.uniform(0.0, 6.0))
    if driving.turns == "left":
        turning = np.abs(turning)
    return ramp * ahead, ramp * (0.0 * turning if driving.turns == "none" else turning)


def _motion(rover: TrueRover, rate: Array, angle: Array, start: float) -> tuple[Array, Array]:
    """Return the motion of the body, shape (n, 3), and its yaw, by implicit steps of a row."""
    place = np.array(rover.place_m) * (1.0 + rover.wider)
    count, load = len(place), 1.0 / len(place)
    middle_m = np.add(place, (rover.ahead_m, 0.0))
    own = np.where(np.arange(count) == 0, 1.0 + rover.first_larger, 1.0)
    rim = rover.radius_m * (1.0 + rover.radius_share) * own * rate
    is_driven = ~np.isin(np.arange(count), rover.free)
    mass = np.diag((1.0, 1.0, float(np.mean(np.sum(place**2, axis=1))))) / (GRAVITY_M_S2 * ROW_S)
    mass[1, 2] = mass[2, 1] = rover.ahead_m * mass[0, 0]
    mass[2, 2] += rover.ahead_m**2 * mass[0, 0]
    weight = math.sin(math.radians(rover.slope_deg))
    yaw, twist = start, np.zeros(3)
    motions, yaws = np.zeros((len(rate), 3)), np.zeros(len(rate))
    for row in range(len(rate)):
        along = np.stack((np.cos(angle[row]), np.sin(angle[row])), axis=1)
        both = np.stack((along, np.stack((-along[:, 1], along[:, 0]), axis=1)), axis=1)
        turned = both[:, :, 1] * middle_m[:, :1] - both[:, :, 0] * middle_m[:, 1:]
        rows = np.concatenate((both, turned[:, :, None]), axis=2)
        downhill = math.radians(rover.downhill_deg) - yaw
        aside = weight * math.sin(downhill)
        turn = twist[2] * ROW_S
        before = np.array((twist[0] + turn * twist[1], twist[1] - turn * twist[0], twist[2]))
        fixed = mass @ before + np.array((weight * math.cos(downhill), aside, rover.ahead_m * aside))
        for _ in range(MOST_ROUNDS):
            speed, last = rows @ twist, twist
            sliding = speed - np.stack((np.where(is_driven, rim[row], speed[:, 0]), np.zeros(count)), axis=1)
            strain = rover.grip * np.linalg.norm(sliding, axis=1) / rover.friction
            grip = load * rover.grip / np.sqrt(1.0 + strain**2)
            resistance = load * rover.rolling / np.sqrt(speed[:, 0] ** 2 + CREEP_M_S**2)
            driving = np.where(is_driven, grip, 0.0)
            size = np.stack((driving + resistance, grip), axis=1)
            matrix = mass + np.einsum("wk,wki,wkj->ij", size, rows, rows)
            twist = np.linalg.solve(matrix, fixed + (driving * rim[row]) @ rows[:, 0])
            if np.abs(twist - last).max() < CONVERGED:
                break
        yaw += twist[2] * ROW_S
        motions[row], yaws[row] = twist, yaw
    return motions, yaws
