"""Wrong gyros, wrong encoders, pauses, breaks: noticed when, named how, and is the estimate honest after it?

    python -m benchmarks.safety.sensor_faults [--seeds 3] [--rover robotino] [--fault NAME]

Both shipped rovers on random slippery ground; the truth is the plant's. Per fault: runs in which it was
noticed, the longest time and true travel from its begin to the stop, or to the suspicion that is shown where
nothing can decide, the greatest NEES of the pose while the rover drives on (99.9 % bound 16.3), the reason.
Faults that slip can explain are marked: they need not be noticed at once. Exit code 1 where
another one is missed, or a rover drives on with a NEES beyond the bound.
"""

import argparse
import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise, product

from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.cluster_option import add_cluster_option
from benchmarks.safety.missions import ROVERS, Driven, Falsify, Moment, drive
from controllers.safety import Mode
from drivers.samples import RateSample, Sample
from rover_hil.config import Config
from rover_hil.parallel.executor import open_executor
from tests.controllers.wrong_encoders import WrongEncoders

START_S = 8.0
LIMIT_S = 30.0
GREATEST_NEES = 16.27
LONGEST_S, LONGEST_M = 1.5, 0.15

ChangeRate = Callable[[float, RateSample], float]


def gyro(change: ChangeRate) -> Falsify:
    """Return a fault that replaces the yaw rate, given the time since its begin and the sample."""

    def falsify(t_s: float, sample: Sample) -> Sample | None:
        if isinstance(sample, RateSample) and t_s >= START_S:
            return replace(sample, rate_z_rad_s=change(t_s - START_S, sample))
        return sample

    return falsify


def encoders(factor: float, wheels: tuple[int, ...] | None = None) -> Falsify:
    """Return a fault of the encoders."""
    wrong = WrongEncoders(factor, wheels)
    return lambda t_s, sample: wrong(sample) if t_s >= START_S else sample


class StuckGyro:
    """The first reading of the fault, for ever."""

    def __init__(self) -> None:
        self._rate_rad_s: float | None = None

    def __call__(self, t_s: float, sample: RateSample) -> float:
        """Return it."""
        if self._rate_rad_s is None:
            self._rate_rad_s = sample.rate_z_rad_s
        return self._rate_rad_s


@dataclass(frozen=True)
class Fault:
    """A fault of a sensor, or a pause of the process, or a broken link.

    Attributes:
        make: Returns what falsifies the samples.
        must_be_noticed: False where slip can explain it, or nothing is wrong after it.
        paused_s: How long the process does not run.
        unplugged: Role of the devices that are unplugged for a second.
    """

    make: Callable[[], Falsify] = lambda: lambda _, sample: sample
    must_be_noticed: bool = True
    paused_s: float = 0.0
    unplugged: tuple[str, ...] = ()


FAULTS: Mapping[str, Fault] = {
    "gyro +0.5 rad/s": Fault(lambda: gyro(lambda _, sample: sample.rate_z_rad_s + 0.5)),
    "gyro -0.5 rad/s": Fault(lambda: gyro(lambda _, sample: sample.rate_z_rad_s - 0.5)),
    "gyro 0 rad/s": Fault(lambda: gyro(lambda _, __: 0.0)),
    "gyro stuck": Fault(lambda: gyro(StuckGyro())),
    "gyro 30 rad/s": Fault(lambda: gyro(lambda _, __: 30.0)),
    "gyro wrong sign": Fault(lambda: gyro(lambda _, sample: -sample.rate_z_rad_s)),
    "gyro wrong axis": Fault(lambda: gyro(lambda _, sample: sample.rate_x_rad_s or 0.0)),
    "gyro bias step 0.5 deg/s": Fault(
        lambda: gyro(lambda _, sample: sample.rate_z_rad_s + math.radians(0.5)), must_be_noticed=False
    ),
    "gyro scaled by 0.5": Fault(
        lambda: gyro(lambda _, sample: 0.5 * sample.rate_z_rad_s), must_be_noticed=False
    ),
    "encoders reversed": Fault(lambda: encoders(-1.0)),
    "encoder 0 reversed": Fault(lambda: encoders(-1.0, (0,))),
    "encoders stuck": Fault(lambda: encoders(0.0)),
    "encoder 0 stuck": Fault(lambda: encoders(0.0, (0,))),
    "encoders scaled by 1.1": Fault(lambda: encoders(1.1), must_be_noticed=False),
    "process paused 0.5 s": Fault(paused_s=0.5, must_be_noticed=False),
    "process paused 2 s": Fault(paused_s=2.0, must_be_noticed=False),
    "wheels unplugged 1 s": Fault(unplugged=("wheels",)),
    "gyro unplugged 1 s": Fault(unplugged=("gyro",)),
    "both unplugged 1 s": Fault(unplugged=("wheels", "gyro")),
}


