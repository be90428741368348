"""Reads a drive, and measures the motion of its pairs of frames beside the truth."""

import csv
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from controllers.ground_motion.estimator import GroundMotionEstimator
from controllers.ground_motion.ground_patch import GroundPatch
from controllers.ground_motion.ground_view import GroundView
from controllers.ground_motion.motion import GroundMotion
from controllers.ground_motion.parameters import DEFAULTS
from controllers.ground_motion.prior import MotionPrior, turned
from controllers.ground_motion.rig import RigFile
from controllers.ground_motion.rig_tolerance import RigTolerance
from drivers.clock import nanoseconds
from drivers.samples import Image
from rover_hil.ftrace.telemetry import read_telemetry

Floats = NDArray[np.float64]
Look = Callable[[Image, int], Image]


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """What was measured of a drive and what is true, a row per pair of frames.

    Attributes:
        name: Of the drive.
        look: Of its pictures; "" where the drive does not say.
        wheel_m: Travel by the wheels, as reported.
        slip: True slip of the watched wheel.
        true: Forward, left (m), turn (rad) of the measured point, in the vehicle's axes of the later frame.
        found: The same, measured; 0 where not valid.
        sd: Standard deviations of the pair.
        scale_sd: Of the shared factor.
        valid: Whether the pair is valid.
        reasons: Why it is not.
        spent_ms: Processor time of a whole step.
    """

    name: str
    look: str
    wheel_m: Floats
    slip: Floats
    true: Floats
    found: Floats
    sd: Floats
    scale_sd: float
    valid: NDArray[np.bool_]
    reasons: list[str]
    spent_ms: Floats


def measure(
    folder: Path, look: Look | None = None, every: int = 1, tolerance: RigTolerance | None = None
) -> Pairs:
    """Return the measured pairs of a drive in the format of `docs/reference/ftrace_files.md`, with truth.

    Args:
        folder: With `frames/`, `rig.json`, `telemetry.csv`, `truth.csv`, and perhaps `scene.json`.
        look: Changes the frames.
        every: Only every so many frames are used.
        tolerance: What is not known about the rig.
    """
    rig = RigFile.model_validate_json((folder / "rig.json").read_text("utf-8"))
    telemetry = list(read_telemetry(folder / "telemetry.csv").values())
    truth = _columns(folder / "truth.csv")
    paths = sorted((folder / "frames").iterdir())
    ground = GroundPatch(rig.geometry())
    estimator = GroundMotionEstimator(GroundView(ground), tolerance)
    poses = _poses(truth, ground.rig.point_m)
    used = range(0, len(paths), every)
    motions: list[GroundMotion] = []
    rows, spent_ms = [], []
    last: int | None = None
    for number in used:
        image = np.asarray(cv2.imread(str(paths[number]), cv2.IMREAD_GRAYSCALE), np.uint8)
        if look is not None:
            image = look(image, number)
        wheel_m, rates = 0.0, None
        dt_s = 0.0 if last is None else telemetry[number].t_s - telemetry[last].t_s
        if last is not None:
            speeds = [telemetry[k].wheel_speed_m_s or 0.0 for k in range(last, number + 1)]
            times = [telemetry[k].t_s for k in range(last, number + 1)]
            wheel_m = float(np.trapezoid(speeds, times))
            rates = telemetry[last].rates_rad_s
        turn, turn_sd = turned(telemetry[number].rates_rad_s, rates, dt_s, DEFAULTS.turn)
        prior = MotionPrior(forward_m=wheel_m, left_m=0.0, turn_rad=turn, turn_sd_rad=turn_sd)
        started = time.thread_time()
        motion = estimator.step(nanoseconds(telemetry[number].t_s), image, prior)
        spent_ms.append(1e3 * (time.thread_time() - started))
        if motion is not None and last is not None:
            begin = last
            while nanoseconds(telemetry[begin].t_s) > motion.from_ns:  # frames that were left out
                begin -= every
            speeds = [telemetry[k].wheel_speed_m_s or 0.0 for k in range(begin, number + 1)]
            times = [telemetry[k].t_s for k in range(begin, number + 1)]
            motions.append(motion)
            slip = float(np.mean(truth["slip"][begin : number + 1]))
            rows.append([float(np.trapezoid(speeds, times)), slip, *_apart(poses[begin], poses[number])])
        last = number
    table = np.array(rows)
    return Pairs(
        name=folder.name,
        look=_look_of(folder),
        wheel_m=table[:, 0],
        slip=table[:, 1],
        true=table[:, 2:],
        found=np.array([[m.forward_m, m.left_m, m.turn_rad] for m in motions]),
        sd=np.array([[m.forward_sd_m, m.left_sd_m, m.turn_sd_rad] for m in motions]),
        scale_sd=motions[0].scale_sd,
        valid=np.array([m.is_valid for m in motions]),
        reasons=[m.invalid_because for m in motions],
        spent_ms=np.array(spent_ms[1:]),
    )


def _columns(path: Path) -> dict[str, Floats]:
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in ("slip", "x", "y", "psi_deg")}


def _poses(truth: dict[str, Floats], point_m: tuple[float, float]) -> Floats:
    """Return place and heading of a point of the vehicle."""
    heading = np.radians(truth["psi_deg"])
    cosine, sine = np.cos(heading), np.sin(heading)
    x = truth["x"] + cosine * point_m[0] - sine * point_m[1]
    y = truth["y"] + sine * point_m[0] + cosine * point_m[1]
    return np.stack([x, y, heading], axis=1)


def _apart(before: Floats, after: Floats) -> tuple[float, float, float]:
    x, y, turn = (after - before).tolist()
    cosine, sine = np.cos(after[2]), np.sin(after[2])
    return (
        float(cosine * x + sine * y),
        float(cosine * y - sine * x),
        float((turn + np.pi) % (2 * np.pi) - np.pi),
    )


def _look_of(folder: Path) -> str:
    path = folder / "scene.json"
    if not path.exists():
        return ""
    return str(json.loads(path.read_text("utf-8")).get("look", ""))
