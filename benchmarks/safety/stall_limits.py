"""False stops by the rule about wheels that do not turn, with several limits beside each other.

    python -m benchmarks.safety.stall_limits [--missions 12] [--first 61000]
    python -m benchmarks.safety.stall_limits --shipped --missions 12 --first 54000

Healthy missions with encoders, gyro and a ground camera: of the Robotino of `tests/nature` on random ground
with a relaxation length of 5 mm (odd seeds) or 15 mm, whose drives droop by more than the shipped settings
say, or of the shipped Robotino. No wheel stops them; each rule watches the same drive. Prints for each
mission the first stop by each rule, and then how many missions each would have stopped.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterator
from unittest import mock

import numpy as np
from rich.console import Console
from rich.progress import track

from benchmarks.cluster_option import add_cluster_option
from benchmarks.safety.healthy_missions import equipped
from benchmarks.safety.missions import drive, ground_camera, robotino
from controllers.fault import Fault, Severity
from controllers.safety import settings as safety_settings
from controllers.safety.entrapment import EntrapmentSettings, ProgressOverGround
from controllers.safety.reasons import Cycle
from controllers.safety.stall_monitor import StallMonitor, StallSettings
from rover_hil.parallel.executor import open_executor
from tests.nature.omni_contact import Floor, OmniContact

LIMIT_S = 120.0
CREEPING_RAD_S = 1.0


class _Excused(StallMonitor):
    """No stall at creeping setpoints while a camera measures progress: a rival of the limits."""

    def __init__(self, settings: StallSettings, wheel_count: int) -> None:
        super().__init__(settings, wheel_count)
        self._ground = ProgressOverGround(EntrapmentSettings().entrapment_ground_m)

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        for pair in cycle.measurements.ground_pairs:
            self._ground.take(pair)
        if self._ground.lost_m:
            return super().check(cycle)
        pairs = zip(cycle.wheels.set.speed_rad_s, cycle.wheels.measured_rad_s, strict=True)
        follows = tuple(set_to if abs(set_to) < CREEPING_RAD_S else turns for set_to, turns in pairs)
        return super().check(cycle._replace(wheels=cycle.wheels._replace(measured_rad_s=follows)))


RULES = {
    "turns from 0.02 rad/s on": (StallMonitor, StallSettings(stall_speed_rad_s=0.02)),
    "turns from 0.01 rad/s on, shipped": (StallMonitor, StallSettings()),
    "turns from 0.005 rad/s on": (StallMonitor, StallSettings(stall_speed_rad_s=0.005)),
    "0.02, setpoints from 0.7 rad/s on": (
        StallMonitor,
        StallSettings(stall_speed_rad_s=0.02, stall_set_point_rad_s=0.7),
    ),
    "0.02, setpoints from 1 rad/s on": (
        StallMonitor,
        StallSettings(stall_speed_rad_s=0.02, stall_set_point_rad_s=1.0),
    ),
    "0.02, excused by progress over the ground": (_Excused, StallSettings(stall_speed_rad_s=0.02)),
}


def first_stops(is_shipped: bool, seed: int) -> tuple[str, dict[str, str]]:
    """Drive a mission; return its end, and the first stop by each rule that would have stopped it."""
    monitors = {name: make(settings, 3) for name, (make, settings) in RULES.items()}
    stops: dict[str, str] = {}

    class Watching(StallMonitor):
        def check(self, cycle: Cycle) -> Iterator[Fault]:
            for name, monitor in monitors.items():
                for reason in monitor.check(cycle):
                    if reason.severity is Severity.STOP:
                        stops.setdefault(name, reason.text)
            return iter(())

    floor = Floor.random(np.random.default_rng(seed), 0.005 if seed % 2 else 0.015)
    with mock.patch.object(safety_settings, "StallMonitor", Watching):
        driven = drive(
            equipped(robotino(seed), "camera"),
            limit_s=LIMIT_S,
            make_plant=None if is_shipped else lambda start_ns: OmniContact(floor, start_ns),
            make_camera=ground_camera(seed),
        )
    return driven.mode.value, stops


def main() -> int:
    """Print the stops."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--missions", type=int, default=12)
    parser.add_argument("--first", type=int, default=61_000)
    parser.add_argument("--shipped", action="store_true", help="the shipped Robotino on random sites")
    parser.add_argument("--processes", type=int, help="default: one for each processor")
    add_cluster_option(parser)
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.missions)
    stopped, ends = Counter[str](), Counter[str]()
    with open_executor(arguments.cluster, arguments.processes) as pool:
        results = pool.map(first_stops, [arguments.shipped] * len(seeds), seeds)
        missions = zip(seeds, results, strict=True)
        for seed, (end, stops) in track(missions, total=len(seeds), console=Console(stderr=True)):
            ends[end] += 1
            stopped.update(list(stops))
            for name, text in stops.items():
                print(f"{seed}, {name}: {text}", flush=True)
    print(f"{len(seeds)} missions without the rule: {dict(ends)}")
    for name in RULES:
        print(f"{name}: {stopped[name]}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
