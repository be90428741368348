"""The yaw excitation with faults of the gyro and other contacts: is wrong slip marked valid?

    python -m benchmarks.robotino.yaw_probe_faults [--sites 12] [--first 3000] [--only CASE ...] [--out FILE]

Every site is driven once with encoders and gyro alone, once with the yaw excitation without calibration, and
once after calibration (`rover-hil calibrate imu` on firm ground with the same fault). The faults act on what
the gyro senses, in a wrapper of the simulated rover that shares no code with the program: low-pass of first
order at 10 and 20 Hz, delay of 40 ms. Other contacts: patchworks of surfaces with random constants, and
`tests/nature/omni_contact.py` with a relaxation length of 5 and 15 mm.
Slip is judged every cycle of a run against the true slip of the half second before: wrong is more than 0.1
and more than 3 reported standard deviations off.
"""

import argparse
import json
import math
import sys
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import cast

import numpy as np
from rich.console import Console
from rich.progress import track

from benchmarks.cluster_option import add_cluster_option
from benchmarks.wilson import share_text
from controllers.safety import Mode
from controllers.slip.effort.gyro_response import GyroResponse
from drivers.clock import VirtualClock, nanoseconds, seconds
from drivers.link import NoTap
from rover_hil.config import Config, load_config
from rover_hil.parallel.executor import open_executor
from rover_hil.ready.imu.calibration import small_turns_config
from rover_hil.ready.imu.fit import fit_response
from rover_hil.ready.imu.turns import read_turns
from rover_hil.ready.turns import on_firm_floor
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.writer import LogWriter
from rover_hil.report.tracks import Track
from rover_hil.run.composition import build_virtual_rig
from rover_hil.tune.metrics import TruePath, closure_m, path_rms_m
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.plants.robotino.site import Site, random_site
from sim_backends.plants.robotino.surfaces import Surface
from sim_backends.world.plant import Plant, Truth
from sim_backends.world.world import World
from tests.nature.omni_contact import Floor, OmniContact

TIME_LIMIT_S = 90.0
STEP_NS = 1_000_000
WINDOW = 50
"""Cycles in a second, the time of a reading."""
LEAST_WAY_M = 0.015
WRONG, DEVIATIONS = 0.1, 3.0
BAR_PATH_M, BAR_CLOSURE_M = 0.045, 0.100
ANGLES = np.radians((60.0, 180.0, 300.0))
TO_BODY = np.linalg.inv(np.column_stack((-np.sin(ANGLES), np.cos(ANGLES), np.full(3, 0.125)))) * 0.040


@dataclass(frozen=True)
class Fault:
    """What is wrong with the gyro."""

    low_pass_hz: float | None = None
    delay_s: float = 0.0


FAULTS = {
    "fast gyro": Fault(),
    "low-pass 10 Hz": Fault(low_pass_hz=10.0),
    "low-pass 20 Hz": Fault(low_pass_hz=20.0),
    "delay 40 ms": Fault(delay_s=0.040),
}


class FaultyGyro:
    """A simulated rover as its gyro senses it; everything else is as it is.

    Args:
        plant: The rover.
        fault: Of the gyro.
    """

    def __init__(self, plant: Plant, fault: Fault) -> None:
        self._plant, self._fault = plant, fault
        self.wheel_count = plant.wheel_count
        self._past: deque[tuple[int, float]] = deque()
        self._sensed_rad_s = 0.0
        self._t_ns: int | None = None

    def set_wheel_speeds(self, speed_rad_s: Sequence[float]) -> None:
        """Pass the setpoints on."""
        self._plant.set_wheel_speeds(speed_rad_s)

    def advance(self, t_ns: int) -> None:
        """Integrate in steps of a millisecond, and filter what the gyro senses."""
        if self._t_ns is None:
            self._plant.advance(t_ns)
            self._t_ns = t_ns
        while self._t_ns < t_ns:
            next_ns = min(self._t_ns + STEP_NS, t_ns)
            self._plant.advance(next_ns)
            rate = self._delayed(next_ns, self._plant.truth().yaw_rate_rad_s)
            if self._fault.low_pass_hz is not None:
                keep = math.exp(-math.tau * self._fault.low_pass_hz * seconds(next_ns - self._t_ns))
                rate += keep * (self._sensed_rad_s - rate)
            self._sensed_rad_s, self._t_ns = rate, next_ns

    def _delayed(self, now_ns: int, rate_rad_s: float) -> float:
        self._past.append((now_ns, rate_rad_s))
        then_ns = now_ns - nanoseconds(self._fault.delay_s)
        while len(self._past) > 1 and self._past[1][0] <= then_ns:
            self._past.popleft()
        return self._past[0][1]

    def truth(self) -> Truth:
        """Return the true state."""
        return self._plant.truth()

    def sensed(self) -> Truth:
        """Return the state with the yaw rate that the gyro senses."""
        return replace(self._plant.truth(), yaw_rate_rad_s=self._sensed_rad_s)