@dataclass(frozen=True)
class Result:
    """One run with one fault: None where it was not noticed, or the rover did not drive again."""

    time_s: float | None
    travel_m: float
    nees: float | None
    end: Mode
    reason: str


def run_once(job: tuple[str, str, int]) -> Result:
    """Drive a mission with one fault."""
    rover, name, seed = job
    fault = FAULTS[name]
    config = _unplug(ROVERS[rover](seed), fault.unplugged)
    driven = drive(
        config, fault.make(), paused_s=(START_S, START_S + fault.paused_s), limit_s=START_S + LIMIT_S
    )
    return judge(driven)


def judge(driven: Driven) -> Result:
    """Return when the fault was named, and how honest the estimate was when the rover drove on."""
    stop = next((moment for moment in _named(driven) if moment.t_s >= START_S), None)
    until_s = math.inf if stop is None else stop.t_s
    way = [moment.truth for moment in driven.moments if START_S <= moment.t_s <= until_s]
    travel_m = sum(math.dist(before[:2], after[:2]) for before, after in pairwise(way))
    # Of two suspicions the second may be the one that widens the estimate.
    honest_s = until_s if stop is None or stop.output.reason else max(until_s, START_S + LONGEST_S)
    again = [
        moment.nees
        for moment in driven.moments
        if moment.t_s > honest_s and moment.output.mode in (Mode.RUNNING, Mode.FINISHED)
    ]
    return Result(
        time_s=None if stop is None else stop.t_s - START_S,
        travel_m=travel_m,
        nees=max(again, default=None),
        end=driven.mode,
        reason="" if stop is None else stop.output.reason or stop.output.suspicion,
    )


def _named(driven: Driven) -> list[Moment]:
    """Return the first cycle of every stop, and of every suspicion that is shown."""
    begun = [
        after
        for before, after in pairwise(driven.moments)
        if after.output.suspicion and not before.output.suspicion
    ]
    return sorted([*driven.stops(), *begun], key=lambda moment: moment.t_s)


def _unplug(config: Config, roles: tuple[str, ...]) -> Config:
    simulation = config.require_simulation()
    faults = [
        {
            "type": "unplug",
            "device": getattr(config.roles, role),
            "start_s": START_S,
            "duration_s": 1.0,
        }
        for role in roles
    ]
    changed = type(simulation).model_validate({**simulation.model_dump(by_alias=True), "faults": faults})
    return config.model_copy(update={"simulation": changed})


def _is_reached(fault: Fault, results: list[Result]) -> bool:
    noticed = [r for r in results if r.time_s is not None and _is_in_time(r)]
    is_honest = all(r.nees is None or r.nees <= GREATEST_NEES for r in results if r.time_s is not None)
    return is_honest and (not fault.must_be_noticed or len(noticed) == len(results))


def _is_in_time(result: Result) -> bool:
    return result.time_s is not None and (result.time_s <= LONGEST_S or result.travel_m <= LONGEST_M)


def main() -> int:
    """Print the table; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=30_000)
    parser.add_argument("--rover", choices=ROVERS, action="append")
    parser.add_argument("--fault", choices=FAULTS, action="append")
    add_cluster_option(parser)
    arguments = parser.parse_args()
    cases = list(product(arguments.rover or ROVERS, arguments.fault or FAULTS))
    jobs = [
        (*case, seed) for case in cases for seed in range(arguments.first, arguments.first + arguments.seeds)
    ]
    with open_executor(arguments.cluster) as pool:
        results = list(track(pool.map(run_once, jobs), total=len(jobs), console=Console(stderr=True)))
    table = Table("rover", "fault", "noticed", "time s", "travel m", "NEES after", "ends", "reason", "bar")
    reached = True
    for index, (rover, name) in enumerate(cases):
        of_fault = results[index * arguments.seeds : (index + 1) * arguments.seeds]
        fault, noticed = FAULTS[name], [r for r in of_fault if r.time_s is not None]
        honest = [r.nees for r in noticed if r.nees is not None]
        is_reached = _is_reached(fault, of_fault)
        reached &= is_reached
        table.add_row(
            rover,
            name,
            f"{len(noticed)} of {len(of_fault)}" + ("" if fault.must_be_noticed else " (slip)"),
            f"{max((r.time_s or 0.0 for r in noticed), default=math.nan):.2f}",
            f"{max((r.travel_m for r in noticed), default=math.nan):.3f}",
            f"{max(honest):.1f}" if honest else "stays stopped",
            " ".join(sorted({r.end.value for r in of_fault})),
            noticed[0].reason[:70] if noticed else "",
            "yes" if is_reached else "NO",
        )
    Console(width=220).print(table)
    return 0 if reached else 1


if __name__ == "__main__":
    sys.exit(main())
