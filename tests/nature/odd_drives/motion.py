"""Rovers and their drives: planned body motion, exact integration, and wheels that slip by some percent.

It knows nothing of any estimator: body velocities are planned, the pose is their integral, and each rim is
faster than its ground by the slip of its wheel.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEP_S = 0.002
BRAKE_M_S2 = 3.0


@dataclass(frozen=True, kw_only=True)
class Rover:
    """Where the wheels stand (x, y, rolling direction in rad), and what a columns file says of them."""

    wheels: dict[str, tuple[float, float, float]]
    radius_m: float
    speed_m_s: float
    turn: float
    """Greatest yaw rate in rad/s; of a steered rover the greatest curvature in 1/m."""
    description: dict[str, object]
    limit_rad_s: float
    wheelbase_m: float = 0.0
    """Above 0: the front wheel steers."""
    ramp_s: float = 0.4


@dataclass(frozen=True, kw_only=True)
class Leg:
    """Part of a plan; `turn` as in `Rover`."""

    seconds: float
    forward: float = 0.0
    sideways: float = 0.0
    turn: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Drive:
    """True values each `STEP_S`: pose, yaw rate, and for each wheel the angle and speed of its rim."""

    rover: Rover
    t: Array
    pose: Array
    yaw_rate: Array
    angles: Array
    speeds: Array
    steering: Array

    def at(self, values: Array, times: Array) -> Array:
        """Values at other times; those before the start and after the end stay."""
        if values.ndim == 1:
            return np.interp(times, self.t, values)
        return np.stack([np.interp(times, self.t, column) for column in values.T], axis=1)


def _wheels(rover: dict[str, tuple[float, float, float]], radius_m: float) -> dict[str, object]:
    """Return the `[rover]` of wheels at any place."""
    wheels = [{"x_m": x, "y_m": y, "radius_m": radius_m} for x, y, _ in rover.values()]
    return {"kinematics": "wheels", "wheels": wheels}


def differential(radius_m: float, track_m: float, speed_m_s: float) -> Rover:
    """Return a rover with two driven wheels and a castor."""
    places = {"left": (0.0, track_m / 2, 0.0), "right": (0.0, -track_m / 2, 0.0)}
    return Rover(
        wheels=places,
        radius_m=radius_m,
        speed_m_s=speed_m_s,
        turn=0.8,
        description=_wheels(places, radius_m),
        limit_rad_s=12.0,
        ramp_s=max(0.4, 0.75 * speed_m_s),
    )


def four_wheels() -> Rover:
    """Return a rover with four fixed wheels."""
    places = {
        "fl": (0.25, 0.35, 0.0),
        "fr": (0.25, -0.35, 0.0),
        "rl": (-0.25, 0.35, 0.0),
        "rr": (-0.25, -0.35, 0.0),
    }
    return Rover(
        wheels=places,
        radius_m=0.12,
        speed_m_s=0.7,
        turn=0.7,
        description={"kinematics": "skid_steer_4", "wheel_radius_m": 0.12, "track_m": 0.7},
        limit_rad_s=14.0,
        ramp_s=0.6,
    )


def omnidirectional() -> Rover:
    """Return a rover on three omnidirectional wheels."""
    angles = (60.0, 180.0, 300.0)
    places = {
        f"w{index}": (
            0.2 * math.cos(math.radians(angle)),
            0.2 * math.sin(math.radians(angle)),
            math.radians(angle + 90.0),
        )
        for index, angle in enumerate(angles)
    }
    return Rover(
        wheels=places,
        radius_m=0.05,
        speed_m_s=0.4,
        turn=0.7,
        description={
            "kinematics": "omni3",
            "wheel_radius_m": 0.05,
            "base_radius_m": 0.2,
            "wheel_angles_deg": list(angles),
        },
        limit_rad_s=20.0,
    )


def car() -> Rover:
    """Return a car: sensors at both rear wheels, and the steering angle of the middle of the front axle."""
    places = {"rl": (0.0, 0.775, 0.0), "rr": (0.0, -0.775, 0.0)}
    front = {
        "x_m": 2.7,
        "y_m": 0.0,
        "radius_m": 0.31,
        "driven": False,
        "measured": False,
        "steering": {"low_deg": -40, "high_deg": 40},
    }
    rear = [{"x_m": x, "y_m": y, "radius_m": 0.31} for x, y, _ in places.values()]
    return Rover(
        wheels=places,
        radius_m=0.31,
        speed_m_s=8.0,
        turn=0.09,
        description={"kinematics": "wheels", "wheels": [*rear, front]},
        limit_rad_s=110.0,
        wheelbase_m=2.7,
        ramp_s=2.6,
    )


SMALL = differential(0.06, 0.30, 0.42)
LARGE = differential(0.15, 0.60, 0.95)
FOUR = four_wheels()
OMNI = omnidirectional()
CAR = car()


def tour(rover: Rover, rng: np.random.Generator, *, seconds: float, back: bool = False) -> list[Leg]:
    """Return a plan of straights, turns both ways and stops; with a part backwards if `back`."""
    rest = Leg(seconds=rover.ramp_s + float(rng.uniform(1.5, 2.5)))
    legs = [rest]
    is_left = bool(rng.integers(2))
    while sum(leg.seconds for leg in legs) < seconds - 3.0:
        legs += _round(rover, rng, is_left=is_left, back=back)
        is_left = not is_left or bool(rng.random() < 0.3)
    return [*legs, Leg(seconds=rover.ramp_s + 2.0)]


def _round(rover: Rover, rng: np.random.Generator, *, is_left: bool, back: bool) -> list[Leg]:
    """Return a straight, a turn in motion, a stop and, on a rover that can, a turn on the spot."""
    speed = rover.speed_m_s * float(rng.uniform(0.6, 1.0))
    turn = rover.turn * float(rng.uniform(0.5, 1.0)) * (1.0 if is_left else -1.0)
    is_car = rover.wheelbase_m > 0.0
    arc = turn if is_car else turn * 0.6
    legs = [
        Leg(seconds=float(rng.uniform(3.0, 6.0)), forward=speed),
        Leg(seconds=float(rng.uniform(2.5, 5.0)), forward=0.7 * speed, turn=arc),
        Leg(seconds=float(rng.uniform(1.0, 3.0)), forward=speed),
        Leg(seconds=2.0 * rover.ramp_s + float(rng.uniform(0.5, 1.5))),
    ]
    if rover is OMNI:
        legs.append(Leg(seconds=float(rng.uniform(2.0, 4.0)), forward=0.3 * speed, sideways=0.8 * speed))
    if not is_car:
        legs.append(Leg(seconds=float(rng.uniform(1.2, 2.2)), turn=-0.8 * turn))
    if back:
        legs.append(Leg(seconds=float(rng.uniform(4.0, 6.0)), forward=-0.6 * speed, turn=-0.3 * arc))
        legs.append(Leg(seconds=2.0 * rover.ramp_s))
    return legs


def road(rng: np.random.Generator, *, seconds: float, speed_m_s: float) -> list[Leg]:
    """Return a nearly straight road: bends of a kilometre and changes of the lane."""
    legs = [Leg(seconds=1.0)]
    while sum(leg.seconds for leg in legs) < seconds:
        bend = float(rng.uniform(-1.0, 1.0)) / 900.0
        legs.append(Leg(seconds=float(rng.uniform(3.0, 7.0)), forward=speed_m_s, turn=bend))
        legs.append(Leg(seconds=float(rng.uniform(2.0, 4.0)), forward=speed_m_s))
    return legs


def _smooth(values: Array, seconds: float) -> Array:
    """Return the mean over a window, twice: ramps without jumps of the acceleration."""
    width = max(1, round(seconds / STEP_S))
    window = np.ones(width) / width
    for _ in range(2):
        padded = np.pad(values, (width // 2, width - 1 - width // 2), mode="edge")
        values = np.convolve(padded, window, mode="valid")
    return values


def _slip(count: int, wheels: int, mean: float, rng: np.random.Generator) -> Array:
    """Return the slip of each wheel: a constant part, and one that changes within two seconds."""
    decay = math.exp(-0.1 / 2.0)
    coarse = np.empty(math.ceil(count * STEP_S / 0.1) + 2)
    slips = []
    for _ in range(wheels):
        noise = rng.normal(size=coarse.size)
        coarse[0] = noise[0]
        for index in range(1, coarse.size):
            coarse[index] = decay * coarse[index - 1] + math.sqrt(1 - decay**2) * noise[index]
        own = mean * float(rng.uniform(0.85, 1.15))
        fine = np.interp(np.arange(count) * STEP_S, np.arange(coarse.size) * 0.1, coarse)
        slips.append(own * (1.0 + 0.25 * fine))
    return np.stack(slips, axis=1)


def drive(
    rover: Rover, legs: list[Leg], rng: np.random.Generator, *, slip: float | None = None, skip_s: float = 0.0
) -> Drive:
    """Return the drive of a plan.

    `slip` is the mean slip of the wheels, by default 1 to 5 %; the first `skip_s` seconds are not recorded.
    """
    counts = [round(leg.seconds / STEP_S) for leg in legs]
    forward, sideways, turn = (
        np.repeat([getattr(leg, name) for leg in legs], counts) for name in ("forward", "sideways", "turn")
    )
    ramp_s = max(rover.ramp_s, float(np.abs(forward).max()) / BRAKE_M_S2)
    forward, sideways = _smooth(forward, ramp_s), _smooth(sideways, ramp_s)
    turn = _smooth(turn, min(rover.ramp_s, 0.8))
    is_car = rover.wheelbase_m > 0.0
    yaw_rate = turn * forward if is_car else turn
    yaw = float(rng.uniform(-math.pi, math.pi)) + np.concatenate(([0.0], np.cumsum(yaw_rate[:-1]) * STEP_S))
    middle = yaw + yaw_rate * STEP_S / 2
    east = forward * np.cos(middle) - sideways * np.sin(middle)
    north = forward * np.sin(middle) + sideways * np.cos(middle)
    place = rng.uniform(-3.0, 3.0, size=2)
    x = place[0] + np.concatenate(([0.0], np.cumsum(east[:-1]) * STEP_S))
    y = place[1] + np.concatenate(([0.0], np.cumsum(north[:-1]) * STEP_S))
    rims = np.stack(
        [
            (forward - yaw_rate * wheel_y) * math.cos(angle)
            + (sideways + yaw_rate * wheel_x) * math.sin(angle)
            for wheel_x, wheel_y, angle in rover.wheels.values()
        ],
        axis=1,
    )
    mean = float(rng.uniform(0.01, 0.05)) if slip is None else slip
    speeds = rims * (1.0 + _slip(len(forward), rims.shape[1], mean, rng)) / rover.radius_m
    angles = np.concatenate((np.zeros((1, rims.shape[1])), np.cumsum(speeds[:-1], axis=0) * STEP_S))
    kept = slice(round(skip_s / STEP_S), None)
    angles = angles[kept] - angles[kept][0]
    return Drive(
        rover=rover,
        t=np.arange(len(angles), dtype=np.float64) * STEP_S,
        pose=np.stack((x, y, yaw), axis=1)[kept],
        yaw_rate=yaw_rate[kept],
        angles=angles,
        speeds=speeds[kept],
        steering=np.arctan(turn * rover.wheelbase_m)[kept],
    )