class _AsSensed:
    """The rover as the emulator of the gyro sees it."""

    def __init__(self, rover: FaultyGyro) -> None:
        self.truth = rover.sensed


def spoil(world: World, fault: Fault, spare_plant: Plant | None) -> None:
    """Put a fault of the gyro, and perhaps another rover, into a simulated world."""
    plant = world.plant if spare_plant is None else spare_plant
    rover = FaultyGyro(plant, fault)
    world.plant = cast("Plant", rover)
    vars(world.byte_devices["board"].emulator)["_plant"] = plant
    vars(world.byte_devices["imu"].emulator)["_plant"] = _AsSensed(rover)


@dataclass(frozen=True)
class Ground:
    """A kind of ground: a site of the shipped rover, or another rover on its own ground, by seed."""

    name: str
    site: Callable[[int], Site] | None = None
    relaxation_m: float = 0.0


def random_constants(seed: int) -> Site:
    """Return a patchwork of surfaces with random constants."""
    rng = np.random.default_rng(seed)
    names = ("table", "brown", "gray", "green", "blue", "red")
    surfaces = {
        name: Surface(
            friction=rng.uniform(0.4, 1.0),
            stiffness=math.exp(rng.uniform(math.log(1.2), math.log(25.0))),
            drag_along=rng.uniform(0.005, 0.12),
            drag_across=rng.uniform(0.03, 0.3),
        )
        for name in names
    }
    return random_site(rng).model_copy(update={"surfaces": surfaces})


def any_site(seed: int) -> Site:
    """Return a patchwork of the measured surfaces."""
    return random_site(np.random.default_rng(seed))


GROUNDS = (
    Ground("sites", site=any_site),
    Ground("random constants", site=random_constants),
    Ground("relaxation 5 mm", relaxation_m=0.005),
    Ground("relaxation 15 mm", relaxation_m=0.015),
)


@dataclass(frozen=True)
class Run:
    """One run.

    Attributes:
        finished: Whether the mission was finished.
        end: Why it was not; empty where it was.
        valid, wrong: Shares of the running time with valid slip, and with wrong slip marked valid.
        square: Mean square of the error of valid slip; None without valid slip.
        bias: Its mean.
        path_m, closure_m: Errors of the true path.
    """

    finished: bool
    end: str
    valid: float
    wrong: float
    square: float | None
    bias: float | None
    path_m: float
    closure_m: float


def configure(ground: Ground, seed: int, *, probe: bool, gyro: GyroResponse | None) -> Config:
    """Return the shipped Robotino on a ground, with the yaw excitation or with encoders and gyro alone."""
    table = load_config("robotino").model_dump(by_alias=True)
    table["loop"]["time_limit_s"] = TIME_LIMIT_S
    if probe:
        table["slip"]["gyro_response"] = None if gyro is None else gyro.model_dump()
    else:
        table["slip"] = None
    config = Config.model_validate(table)
    simulation = config.require_simulation()
    site = Site() if ground.site is None else ground.site(seed)
    plant = RobotinoPlantSettings(type="robotino", site=site)
    return config.model_copy(
        update={"simulation": simulation.model_copy(update={"seed": seed, "plant": plant})}
    )


