"""Check rendered drives: python -m tests.nature.sinking_drives.check --out DIR.

The marker check renders bright dots at known places of the ground and finds them again where
OpenCV projects them from the written poses; it shares no code with the ray casting.  The
other checks read the files of a rendered set.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import tempfile
from collections import defaultdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .drives import Drive
from .grounds import CELL, TILE, Ground
from .write import write_drive

F64 = NDArray[np.float64]

PITCH_CELLS = 128  # between markers
MARKER_SIGMA_CELLS = 4.0
CONTACT = np.array([-0.325, 0.225])  # rear left, as in rig.json


def read(path: Path) -> dict[str, F64]:
    """Read a table by columns."""
    with path.open() as file:
        rows = list(csv.DictReader(file))
    return {key: np.array([float(row[key]) for row in rows]) for key in rows[0]}


def picture(path: Path) -> NDArray[np.uint8]:
    """Read a frame in grey."""
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise FileNotFoundError(path)
    return np.asarray(image, np.uint8)


def true_camera(scene: dict[str, Any], pose: dict[str, F64], i: int) -> tuple[F64, F64]:
    """Return camera-from-world rotation and translation, from plain rotation matrices."""
    a, b, c = pose["psi_rad"][i], pose["pitch_rad"][i], pose["roll_rad"][i]
    about_z = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    about_x = np.array([[1, 0, 0], [0, np.cos(c), -np.sin(c)], [0, np.sin(c), np.cos(c)]])
    body = about_z @ about_y @ about_x
    place = np.array([pose["x"][i], pose["y"][i], pose["z"][i]])
    world_camera = body @ np.array(scene["true_R_vehicle_camera"])
    eye = place + body @ np.array(scene["true_t_vehicle_camera"])
    return world_camera.T, -world_camera.T @ eye


def project(rig: dict[str, Any], camera: tuple[F64, F64], points: F64) -> F64:
    """Project ground points into the image with OpenCV."""
    turn, _ = cv2.Rodrigues(camera[0])
    pixels, _ = cv2.projectPoints(
        points.reshape(-1, 1, 3),
        turn,
        camera[1],
        np.array(rig["camera_matrix"]),
        np.array(rig["dist_coeffs"]["values"]),
    )
    return np.asarray(pixels[:, 0], float)


def marker_ground(relief: float) -> Ground:
    """Return a ground of bright dots on gentle swells."""
    axis = np.arange(TILE, dtype=np.float32)
    swell = np.sin(2 * np.pi * 9 * axis / TILE)
    height = np.float32(relief) * swell[:, None] * np.roll(swell, 50)[None, :]
    bump = np.exp(-0.5 * ((axis % PITCH_CELLS - PITCH_CELLS / 2) / MARKER_SIGMA_CELLS) ** 2)
    return Ground(
        "markers",
        height.astype(np.float32),
        (0.4 + 1.6 * bump[:, None] * bump[None, :]).astype(np.float32),
        (0.9, 0.9, 0.9),
        0.3,
    )


def check_markers(relief: float, blur: float) -> str:
    """Render a marker drive and compare dots found with dots projected."""
    drive = Drive(
        "markers",
        "check",
        "markers",
        "ABCDRb",
        2,
        24,
        0.1,
        0.7,
        700,
        yaw=(0.0, 0.2, -0.1),
        drift=(0.0, 10.0),
        share=0.0,
        level=0.35,
        wells=100.0,
        blur=blur,
    )
    ground = marker_ground(relief)
    with tempfile.TemporaryDirectory() as name:
        write_drive(Path(name), drive, ground, 7, 0)
        folder = Path(name) / drive.name
        rig, scene = (json.loads((folder / f).read_text()) for f in ("rig.json", "scene.json"))
        pose, truth = read(folder / "poses.csv"), read(folder / "truth.csv")
        pose["x"], pose["y"], pose["psi_rad"] = truth["x"], truth["y"], np.radians(truth["psi_deg"])
        errors = []
        moves = []
        before: dict[tuple[int, int], F64] = {}
        for i in range(drive.frames):
            image = picture(folder / "frames" / f"{i:06d}.jpg")
            linear = (image / 255.0) ** 2.2
            first = np.array(scene["map_corner_cells"])
            cells = np.stack(np.meshgrid(*(np.arange(64, 9000, PITCH_CELLS),) * 2), -1).reshape(-1, 2)
            points = np.array(scene["map_origin_m"]) + (cells - first) * CELL
            points = np.column_stack([points, ground.height[cells[:, 1] % TILE, cells[:, 0] % TILE]])
            camera = true_camera(scene, pose, i)
            front = (points @ camera[0].T + camera[1])[:, 2] > 0.1
            near = np.hypot(*(points[:, :2] - [truth["x"][i], truth["y"][i]]).T) < 2.0
            now = {}
            keep = np.flatnonzero(front & near)
            for k, (u, v) in zip(keep, project(rig, camera, points[keep]), strict=False):
                if not (22 < u < 618 and 22 < v < 458):
                    continue
                u0, v0 = round(u), round(v)
                part = linear[v0 - 12 : v0 + 13, u0 - 12 : u0 + 13]
                base = np.median(part)
                weight = np.clip(part - base - 0.15 * (part.max() - base), 0, None)
                dv, du = np.mgrid[-12:13, -12:13]
                spot = np.array(
                    [u0 + (weight * du).sum() / weight.sum(), v0 + (weight * dv).sum() / weight.sum()]
                )
                error = spot - (u, v)
                errors.append(error)
                key = (int(cells[k, 0]), int(cells[k, 1]))
                now[key] = error
                if key in before:
                    moves.append(error - before[key])
            before = now
    e, m = np.array(errors), np.array(moves)
    return (
        f"markers, relief {relief * 1e3:.0f} mm, blur {blur:.0f} px: {len(e)} dots, "
        f"place rms {np.sqrt((e**2).mean()):.3f} px, mean {e[:, 0].mean():+.3f} {e[:, 1].mean():+.3f}, "
        f"99 % below {np.quantile(np.abs(e), 0.99):.3f} px; "
        f"motion between frames rms {np.sqrt((m**2).mean()):.3f} px"
    )


def track(folder: Path, step: int = 5) -> tuple[float, float, int]:
    """Follow ground features between frames and compare with the written poses, in pixels."""
    rig, scene = (json.loads((folder / f).read_text()) for f in ("rig.json", "scene.json"))
    pose = read(folder / "poses.csv")
    matrix, bend = np.array(rig["camera_matrix"]), np.array(rig["dist_coeffs"]["values"])
    names = sorted((folder / "frames").glob("*.jpg"))
    left = []
    for i in range(0, len(names) - 1, step):
        a, b = (picture(n) for n in names[i : i + 2])
        found = np.asarray(cv2.goodFeaturesToTrack(a, 150, 0.02, 12))
        one, two = true_camera(scene, pose, i), true_camera(scene, pose, i + 1)
        rays = cv2.undistortPoints(found, matrix, bend)[:, 0]
        ways = np.column_stack([rays, np.ones(len(rays))]) @ one[0]
        eye = -one[0].T @ one[1]
        height = pose["z"][i] + pose["sinkage_m"][i]
        points = eye + ways * ((height - eye[2]) / ways[:, 2:])
        aim = project(rig, two, points).astype(np.float32)
        moved, ok, _ = cv2.calcOpticalFlowPyrLK(
            a, b, found, aim[:, None].copy(), winSize=(21, 21), maxLevel=2, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
        )
        good = (ok[:, 0] > 0) & (aim > 12).all(1) & (aim < [628, 468]).all(1)
        left.append((moved[:, 0] - aim)[good])
    if not left:
        return np.nan, np.nan, 0
    rest = np.concatenate(left)
    return (float(np.median(np.hypot(*rest.T))), float(np.hypot(*np.median(rest, 0))), len(rest))


def check_drive(folder: Path) -> dict[str, Any]:
    """Compare the tables of one drive with each other and with its images."""
    truth, told, pose = (read(folder / f"{n}.csv") for n in ("truth", "telemetry", "poses"))
    rig = json.loads((folder / "rig.json").read_text())
    scene = json.loads((folder / "scene.json").read_text())
    psi = np.radians(truth["psi_deg"])
    spot = np.stack([truth["x"], truth["y"]], 1) + np.stack(
        [
            CONTACT[0] * np.cos(psi) - CONTACT[1] * np.sin(psi),
            CONTACT[0] * np.sin(psi) + CONTACT[1] * np.cos(psi),
        ],
        1,
    )
    mid = 0.5 * (psi[1:] + psi[:-1])
    dt = np.diff(truth["t"])
    ahead = np.sum(np.diff(spot, axis=0) * np.stack([np.cos(mid), np.sin(mid)], 1), 1) / dt
    expected = pose["wheel_mps"] * (1 - truth["slip"])
    speed_error = np.abs(ahead - 0.5 * (expected[1:] + expected[:-1])).max()
    gyro = 0.5 * (told["gyro_yaw_dps"][1:] + told["gyro_yaw_dps"][:-1]) - scene["gyro_bias_dps"][2]
    turn_error = float(np.sum(gyro * dt) - (truth["psi_deg"][-1] - truth["psi_deg"][0]))
    told_r, true_r = np.array(rig["R_vehicle_camera"]), np.array(scene["true_R_vehicle_camera"])
    tilt = np.degrees(np.arccos(np.clip((np.trace(told_r.T @ true_r) - 1) / 2, -1, 1)))
    shift = np.linalg.norm(np.array(rig["t_vehicle_camera"]) - scene["true_t_vehicle_camera"])
    median, offset, count = track(folder)
    frame = picture(folder / "frames" / "000000.jpg")
    turning = np.abs(pose["wheel_mps"]) > 1e-3
    slip = truth["slip"][turning]
    edges = [-np.inf, 0.3, 0.55, 0.9, np.inf]
    return {
        "look": scene["look"],
        "frames": len(psi),
        "speed_error": speed_error,
        "turn_error": turn_error,
        "tilt": tilt,
        "shift": shift,
        "wheel_noise": np.std(told["wheel_speed_mps"][turning] / pose["wheel_mps"][turning])
        if turning.any()
        else 0.0,
        "track": median,
        "offset": offset,
        "tracked": count,
        "grey": float(frame.mean()),
        "sink": (pose["sinkage_m"].min() * 1e3, pose["sinkage_m"].max() * 1e3),
        "bands": [int(((slip >= a) & (slip < b)).sum()) for a, b in pairwise(edges)],
        "still": int((~turning).sum()),
        "size": sum(f.stat().st_size for f in folder.rglob("*") if f.is_file()),
    }


def say(text: str) -> None:
    """Write a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main() -> None:
    """Run all checks and print what they find."""
    parser = argparse.ArgumentParser(prog="sinking_drives.check", description=__doc__)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--only", default="")
    choice = parser.parse_args()
    cv2.setNumThreads(1)
    for relief, blur in ((0.0, 0.0), (0.01, 0.0), (0.01, 12.0)):
        say(check_markers(relief, blur))
    if choice.out is None:
        return
    looks: dict[str, list[int]] = defaultdict(lambda: [0] * 5)
    tilts, shifts, size, frames = [], [], 0, 0
    for folder in sorted(p for p in choice.out.iterdir() if p.name.startswith(choice.only)):
        got = check_drive(folder)
        looks[got["look"]] = [
            a + b for a, b in zip(looks[got["look"]], [*got["bands"], got["still"]], strict=False)
        ]
        tilts.append(got["tilt"])
        shifts.append(got["shift"])
        size, frames = size + got["size"], frames + got["frames"]
        say(
            f"{folder.name:12s} slip bands {got['bands']} still {got['still']:3d}  "
            f"sinkage {got['sink'][0]:.1f} to {got['sink'][1]:.1f} mm  "
            f"speed error {got['speed_error'] * 1e3:.2f} mm/s  turn error {got['turn_error']:+.2f} deg  "
            f"wheel noise {got['wheel_noise'] * 100:.2f} %  grey {got['grey']:.0f}  "
            f"features {got['tracked']} median {got['track']:.2f} offset {got['offset']:.2f} px"
        )
    for look, row in looks.items():
        say(f"{look:10s} frames with slip below 0.3 / 0.55 / 0.9 / above / wheels still: {row}")
    say(
        f"{frames} frames, {size / 1e6:.0f} MB; errors of the given rig, rms per axis: "
        f"{np.sqrt(np.mean(np.square(tilts)) / 3):.3f} deg, "
        f"{np.sqrt(np.mean(np.square(shifts)) / 3) * 1e3:.2f} mm"
    )


if __name__ == "__main__":
    main()
