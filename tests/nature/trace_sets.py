"""Draws of drives for `trace_drive`: cameras and wheels of many sizes, and the motion of each set."""

import math

import cv2
import numpy as np

from tests.nature.trace_drive import (
    FRAMES_HZ,
    LEAD_M,
    LOWEST_RAY,
    RATE_HZ,
    SETS,
    SPARSE_STEP_M,
    Camera,
    Drive,
    Floats,
    Motion,
    Wheel,
    turned,
)

LARGEST_THETA_RAD = math.radians(20)
SECONDS = {"field_1": 60.0, "field_2": 60.0, "sparse": 120.0}


def make_drive(name: str, seed: int, seconds: float | None = None) -> Drive:
    """Return the drive of a set with this seed; `seconds` is its length, its own where None."""
    rng = np.random.default_rng([seed, SETS.index(name), 4711])
    wheels = _wheels(rng)
    speed = 0.08 if name == "sparse" else float(rng.uniform(0.05, 0.12))
    rate = speed / SPARSE_STEP_M if name == "sparse" else FRAMES_HZ
    under_way = bool(rng.random() < 0.5)
    seconds = SECONDS.get(name, 25.0) if seconds is None else seconds
    lead = round((LEAD_M / speed if under_way else 0.0) * RATE_HZ)
    period = RATE_HZ / rate
    steps = tuple(round(lead + period * k) for k in range(int(seconds * rate)))
    motion = _motion(name, wheels[0], speed, steps[-1] + 1, rng)
    gain = np.clip(1 + 0.12 * _slow(len(steps), 25, rng), 0.7, 1.35)
    for _ in range(len(steps) // 15 if name == "drop_out" else 0):
        first, count = int(rng.integers(8, max(len(steps) - 4, 9))), int(rng.integers(1, 4))
        gain[first : first + count] = rng.choice([0.0, 0.03, 0.45, 1.7, 7.0])
    return Drive(
        name=name,
        seed=seed,
        camera=_camera(wheels[0], rng),
        wheels=wheels,
        motion=motion,
        steps=steps,
        gain=tuple(gain.tolist()),
        nominal_m_s=speed,
        frames_hz=rate,
    )


def _slow(count: int, over: float, rng: np.random.Generator) -> Floats:
    """Return noise of unit variance that changes over so many steps: cosines of random phase."""
    waves = rng.uniform(0.3, 1.0, 6) * 2 * np.pi / (over * 2.5)
    phases = rng.uniform(0, 2 * np.pi, 6)
    steps = np.arange(count)[:, None]
    return np.asarray(np.cos(steps * waves + phases).sum(axis=1) / math.sqrt(3.0), np.float64)


def _wheels(rng: np.random.Generator) -> tuple[Wheel, ...]:
    behind, ahead, half_track = rng.uniform(0.25, 0.36), rng.uniform(0.25, 0.36), rng.uniform(0.19, 0.27)
    steer = float(np.radians(rng.uniform(-6, 6))) if rng.random() < 0.25 else 0.0
    radius, width = float(rng.uniform(0.08, 0.11)), float(rng.uniform(0.085, 0.125))
    lugs, lug_m = int(rng.integers(12, 26)), float(rng.uniform(0.005, 0.012))
    places = {
        "rear_left": (-behind, half_track),
        "front_left": (ahead, half_track),
        "rear_right": (-behind, -half_track),
        "front_right": (ahead, -half_track),
    }
    return tuple(
        Wheel(
            name=name,
            x_m=float(x),
            y_m=float(y),
            radius_m=radius,
            width_m=width,
            lug_count=lugs,
            lug_m=lug_m,
            steer_rad=steer if name.startswith("rear") else 0.0,
        )
        for name, (x, y) in places.items()
    )


def _camera(wheel: Wheel, rng: np.random.Generator) -> Camera:
    """Draw cameras until one sees at least 0.45 m behind the wheel, and not farther than 1.2 m."""
    while True:
        focal = rng.uniform(400, 680)
        tilt, pan, bank = np.radians([rng.uniform(38, 70), rng.normal(0, 3), rng.normal(0, 2)])
        place = np.array([wheel.x_m, wheel.y_m, 0.0])
        place += (rng.uniform(-0.12, 0.08), rng.uniform(-0.12, 0.12), rng.uniform(0.35, 0.75))
        ahead = np.array([-math.cos(tilt), 0.0, -math.sin(tilt)])
        right = np.array([0.0, 1.0, 0.0])
        level = np.stack([right, np.cross(ahead, right), ahead], axis=1)
        about_up, about_axis = (cv2.Rodrigues(np.array([0.0, 0.0, angle]))[0] for angle in (pan, bank))
        k1 = rng.uniform(-0.22, 0.08)
        bent = [k1, rng.uniform(0, 0.06) * (k1 < 0), *rng.normal(0, 6e-4, 2), 0.0]
        matrix = np.array([[focal, 0, rng.normal(319.5, 8)], [0, focal, rng.normal(239.5, 8)], [0, 0, 1]])
        camera = Camera(
            matrix=matrix, distortion=np.array(bent), axes=about_up @ level @ about_axis, place_m=place
        )
        rays = camera.rays(80)
        corners, middle = rays[[0, 0, -1], [0, -1, 4]], rays[3, [0, -1]]
        if (corners[:2, 2] > -LOWEST_RAY * 2).any():
            continue
        far, near = (place[0] - ray[0] / ray[2] * place[2] - wheel.x_m for ray in (corners[0], corners[2]))
        wide = np.ptp(middle[:, 1] / middle[:, 2] * place[2])
        if 0.5 < -far < 1.2 and -near < 0.12 and wide > 0.5:
            return camera


def _theta(name: str, way_m: Floats, rng: np.random.Generator) -> Floats:
    """Return the angle of the watched wheel's velocity along its way, rad."""
    slow = _slow(len(way_m), 0.5 * len(way_m) / max(way_m[-1], 0.1), rng)
    theta = rng.uniform(-6, 6) + 1.2 * slow
    if name == "overlap":
        theta = rng.choice([-1, 1]) * rng.uniform(5, 13) + 1.5 * slow
    if name == "curved":
        swing = rng.uniform(8, 15) * np.sin(2 * np.pi * way_m / rng.uniform(1.2, 2.4) + rng.uniform(0, 6))
        theta = rng.uniform(-4, 4) + swing + slow
    if name == "field_1":
        theta = rng.choice([-1, 1]) * rng.uniform(6, 16) / (1 + np.exp(-(way_m - 2.0) / 0.4)) + slow
    if name == "field_2":
        theta = rng.uniform(6, 14) * np.sin(np.pi * way_m / 1.3) * (np.sin(np.pi * way_m / 2.6) > -0.4) + slow
    return np.asarray(np.clip(np.radians(theta), -LARGEST_THETA_RAD, LARGEST_THETA_RAD), np.float64)


def _hard(name: str, length_m: float, rng: np.random.Generator) -> Floats:
    if name == "no_trace":
        return np.array([[-1e3, 1e3]])
    if name != "drop_out":
        return np.zeros((0, 2))
    starts = np.arange(0.6, length_m + 1.0, 0.9)
    starts += rng.uniform(-0.1, 0.1, len(starts))
    return np.column_stack([starts, starts + rng.uniform(0.08, 0.45, len(starts))])


def _motion(name: str, wheel: Wheel, speed: float, count: int, rng: np.random.Generator) -> Motion:
    """Integrate the watched contact's velocity, and hang the vehicle on it."""
    over_ground = speed * (1 + 0.05 * _slow(count, 2 * RATE_HZ, rng))
    way = np.concatenate([[0.0], np.cumsum((over_ground[1:] + over_ground[:-1]) / (2 * RATE_HZ))])
    theta = _theta(name, way, rng)
    turning = {"curved": 1.2, "field_1": 0.5, "field_2": 0.6}.get(name, 0.3)
    yaw_rate = np.radians(turning * _slow(count, 3 * RATE_HZ, rng))
    yaw = rng.uniform(-np.pi, np.pi) + np.concatenate(
        [[0.0], np.cumsum((yaw_rate[1:] + yaw_rate[:-1]) / (2 * RATE_HZ))]
    )
    forward = np.stack([over_ground, np.zeros(count)], axis=1)
    velocity = turned(forward, yaw + wheel.steer_rad + theta)
    contact = np.concatenate([np.zeros((1, 2)), np.cumsum((velocity[1:] + velocity[:-1]) / (2 * RATE_HZ), 0)])
    lean = math.radians(0.6 if name == "field_2" else 0.3)
    rock = lean * np.stack([_slow(count, 0.6 * RATE_HZ, rng), _slow(count, 0.6 * RATE_HZ, rng)], axis=1)
    rock_rate = np.gradient(rock, 1 / RATE_HZ, axis=0)
    slip = np.clip(0.12 + 0.4 * np.abs(np.sin(theta)) + 0.03 * _slow(count, 3 * RATE_HZ, rng), 0.0, 0.5)
    return Motion(
        origin_m=contact - turned(np.array([wheel.x_m, wheel.y_m]), yaw),
        yaw_rad=yaw,
        rate_rad_s=np.column_stack([rock_rate, yaw_rate]),
        rock_rad=rock,
        theta_rad=theta,
        way_m=way,
        rim_m_s=over_ground * np.cos(theta) / (1 - slip),
        hard_m=_hard(name, float(way[-1]), rng),
    )
