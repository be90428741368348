"""Processor time of ground motion: a whole step, a pair, and one plain Lucas-Kanade on the same pictures.

    python -m benchmarks.ground_motion.cost FOLDER [FOLDER ...]

A folder is a drive as of `benchmarks.ground_motion.drives`. Prints medians and 95 % points of all frames, on
one thread: the step with rectification, the pair on rectified structure, and `cv2.calcOpticalFlowPyrLK` once
on the same points.
"""

import argparse
import sys
import time
from pathlib import Path

import cv2
import numpy as np

from controllers.ground_motion.estimator import GroundMotionEstimator
from controllers.ground_motion.flow import GroundFlow
from controllers.ground_motion.ground_patch import GroundPatch
from controllers.ground_motion.parameters import DEFAULTS
from controllers.ground_motion.prior import MotionPrior, turned
from controllers.ground_motion.rig import RigFile
from controllers.ground_motion.structure import FineStructure
from drivers.clock import nanoseconds
from drivers.samples import Image
from rover_hil.ftrace.telemetry import read_telemetry


def main() -> int:
    """Print the times."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+")
    cv2.setNumThreads(1)
    spent: dict[str, list[float]] = {"step": [], "pair": [], "plain Lucas-Kanade": []}
    for folder in parser.parse_args().folders:
        _time(folder, spent)
    for name, values in spent.items():
        sys.stdout.write(f"{name}: {np.median(values):.1f} ms, 95 % {np.percentile(values, 95):.1f} ms\n")
    return 0


def _time(folder: Path, spent: dict[str, list[float]]) -> None:
    rig = RigFile.model_validate_json((folder / "rig.json").read_text("utf-8"))
    ground = GroundPatch(rig.geometry())
    structure, flow = FineStructure(ground, DEFAULTS.structure), GroundFlow(ground, DEFAULTS.flow)
    whole, pairs = GroundMotionEstimator(ground), GroundMotionEstimator(ground)
    points_m = flow.points_m()
    pixels = np.stack(
        [points_m[:, 1] / ground.pixel_m + ground.centre, points_m[:, 0] / ground.pixel_m - 0.5], axis=1
    ).astype(np.float32)
    before: Image | None = None
    rates, before_s = None, 0.0
    rows = read_telemetry(folder / "telemetry.csv").values()
    for row, path in zip(rows, sorted((folder / "frames").iterdir()), strict=False):
        image = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), np.uint8)
        dt_s = row.t_s - before_s
        turn, turn_sd = turned(row.rates_rad_s, rates, dt_s, DEFAULTS.turn)
        prior = MotionPrior(
            forward_m=(row.wheel_speed_m_s or 0.0) * dt_s, left_m=0.0, turn_rad=turn, turn_sd_rad=turn_sd
        )
        patch = ground.rectify(image)
        fine = structure.of(structure.log_grey(patch))
        picture = structure.picture(fine)
        t_ns = nanoseconds(row.t_s)
        marks = [time.thread_time()]
        whole.step(t_ns, image, prior)
        marks.append(time.thread_time())
        pairs.step_patch(t_ns, patch, fine, prior)
        marks.append(time.thread_time())
        if before is not None:
            cv2.calcOpticalFlowPyrLK(before, picture, pixels, pixels.copy(), winSize=(15, 15), maxLevel=1)
            marks.append(time.thread_time())
            for name, start, end in zip(spent, marks, marks[1:], strict=False):
                spent[name].append(1e3 * (end - start))
        before, rates, before_s = picture, row.rates_rad_s, row.t_s


if __name__ == "__main__":
    sys.exit(main())
