"""Processor time of ground motion, beside one plain Lucas-Kanade on the same pictures in the same run.

    python -m benchmarks.ground_motion.cost FOLDER [FOLDER ...]

A folder is a drive as of `benchmarks.ground_motion.drives`. Prints medians and 95 % points of all frames, on
one thread, and the median of the ratio to the peer, which a loaded machine changes little. `step`: with
rectification. `pair`: on rectified structure. `trace alone`: a step of the wheel's trace, which measures the
motion over the ground itself. `trace`: of a rover that has measured it; `step and trace`: both in one cycle.
The peer: `cv2.calcOpticalFlowPyrLK` once on the same points. Exit code 1 where a median misses its bar.
"""

import argparse
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from controllers.ftrace.estimator import TraceEstimator
from controllers.ground_motion.estimator import GroundMotionEstimator
from controllers.ground_motion.flow import GroundFlow
from controllers.ground_motion.ground_patch import GroundPatch
from controllers.ground_motion.ground_view import GroundView
from controllers.ground_motion.pair_sum import PairSum
from controllers.ground_motion.parameters import DEFAULTS
from controllers.ground_motion.prior import MotionPrior, turned
from controllers.ground_motion.rig import RigFile
from drivers.clock import nanoseconds
from drivers.samples import Image
from rover_hil.ftrace.telemetry import read_telemetry

PEER = "plain Lucas-Kanade"
CYCLE = "step and trace"
BARS_MS = {"step": 8.0, "pair": 5.0, CYCLE: 8.0}


class Stopwatch:
    """Processor times of this thread, ms, by name."""

    def __init__(self) -> None:
        self.spent_ms: defaultdict[str, list[float]] = defaultdict(list)

    @contextmanager
    def of(self, name: str) -> Iterator[None]:
        """Measure what is inside."""
        start_s = time.thread_time()
        yield
        self.spent_ms[name].append(1e3 * (time.thread_time() - start_s))


def main() -> int:
    """Print the times; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+")
    cv2.setNumThreads(1)
    watch = Stopwatch()
    for folder in parser.parse_args().folders:
        _time(folder, watch)
    for name, values in watch.spent_ms.items():
        ratio = np.median(np.array(values) / np.array(watch.spent_ms[PEER]))
        sys.stdout.write(
            f"{name}: {np.median(values):.1f} ms, 95 % {np.percentile(values, 95):.1f} ms, "
            f"{ratio:.1f} times the peer\n"
        )
    return int(any(np.median(watch.spent_ms[name]) > most_ms for name, most_ms in BARS_MS.items()))


def _time(folder: Path, watch: Stopwatch) -> None:
    rig = RigFile.model_validate_json((folder / "rig.json").read_text("utf-8")).geometry()
    ground = GroundPatch(rig)
    flow, shared = GroundFlow(ground, DEFAULTS.flow), GroundView(ground)
    alone, pairs = (GroundMotionEstimator(view) for view in (GroundView(ground), shared))
    measured = PairSum(GroundView(ground))
    trace_alone, trace = TraceEstimator(rig), TraceEstimator(rig, pairs=measured)
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
        t_ns = nanoseconds(row.t_s)
        counted = Stopwatch() if before is None else watch
        with counted.of("step"):
            alone.step(t_ns, image, prior)
        with counted.of("trace alone"):
            trace_alone.step(t_ns, image, wheel_speed_m_s=row.wheel_speed_m_s, rates_rad_s=row.rates_rad_s)
        with counted.of(CYCLE):
            measured.measure(t_ns, measured.view.look(image), prior)
            with counted.of("trace"):
                trace.step(t_ns, image, wheel_speed_m_s=row.wheel_speed_m_s, rates_rad_s=row.rates_rad_s)
        seen = shared.look(image)
        with counted.of("pair"):
            pairs.step_patch(t_ns, seen.patch, seen.structure, prior)
        picture = shared.structure.picture(seen.structure)
        with counted.of(PEER):
            if before is not None:
                cv2.calcOpticalFlowPyrLK(before, picture, pixels, pixels.copy(), winSize=(15, 15), maxLevel=1)
        before, rates, before_s = picture, row.rates_rad_s, row.t_s


if __name__ == "__main__":
    sys.exit(main())
