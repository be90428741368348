"""Drives of a rover on two wheels and a castor: truth for what its encoders, its gyro and a camera measure.

Each wheel has a radius of its own; its rim slips in proportion to its share of the resistance. Two rims make
an arc. Downhill the rover creeps in proportion to its speed. The pose is the exact arc of each millisecond.
It knows nothing of any model or estimator.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEP_S = 0.001
ROW_STEPS = 20
TICK_RAD = math.tau / 4096.0


@dataclass(frozen=True, kw_only=True)
class TrueDifferential:
    """What the rover is; the configured numbers, each a little off."""

    radius_m: float = 0.06005
    left_larger: float = 0.0008
    """Radius of the left wheel over that of the right one, less one."""
    track_m: float = 0.3006
    slip: float = 0.001
    gyro_gain: float = 1.0
    gyro_offset: float = 0.0002
    gyro_noise: float = 0.002
    pose_noise_m: float = 0.0003
    pose_noise_rad: float = 0.0005
    pose_age_s: float = 0.0
    creep: tuple[float, float] = (0.0, 0.0)
    """Speed over the speed of travel, along x and y of the ground."""


@dataclass(frozen=True)
class Recorded:
    """A drive at 50 Hz.

    Attributes:
        t_s: Times, shape (n,).
        wheels_rad: Angles of both wheels in whole ticks, left first, shape (n, 2).
        gyro_rad_s: Measured yaw rate.
        pose: Measured x, y, yaw, shape (n, 3).
    """

    t_s: Array
    wheels_rad: Array
    gyro_rad_s: Array
    pose: Array


def record(rover: TrueDifferential, rng: np.random.Generator, *, duration_s: float = 16.0) -> Recorded:
    """Return a drive of random legs: straight lines and arcs to both sides, with rest at both ends."""
    legs = [
        (rng.uniform(0.12, 0.3), rng.choice((0.0, 0.0, 1.0, -1.0)) * rng.uniform(0.3, 0.9))
        for _ in range(math.ceil(duration_s / 2.0))
    ]
    ahead = turning = 0.0
    x, y, yaw = 0.0, 0.0, rng.uniform(-3.0, 3.0)
    angles, rows, past = np.zeros(2), [], []
    for step in range(round(duration_s / STEP_S)):
        t = step * STEP_S
        speed, rate = legs[int(t // 2.0)] if 0.6 < t < duration_s - 0.8 else (0.0, 0.0)
        ahead += STEP_S / 0.15 * (speed - ahead)
        turning += STEP_S / 0.15 * (rate - turning)
        sides = np.array([ahead - 0.15 * turning, ahead + 0.15 * turning]) / 0.06
        angles = angles + STEP_S * sides
        radii = rover.radius_m * np.array([1.0 + rover.left_larger, 1.0]) * (1.0 - rover.slip)
        left, right = (sides * radii).tolist()
        forward, turn = 0.5 * (left + right), (right - left) / rover.track_m
        middle = yaw + 0.5 * turn * STEP_S
        x += STEP_S * (forward * math.cos(middle) + rover.creep[0] * abs(forward))
        y += STEP_S * (forward * math.sin(middle) + rover.creep[1] * abs(forward))
        yaw += STEP_S * turn
        past.append((x, y, yaw))
        if step % ROW_STEPS == 0:
            seen = past[max(0, step - round(rover.pose_age_s / STEP_S))]
            rows.append((t, *np.floor(angles / TICK_RAD), turn, *seen))
    table = np.array(rows)
    noise = rng.standard_normal((len(table), 4))
    sizes = (rover.pose_noise_m, rover.pose_noise_m, rover.pose_noise_rad)
    return Recorded(
        t_s=table[:, 0],
        wheels_rad=table[:, 1:3] * TICK_RAD,
        gyro_rad_s=rover.gyro_gain * table[:, 3] + rover.gyro_offset + rover.gyro_noise * noise[:, 0],
        pose=table[:, 4:] + noise[:, 1:] * sizes,
    )