def drive(ground: Ground, seed: int, fault: Fault, *, probe: bool, gyro: GyroResponse | None) -> Run:
    """Drive once and judge."""
    config = configure(ground, seed, probe=probe, gyro=gyro)
    clock = VirtualClock()
    rig, world = build_virtual_rig(config, clock, NoTap())
    spare_plant = None
    if ground.relaxation_m:
        floor = Floor.random(np.random.default_rng(seed), ground.relaxation_m)
        spare_plant = OmniContact(floor, clock.now_ns())
    spoil(world, fault, spare_plant)
    period_ns = nanoseconds(1.0 / config.loop.rate_hz)
    start_ns = now_ns = clock.now_ns()
    rows: list[tuple[float, ...]] = []
    mode, reason = Mode.SETTLING, ""
    rig.connect(1.0)
    with closing(rig):
        while now_ns < start_ns + nanoseconds(TIME_LIMIT_S) and mode not in (
            Mode.FINISHED,
            Mode.EMERGENCY_STOP,
        ):
            now_ns += period_ns
            clock.sleep_until(now_ns)
            _, output, _ = rig.cycle(now_ns)
            mode, reason = output.mode, output.reason
            truth = world.plant.truth()
            slip = None if output.slip is None else output.slip.rover
            reading = (math.nan, math.nan, 0.0) if slip is None else (slip.slip, slip.sd, not slip.reason)
            rows.append(
                (
                    seconds(now_ns - start_ns),
                    truth.x_m,
                    truth.y_m,
                    truth.yaw_rad,
                    *truth.wheel_position_rad,
                    mode is Mode.RUNNING,
                    *reading,
                )
            )
    table = np.array(rows)
    path = TruePath.of(Track.of(table[:, :4]).from_first_pose())
    assert config.mission is not None
    corners = config.mission.corners()
    finished = mode is Mode.FINISHED
    end = "" if finished else reason or mode.value
    valid, wrong, square, bias = judge_slip(table)
    return Run(finished, end, valid, wrong, square, bias, path_rms_m(path, corners), closure_m(path, corners))


def judge_slip(table: np.ndarray) -> tuple[float, float, float | None, float | None]:
    """Return shares of valid, and wrong and valid slip, mean square and mean of its error."""
    yaw = table[:, 3]
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    true_m = np.diff(table[:, 1] + 1j * table[:, 2]) * np.exp(-1j * middle)
    wheels = np.diff(table[:, 4:7], axis=0) @ TO_BODY.T
    wheels_m = wheels[:, 0] + 1j * wheels[:, 1]
    true_sum, wheel_sum = (np.concatenate(([0.0], np.cumsum(each))) for each in (true_m, wheels_m))
    ends = np.flatnonzero(table[:, 7] > 0.0)
    ends = ends[ends >= WINDOW]
    true_way, wheel_way = (each[ends] - each[ends - WINDOW] for each in (true_sum, wheel_sum))
    moves = np.abs(wheel_way) > LEAST_WAY_M
    true_slip = 1.0 - (true_way / np.where(moves, wheel_way, 1.0)).real
    slip, sd, valid = table[ends, 8], table[ends, 9], table[ends, 10] > 0.0
    error = np.abs(slip - true_slip)
    used = valid & moves
    wrong = used & (error > WRONG) & (error > DEVIATIONS * sd)
    if not used.any():
        return float(valid.mean()), 0.0, None, None
    differences = (slip - true_slip)[used]
    return float(valid.mean()), float(wrong.mean()), float(np.mean(differences**2)), float(differences.mean())


def calibrate(fault: Fault) -> GyroResponse:
    """Return the constants of a gyro with a fault, as `rover-hil calibrate imu` identifies them."""
    config = small_turns_config(load_config("robotino"))
    config = config.model_copy(update={"simulation": on_firm_floor(config.require_simulation())})
    clock = VirtualClock()
    with TemporaryDirectory() as folder:
        path = Path(folder) / "turns.mcap"
        config_json = config.model_dump_json(by_alias=True).encode()
        with LogWriter(path, clock.now_ns(), config_json, collect_data_files(config), "virtual") as log:
            rig, world = build_virtual_rig(config, clock, log)
            spoil(world, fault, None)
            period_ns, mode = nanoseconds(1.0 / config.loop.rate_hz), Mode.SETTLING
            rig.connect(1.0)
            with closing(rig):
                while mode not in (Mode.FINISHED, Mode.EMERGENCY_STOP):
                    clock.sleep_until(clock.now_ns() + period_ns)
                    samples, output, _ = rig.cycle(clock.now_ns())
                    log.samples(clock.now_ns(), samples)
                    mode = output.mode
        fit = fit_response(read_turns(path))
    assert not fit.problem, fit.problem
    return GyroResponse(
        source="benchmark",
        identified_on="2026-11-23",
        gain=fit.gain,
        gain_sd=fit.gain_sd,
        delay_s=fit.delay_s,
        delay_sd_s=fit.delay_sd_s,
        bandwidth_hz=fit.bandwidth_hz,
        bandwidth_sd_hz=fit.bandwidth_sd_hz,
    )


@dataclass(frozen=True)
class Case:
    """A row of the table.

    Attributes:
        ground: What is driven on.
        gyro: Name of its fault, one of `FAULTS`.
        slip: How slip is known, one of `ENCODERS`, `NOT_CALIBRATED` and `CALIBRATED`.
    """

    ground: Ground
    gyro: str
    slip: str

    @property
    def title(self) -> str:
        """Name of the row."""
        if self.slip == ENCODERS:
            return f"{self.ground.name}, {ENCODERS}"
        return f"{self.ground.name}, {self.gyro}, {self.slip}"


