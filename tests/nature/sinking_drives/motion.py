"""The rover's motion: wheel speed, slip, sinkage, drift and turn, integrated finely."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

F64 = NDArray[np.float64]

STEP = 1.0 / 240.0  # integration step, seconds
HALF_BASE, HALF_TRACK = 0.325, 0.225  # wheel contacts from the centre, metres
RADIUS, WIDTH, LUGS, LUG_HEIGHT = 0.092, 0.11, 24, 0.01
REAR_LEFT = np.array([-HALF_BASE, HALF_TRACK, 0.0])
WHEELS = {
    "front_left": (HALF_BASE, HALF_TRACK),
    "front_right": (HALF_BASE, -HALF_TRACK),
    "rear_left": (-HALF_BASE, HALF_TRACK),
    "rear_right": (-HALF_BASE, -HALF_TRACK),
}
SINK_LEAST, SINK_GROWTH = 0.005, 0.015  # sinkage 5 mm without slip, 20 mm at full slip
SINK_TRAVEL = 0.06  # wheel travel over which sinkage follows slip, metres
RAMP = 0.9  # seconds that a change of slip or speed takes

# A plan is one letter per stretch of equal duration.
BANDS = {
    "A": (0.03, 0.27),
    "B": (0.33, 0.52),
    "C": (0.6, 0.86),
    "D": (0.92, 0.985),
    "R": (1.1, 1.45),
    "S": (1.0, 1.0),
    "b": (0.03, 0.2),
    "0": (0.0, 0.0),
}


@dataclass
class Motion:
    """Fine samples of the motion; t = 0 is the first frame, earlier samples are its history."""

    t: F64
    wheel: F64  # true wheel speed, m/s
    slip: F64
    x: F64
    y: F64
    psi: F64  # heading, rad
    rate: F64  # yaw rate, rad/s
    forward: F64  # velocity of the origin in the vehicle frame
    sideways: F64
    sink: F64
    z: F64  # height of the contact plane
    pitch: F64
    roll: F64

    def at(self, name: str, t: float | F64) -> F64:
        """Interpolate one quantity."""
        return np.asarray(np.interp(t, self.t, getattr(self, name)))

    def pose(self, t: float) -> tuple[F64, F64]:
        """Return rotation and position of the vehicle in the world at one time."""
        angles = [float(self.at(n, t)) for n in ("psi", "pitch", "roll")]
        place = np.array([float(self.at(n, t)) for n in ("x", "y", "z")])
        return Rotation.from_euler("ZYX", angles).as_matrix(), place

    def body_rates(self, t: float, half: float = 0.005) -> F64:
        """Return the angular velocity in the vehicle frame, deg/s."""
        before, after = self.pose(t - half)[0], self.pose(t + half)[0]
        turn = Rotation.from_matrix(before.T @ after).as_rotvec(degrees=True)
        return np.asarray(turn / (2 * half))


def _follow(t: F64, values: list[float], duration: float) -> F64:
    """Hold each value over an equal share of the drive, with smooth steps between."""
    out = np.full_like(t, values[0])
    share = duration / len(values)
    for i in range(1, len(values)):
        s = np.clip((t - (i * share - RAMP / 2)) / RAMP, 0.0, 1.0)
        out += (values[i] - values[i - 1]) * (s * s * (3 - 2 * s))
    return out


def plan_motion(
    rng: np.random.Generator,
    plan: str,
    speed: float,
    duration: float,
    yaw: list[float],
    drift_deg: list[float],
) -> Motion:
    """Integrate the planar motion of one drive; attitude and height are settled later."""
    history = max(4.0, 1.5 / speed)
    t = np.arange(-history, duration + 1.0, STEP)
    slips: list[float] = []
    factors: list[float] = []
    for letter in plan:
        slips.append(float(rng.uniform(*BANDS[letter])) if letter != "0" else (slips or [0.1])[-1])
        factors.append({"0": 0.0, "b": -0.8}.get(letter, 1.0))
    slip = _follow(t, slips, duration)
    early = t < -1.5  # the rover came with little slip, so that a trace lies behind it
    slip = np.where(early, 0.1 + (slip - 0.1) * np.clip((t + 2.5), 0, 1), slip)
    swing = sum(rng.normal(0, 0.01) * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (0.13, 0.31))
    wheel = speed * _follow(t, factors, duration) * (1 + swing)
    wave = 0.03 * np.sin(2 * np.pi * 0.23 * t + rng.uniform(0, 6))
    wave *= np.interp(np.abs(slip - 1.0), [0.0, 0.15], [0.0, 1.0])
    slip = np.where(slip < 1, np.clip(slip + wave, 0.0, None), slip)
    contact = wheel * (1 - slip)
    contact[np.abs(contact) < 1e-6] = 0.0
    moving = np.clip(np.abs(contact) / (0.3 * speed), 0, 1)
    rate = _follow(t, yaw, duration) * moving * np.clip(t + 1.0, 0, 1)
    forward = contact + rate * HALF_TRACK
    drift = np.radians(_follow(t, drift_deg, duration)) * np.clip(t + 1.5, 0, 1)
    sideways = forward * np.tan(drift)
    psi0 = rng.normal(0, 0.02)
    psi = psi0 + np.concatenate([[0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * STEP)])
    psi -= np.interp(0.0, t, psi) - psi0
    vx = forward * np.cos(psi) - sideways * np.sin(psi)
    vy = forward * np.sin(psi) + sideways * np.cos(psi)
    x = np.concatenate([[0], np.cumsum(0.5 * (vx[1:] + vx[:-1]) * STEP)])
    y = np.concatenate([[0], np.cumsum(0.5 * (vy[1:] + vy[:-1]) * STEP)])
    x -= np.interp(0.0, t, x)
    y -= np.interp(0.0, t, y)
    aim = SINK_LEAST + SINK_GROWTH * np.clip(slip, 0, 1)
    sink = np.empty_like(t)
    level = aim[0]
    for i in range(len(t)):
        level += (aim[i] - level) * min(1.0, abs(wheel[i]) * STEP / SINK_TRAVEL)
        sink[i] = level
    zero = np.zeros_like(t)
    return Motion(t, wheel, slip, x, y, psi, rate, forward, sideways, sink, zero, zero, zero)


def settle(
    motion: Motion, rng: np.random.Generator, height_at: Callable[[F64, F64], F64], speed: float
) -> None:
    """Let the body follow the ground under its four wheels, sink, and shake a little."""
    c, s = np.cos(motion.psi), np.sin(motion.psi)
    under = {}
    for name, (a, b) in WHEELS.items():
        under[name] = height_at(motion.x + a * c - b * s, motion.y + a * s + b * c)
    front = 0.5 * (under["front_left"] + under["front_right"])
    rear = 0.5 * (under["rear_left"] + under["rear_right"])
    left = 0.5 * (under["front_left"] + under["rear_left"])
    right = 0.5 * (under["front_right"] + under["rear_right"])
    motion.z = 0.5 * (front + rear) - motion.sink
    motion.pitch = np.arctan((rear - front) / (2 * HALF_BASE))
    motion.roll = np.arctan((left - right) / (2 * HALF_TRACK))
    turning = np.clip(np.abs(motion.wheel) / speed, 0, 1)
    for name in ("pitch", "roll"):
        shake = sum(
            np.radians(rng.normal(0, 0.015)) * np.sin(2 * np.pi * f * motion.t + rng.uniform(0, 6))
            for f in rng.uniform(0.8, 4.0, 5)
        )
        setattr(motion, name, getattr(motion, name) + turning * shake)
