"""Renders one drive and writes its files."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .camera import (
    FULL_WELL,
    HIGH,
    JPEG_QUALITY,
    WIDE,
    Rig,
    expose,
    make_dirt,
    make_rig,
    misjudge,
    vignette,
)
from .drives import Drive, make_occluders, sun_direction
from .grounds import TILE, Ground
from .motion import (
    HALF_BASE,
    HALF_TRACK,
    LUG_HEIGHT,
    LUGS,
    RADIUS,
    REAR_LEFT,
    WHEELS,
    WIDTH,
    Motion,
    plan_motion,
    settle,
)
from .render import Light, Map, Renderer
from .trace import describe, press

F64 = NDArray[np.float64]

WHEEL_NOISE = 0.005
GYRO_NOISE_DPS, GYRO_BIAS_DPS = 0.05, 0.1
COMPASS_NOISE_DEG, COMPASS_BIAS_DEG = 0.25, 0.3
MARGIN = 0.15  # metres of ground beyond what the level camera sees


def seen_box(motion: Motion, rig: Rig, times: F64) -> tuple[float, float, float, float]:
    """Return the ground box that the camera sees over the given times."""
    rays = rig.rays()
    border = np.concatenate([rays[0, ::40], rays[-1, ::40], rays[::40, 0], rays[::40, -1], rays[-1:, -1]])
    points = []
    for t in times:
        rotation, place = motion.pose(float(t))
        ways = border @ (rotation @ rig.rotation).T
        eye = place + rotation @ rig.place
        points += [(eye + ways * ((level - eye[2]) / ways[:, 2:]))[:, :2] for level in (-0.04, 0.04)]
    spread = np.concatenate(points)
    low, high = spread.min(0) - MARGIN, spread.max(0) + MARGIN
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def rig_file(rig: Rig, drive: Drive) -> dict[str, Any]:
    """Return the content of rig.json."""
    rays = rig.rays() @ rig.rotation.T
    ground = rig.place[:2] - rays[..., :2] * rig.place[2] / rays[..., 2:]
    middle = ground[:, WIDE // 2]
    return {
        "schema": "rear-camera-rig/1",
        "image": {"width": WIDE, "height": HIGH, "fps": float(drive.fps), "format": "jpg, 8-bit BGR"},
        "camera_matrix": rig.matrix.tolist(),
        "dist_coeffs": {"model": "opencv_brown_k1k2p1p2k3", "values": rig.distortion.tolist()},
        "vehicle_frame": "origin = projection of G on the wheel-contact plane, X forward, Y left, "
        "Z up, metres; angles ccw positive",
        "R_vehicle_camera": rig.rotation.tolist(),
        "t_vehicle_camera": rig.place.tolist(),
        "wheel": {
            "name": "rear_left",
            "contact_point": REAR_LEFT.tolist(),
            "radius_m": RADIUS,
            "width_m": WIDTH,
            "grouser_height_m": LUG_HEIGHT,
            "lug_count": LUGS,
            "steer_deg": 0.0,
        },
        "other_wheels": [
            {"name": name, "contact_point": [a, b, 0.0]}
            for name, (a, b) in WHEELS.items()
            if name != "rear_left"
        ],
        "b_m": HALF_BASE,
        "nominal_speed_mps": drive.speed,
        "ground_view_m": {
            "behind_contact": round(float(REAR_LEFT[0] - middle[:, 0].min()), 2),
            "lateral_about_contact": round(float(np.ptp(ground[HIGH // 4, :, 1])), 2),
        },
        "max_slip_angle_deg": 35.0,
    }


def _table(path: Path, head: str, rows: Sequence[Sequence[object]]) -> None:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(head.split(","))
        writer.writerows(rows)


def _gain(drive: Drive, i: int, plan: F64) -> float:
    """Return the exposure of one frame before any automatic control."""
    if drive.change == "step":
        return float(drive.level * np.prod(plan[: 1 + np.searchsorted([0.3, 0.55, 0.8], i / drive.frames)]))
    if drive.change == "drift":
        return float(drive.level * np.exp(0.5 * np.sin(2 * np.pi * i / drive.frames * 2.3 + plan[0])))
    return drive.level


def write_drive(out: Path, drive: Drive, ground: Ground, seed: int, index: int) -> int:
    """Render a drive into its folder and return the bytes written."""
    rng = np.random.default_rng([seed, index])
    folder = out / drive.name
    (folder / "frames").mkdir(parents=True, exist_ok=True)
    rig = make_rig(rng, drive.height, drive.focal, drive.lateral)
    told = misjudge(rng, rig)
    times = np.arange(drive.frames) / drive.fps
    motion = plan_motion(rng, drive.plan, drive.speed, float(times[-1]), list(drive.yaw), list(drive.drift))
    box = seen_box(motion, rig, np.append(times[::3], times[-1]))
    corner = (int(rng.integers(TILE)), int(rng.integers(TILE)))
    ground_map = Map(ground, box, corner)
    settle(motion, rng, ground_map.smooth_height(), drive.speed)
    if drive.trace:
        press(rng, ground_map.height, ground_map.albedo, box[0], box[1], motion, float(times[-1]))
    light = Light(sun_direction(drive), drive.share)
    occluders = make_occluders(rng, drive, light.sun, box)
    renderer = Renderer(ground_map, rig, light, occluders)
    ground_map.illuminate(light, (renderer.near, renderer.far), drive.contrast)
    dirt = make_dirt(rng, drive.dirt) if drive.dirt else None
    fall_off = vignette()

    middle = 0.5 * (renderer.near + renderer.far)  # metres of ground per pixel
    exposure = drive.blur * middle / drive.speed
    if exposure > 0.95 / drive.fps:
        raise ValueError(f"{drive.name}: the exposure is longer than the frame")
    gains = rng.choice([0.55, 0.7, 1.5, 1.9], 4)
    gains[0] = 1.0
    bias = rng.normal(0, GYRO_BIAS_DPS, 3)
    compass_bias = rng.normal(0, COMPASS_BIAS_DEG)
    telemetry, truth, poses = [], [], []
    auto, theta, size = 1.0, 0.0, 0
    for i, t in enumerate(times.tolist()):
        turn = rng.uniform(0, np.pi)
        shake = (
            rng.uniform(0.7, 1.2) * drive.shake / drive.focal * np.array([np.cos(turn), np.sin(turn), 0.0])
        )
        flow = float(abs(motion.at("forward", t))) * exposure / middle + drive.shake
        samples = 1 + int(np.ceil(flow / 2.0)) if flow > 1 else 1
        seen = renderer.shoot(motion, t, exposure, rig.rotation @ shake, samples)
        gain = _gain(drive, i, gains)
        if drive.change == "auto":
            auto *= (0.75 / float(seen.mean()) / auto) ** 0.25
            gain *= auto
        image = expose(rng, seen, gain, FULL_WELL * drive.wells, dirt, drive.defocus, drive.haze, fall_off)
        name = folder / "frames" / f"{i:06d}.jpg"
        cv2.imwrite(str(name), image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        size += name.stat().st_size

        wheel, x, y = (float(motion.at(n, t)) for n in ("wheel", "x", "y"))
        psi = float(np.degrees(motion.at("psi", t)))
        forward, side, rate = (float(motion.at(n, t)) for n in ("forward", "sideways", "rate"))
        contact = forward - rate * HALF_TRACK
        slip = 1 - contact / wheel if abs(wheel) > 1e-4 else 0.0
        beta = float(np.degrees(np.arctan(side / forward))) if abs(forward) > 1e-3 else 0.0
        length, theta, distance, chord = describe(motion, rig, t, theta)
        marks = (int(length > 0), round(length, 3), round(theta, 4), round(distance, 5), round(chord, 4))
        if not drive.trace:
            marks = (0, -1, 0, -1, 0)
        truth.append(
            (i, round(t, 4), *marks, round(beta, 4), round(slip, 4), round(x, 6), round(y, 6), round(psi, 5))
        )
        rates = motion.body_rates(t) + bias + rng.normal(0, GYRO_NOISE_DPS, 3)
        compass = psi + compass_bias + rng.normal(0, COMPASS_NOISE_DEG)
        telemetry.append(
            (
                i,
                round(t, 4),
                round(wheel * (1 + rng.normal(0, WHEEL_NOISE)), 5),
                round(compass, 3),
                *np.round(rates, 4).tolist(),
            )
        )
        others = [float(motion.at(name, t)) for name in ("z", "psi", "pitch", "roll", "sink")]
        poses.append((i, round(t, 4), *np.round([x, y, *others, wheel], 7).tolist()))

    _table(
        folder / "telemetry.csv",
        "frame,t,wheel_speed_mps,compass_deg,gyro_roll_dps,gyro_pitch_dps,gyro_yaw_dps",
        telemetry,
    )
    _table(
        folder / "truth.csv",
        "frame,t,present,visible_len_m,theta_t_deg,d_t_m,theta_chord_deg,beta_deg,slip,x,y,psi_deg",
        truth,
    )
    _table(folder / "poses.csv", "frame,t,x,y,z,psi_rad,pitch_rad,roll_rad,sinkage_m,wheel_mps", poses)
    (folder / "rig.json").write_text(json.dumps(rig_file(told, drive), indent=1))
    scene = {
        "look": drive.look,
        "effects": drive.effects(),
        "ground": drive.ground,
        "plan": drive.plan,
        "seed": seed,
        "sun_azimuth_elevation_deg": drive.sun,
        "sun_share": drive.share,
        "exposure_s": exposure,
        "metres_per_pixel": [renderer.near, renderer.far],
        "true_R_vehicle_camera": rig.rotation.tolist(),
        "true_t_vehicle_camera": rig.place.tolist(),
        "gyro_bias_dps": bias.tolist(),
        "map_origin_m": box[:2],
        "map_corner_cells": corner,
    }
    (folder / "scene.json").write_text(json.dumps(scene, indent=1))
    return size
