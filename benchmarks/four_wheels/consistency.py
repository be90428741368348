"""Is the covariance of the El-Dorado's pose right? NEES over missions on the sites of both field tests.

    python -m benchmarks.four_wheels.consistency [--missions 8] [--first 40000] [--only GROUP] [--camera]

Each mission drives one site along its x axis with the shipped loop. Of each seed the site, the wheel radius
and all noise are drawn anew. Known ground is the soil of the shipped parameters; unknown ground has another
friction angle and shear modulus. Pose fixes are those of an overhead camera every 2 s: 10 mm, 0.6 deg, 0.1 s
late. Without `--camera` no pictures are rendered: the trace is the true direction of the rear left wheel with
a constant error, a correlated one, white noise and missed frames, about as large as in the field tests.

The pose is compared with the plant's truth at the time of the estimate, every half second of driving. Prints
for position (two numbers) and yaw (one): share inside the 95 % ellipse, required 90 to 98 %; mean NEES over
the dimension, required 0.5 to 1.5; root mean square of the error and of the reported standard deviation.
First for each ground and at the end of the missions, then for both grounds together, which is what is judged:
the rover does not know its ground. Exit code 1 where one of these is outside. A mission takes a quarter of a
minute on an idle machine, several times as long with `--camera`.
"""

import argparse
import math
import sys
import tempfile
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from benchmarks.cluster_option import add_cluster_option
from benchmarks.four_wheels.field_drives import MOUNDS, SIDEWAYS
from benchmarks.robotino.consistency import BOUND, INSIDE_BAR, NEES_BAR
from controllers.control_loop import ControlLoop, StepOutput
from controllers.estimation.pose_estimate import PoseEstimate
from controllers.ftrace.reading import Rates, TraceReading
from controllers.safety import Mode
from controllers.slip.scomp.trace_reader import TraceFinder
from drivers.clock import VirtualClock, nanoseconds, seconds
from drivers.link import NoTap
from drivers.samples import FrameSample, PoseFixSample, Sample
from rover_hil.config import Config, load_config
from rover_hil.parallel.executor import open_executor
from rover_hil.run.composition import build_virtual_rig, make_finder
from sim_backends.terramechanics.soil.library import load_soil
from sim_backends.world.plant import Truth

Array = NDArray[np.float64]
Errors: TypeAlias = list[tuple[float, ...]]
"""Rows of `find_errors`."""

EVERY_S = 0.5
LONGEST_S = 400.0
SITES = {"side slope": SIDEWAYS, "mounds": MOUNDS}
WAYS = ("compensated", "not compensated")
GROUNDS = ("known", "unknown")
FIXES = ("no fixes", "fixes")
FIX_PERIOD_S, FIX_DELAY_S, FIX_SD_M, FIX_SD_RAD = 2.0, 0.1, 0.01, 0.01
FRAME_PERIOD_S, FRAME_DELAY_S = 0.2, 0.06
REAR_LEFT_M = (-0.30, 0.22)
SLOWEST_M_S, FIRST_TRACE_S = 0.01, 5.0
FIX_DEVICE, CAMERA = "overhead", "camera"


@dataclass(frozen=True, slots=True)
class Case:
    """What is driven: site, compensated or not, on which ground, with pose fixes or without."""

    seed: int
    site: str
    way: str = WAYS[0]
    ground: str = GROUNDS[0]
    fixes: str = FIXES[0]

    @property
    def group(self) -> str:
        """What is pooled: both sites, both grounds and all seeds. The rover does not know its ground."""
        return f"{self.way}, {self.fixes}"


