"""A rover with magnets and bent iron that turns on nearly level ground: truth for the calibration of
compasses.

The earth's field is a vector; the rover's magnets add a vector that turns with it, its iron multiplies the
field by a matrix. The magnetometer counts ten per microtesla, the gyro has scale, bias, walk and noise.
Frames and sentences are packed here, from the data sheets alone. A fluxgate compass shows the direction of
the disturbed horizontal field, damped.
"""

import math
import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

COUNTS_PER_UT = 10.0
STEP_S = 0.02
FLUXGATE_STEPS = 5
REST_S = 2.0


@dataclass(frozen=True, kw_only=True)
class Rover:
    """What disturbs the sensors; fields in uT, angles in deg."""

    horizontal: float = 20.0
    dip: float = 66.0
    magnets: tuple[float, float, float] = (0.0, 0.0, 0.0)
    iron: tuple[tuple[float, float, float], ...] = (
        (1.06, 0.04, 0.01),
        (0.02, 0.95, -0.02),
        (0.0, 0.02, 1.02),
    )
    noise: float = 0.4
    wobble: float = 0.4
    """Tilt of the ground and of the body, standard deviation."""
    gyro_scale: float = 0.012
    gyro_bias: float = 0.15
    gyro_noise: float = 0.08
    gyro_walk: float = 0.003
    fluxgate_noise: float = 0.3
    fluxgate_lag_s: float = 0.45
    turns: int = 3
    rate: float = 0.8


@dataclass(frozen=True)
class Turns:
    """Truth, and what the sensors sent at each time; `yaw` counter-clockwise from east, rad."""

    t_s: Array
    yaw: Array
    frames: list[bytes]
    sentences: list[bytes]


def turn(rover: Rover, seed: int) -> Turns:
    """Return whole turns in both senses, not at a constant rate, between rests."""
    rng = np.random.default_rng(seed)
    yaw: Array = np.asarray(_yaw(rover, rng), np.float64)
    t_s: Array = np.asarray(STEP_S * np.arange(1, len(yaw) + 1), np.float64)
    rate = np.gradient(yaw, STEP_S)
    roll, pitch = (_wobble(len(yaw), rover, rng) for _ in range(2))
    bias = math.radians(rover.gyro_bias) + np.cumsum(
        math.radians(rover.gyro_walk) * math.sqrt(STEP_S) * rng.standard_normal(len(yaw))
    )
    gyro = (
        (1.0 + rover.gyro_scale) * rate
        + bias
        + math.radians(rover.gyro_noise) * rng.standard_normal(len(yaw))
    )
    field = np.array([_field(rover, *angles) for angles in zip(yaw, pitch, roll, strict=True)])
    sensed = field @ np.array(rover.iron).T + np.array(rover.magnets)
    noisy = sensed + rover.noise * rng.standard_normal(sensed.shape)
    frames = [
        _frame(0x52, (0.0, 0.0, each), math.radians(2000.0))
        + _frame(0x53, (tilt_x, tilt_y, 0.3), math.pi)
        + _frame(0x54, tuple(vector * COUNTS_PER_UT), 32768.0)
        for each, tilt_x, tilt_y, vector in zip(gyro, roll, pitch, noisy, strict=True)
    ]
    keep = math.exp(-STEP_S / rover.fluxgate_lag_s)
    slow, sentences = sensed[0, :2], []
    for index, vector in enumerate(sensed[:, :2]):
        slow = keep * slow + (1.0 - keep) * vector
        # The horizontal field points north; forward is x, left is y.
        shown = math.degrees(math.atan2(slow[1], slow[0])) + rover.fluxgate_noise * rng.standard_normal()
        sentences.append(_sentence(shown) if index % FLUXGATE_STEPS == 0 else b"")
    return Turns(t_s, yaw, frames, sentences)


def _yaw(rover: Rover, rng: np.random.Generator) -> Array:
    yaw, parts = rng.uniform(-math.pi, math.pi), []
    rest = int(REST_S / STEP_S)
    parts.append(np.full(rest, yaw))
    for sense in (1.0, -1.0):
        count = int(rover.turns * math.tau / rover.rate / STEP_S)
        rates = sense * rover.rate * (1.0 + 0.15 * np.sin(0.013 * np.arange(count) + rng.uniform(0, 6)))
        ramp = np.minimum(1.0, np.minimum(np.arange(count), np.arange(count)[::-1]) * STEP_S)
        parts.append(yaw + np.cumsum(rates * ramp) * STEP_S)
        yaw = float(parts[-1][-1])
        parts.append(np.full(rest, yaw))
    return np.concatenate(parts)


def _wobble(count: int, rover: Rover, rng: np.random.Generator) -> Array:
    waves = sum(
        math.sqrt(2.0 / 3.0) * np.sin(0.02 * each * np.arange(count) + rng.uniform(0, 6))
        for each in (0.3, 1.1, 2.7)
    )
    return math.radians(rover.wobble) * np.asarray(waves)


def _field(rover: Rover, yaw: float, pitch: float, roll: float) -> Array:
    """Return the earth's field in body axes: x forward, y left, z up, turned about z, then y, then x."""
    about_z = np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]])
    about_y = np.array(
        [[math.cos(pitch), 0, math.sin(pitch)], [0, 1, 0], [-math.sin(pitch), 0, math.cos(pitch)]]
    )
    about_x = np.array([[1, 0, 0], [0, math.cos(roll), -math.sin(roll)], [0, math.sin(roll), math.cos(roll)]])
    north_up = np.array([0.0, rover.horizontal, -rover.horizontal * math.tan(math.radians(rover.dip))])
    found: Array = (about_z @ about_y @ about_x).T @ north_up
    return found


def _frame(kind: int, values: tuple[float, ...], full: float) -> bytes:
    words = [max(-32768, min(32767, round(32768.0 * value / full))) for value in values]
    body = struct.pack("<BBhhhh", 0x55, kind, *words, 0)
    return body + bytes([sum(body) % 256])


def _sentence(heading_deg: float) -> bytes:
    text = f"HCHDM,{round(heading_deg % 360.0, 1) % 360.0:.1f},M"
    check = 0
    for character in text.encode():
        check ^= character
    return f"${text}*{check:02X}\r\n".encode()
