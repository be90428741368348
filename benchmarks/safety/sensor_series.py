"""Series of sensors that report wrong values: is the device named in time, or the region large enough?

    python -m benchmarks.safety.sensor_series [--runs 60] [--only "gyro repeats"] [--markdown FILE]

Each class pools the rovers with such a device: Robotino and El-Dorado on random sites and slopes, without a
yaw excitation, and the differential rover with a receiver. The fault begins 4.5 to 8 s after the first
motion, that of north 13.5 to 17 s, about where that rover begins to drive north; the run ends 10 s after
that; a gyro of a wrong sign or scale has it from the start. The ground truth is that of the simulated rover.

A run is right where the first new reason or warning names the device within 3 s or 1 m, or where NEES (x, y,
yaw) stays at most 16.3 and the 95 % radius at most 0.2 m and half the true distance; that by the wheels, of
which slip loses a part, is a separate column. A warning about the rover itself blames no device. Exit code
1 where fewer than 95 % of the runs of a class are right, where NEES exceeds 30 and nothing is reported within
3 s, or where only another device is named in more than 1 % of all runs.
"""

import argparse
import math
import re
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console

from benchmarks.cluster_option import add_cluster_option
from benchmarks.safety.faults.cases import (
    COMPASS,
    FOR_EVER_S,
    GNSS,
    GYRO_PER_RAD_S,
    GYROS,
    WHEELS,
    Case,
    Duty,
)
from benchmarks.safety.faults.injection import (
    Biased,
    Changed,
    Drifting,
    Held,
    Looped,
    Multiplied,
    Scaled,
    White,
)
from benchmarks.safety.faults.measures import NEES_BAR, Moment, add_truth, read_story
from benchmarks.safety.faults.runs import run_case
from benchmarks.safety.faults.wires import Change
from benchmarks.safety.missions import el_dorado, robotino
from controllers.safety.position_region import CHI_SQUARE
from controllers.slip.effort.settings import SURFACES
from drivers.clock import nanoseconds, seconds
from rover_hil.config import Config
from rover_hil.parallel.executor import open_executor
from tests.rover_hil.test_gnss_run import config_with

IN_TIME_S, IN_TIME_M = 3.0, 1.0
RADIUS_M, RADIUS_SHARE = 0.2, 0.5
SILENT_NEES = 30.0
LEAST_RIGHT, MOST_WRONG = 0.95, 0.01
LATER_S = 1.5, 5.0
"""The fault begins so much later than that of its case."""
CORNER_S = 12.0
"""The differential rover is near its first corner then, and drives north after it."""
WATCHED_S = 7.0
COLUMNS = (
    "class | runs | right | named in time | region right | right by the wheels' distance | "
    "NEES above 30 in silence | other device only"
)

Rng = np.random.Generator
Make = Callable[[str, Rng], Case]


def _gyro(change: Callable[[Rng], Change]) -> Make:
    def make(rover: str, rng: Rng) -> Case:
        device = GYROS[rover]
        return device.case("series", Duty.NOTICE, to_host=lambda _: Changed(device.wire, change(rng)))

    return make


def _east(change: Callable[[int], Change]) -> Make:
    """Return a fault of east on the first leg of the rectangle, or of north at its first corner."""

    def make(_: str, rng: Rng) -> Case:
        channel = int(rng.integers(2))
        after_s = CORNER_S if channel == 0 else 3.0
        disturb = change(channel)
        return GNSS.case(
            "series", Duty.NOTICE, after_s=after_s, to_host=lambda _: Changed(GNSS.wire, disturb)
        )

    return make


def _gnss(change: Callable[[Rng], Change]) -> Make:
    return lambda _, rng: GNSS.case("series", Duty.NOTICE, to_host=lambda _: Changed(GNSS.wire, change(rng)))


def _repeating_gyro(rover: str, rng: Rng) -> Case:
    period_s = float(rng.uniform(1.0, 4.0))
    return GYROS[rover].case("series", Duty.NOTICE, to_host=lambda _: Looped(period_s))


def _scaled_gyro(rover: str, rng: Rng) -> Case:
    device, factor = GYROS[rover], float(rng.choice((-1.0, 0.5, 1.5)))
    return device.case(
        "series", Duty.NOTICE, after_s=0.0, to_host=lambda _: Changed(device.wire, Scaled(factor, (2,)))
    )


def _repeating_wheels(rover: str, rng: Rng) -> Case:
    period_s = float(rng.uniform(0.2, 0.5))
    return WHEELS[rover].case("series", Duty.NOTICE, duration_s=4.0, to_host=lambda _: Looped(period_s))


