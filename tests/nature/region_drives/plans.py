"""Commands of drives of 10 to 30 m: rectangle, figure eight and random waypoints, after 5 s of standstill."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.nature.region_drives.rovers import Rover

Array = NDArray[np.float64]

STEP_S = 0.01
STANDSTILL_S = 5.0
PAUSE_S = 0.8
RATE_RAD_S = 0.7
ARC_M = 0.8
SHAPES = ("rectangle", "eight", "waypoints")


@dataclass(frozen=True)
class Leg:
    """Commanded velocity of the body for a time."""

    seconds: float
    forward: float = 0.0
    left: float = 0.0
    rate: float = 0.0


def rotation(rover: Rover, angle: float, speed: float) -> list[Leg]:
    """Return a rotation: on the spot between pauses, or an arc where the wheels steer."""
    rate = math.copysign(speed / ARC_M if rover.steers else RATE_RAD_S, angle)
    if rover.steers:
        return [Leg(angle / rate, forward=speed, rate=rate)]
    return [Leg(PAUSE_S), Leg(angle / rate, rate=rate), Leg(PAUSE_S)]


def straight(length: float, speed: float, direction: float = 0.0) -> Leg:
    """Return a straight leg, in a direction of the body."""
    return Leg(length / speed, forward=speed * math.cos(direction), left=speed * math.sin(direction))


def endless(rover: Rover, shape: str, rng: np.random.Generator, speed: float) -> Iterator[Leg]:
    """Yield the legs of a shape without end."""
    side = float(rng.choice((-1.0, 1.0)))
    crabs = rover.name == "omni" and rng.random() < 0.5
    if shape == "rectangle":
        lengths = rng.uniform(1.5, 4.0, 2)
        number = 0
        while True:
            direction = side * 0.5 * math.pi * number if crabs else 0.0
            yield straight(float(lengths[number % 2]), speed, direction)
            if not crabs:
                yield from rotation(rover, side * 0.5 * math.pi, speed)
            number += 1
    if shape == "eight":
        rate = side * speed / rng.uniform(0.8, 1.6)
        while True:
            yield Leg(math.tau / abs(rate), forward=speed, rate=rate)
            rate = -rate
    direction = 0.0
    while True:
        yield straight(float(rng.uniform(1.0, 4.0)), speed, direction)
        angle = float(rng.choice((-1.0, 1.0)) * rng.uniform(0.35, 2.4))
        if crabs:
            direction += angle
            yield Leg(PAUSE_S)
        else:
            yield from rotation(rover, angle, speed)


def commands(rover: Rover, shape: str, rng: np.random.Generator, length_m: float) -> Array:
    """Return body velocities at each step of a drive whose wheels travel a length, shape (n, 3)."""
    speed = float(rng.uniform(0.5, 0.8))
    legs, driven = [Leg(STANDSTILL_S)], 0.0
    for leg in endless(rover, shape, rng, speed):
        moves = math.hypot(leg.forward, leg.left)
        seconds = min(leg.seconds, (length_m - driven) / moves) if moves else leg.seconds
        legs.append(Leg(seconds, leg.forward, leg.left, leg.rate))
        driven += seconds * moves
        if driven >= length_m - 1e-9:
            break
    rows = [[(leg.forward, leg.left, leg.rate)] * round(leg.seconds / STEP_S) for leg in (*legs, Leg(1.0))]
    return np.concatenate([np.array(row).reshape(-1, 3) for row in rows])
