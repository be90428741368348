"""Motion of a rover, and what its wheels turn and steer by: rigid-body geometry without slip."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tests.nature.hidden_machines.machine import Array


@dataclass(frozen=True)
class Wheel:
    """A wheel: place forward and to the left, and whether it steers."""

    x_m: float
    y_m: float
    steers: bool = False


@dataclass(frozen=True)
class Rover:
    """A rover whose fixed wheels are all on the axle through its origin."""

    name: str
    radius_m: float
    wheels: tuple[Wheel, ...]
    least_turn_m: float
    """Smallest radius of a curve; 0: it rotates on the spot."""


ROVERS = (
    Rover("two_wheels", 0.06, (Wheel(0.0, 0.16), Wheel(0.0, -0.16)), 0.0),
    Rover(
        "four_steered",
        0.1,
        tuple(Wheel(x, y, True) for x, y in ((0.3, 0.25), (0.3, -0.25), (-0.3, 0.25), (-0.3, -0.25))),
        0.9,
    ),
    Rover(
        "rocker_bogie",
        0.08,
        (
            Wheel(0.35, 0.3, True),
            Wheel(0.35, -0.3, True),
            Wheel(0.0, 0.32),
            Wheel(0.0, -0.32),
            Wheel(-0.35, 0.3, True),
            Wheel(-0.35, -0.3, True),
        ),
        1.0,
    ),
)
LEG_S, CHANGE_S, SPEED_M_S = 4.0, 1.2, 0.25


def command(rover: Rover, time_s: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return speed and yaw rate: straight and curved legs, ahead and back, with smooth changes."""
    legs = int(time_s[-1] / LEG_S) + 1
    speeds = SPEED_M_S * rng.uniform(0.4, 1.0, legs) * rng.choice([1.0, 1.0, -1.0], legs)
    bends = rng.choice([-1.0, 0.0, 1.0], legs) * rng.uniform(0.4, 1.0, legs)
    sharpest = rover.least_turn_m or 0.4
    speed, bend = _smooth(speeds, time_s), _smooth(bends / sharpest, time_s)
    return speed, speed * bend


def _smooth(values: Array, time_s: Array) -> Array:
    """Return values per leg, standing still at both ends, with changes that take `CHANGE_S`."""
    padded = np.concatenate([[0.0], values, [0.0]])
    result = np.zeros_like(time_s)
    for k, (before, after) in enumerate(pairwise(padded)):
        begin = LEG_S * k + (0.5 if k == 0 else 0.0) - (CHANGE_S if k == values.size else 0.0)
        share = np.clip((time_s - begin) / CHANGE_S, 0.0, 1.0)
        result += (after - before) * 0.5 * (1.0 - np.cos(np.pi * share))
    return result


def path(speed: Array, sideways: Array, rate: Array, dt: float) -> tuple[Array, Array, Array]:
    """Return x, y and yaw from speeds forward and to the left and yaw rate, by the midpoint rule."""
    yaw = np.concatenate([[0.0], np.cumsum(0.5 * dt * (rate[1:] + rate[:-1]))])
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    ahead, left = 0.5 * (speed[1:] + speed[:-1]), 0.5 * (sideways[1:] + sideways[:-1])
    x = np.concatenate([[0.0], np.cumsum(dt * (ahead * np.cos(middle) - left * np.sin(middle)))])
    y = np.concatenate([[0.0], np.cumsum(dt * (ahead * np.sin(middle) + left * np.cos(middle)))])
    return x, y, yaw


def wheel_motion(wheel: Wheel, speed: Array, rate: Array) -> tuple[Array, Array]:
    """Return the speed along the direction of rolling, m/s, and the steering angle, rad."""
    ahead, left = speed - rate * wheel.y_m, rate * wheel.x_m
    if not wheel.steers:
        return ahead, np.zeros_like(ahead)
    moves = np.abs(ahead) > 1e-6
    angle = np.arctan(np.where(moves, left / np.where(moves, ahead, 1.0), 0.0))
    return np.sign(ahead) * np.hypot(ahead, left), angle
