"""Ground motion on frames of a real road (KITTI), without wheels and gyro, beside plain Lucas-Kanade.

    python -m benchmarks.ground_motion.road FOLDER [--every 1] [--pitch-sd-deg 0.3]

FOLDER holds `truth.csv` and the frames, as `road_a` of the shared data `ground_real`: a level camera that
looks ahead, 1.65 m over the road. Prints shares of pairs, errors of a pair and of the distance, and how many
errors are within two reported deviations with this tolerance of the rig's pitch.
"""

import argparse
import csv
import sys
import time
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from benchmarks.ground_motion.measured import Floats, TimedEstimator
from controllers.ground_motion.ground_patch import GroundPatch
from controllers.ground_motion.ground_view import GroundView
from controllers.ground_motion.rig import SCHEMA, RigFile
from controllers.ground_motion.rig_tolerance import RigTolerance
from drivers.samples import Image
from rover_hil.ftrace.frames import FrameSource
from rover_hil.ftrace.inputs import FrameInputs
from rover_hil.ground.run import measure

Measured = tuple[Floats, Floats, float, float]
"""Motion of the pairs (forward, left, turn), its standard deviations, that of the scale, and ms of a step."""

RATE_HZ = 10.0
HEIGHT_M = 1.65
FOCAL_PX, CENTRE_PX = 721.5377, (300.5593, -52.146)
"""Calibration of the cut frames, by the README of the data."""


def road_rig() -> RigFile:
    """Return the rig of the frames."""
    return RigFile.model_validate(
        {
            "schema": SCHEMA,
            "vehicle_frame": "below the camera: forward, left, up",
            "image": {"width": 600, "height": 150, "fps": RATE_HZ, "format": "jpg, 8-bit grey"},
            "camera_matrix": (
                (FOCAL_PX, 0.0, CENTRE_PX[0]),
                (0.0, FOCAL_PX, CENTRE_PX[1]),
                (0.0, 0.0, 1.0),
            ),
            "dist_coeffs": {"model": "opencv_brown_k1k2p1p2k3", "values": (0.0,) * 5},
            "R_vehicle_camera": ((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
            "t_vehicle_camera": (0.0, 0.0, HEIGHT_M),
            "wheel": None,
            "other_wheels": [],
            "b_m": 0.0,
            "nominal_speed_mps": 7.0,
            "ground_view_m": None,
            "max_slip_angle_deg": 35.0,
        }
    )


def main() -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--every", type=int, default=1, help="use only every so many frames")
    parser.add_argument("--pitch-sd-deg", type=float, default=0.3)
    given = parser.parse_args()
    cv2.setNumThreads(1)
    images = [
        np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), np.uint8)
        for path in sorted(given.folder.glob("*.jpg"))
    ][:: given.every]
    true = _true_motion(given.folder / "truth.csv", given.every)
    tolerance = RigTolerance(
        height_sd_m=0.02, pitch_sd_deg=given.pitch_sd_deg, focal_length_sd=0.0, sinkage_sd_m=0.0
    )
    ground = GroundPatch(road_rig().geometry())
    sys.stdout.write(
        f"view {ground.shape[0] * ground.pixel_m:.1f} m long, {ground.shape[1] * ground.pixel_m:.1f} m wide, "
        f"from {ground.rig.contact_m[0] - ground.shape[0] * ground.pixel_m:.1f} m ahead, "
        f"pixels of {100 * ground.pixel_m:.1f} cm\n"
    )
    inputs = FrameInputs(FrameSource(given.folder), road_rig(), None)
    _report("ground motion", *_ours(ground, tolerance, inputs, given.every), true)
    _report("plain Lucas-Kanade", *_plain(images), true)
    return 0


