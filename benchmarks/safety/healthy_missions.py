"""False alarms: healthy missions on slippery ground, which nothing may stop.

    python -m benchmarks.safety.healthy_missions [--missions 300] [--el-dorado 20] [--first 20000]
    python -m benchmarks.safety.healthy_missions --missions 40 --el-dorado 0 --nature 20 --sensors fixes
    python -m benchmarks.safety.healthy_missions --missions 200 --el-dorado 0 --nature 200 --sensors camera

The Robotino drives its rectangle on random sites of loose and soft patches, the El-Dorado 1.5 m straight on
slopes of sand of up to 12 deg in any direction. `--nature` missions are of the Robotino of `tests/nature` on
floors on which it loses a fifth of its wheels' travel, and in places nearly all. Sensors of both Robotinos:
`excitation`, the yaw excitation as shipped; `encoders`, encoders and gyro alone; `fixes`, the excitation and
fixes by an overhead camera every two seconds; `encoders+fixes`, these without the excitation; `camera`,
encoders, gyro and a camera that measures the motion over the ground, by the model of its errors.

Prints every stop with its reason and the true progress over the half metre of the wheels before it, the
number of missions with one, and how the missions ended. A rover stopped below 2 % of progress is not healthy.
Exit code 1 where a healthy mission did not finish, or one with fixes or a camera was stopped.
"""

import argparse
import math
import sys
from collections import Counter

from rich.console import Console
from rich.progress import track

from benchmarks.cluster_option import add_cluster_option
from benchmarks.safety.missions import (
    ROVERS,
    Driven,
    Moment,
    drive,
    ground_camera,
    omni_contact,
    robotino,
    with_drooping_drives,
    with_fixes,
)
from controllers.safety import Mode
from rover_hil.config import Config
from rover_hil.parallel.executor import open_executor

FIXES_PER_S = 0.5
LIMIT_S = 300.0
"""A rover that loses most of its wheels' travel takes several times as long."""
TRAVEL_M, LEAST_PROGRESS = 0.5, 0.02
SENSORS = ("excitation", "encoders", "fixes", "encoders+fixes", "camera")


def equipped(config: Config, sensors: str) -> Config:
    """Return a Robotino with these sensors."""
    if sensors.startswith(("encoders", "camera")):
        config = config.model_copy(update={"slip": None})
    return with_fixes(config, FIXES_PER_S) if sensors.endswith("fixes") else config


def progress(driven: Driven, stop: Moment) -> float:
    """Return the true distance over the half metre of the wheels before a stop; 1 before there was one."""
    wheels_m, after = 0.0, stop
    for before in reversed(driven.moments[: driven.moments.index(stop)]):
        a, b = before.output.odometry, after.output.odometry
        wheels_m += math.hypot(b.x_m - a.x_m, b.y_m - a.y_m)
        after = before
        if wheels_m >= TRAVEL_M:
            return math.dist(before.truth[:2], stop.truth[:2]) / wheels_m
    return 1.0


def reasons(rover: str, seed: int, sensors: str) -> tuple[str, list[tuple[str, float]]]:
    """Drive one mission; return its end, and of every stop time and reason, and the progress before it."""
    if rover == "el-dorado":
        driven = drive(ROVERS[rover](seed))
    else:
        config, make_plant = equipped(robotino(seed), sensors), None
        if rover == "nature":
            config, make_plant = with_drooping_drives(config), omni_contact(seed)
        make_camera = ground_camera(seed) if sensors == "camera" else None
        driven = drive(config, limit_s=LIMIT_S, make_plant=make_plant, make_camera=make_camera)
    return driven.mode.value, [
        (f"{stop.t_s:.2f} s: {stop.output.reason}", progress(driven, stop)) for stop in driven.stops()
    ]


def main() -> int:
    """Print the stops; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--missions", type=int, default=300)
    parser.add_argument("--el-dorado", type=int, default=20, help="how many of them the El-Dorado drives")
    parser.add_argument("--nature", type=int, default=0, help="how many the Robotino of tests/nature drives")
    parser.add_argument("--sensors", choices=SENSORS, default="excitation")
    parser.add_argument("--first", type=int, default=20_000, help="seed of the first mission")
    parser.add_argument("--processes", type=int, help="default: one for each processor")
    add_cluster_option(parser)
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.missions)
    others = arguments.nature + arguments.el_dorado
    if others > arguments.missions:
        parser.error(f"--missions counts all: give at least {others}")
    rovers = [
        *["robotino"] * (arguments.missions - others),
        *["nature"] * arguments.nature,
        *["el-dorado"] * arguments.el_dorado,
    ]
    console, stopped, healthy, ends = Console(), 0, 0, Counter[str]()
    with open_executor(arguments.cluster, arguments.processes) as pool:
        results = pool.map(reasons, rovers, seeds, [arguments.sensors] * len(rovers))
        missions = zip(rovers, seeds, results, strict=True)
        for rover, seed, (end, stops) in track(missions, total=len(rovers), console=Console(stderr=True)):
            for stop, share in stops:
                console.print(f"{rover} {seed}: {stop} (progress {100.0 * share:.1f} %)", soft_wrap=True)
            if any(share < LEAST_PROGRESS for _, share in stops):
                ends[f"{rover} that was stuck: {end}"] += 1
                continue
            healthy += 1
            ends[f"{rover}: {end}"] += 1
            stopped += bool(stops)
    console.print(f"{stopped} of {healthy} healthy missions were stopped; ends: {dict(ends)}", soft_wrap=True)
    finished = sum(ends[f"{rover}: {Mode.FINISHED.value}"] for rover in set(rovers))
    is_strict = arguments.sensors.endswith("fixes") or arguments.sensors == "camera"
    is_reached = finished == healthy and not (stopped and is_strict)
    return 0 if is_reached else 1


if __name__ == "__main__":
    sys.exit(main())