def _frequent_compass(_: str, rng: Rng) -> Case:
    count = int(rng.integers(50, 400))
    return COMPASS.case("series", Duty.NOTICE, to_host=lambda _: Multiplied(count))


def _ramp_and_shift(rover: str, rng: Rng) -> Case:
    ramp, shift = rng.choice((-1.0, 1.0), 2)
    rate = 0.005 * GYRO_PER_RAD_S * float(ramp)
    gyro = _gyro(lambda _: Drifting(rate, (2,)))(rover, rng)
    offset = math.degrees(0.05) * float(shift)
    return COMPASS.case(
        "series",
        Duty.NOTICE,
        names=(*COMPASS.names, *gyro.names),
        to_host=lambda _: Changed(COMPASS.wire, Biased(offset, (0,))),
        also=gyro,
    )


BOTH = ("robotino", "el-dorado")
CLASSES: dict[str, tuple[tuple[str, ...], Make]] = {
    "gyro repeats its last 1 to 4 s": (BOTH, _repeating_gyro),
    "gyro sends noise without a signal": (BOTH, _gyro(lambda rng: White(rng, 0.002 * GYRO_PER_RAD_S))),
    "gyro noise of 0.3 rad/s": (BOTH, _gyro(lambda rng: White(rng, 0.3 * GYRO_PER_RAD_S))),
    "gyro at -1, 0.5 or 1.5 times from the start": (BOTH, _scaled_gyro),
    "compass 50 to 400 times as often": (("el-dorado",), _frequent_compass),
    "wheels repeat 0.2 to 0.5 s for 4 s": (BOTH, _repeating_wheels),
    "position stays, times go on": (("differential",), _gnss(lambda _: Held())),
    "position drifts at 0.3 m/s": (
        ("differential",),
        _gnss(lambda rng: Drifting(0.3 * float(rng.choice((-1.0, 1.0))), (int(rng.integers(2)),))),
    ),
    "position mirrored": (("differential",), _east(lambda channel: Scaled(-1.0, (channel,)))),
    "position at half scale": (("differential",), _east(lambda channel: Scaled(0.5, (channel,)))),
    "gyro ramp and shifted compass": (("el-dorado",), _ramp_and_shift),
}
"""Rovers and fault of each."""


class Result(NamedTuple):
    """What came of a run.

    Attributes:
        named: Whether the first new reason or warning names the device in time.
        is_honest: Whether the region was right and small enough all the time.
        is_honest_rolled: The same, with the distance by the wheels.
        is_silent: Whether NEES exceeded 30 and nothing was reported within 3 s.
        is_other: Whether only another device was named.
        text: Of the first reason or warning; empty for none.
        nees: The greatest from the begin of the fault on.
        radius: 95 % radius over its bar, the greatest.
    """

    named: bool
    is_honest: bool
    is_honest_rolled: bool
    is_silent: bool
    is_other: bool
    text: str
    nees: float
    radius: float


def config_of(rover: str, seed: int) -> Config:
    """Return the rover with noise and ground of a seed, without an excitation."""
    if rover == "differential":
        config = config_with()
        simulation = config.require_simulation().model_copy(update={"seed": seed})
        return config.model_copy(update={"simulation": simulation})
    config = robotino(seed) if rover == "robotino" else el_dorado(seed)
    if config.slip is None:
        return config
    return config.model_copy(update={"slip": config.slip.model_copy(update={"use": SURFACES})})


def run(name: str, index: int) -> Result:
    """Run the fault of a class once; the number of the run seeds all that is random."""
    rng = np.random.default_rng((index, *name.encode()))
    rovers, make = CLASSES[name]
    rover = rovers[index % len(rovers)]
    case = make(rover, rng)
    after_s = case.after_s and case.after_s + float(rng.uniform(*LATER_S))
    duration_s = case.duration_s if case.duration_s > 1.0 else FOR_EVER_S
    case = replace(case, after_s=after_s, duration_s=duration_s, is_excited=False)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        _, window = run_case(case, path, WATCHED_S, config_of(rover, 40_000 + index))
        story = read_story(path, case.device)
        add_truth(story)
    return judge(case.names, story.moments, window.begin_ns)