def configured(case: Case, folder: Path, *, camera: bool = False) -> Config:
    """Return the shipped El-Dorado on the site of a case; its soil is written into `folder`."""
    rng = np.random.default_rng([case.seed, len(case.site)])
    site = SITES[case.site].drawn(rng)
    table = load_config("el-dorado").model_dump(by_alias=True)
    if not camera:
        del table["devices"]["camera"]
        table["roles"]["camera"] = table["scomp"]["rig"] = None
    if case.way == "not compensated":
        table["scomp"] = table["roles"]["camera"] = None
    plant = table["simulation"]["plant"]
    table["simulation"]["seed"] = case.seed
    plant["wheel_radius_error"] = 0.01 + float(rng.normal(0.0, 0.004))
    plant["ground"]["inclination_deg"], plant["ground"]["uphill_deg"] = site.inclination_deg, 0.0
    plant["ground"]["mounds"] = [
        {"x_m": x, "y_m": y, "height_m": top, "radius_m": radius} for x, y, top, radius in site.mounds
    ]
    soil = load_soil("toyoura")
    changes = (float(rng.normal(0.0, 2.0)), math.exp(0.25 * float(rng.standard_normal())))
    if case.ground == "unknown":
        soil = soil.model_copy(
            update={
                "friction_angle_deg": soil.friction_angle_deg + changes[0],
                "shear_modulus_m": soil.shear_modulus_m * changes[1],
            }
        )
        path = folder / f"soil {case.seed} {case.site}.toml"
        path.write_text(_toml(soil.model_dump(exclude_none=True)))
        plant["ground"]["soil"] = str(path)
    table["mission"]["length_m"] = site.way_m
    return Config.model_validate(table)


def _toml(table: dict[str, object], prefix: str = "") -> str:
    """Return a table of numbers, texts, lists and tables as TOML."""
    lines, tables = [], []
    for name, value in table.items():
        if isinstance(value, dict):
            tables.append(f"[{prefix}{name}]\n" + _toml(value, f"{prefix}{name}."))
        else:
            text = list(value) if isinstance(value, tuple) else value
            lines.append(f"{name} = {text!r}")
    return "\n".join([*lines, *tables]) + "\n"


class TraceErrors:
    """Errors of the direction of a trace, frame by frame: constant, correlated, white; and missed frames."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._constant_deg = 0.3 * float(rng.standard_normal())
        self._slow_deg = 0.0
        self._missing = 0

    def next(self) -> tuple[float, bool]:
        """Return the error in deg of the next frame, and whether its trace is missed."""
        keep = math.exp(-FRAME_PERIOD_S / 1.0)
        self._slow_deg *= keep
        self._slow_deg += math.sqrt(1.0 - keep * keep) * 0.5 * float(self._rng.standard_normal())
        if self._rng.random() < 0.005:
            self._missing = int(self._rng.integers(1, 10))
        self._missing = max(0, self._missing - 1)
        error_deg = self._constant_deg + self._slow_deg + 0.4 * float(self._rng.standard_normal())
        return error_deg, self._missing > 0


def shown_trace(
    true_deg: Array, is_present: NDArray[np.bool_], rng: np.random.Generator
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the direction of a trace with errors, in deg, and in which frames it is seen."""
    source = TraceErrors(rng)
    shown = [source.next() for _ in true_deg]
    missed = np.array([is_missed for _, is_missed in shown])
    return true_deg + np.array([error for error, _ in shown]), is_present & ~missed


