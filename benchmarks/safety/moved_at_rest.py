"""A rover that slides or is carried while its wheels are stationary, with a receiver or an overhead camera.

    python -m benchmarks.safety.moved_at_rest [--runs 20]

The differential rover with a receiver drives for 22 s around a corner, the Robotino with an overhead camera
for 6 s. They stop because their wheels are silent for a second, and stay stopped. Two seconds later they
slide (0.02 to 0.1 m/s for 3 to 8 s) or are carried (0.5 to 3 m in 2 s; the Robotino 0.4 m, so that the
camera sees it) without a turn. The wheels do not roll, the accelerometer does not show it. Four seconds
after that the region is compared with the ground truth: exit code 1 where it contains it in fewer than 95 %
of the runs, or where its radius has grown by more than 0.2 m and twice the way.
"""

import argparse
import cmath
import math
import sys
import tempfile
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.cluster_option import add_cluster_option
from benchmarks.safety.faults.cases import Case, Duty
from benchmarks.safety.faults.injection import silence
from benchmarks.safety.faults.measures import Moment, add_truth, read_story
from benchmarks.safety.faults.runs import FaultTimer
from benchmarks.safety.missions import put, robotino, with_fixes
from controllers.safety.position_region import CHI_SQUARE
from drivers.clock import VirtualClock, nanoseconds, seconds
from rover_hil.config import Config
from rover_hil.parallel.executor import open_executor
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.schema import END, end_record
from rover_hil.recording.writer import LogWriter
from rover_hil.run.composition import build_virtual_rig
from rover_hil.run.executive import Executive
from sim_backends.world.plant import Plant, Truth
from tests.rover_hil.test_gnss_run import config_with

DRIVEN_S = {"differential": 22.0, "robotino": 6.0}
REST_S, AFTER_S = 3.0, 4.0
STAYS_S = 60.0
SEEN_M = {"differential": math.inf, "robotino": 0.4}
SEEN_RAD = (math.radians(60.0), math.radians(150.0))
LEAST_CONTAINED = 0.95
RADIUS_M, RADIUS_SHARE = 0.2, 2.0
KINDS = ("slides", "is carried")
ROVERS = {"differential": "wheels", "robotino": "board"}


class MovedPlant:
    """A rover that something moves by a way from a time on, with a constant velocity and without a turn."""

    def __init__(self, plant: Plant, way_m: complex, duration_s: float) -> None:
        self._plant, self._way_m, self._duration_s = plant, way_m, duration_s
        self.begin_ns: int | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._plant, name)

    def truth(self) -> Truth:
        """Return the state of the rover where it has been moved to."""
        truth = self._plant.truth()
        if self.begin_ns is None:
            return truth
        share = min(1.0, max(0.0, seconds(truth.t_ns - self.begin_ns) / self._duration_s))
        return replace(
            truth, x_m=truth.x_m + share * self._way_m.real, y_m=truth.y_m + share * self._way_m.imag
        )


class Result(NamedTuple):
    """What a region was when the rover had been moved: its Mahalanobis distance, radius and its bar."""

    distance: float
    radius_m: float
    bar_m: float
    reason: str


def config_of(rover: str, seed: int) -> Config:
    """Return the rover with noise of a seed; once it has stopped it stays so."""
    config = config_with() if rover == "differential" else with_fixes(robotino(seed), 2.0)
    simulation = config.require_simulation().model_copy(update={"seed": seed})
    safety = config.safety.model_copy(update={"recover_s": STAYS_S})
    return config.model_copy(update={"simulation": simulation, "safety": safety})


def run(kind: str, index: int) -> Result:
    """Move a rover once; the number of the run seeds all that is random."""
    rng = np.random.default_rng((index, *kind.encode()))
    rover = tuple(ROVERS)[index % len(ROVERS)]
    duration_s = float(rng.uniform(3.0, 8.0)) if kind == "slides" else 2.0
    way_m = duration_s * rng.uniform(0.02, 0.1) if kind == "slides" else rng.uniform(0.5, 3.0)
    limits_rad = (-math.pi, math.pi) if rover == "differential" else SEEN_RAD
    direction = cmath.rect(min(float(way_m), SEEN_M[rover]), float(rng.uniform(*limits_rad)))
    case = Case(
        rover=rover,
        device=ROVERS[rover],
        fault="silence",
        duty=Duty.STOP,
        to_host=lambda _: silence,
        after_s=DRIVEN_S[rover],
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        drive(case, config_of(rover, 60_000 + index), path, direction, duration_s)
        story = read_story(path, case.device)
        add_truth(story)
    last = story.moments[-1]
    before = next(each for each in story.moments if seconds(last.t_ns - each.t_ns) < duration_s + AFTER_S)
    xx, xy, _, yy, _, _ = last.covariance
    error = last.error[:2]
    distance = float(error @ np.linalg.solve(np.array([[xx, xy], [xy, yy]]), error))
    bar_m = radius_of(before) + RADIUS_M + RADIUS_SHARE * abs(direction)
    return Result(distance, radius_of(last), bar_m, last.reason or last.suspicion)


def radius_of(moment: Moment) -> float:
    """Return the 95 % radius of the position in m."""
    xx, xy, _, yy, _, _ = moment.covariance
    return math.sqrt(CHI_SQUARE * (0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)))


def drive(case: Case, config: Config, path: Path, way_m: complex, duration_s: float) -> None:
    """Drive, stop and be moved, into a log."""
    clock = VirtualClock()
    with ExitStack() as resources:
        settings = config.model_dump_json(by_alias=True).encode()
        log = resources.enter_context(
            LogWriter(path, clock.now_ns(), settings, collect_data_files(config), "virtual")
        )
        rig, world = build_virtual_rig(config, clock, log)
        plant = MovedPlant(world.plant, way_m, duration_s)
        put(world, plant)
        timer = FaultTimer(case, world)
        rig.connect(timeout_s=2.0)
        resources.enter_context(closing(rig))

        def on_cycle(now_ns: int) -> None:
            log.truth(now_ns, world.plant.truth())
            timer.watch(now_ns)
            begin_ns = timer.window.begin_ns + nanoseconds(REST_S)
            if plant.begin_ns is None and now_ns >= begin_ns:
                plant.begin_ns = now_ns

        executive = Executive(rig, log, config.loop.rate_hz, on_cycle=on_cycle)
        result = executive.run(config.safety.settle_s + case.after_s + REST_S + duration_s + AFTER_S)
        log.write_json(END, executive.now_ns(), end_record(result))


def main() -> int:
    """Print what the regions were; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=20, help="of each kind")
    parser.add_argument("--processes", type=int, default=2)
    add_cluster_option(parser)
    arguments = parser.parse_args()
    missed = False
    with open_executor(arguments.cluster, arguments.processes) as pool:
        for kind in KINDS:
            results = list(pool.map(run, [kind] * arguments.runs, range(arguments.runs)))
            for index, each in enumerate(results):
                if each.distance > CHI_SQUARE or each.radius_m > each.bar_m:
                    print(
                        f"{kind}, run {index}: distance {each.distance:.1f}, radius {each.radius_m:.2f} m "
                        f"of {each.bar_m:.2f} m; {each.reason or 'nothing reported'}"
                    )
            contained = sum(each.distance <= CHI_SQUARE for each in results)
            small = sum(each.radius_m <= each.bar_m for each in results)
            print(
                f"{kind}: region contains the ground truth in {contained} of {len(results)}, small in {small}"
            )
            missed |= contained < LEAST_CONTAINED * len(results) or small < len(results)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