def judge(names: Sequence[str], moments: Sequence[Moment], begin_ns: int) -> Result:
    """Return what came of a run, from its cycles and the time of the fault."""
    before = {text for moment in moments if moment.t_ns < begin_ns for text in _texts(moment)}
    after = [moment for moment in moments if moment.t_ns >= begin_ns]
    ways_m = _distances_m([moment.truth for moment in moments])[-len(after) :]
    rolled_m = _distances_m([moment.odometry for moment in moments])[-len(after) :]
    reports = [
        (moment, text, way_m)
        for moment, way_m in zip(after, ways_m, strict=True)
        for text in _texts(moment)
        if text not in before
    ]
    named = is_other = False
    text = ""
    if reports:
        first, text, way_m = reports[0]
        in_time = seconds(first.t_ns - begin_ns) <= IN_TIME_S or way_m - ways_m[0] <= IN_TIME_M
        named = in_time and _names(names, text)
        blaming = [each for _, each, _ in reports if not each.startswith("rover: ")]
        is_other = bool(blaming) and not any(_names(names, each) for each in blaming)
    nees = [moment.nees for moment in after]
    radius, by_wheels = (
        max(
            _radius_m(moment) / (RADIUS_M + RADIUS_SHARE * way_m)
            for moment, way_m in zip(after, each_m, strict=True)
        )
        for each_m in (ways_m, rolled_m)
    )
    is_right = max(nees) <= NEES_BAR
    reported_ns = reports[0][0].t_ns if reports else math.inf
    is_silent = any(
        moment.nees > SILENT_NEES and reported_ns > moment.t_ns + nanoseconds(IN_TIME_S) for moment in after
    )
    return Result(
        named=named,
        is_honest=is_right and radius <= 1.0,
        is_honest_rolled=is_right and by_wheels <= 1.0,
        is_silent=is_silent,
        is_other=is_other,
        text=text,
        nees=max(nees),
        radius=radius,
    )


def _distances_m(poses: Sequence[tuple[float, float, float]]) -> Sequence[float]:
    """Return the distance driven until each pose."""
    steps = [math.dist(a[:2], b[:2]) for a, b in pairwise((poses[0], *poses))]
    return [float(each) for each in np.cumsum(steps)]


def _texts(moment: Moment) -> tuple[str, ...]:
    is_driving = moment.mode in ("running", "finished")
    texts = filter(None, (moment.suspicion, "" if is_driving else moment.reason))
    return tuple(re.sub(r"[\d.]+", "…", text) for text in texts)  # a warning goes on with other numbers


def _names(names: Sequence[str], text: str) -> bool:
    return any(name in text.lower() for name in names)


def _radius_m(moment: Moment) -> float:
    xx, xy, _, yy, _, _ = moment.covariance
    return math.sqrt(CHI_SQUARE * (0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)))


def row(name: str, results: Sequence[Result]) -> str:
    """Return the row of a class."""
    counts = (
        sum(each.named or each.is_honest for each in results),
        sum(each.named for each in results),
        sum(each.is_honest for each in results),
        sum(each.named or each.is_honest_rolled for each in results),
        sum(each.is_silent for each in results),
        sum(each.is_other for each in results),
    )
    return f"| {name} | {len(results)} | {' | '.join(map(str, counts))} |"


def main() -> int:
    """Print the table; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=60, help="of each class")
    parser.add_argument("--first", type=int, default=0, help="number of the first run")
    parser.add_argument("--only", default="", help="classes whose name contains this")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--markdown", type=Path)
    add_cluster_option(parser)
    arguments = parser.parse_args()
    console = Console(stderr=True, highlight=False, markup=False, soft_wrap=True)
    names = [name for name in CLASSES if arguments.only in name]
    rows, others, missed = [], 0, 0
    with open_executor(arguments.cluster, arguments.processes) as pool:
        for name in names:
            indices = range(arguments.first, arguments.first + arguments.runs)
            results = list(pool.map(run, [name] * len(indices), indices))
            for index, each in zip(indices, results, strict=True):
                if each.is_silent or each.is_other or not (each.named or each.is_honest):
                    what = (
                        f"{each.text or 'nothing'}; NEES {each.nees:.1f}, radius {each.radius:.2f} of its bar"
                    )
                    console.print(f"{name}, run {index}: {what}")
            rows.append(row(name, results))
            console.print(rows[-1])
            others += sum(each.is_other for each in results)
            right = sum(each.named or each.is_honest for each in results)
            missed += right < LEAST_RIGHT * len(results) or any(each.is_silent for each in results)
    table = "\n".join([f"| {COLUMNS} |", "|" + "---|" * (COLUMNS.count("|") + 1), *rows]) + "\n"
    if arguments.markdown is not None:
        arguments.markdown.write_text(f"# Sensors that report wrong values\n\n{table}", encoding="utf-8")
    print(table)
    return 1 if missed or others > MOST_WRONG * arguments.runs * len(names) else 0


if __name__ == "__main__":
    sys.exit(main())
