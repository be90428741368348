"""The loop of the shipped El-Dorado with and without trace and tilt, on its simulated slope.

    python -m benchmarks.four_wheels.live_loop [--seeds 3]
    python -m benchmarks.four_wheels.live_loop --way shipped --way "slip measured" --length-m 1 --seeds 2
    python -m benchmarks.four_wheels.live_loop --way "slip measured" --length-m 1 --approach-gain-per-s 10

Each seed is other noise on the same slope, with `rover-hil run --virtual`: as shipped; with the course
followed by the nose (`steer_against_drift = false`); with wheels that are taken to roll; and as shipped with
the motion over the ground in the same frames (`[ground_motion]`), which then is the slip. The shipped
parameters are from a seed that is not among these.

Prints as JSON for each, median, least and greatest over the seeds: whether the mission was finished, 1 or 0;
distance of estimate and rover from each other at the end, distance of the true end from the end of the line,
rms of the true distance from the line, and rms errors of slip and slip angle by sComp; then how many
microseconds a step takes, with a frame to look at and without: median and 99th percentile.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from unittest import mock

import numpy as np

from controllers.control_loop import ControlLoop, StepOutput
from controllers.motion.settings import LineMission
from controllers.safety import Mode
from drivers.clock import stopwatch_ns
from drivers.samples import Sample
from rover_hil.config import Config, load_config
from rover_hil.report.read_run import read_run
from rover_hil.report.summary import summarise
from rover_hil.run.driving import run_virtual

FIRST_SEED = 1000
UNCHANGED: Mapping[str, float] = MappingProxyType({})
CHANGEABLE = ("length_m", "approach_gain_per_s")
"""Numbers of the mission that a run may change."""
MEASURED = "slip measured"
WAYS = ("shipped", "nose along the line", "wheels roll", MEASURED)


def variant(way: str, seed: int, changes: Mapping[str, float]) -> Config:
    """Return the shipped configuration, changed as a way of driving wants it, and in its mission."""
    table = load_config("el-dorado").model_dump(by_alias=True)
    table["simulation"]["seed"] = seed
    table["mission"].update(changes)
    if way == MEASURED:
        table["ground_motion"] = {"rig": table["scomp"]["rig"]}
    if way == "nose along the line":
        table["scomp"]["steer_against_drift"] = False
    if way == "wheels roll":
        table["scomp"] = table["roles"]["camera"] = None
    return Config.model_validate(table)


def drive(way: str, seed: int, path: Path, changes: Mapping[str, float] = UNCHANGED) -> dict[str, float]:
    """Return the figures of a drive; its log stays at the path."""
    config = variant(way, seed, changes)
    run_virtual(config, path, config.loop.time_limit_s, None)
    run = read_run(path)
    summary, truth = summarise(run), run.truth
    if truth is None or summary.estimate_error is None or not isinstance(config.mission, LineMission):
        raise SystemExit("el-dorado must drive a line, with the truth in its log")
    error = summary.estimate_error
    figures = {
        "finished": float(summary.mode is Mode.FINISHED),
        "estimate_off_m": error.position_final_m,
        "end_missed_m": float(np.hypot(truth.x_m[-1] - config.mission.length_m, truth.y_m[-1])),
        "beside_line_rms_m": float(np.sqrt(np.mean(truth.y_m**2))),
    }
    if summary.drift is not None:
        figures["slip_rms"] = summary.drift.slip_error_rms or 0.0
        figures["slip_angle_rms_deg"] = summary.drift.slip_angle_error_rms_deg or 0.0
    return figures


def median_and_range(values: Sequence[float]) -> list[float]:
    """Return median, least and greatest."""
    return [round(float(value), 3) for value in (np.median(values), min(values), max(values))]


def step_times_us(path: Path) -> dict[str, list[float]]:
    """Return median and 99th percentile of the steps of a drive, with a frame to look at and without."""
    times: dict[str, list[float]] = {"with_frame": [], "without": []}
    plain_step = ControlLoop.step

    def step(loop: ControlLoop, now_ns: int, samples: Sequence[Sample]) -> StepOutput:
        start_ns = stopwatch_ns()
        output = plain_step(loop, now_ns, samples)
        has_frame = output.scomp is not None and output.scomp.trace is not None
        times["with_frame" if has_frame else "without"].append((stopwatch_ns() - start_ns) / 1e3)
        return output

    with mock.patch.object(ControlLoop, "step", step):
        drive(WAYS[0], FIRST_SEED, path)
    return {name: np.percentile(durations, (50, 99)).round().tolist() for name, durations in times.items()}


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--way", choices=WAYS, action="append", help="default: all, and the times of a step")
    for number in CHANGEABLE:
        parser.add_argument(f"--{number.replace('_', '-')}", type=float, help="default: as shipped")
    arguments = parser.parse_args()
    changes = {name: value for name in CHANGEABLE if (value := getattr(arguments, name)) is not None}
    report: dict[str, dict[str, list[float]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for way in arguments.way or WAYS:
            results = [
                drive(way, seed, Path(folder) / f"{way} {seed}.mcap", changes)
                for seed in range(FIRST_SEED, FIRST_SEED + arguments.seeds)
            ]
            report[way] = {name: median_and_range([row[name] for row in results]) for name in results[0]}
            print(f"{way}: {json.dumps(report[way])}", file=sys.stderr)
        times = {} if arguments.way else {"step_us": step_times_us(Path(folder) / "timed.mcap")}
    print(json.dumps({"seeds": arguments.seeds, **report, **times}, indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