ENCODERS, NOT_CALIBRATED, CALIBRATED = "encoders", "not calibrated", "calibrated"
CASES = (
    *(
        Case(ground, "fast gyro", slip)
        for ground in GROUNDS
        for slip in (ENCODERS, NOT_CALIBRATED, CALIBRATED)
    ),
    *(Case(GROUNDS[0], gyro, slip) for gyro in list(FAULTS)[1:] for slip in (NOT_CALIBRATED, CALIBRATED)),
)


def wrong_percent(runs: Sequence[Run]) -> float:
    """Return the share of the time with wrong slip marked valid."""
    return 100.0 * float(np.mean([run.wrong for run in runs]))


def row_of(runs: Sequence[Run]) -> dict[str, str]:
    """Return the figures of a table's row."""
    squares = [run.square for run in runs if run.square is not None]
    biases = [abs(run.bias) for run in runs if run.bias is not None]
    within = [r.finished and r.path_m <= BAR_PATH_M and r.closure_m <= BAR_CLOSURE_M for r in runs]
    return {
        "valid, % of the time": f"{100.0 * float(np.mean([run.valid for run in runs])):.0f}",
        "wrong and valid, %": f"{wrong_percent(runs):.1f}",
        "slip rms": f"{math.sqrt(float(np.mean(squares))):.3f}" if squares else "",
        "bias of a site": f"{float(np.mean(biases)):.3f}" if biases else "",
        "path, mm": f"{1e3 * float(np.median([run.path_m for run in runs])):.0f}",
        "closure, mm": f"{1e3 * float(np.median([run.closure_m for run in runs])):.0f}",
        "finished": share_text(sum(run.finished for run in runs), len(runs)),
        "within 45 and 100 mm": share_text(sum(within), len(runs)),
    }


def drive_case(case: Case, seed: int, gyro: GyroResponse | None) -> Run:
    """Drive one case on the ground of a seed; `gyro` are the constants where it is calibrated."""
    return drive(case.ground, seed, FAULTS[case.gyro], probe=case.slip != ENCODERS, gyro=gyro)


def experiment(cases: Sequence[Case], seeds: range, cluster: str | None) -> dict[Case, list[Run]]:
    """Return the runs of every case."""
    gyros = {case.gyro for case in cases if case.slip == CALIBRATED}
    known = {name: calibrate(fault) for name, fault in FAULTS.items() if name in gyros}
    jobs = [
        (case, seed, known[case.gyro] if case.slip == CALIBRATED else None)
        for case in cases
        for seed in seeds
    ]
    with open_executor(cluster) as pool:
        results = pool.map(drive_case, *zip(*jobs, strict=True))
        runs = list(track(results, "drives", total=len(jobs), console=Console(stderr=True)))
    starts = range(0, len(jobs), len(seeds))
    return {case: runs[start : start + len(seeds)] for case, start in zip(cases, starts, strict=True)}


def main() -> int:
    """Print a row for each case; exit code 1 where wrong slip is valid for more than 2 % of the time."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sites", type=int, default=12)
    parser.add_argument(
        "--first",
        type=int,
        default=3000,
        help="first seed; 0 to 19: development, 9100 to 9159: in benchmarks/results",
    )
    titles = [case.title for case in CASES]
    parser.add_argument("--only", nargs="+", choices=titles, default=titles, metavar="CASE")
    parser.add_argument("--out", type=Path)
    add_cluster_option(parser)
    arguments = parser.parse_args()
    cases = [case for case in CASES if case.title in arguments.only]
    seeds = range(arguments.first, arguments.first + arguments.sites)
    results = experiment(cases, seeds, arguments.cluster)
    if arguments.out is not None:
        rows = {case.title: [asdict(run) for run in runs] for case, runs in results.items()}
        arguments.out.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    columns = ["ground, gyro", *row_of(next(iter(results.values())))]
    print("|", " | ".join(columns), "|")
    print("|---" * len(columns), "|", sep="")
    for case, runs in results.items():
        print("|", " | ".join((case.title, *row_of(runs).values())), "|")
    for case, runs in results.items():
        for seed, run in zip(seeds, runs, strict=True):
            if run.end:
                print(f"{case.title}, {seed}: {run.end}")
    return int(any(wrong_percent(runs) > 2.0 for runs in results.values()))


if __name__ == "__main__":
    sys.exit(main())
