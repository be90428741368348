"""Reads a drive, and measures the motion of its pairs of frames beside the truth."""

import csv
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import JsonValue

from controllers.ground_motion.estimator import GroundMotionEstimator
from controllers.ground_motion.ground_patch import GroundPatch
from controllers.ground_motion.ground_view import GroundView
from controllers.ground_motion.motion import GroundMotion
from controllers.ground_motion.prior import MotionPrior
from controllers.ground_motion.rig_tolerance import RigTolerance
from drivers.clock import nanoseconds
from drivers.samples import Image
from rover_hil.ftrace.inputs import read_inputs
from rover_hil.ground.run import measure as measure_frames

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
    inputs = read_inputs(folder / "frames", folder / "rig.json", folder / "telemetry.csv")
    inputs = inputs._replace(is_of_rover=_scene(folder).get("speed_of") == "rover")
    truth = _columns(folder / "truth.csv")
    ground = GroundPatch(inputs.rig.geometry())
    estimator = TimedEstimator(GroundView(ground), tolerance)
    poses = _poses(truth, ground.rig.point_m)
    by_ns: dict[int, int] = {}
    motions: list[GroundMotion] = []
    rows = []
    for number, item in enumerate(measure_frames(inputs, estimator, look, every)):
        by_ns[nanoseconds(item.t_s)] = number * every
        if item.motion is None:
            continue
        begin, end = by_ns[item.motion.from_ns], number * every
        slip = float(np.mean(truth["slip"][begin : end + 1]))
        motions.append(item.motion)
        rows.append([item.wheel_m or 0.0, slip, *_apart(poses[begin], poses[end])])
    table = np.array(rows)
    return Pairs(
        name=folder.name,
        look=str(_scene(folder).get("look", "")),
        wheel_m=table[:, 0],
        slip=table[:, 1],
        true=table[:, 2:],
        found=np.array([[m.forward_m, m.left_m, m.turn_rad] for m in motions]),
        sd=np.array([[m.forward_sd_m, m.left_sd_m, m.turn_sd_rad] for m in motions]),
        scale_sd=motions[0].scale_sd,
        valid=np.array([m.is_valid for m in motions]),
        reasons=[m.invalid_because for m in motions],
        spent_ms=np.array(estimator.spent_ms[1:]),
    )


class TimedEstimator(GroundMotionEstimator):
    """An estimator that keeps the processor time of each step.

    Attributes:
        spent_ms: Of each step, ms.
    """

    def __init__(self, view: GroundView, tolerance: RigTolerance | None) -> None:
        super().__init__(view, tolerance)
        self.spent_ms: list[float] = []

    def step(self, t_ns: int, image: Image, prior: MotionPrior) -> GroundMotion | None:
        """Return what the estimator returns."""
        started = time.thread_time()
        motion = super().step(t_ns, image, prior)
        self.spent_ms.append(1e3 * (time.thread_time() - started))
        return motion


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


def _scene(folder: Path) -> dict[str, JsonValue]:
    path = folder / "scene.json"
    return dict(json.loads(path.read_text("utf-8"))) if path.exists() else {}