def _ours(ground: GroundPatch, tolerance: RigTolerance, inputs: FrameInputs, every: int) -> Measured:
    """Return what `rover-hil ground` measures."""
    estimator = TimedEstimator(GroundView(ground), tolerance)
    rows, scale_sd = [], 0.0
    for item in measure(inputs, estimator, every=every):
        motion = item.motion
        if motion is None:
            continue
        scale_sd = motion.scale_sd
        row = (
            motion.forward_m, motion.left_m, motion.turn_rad,
            motion.forward_sd_m, motion.left_sd_m, motion.turn_sd_rad,
        )  # fmt: skip
        rows.append(row if motion.is_valid else (np.nan,) * 6)
        if not motion.is_valid:
            sys.stdout.write(f"- frame {item.number}: {motion.invalid_because}\n")
    table = np.array(rows)
    return table[:, :3], table[:, 3:], scale_sd, float(np.median(estimator.spent_ms))


def _plain(images: list[Image]) -> Measured:
    """Return the same by OpenCV's Lucas-Kanade from corner to corner: the median on a plane road, no turn."""
    camera = np.array([[FOCAL_PX, 0.0, CENTRE_PX[0]], [0.0, FOCAL_PX, CENTRE_PX[1]], [0.0, 0.0, 1.0]])
    to_road, rows, spent_ms = np.linalg.inv(camera), [], []
    for before, after in pairwise(images):
        started = time.thread_time()
        corners = cv2.goodFeaturesToTrack(before, 400, 0.005, 6)
        moved, status, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, corners.copy(), maxLevel=3)
        keep = status.ravel() > 0
        spots = []
        for pixels in (corners, moved):
            rays = np.c_[pixels.reshape(-1, 2), np.ones(len(pixels))] @ to_road.T
            spots.append(HEIGHT_M * np.stack([rays[:, 2], -rays[:, 0]], axis=1) / rays[:, 1:2])
        forward_m, left_m = np.median((spots[0] - spots[1])[keep], axis=0)
        row = (float(forward_m), float(left_m), 0.0)
        spent_ms.append(1e3 * (time.thread_time() - started))
        rows.append(row)
    table = np.array(rows)
    return table, np.full_like(table, np.nan), np.nan, float(np.median(spent_ms))


def _report(name: str, measured: Floats, sd: Floats, scale_sd: float, step_ms: float, true: Floats) -> None:
    valid = np.isfinite(measured[:, 0])
    error = (measured - true)[valid]
    distance = float(measured[valid, 0].sum() / true[valid, 0].sum() - 1)
    text = (
        f"{name}: {100 * valid.mean():.0f} % of {len(valid)} pairs; a pair forward "
        f"{1000 * error[:, 0].mean():+.0f} mm, sd {1000 * error[:, 0].std():.0f} mm; sideways "
        f"{1000 * _rms(error[:, 1]):.1f} mm rms; yaw {np.degrees(_rms(error[:, 2])):.3f} deg rms; "
        f"distance {100 * distance:+.1f} %; {step_ms:.1f} ms a step"
    )
    if np.isfinite(scale_sd):
        told = np.hypot(sd[valid, 0], scale_sd * measured[valid, 0])
        shares = [np.abs(error[:, 0]) < 2 * told, np.abs(error[:, 1]) < 2 * sd[valid, 1]]
        shares.append(np.abs(error[:, 2]) < 2 * sd[valid, 2])
        forward, left, turn = (100 * float(share.mean()) for share in shares)
        text += (
            f"; within two deviations: forward {forward:.0f} %, sideways {left:.0f} %, yaw {turn:.0f} % "
            f"(scale {100 * scale_sd:.1f} %)"
        )
    sys.stdout.write(text + "\n")


def _true_motion(path: Path, every: int) -> Floats:
    """Return forward, left and turn of the pairs, in the axes of the later frame."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))[::every]
    places = np.array([[float(row[f"{name}_m"]) for name in ("forward", "right", "down")] for row in rows])
    turns = [cv2.Rodrigues(np.array([float(row[f"r{axis}_rad"]) for axis in "xyz"]))[0] for row in rows]
    motions = []
    for before, after in pairwise(range(len(rows))):
        # Rotation vectors are about right, down, forward; places are forward, right, down.
        right, down, forward = turns[after].T @ np.roll(places[after] - places[before], -1)
        step = cv2.Rodrigues(turns[before].T @ turns[after])[0].ravel()
        del down
        motions.append((forward, -right, -step[1]))
    return np.array(motions)


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    sys.exit(main())