class TruthfulTrace:
    """A finder whose trace is the true direction of the rear left wheel with errors.

    Args:
        rng: Of the errors.

    Attributes:
        truth: Of the frames that are yet to be found, by their index.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._errors = TraceErrors(rng)
        self.truth: dict[int, Truth] = {}

    def find(
        self, frame: FrameSample, wheel_speed_m_s: float, rates_rad_s: Rates | None
    ) -> TraceReading | None:
        """Return the trace in a frame."""
        truth = self.truth.pop(frame.index)
        error_deg, is_missed = self._errors.next()
        ahead_m_s = truth.velocity_x_m_s - truth.yaw_rate_rad_s * REAR_LEFT_M[1]
        aside_m_s = truth.velocity_y_m_s + truth.yaw_rate_rad_s * REAR_LEFT_M[0]
        seen = not is_missed and ahead_m_s > SLOWEST_M_S and truth.t_ns > nanoseconds(FIRST_TRACE_S)
        angle_rad = math.atan2(aside_m_s, ahead_m_s) + math.radians(error_deg)
        return TraceReading(
            t_ns=frame.t_ns,
            detected=seen,
            theta_rad=angle_rad if seen else None,
            confidence=float(seen),
            source="trace" if seen else "none",
            theta_sd_rad=None,
        )


@dataclass(slots=True)
class Extra:
    """Samples that no emulator sends: pose fixes, and frames for the finder without pictures.

    Attributes:
        finder: None where pictures are rendered.
    """

    rng: np.random.Generator
    begin: Truth
    has_fixes: bool
    finder: TruthfulTrace | None
    frames: int = 0
    waiting: deque[tuple[int, Sample]] = field(default_factory=deque)
    next_fix_ns: int = 0
    next_frame_ns: int = 0

    def samples(self, now_ns: int, truth: Truth) -> Iterator[Sample]:
        """Yield what arrives in the cycle at `now_ns`."""
        if self.has_fixes and now_ns >= self.next_fix_ns:
            self.next_fix_ns = now_ns + nanoseconds(FIX_PERIOD_S)
            self.waiting.append((now_ns + nanoseconds(FIX_DELAY_S), self._fix(now_ns, truth)))
        if self.finder is not None and now_ns >= self.next_frame_ns:
            self.next_frame_ns = now_ns + nanoseconds(FRAME_PERIOD_S)
            self.finder.truth[self.frames] = truth
            picture = np.zeros((1, 1), np.uint8)
            arrival_ns = now_ns + nanoseconds(FRAME_DELAY_S)
            frame = FrameSample(
                device=CAMERA, t_ns=arrival_ns, t_capture_ns=now_ns, index=self.frames, image=picture
            )
            self.frames += 1
            self.waiting.append((arrival_ns, frame))
        for item in [item for item in self.waiting if item[0] <= now_ns]:
            self.waiting.remove(item)
            yield item[1]

    def _fix(self, now_ns: int, truth: Truth) -> PoseFixSample:
        x_m, y_m, yaw_rad = (float(value) for value in self.rng.normal(0.0, (FIX_SD_M, FIX_SD_M, FIX_SD_RAD)))
        return PoseFixSample(
            device=FIX_DEVICE,
            t_ns=now_ns + nanoseconds(FIX_DELAY_S),
            t_capture_ns=now_ns,
            x_m=truth.x_m + x_m,
            y_m=truth.y_m + y_m,
            yaw_rad=truth.yaw_rad + yaw_rad,
            position_std_m=FIX_SD_M,
            yaw_std_rad=FIX_SD_RAD,
        )


@dataclass(frozen=True, slots=True)
class Moment:
    """One cycle: its output, the estimate's age, and the true pose relative to the start at the cycle."""

    t_s: float
    age_s: float
    output: StepOutput
    truth: tuple[float, float, float]


Watch = Callable[[int, Sequence[Sample], Truth], None]
"""Takes the time of a cycle, what arrived in it, and the truth."""


def drive(config: Config, case: Case, watch: Watch = lambda *_: None) -> list[Moment]:
    """Drive the mission of a case to its end; return every cycle."""
    clock = VirtualClock()
    rig, world = build_virtual_rig(config, clock, NoTap())
    has_fixes, has_scomp = case.fixes == "fixes", config.scomp is not None
    has_camera = config.roles.camera is not None
    rng = np.random.default_rng([case.seed, len(case.site), 7])
    finder = TruthfulTrace(rng) if has_scomp and not has_camera else None
    loop = make_loop(config, finder, has_fixes=has_fixes)
    begin = world.plant.truth()
    extra = Extra(rng, begin, has_fixes, finder)
    moments: list[Moment] = []
    start_ns = now_ns = clock.now_ns()
    rig.connect(timeout_s=1.0)
    over = (Mode.FINISHED, Mode.EMERGENCY_STOP)
    with closing(rig):
        while not moments or (moments[-1].output.mode not in over and moments[-1].t_s < LONGEST_S):
            now_ns += nanoseconds(1.0 / config.loop.rate_hz)
            clock.sleep_until(now_ns)
            truth = world.plant.truth()
            samples = [*rig.poll(), *extra.samples(now_ns, truth)]
            watch(now_ns, samples, truth)
            output = loop.step(now_ns, samples)
            rig.drive.command(output.command)
            moments.append(
                Moment(
                    seconds(now_ns - start_ns),
                    seconds(now_ns - output.estimate.t_ns),
                    output,
                    relative_pose(begin, truth),
                )
            )
    return moments


def make_loop(config: Config, finder: TraceFinder | None, *, has_fixes: bool) -> ControlLoop:
    """Return the control loop of a configuration with a finder of its own, and with pose fixes or without."""
    roles = replace(config.device_roles(), fixes=(FIX_DEVICE,) if has_fixes else ())
    if finder is not None:
        roles = replace(roles, camera=CAMERA)
    else:
        finder = make_finder(config)
    return ControlLoop(config, roles, finder)


