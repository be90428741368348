"""False alarms: healthy missions on slippery ground, which nothing may stop.

    python -m benchmarks.safety.healthy_missions [--missions 300] [--el-dorado 20] [--first 20000]
    python -m benchmarks.safety.healthy_missions --missions 40 --el-dorado 0 --nature 20 --sensors fixes
    python -m benchmarks.safety.healthy_missions --missions 200 --el-dorado 0 --nature 200 --sensors camera
    python -m benchmarks.safety.healthy_missions --missions 300 --el-dorado 100 --nature 200 --area 0.5

The Robotino drives its rectangle on random sites of loose and soft patches, the El-Dorado 1.5 m straight on
slopes of sand of up to 12 deg in any direction. `--nature` missions are of the Robotino of `tests/nature` on
floors on which it loses a fifth of its wheels' travel, and in places nearly all. Sensors of both Robotinos:
`excitation`, the yaw excitation as shipped; `encoders`, encoders and gyro alone; `fixes`, the excitation and
fixes by an overhead camera every two seconds; `encoders+fixes`, these without the excitation; `camera`,
encoders, gyro and a camera that measures the motion over the ground, by the model of its errors.

Prints every stop with its reason and the true progress over the half metre of the wheels before it, the
number of missions with one, and how the missions ended. A rover stopped below 2 % of progress is not healthy.
Exit code 1 where a healthy mission did not finish, or one with fixes or a camera was stopped.

`--area M` drives each mission twice: as configured, and with the stops that are off as shipped: the box
around its path that is wider by the greatest 95 % radius and by M as area, `response_ratio` and
`least_supply_v`. It prints these radii; exit code 1 also where one of these stopped a mission.
"""

import argparse
import math
import statistics
import sys
from collections import Counter
from typing import NamedTuple

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
from controllers.safety.area import PolygonArea
from controllers.safety.position_region import CHI_SQUARE
from rover_hil.config import Config
from rover_hil.parallel.executor import open_executor

FIXES_PER_S = 0.5
EL_DORADO_LIMIT_S = 120.0
LIMIT_S = 300.0
"""A rover that loses most of its wheels' travel takes several times as long."""
TRAVEL_M, LEAST_PROGRESS = 0.5, 0.02
RESPONSE_RATIO, LEAST_SUPPLY_V, BODY_M = 0.6, 20.0, 0.35
STOPS = ("safety.area", "% of its setpoints over", "safety.least_supply_v")
"""Parts of their reasons."""
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


class Outcome(NamedTuple):
    """How a mission went.

    Attributes:
        end: The last mode.
        stops: Time and reason of every stop, and the progress before it.
        radius_m: Greatest radius of the 95 % region of the position.
    """

    end: str
    stops: list[tuple[str, float]]
    radius_m: float


def outcome(rover: str, seed: int, sensors: str, margin_m: float | None) -> Outcome:
    """Drive one mission, with a margin once more in an area; return how the last drive went."""
    make_plant = make_camera = None
    limit_s = LIMIT_S
    if rover == "el-dorado":
        config, limit_s = ROVERS[rover](seed), EL_DORADO_LIMIT_S
    else:
        config = equipped(robotino(seed), sensors)
        if rover == "nature":
            config, make_plant = with_drooping_drives(config), omni_contact(seed)
        make_camera = ground_camera(seed) if sensors == "camera" else None
    driven = drive(config, limit_s=limit_s, make_plant=make_plant, make_camera=make_camera)
    radius_m = greatest_radius_m(driven)
    if margin_m is not None:
        config = with_stops(config, radius_m + margin_m)
        driven = drive(config, limit_s=limit_s, make_plant=make_plant, make_camera=make_camera)
    stops = [(f"{stop.t_s:.2f} s: {stop.output.reason}", progress(driven, stop)) for stop in driven.stops()]
    return Outcome(driven.mode.value, stops, radius_m)


def greatest_radius_m(driven: Driven) -> float:
    """Return the greatest semi-axis of the 95 % regions of the position in a mission."""
    variances_m2 = []
    for moment in driven.moments:
        xx, xy, _, yy, _, _ = moment.output.estimate.covariance
        variances_m2.append(0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy))
    return math.sqrt(CHI_SQUARE * max(variances_m2))


def with_stops(config: Config, margin_m: float) -> Config:
    """Return the rover with all stops, in the box that is wider than the path of its mission by a margin."""
    assert config.mission is not None
    xs, ys = zip(*config.mission.corners(), strict=True)
    (left, right), (bottom, top) = ((min(v) - margin_m, max(v) + margin_m) for v in (xs, ys))
    points = ((left, bottom), (right, bottom), (right, top), (left, top))
    area = PolygonArea(type="polygon", points_m=points)
    stops = {
        "area": area,
        "area_body_m": BODY_M,
        "response_ratio": RESPONSE_RATIO,
        "least_supply_v": LEAST_SUPPLY_V,
    }
    return config.model_copy(update={"safety": config.safety.model_copy(update=stops)})


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
    parser.add_argument("--area", type=float, help="margin of the area around path and 95 %% radius, in m")
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
    by_option, radii_m = 0, dict[str, list[float]]()
    with open_executor(arguments.cluster, arguments.processes) as pool:
        shared = ([value] * len(rovers) for value in (arguments.sensors, arguments.area))
        results = pool.map(outcome, rovers, seeds, *shared)
        missions = zip(rovers, seeds, results, strict=True)
        for rover, seed, (end, stops, radius_m) in track(
            missions, total=len(rovers), console=Console(stderr=True)
        ):
            radii_m.setdefault(rover, []).append(radius_m)
            by_option += any(name in stop for stop, _ in stops for name in STOPS)
            for stop, share in stops:
                console.print(f"{rover} {seed}: {stop} (progress {100.0 * share:.1f} %)", soft_wrap=True)
            if any(share < LEAST_PROGRESS for _, share in stops):
                ends[f"{rover} that was stuck: {end}"] += 1
                continue
            healthy += 1
            ends[f"{rover}: {end}"] += 1
            stopped += bool(stops)
    console.print(f"{stopped} of {healthy} healthy missions were stopped; ends: {dict(ends)}", soft_wrap=True)
    for rover, each_m in radii_m.items() if arguments.area is not None else ():
        middle_m = statistics.median(each_m)
        console.print(f"{rover}: 95 % radius median {middle_m:.3f} m, greatest {max(each_m):.3f} m")
    if arguments.area is not None:
        console.print(f"{by_option} of {len(rovers)} missions were stopped by area, response or supply")
    finished = sum(ends[f"{rover}: {Mode.FINISHED.value}"] for rover in set(rovers))
    is_strict = arguments.sensors.endswith("fixes") or arguments.sensors == "camera"
    is_reached = finished == healthy and not (stopped and is_strict)
    return 0 if is_reached and not by_option else 1


if __name__ == "__main__":
    sys.exit(main())
