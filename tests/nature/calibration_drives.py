"""Drives of three robots in five kinds of motion, whose wheels are not as described, with and without slip.

It knows nothing of the program. The body moves as commanded; in rotations the wheels roll farther than that
where the ground lets them slip, the more the tighter the rotation is. What is recorded: angles of the wheels
and of the steering, the gyro, and the pose of a marker somewhere on the robot.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STEP_S = 0.002
RECORD = 10
"""Steps of the simulation for a row."""
Leg = tuple[float, float, float]
"""Seconds, ahead in m/s, yaw rate in rad/s; of a robot that steers the yaw rate follows from the speed."""
SPEED_M_S, TURN_RAD_S = 0.25, 0.5


@dataclass(frozen=True, kw_only=True)
class Wheel:
    """Where a wheel stands, which way it rolls, and whether it steers."""

    x_m: float
    y_m: float
    radius_m: float
    direction_rad: float = 0.0
    steers: bool = False


@dataclass(frozen=True, kw_only=True)
class Sensors:
    """How a drive is recorded: noise, marker, delays of pose and steering, gyro."""

    place_sd_m: float = 0.001
    yaw_sd_rad: float = 0.003
    marker: tuple[float, float, float] = (0.0, 0.0, 0.0)
    delay_s: float = 0.0
    steering_delay_s: float = 0.0
    gyro: tuple[float, float] = (1.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Drive:
    """Rows of a drive: times, angles of the wheels and of the steering, gyro, and pose of the marker."""

    kind: str
    t_s: Array
    turned_rad: Array
    steering_rad: Array
    gyro_rad_s: Array
    pose: Array


DIFF = (
    Wheel(x_m=0.0, y_m=0.1, radius_m=0.042),
    Wheel(x_m=0.0, y_m=-0.1, radius_m=0.042),
)
OMNI = tuple(
    Wheel(
        x_m=0.195 * math.cos(math.radians(angle)),
        y_m=0.195 * math.sin(math.radians(angle)),
        radius_m=0.051,
        direction_rad=math.radians(angle + 90.0),
    )
    for angle in (300.0, 60.0, 180.0)
)
TRICYCLE = (Wheel(x_m=0.15, y_m=0.0, radius_m=0.0325, steers=True),)


def legs_of(kind: str, rng: np.random.Generator, seconds: float, *, steers: bool) -> list[Leg]:
    """Return the commands of a kind of motion."""
    speed, turn = SPEED_M_S * float(rng.uniform(0.8, 1.2)), TURN_RAD_S * float(rng.uniform(0.8, 1.2))
    sense = float(rng.choice((-1.0, 1.0)))
    pause, legs = (1.0, 0.0, 0.0), [(1.0, 0.0, 0.0)]
    while sum(leg[0] for leg in legs) < seconds:
        if kind == "straight":
            legs += [(8.0, speed, 0.0), pause]
        elif kind == "circle":
            legs += [(seconds, speed, sense * speed / 0.7)]
        elif kind == "on the spot":
            legs += [(6.0, 0.0, sense * turn), pause]
        elif kind == "square" and not steers:
            legs += [(5.0, speed, 0.0), pause, (0.5 * math.pi / turn, 0.0, sense * turn), pause]
        elif kind == "square":
            legs += [(5.0, speed, 0.0), (0.5 * math.pi * 0.4 / speed, speed, sense * speed / 0.4)]
        else:
            bend = 0.0 if rng.random() < 0.3 else float(rng.uniform(-1.5, 1.5))
            each = speed * float(rng.choice((-1.0, 1.0), p=(0.2, 0.8)))
            legs += [(float(rng.uniform(1.0, 4.0)), each, each * bend)]
            if not steers and rng.random() < 0.3:
                legs += [(2.0, 0.0, float(rng.choice((-1.0, 1.0))) * turn)]
    return [*legs, pause]


def drive(
    wheels: Sequence[Wheel],
    kind: str,
    rng: np.random.Generator,
    *,
    seconds: float = 60.0,
    rotation_slip: float = 0.0,
    along_slip: float = 0.0,
    sensors: Sensors = Sensors(),
) -> Drive:
    """Drive and record.

    Args:
        wheels: The true ones.
        kind: Of the motion.
        rng: For commands and noise.
        seconds: About the length.
        rotation_slip: Share of a rotation on the spot that is lost; of a wide bend less.
        along_slip: Share of the distance that is lost or gained, at most; it wanders about zero.
        sensors: Of the record.
    """
    steers = any(wheel.steers for wheel in wheels)
    legs = legs_of(kind, rng, seconds, steers=steers)
    counts = [round(leg[0] / STEP_S) for leg in legs]
    ahead, turn = (np.repeat([leg[place] for leg in legs], counts) for place in (1, 2))
    ramp = np.ones(round(0.5 / STEP_S)) / round(0.5 / STEP_S)
    ahead, turn = (np.convolve(each, ramp, "same") for each in (ahead, turn))
    t_s = np.arange(len(ahead), dtype=np.float64) * STEP_S
    size_m = max(math.hypot(wheel.x_m, wheel.y_m) for wheel in wheels)
    rims = size_m * np.abs(turn)
    lost = rotation_slip * rims / np.maximum(rims + np.abs(ahead), 1e-9)
    knots_s = np.arange(0.0, t_s[-1] + 16.0, 8.0)
    along = along_slip * np.interp(t_s, knots_s, rng.uniform(-1.0, 1.0, len(knots_s)))
    true_turn, true_ahead = turn * (1.0 - lost), ahead * (1.0 - along)
    yaw = float(rng.uniform(-3.0, 3.0)) + np.concatenate(([0.0], np.cumsum(true_turn)[:-1])) * STEP_S
    middle = yaw + 0.5 * true_turn * STEP_S
    x = np.concatenate(([0.0], np.cumsum(true_ahead * np.cos(middle))[:-1])) * STEP_S
    y = np.concatenate(([0.0], np.cumsum(true_ahead * np.sin(middle))[:-1])) * STEP_S
    turned, steering = np.zeros((len(t_s), len(wheels))), np.zeros((len(t_s), len(wheels)))
    for place, wheel in enumerate(wheels):
        along_x, along_y = ahead - turn * wheel.y_m, turn * wheel.x_m
        if wheel.steers:
            with np.errstate(divide="ignore", invalid="ignore"):
                angle = np.arctan(np.where(np.abs(ahead) > 1e-6, turn * wheel.x_m / ahead, np.nan))
            known = np.flatnonzero(np.isfinite(angle))
            angle = np.interp(np.arange(len(t_s)), known, angle[known])
            steering[:, place] = angle - wheel.direction_rad
            rim = along_x * np.cos(angle) + along_y * np.sin(angle)
        else:
            rim = along_x * math.cos(wheel.direction_rad) + along_y * math.sin(wheel.direction_rad)
        turned[:, place] = np.concatenate(([0.0], np.cumsum(rim)[:-1])) * STEP_S / wheel.radius_m
    rows = np.arange(0, len(t_s), RECORD)
    late = np.maximum(t_s[rows] - sensors.delay_s, 0.0)
    marker_x, marker_y, marker_yaw = sensors.marker
    seen_yaw = np.interp(late, t_s, yaw)
    seen_x = np.interp(late, t_s, x) + marker_x * np.cos(seen_yaw) - marker_y * np.sin(seen_yaw)
    seen_y = np.interp(late, t_s, y) + marker_x * np.sin(seen_yaw) + marker_y * np.cos(seen_yaw)
    noise = rng.normal(0.0, 1.0, (len(rows), 4))
    scale, bias = sensors.gyro
    return Drive(
        kind=kind,
        t_s=t_s[rows],
        turned_rad=turned[rows],
        steering_rad=steering[np.maximum(rows - round(sensors.steering_delay_s / STEP_S), 0)],
        gyro_rad_s=scale * true_turn[rows] + bias + 0.002 * noise[:, 3],
        pose=np.column_stack((seen_x, seen_y, seen_yaw + marker_yaw))
        + noise[:, :3] * (sensors.place_sd_m, sensors.place_sd_m, sensors.yaw_sd_rad),
    )