def relative_pose(begin: Truth, truth: Truth) -> tuple[float, float, float]:
    """Return the true pose in the frame of the start."""
    way = complex(truth.x_m - begin.x_m, truth.y_m - begin.y_m)
    turned = way * complex(math.cos(begin.yaw_rad), -math.sin(begin.yaw_rad))
    return (turned.real, turned.imag, truth.yaw_rad - begin.yaw_rad)


def find_errors(estimate: PoseEstimate, truth: Array) -> tuple[float, ...]:
    """Return NEES, squared error and variance of the position, then of the yaw, against x, y, yaw."""
    xx, xy, _, yy, _, tt = estimate.covariance
    position = np.array([estimate.x_m, estimate.y_m]) - truth[:2]
    yaw_rad = math.remainder(estimate.yaw_rad - truth[2], math.tau)
    nees = float(position @ np.linalg.solve(np.array([[xx, xy], [xy, yy]]) + 1e-12 * np.eye(2), position))
    return (nees, float(position @ position), xx + yy, yaw_rad**2 / (tt + 1e-12), yaw_rad**2, tt)


def rows_of(moments: Sequence[Moment]) -> Errors:
    """Return the errors of each half second of driving."""
    times_s = [moment.t_s for moment in moments]
    truths = np.array([moment.truth for moment in moments])
    rows: Errors = []
    next_s = 0.0
    for moment in moments:
        if moment.output.mode is Mode.RUNNING and moment.t_s >= next_s:
            then_s = moment.t_s - moment.age_s
            truth = np.array([np.interp(then_s, times_s, values) for values in truths.T])
            rows.append(find_errors(moment.output.estimate, truth))
            next_s = moment.t_s + EVERY_S
    return rows


def mission(case: Case, camera: bool) -> tuple[str, Errors]:
    """Drive one mission; return its last mode, and the errors of each half second."""
    with tempfile.TemporaryDirectory() as folder:
        config = configured(case, Path(folder), camera=camera)
        moments = drive(config, case)
    return moments[-1].output.mode.value, rows_of(moments)


def print_errors(name: str, table: Array) -> bool:
    """Print the figures of a group; return whether they are within the bars."""
    is_right = True
    for what, column, size in (("position", 0, 2), ("yaw", 3, 1)):
        nees, error2, variance = table[:, column : column + 3].T
        inside, mean = float((nees <= BOUND[size]).mean()), float(nees.mean()) / size
        is_right &= INSIDE_BAR[0] <= inside <= INSIDE_BAR[1] and NEES_BAR[0] <= mean <= NEES_BAR[1]
        print(
            f"{name:<40}{what:<9} inside {inside:6.1%}  NEES/dimension {mean:5.2f}  "
            f"error {np.sqrt(error2.mean()):.4f}  reported {np.sqrt(variance.mean()):.4f}"
        )
    return is_right


def main() -> int:
    """Print the table; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--missions", type=int, default=8, help="seeds of each group, on both sites")
    parser.add_argument("--first", type=int, default=40_000, help="seed of the first mission")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--camera", action="store_true", help="render pictures; slow")
    parser.add_argument("--only", help="the group of this name, as 'compensated, no fixes'")
    add_cluster_option(parser)
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.missions)
    cases = [
        Case(seed, site, way, ground, fixes)
        for way in WAYS
        for ground in GROUNDS
        for fixes in FIXES
        for seed in seeds
        for site in SITES
    ]
    cases = [case for case in cases if arguments.only in (None, case.group)]
    if not cases:
        parser.error(f"--only {arguments.only!r}: there is no such group")
    pooled: defaultdict[str, Errors] = defaultdict(list)
    parts: defaultdict[str, Errors] = defaultdict(list)
    ends = Counter[str]()
    with open_executor(arguments.cluster, arguments.workers) as pool:
        results = pool.map(mission, cases, [arguments.camera] * len(cases))
        console = Console(stderr=True)
        for case, (end, errors) in track(zip(cases, results, strict=True), total=len(cases), console=console):
            ends[f"{case.way}: {end}"] += 1
            pooled[case.group] += errors
            parts[f"{case.group}, {case.ground}"] += errors
            parts[f"{case.group}, end"] += errors[-1:]
    for name in sorted(parts):
        print_errors(name, np.array(parts[name]))
    is_right = [print_errors(name, np.array(table)) for name, table in pooled.items()]
    print(dict(ends))
    return 0 if all(is_right) else 1


if __name__ == "__main__":
    sys.exit(main())
