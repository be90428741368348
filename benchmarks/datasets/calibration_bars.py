"""Are the numbers of `calibrate wheels` and `diagnose --enter` as good as a reference, and are they honest?

    python -m benchmarks.datasets.calibration_bars reference ../shared/data/vehicles/optiodom
    python -m benchmarks.datasets.calibration_bars kinds --seed 1000
    python -m benchmarks.datasets.calibration_bars covariance --seed 1000
    python -m benchmarks.datasets.calibration_bars halves ../shared/data/vehicles/optiodom

`reference`: the three OptiOdom robots, calibrated on the recordings that the reference fit was made on and
validated on its other ones. The error at the end is that of `benchmarks.datasets.reference_fit.fit`.

`kinds`: simulated robots drive straights and one kind of motion, then another one. Half of them slip in
rotations. The numbers of the first drives do not hold in the others exactly then. Does the page state it?

`covariance`: simulated robots are diagnosed, what is accepted is entered, and other drives of the same robots
are replayed with it. Regions are those of x, y and yaw at 95 % (chi-square, 3 degrees of freedom), from the
true pose at the start, at the end and every 2 m by the wheels. `halves` does the same with the recordings of
the OptiOdom robots: half of them are diagnosed, the other half is judged, and the other way round.
"""

import argparse
import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from benchmarks.datasets.position_region import call
from benchmarks.datasets.reference_fit.__main__ import RESULTS
from benchmarks.datasets.reference_fit.fit import EndError, end_error
from benchmarks.datasets.reference_fit.models import ROBOTS as REFERENCE_ROBOTS
from benchmarks.datasets.reference_fit.recordings import Recording, halves
from benchmarks.wilson import share_text
from controllers.motion.rover_geometry import OmniRoverSettings, WheelsRoverSettings
from rover_hil.config import load_config
from rover_hil.drives.formats.drive import Contents
from rover_hil.drives.formats.files import import_file
from rover_hil.drives.formats.limits import LimitSettings
from rover_hil.drives.formats.table.columns import read_columns, rover_of
from rover_hil.drives.formats.table.to_log import write_table_as_log
from rover_hil.ready.wheels.from_drives import GeometryResult, geometry_from_drives
from rover_hil.ready.wheels.geometry import MARKER_X, MARKER_Y, MARKER_YAW
from rover_hil.ready.wheels.trajectory import read_recorded
from rover_hil.recording.data_files import restore_config, with_controller_of
from rover_hil.recording.reader import LogReader
from rover_hil.run.replay import estimate_again
from tests.nature.optiodom_motion import ROBOTS, TrueRobot, commands, draw, record, write

Array = NDArray[np.float64]

COLUMNS = {"diff": "diff", "omni3": "omni3", "tricyc": "steered_tricycle"}
"""Files of columns, by robot."""
LIMIT = float(chi2.ppf(0.95, 3))
EVERY_M = 2.0
LOST = (0.02, 0.15)
"""Share of a rotation on the spot that is lost, of robots that slip."""
KNOWN = (0.0005, 0.004)
"""Standard deviations of a measured place in m and yaw in rad of the OptiOdom recordings, by their jitter."""
WORSE = 1.1
"""The error at the end may be so many times that of the reference."""


def columns_of(robot: str) -> Path:
    """Return the file of columns of a robot."""
    return Path(__file__).with_name(f"{COLUMNS[robot]}.toml")


def import_tables(tables: Sequence[Path], columns_path: Path, folder: Path) -> list[Path]:
    """Return the logs of tables, in a folder."""
    columns = read_columns(columns_path)
    rover = rover_of(columns, columns_path)

    def write_drive(file: Path, part: Path) -> Iterator[Contents]:
        return write_table_as_log(file, columns, rover, part, with_estimate=False)

    folder.mkdir(parents=True, exist_ok=True)
    logs = [folder / f"{table.name.removesuffix('.csv.gz')}.mcap" for table in tables]
    for table, log in zip(tables, logs, strict=True):
        import_file(table, log, lambda: write_drive, LimitSettings(None, None))
    return logs


# The reference


def in_its_units(robot: str, result: GeometryResult, values: dict[str, float]) -> dict[str, float]:
    """Return numbers of the calibration as those of the reference."""
    rover = result.geometry.corrected(values)
    found = {
        "marker_x_m": values.get(MARKER_X, 0.0),
        "marker_y_m": values.get(MARKER_Y, 0.0),
        "marker_yaw_rad": values.get(MARKER_YAW, 0.0),
    }
    if isinstance(rover, OmniRoverSettings):
        radii = dict.fromkeys((f"radius_{wheel}_m" for wheel in range(3)), rover.wheel_radius_m)
        return {**radii, "base_m": rover.base_radius_m, **found}
    assert isinstance(rover, WheelsRoverSettings)
    wheels = rover.wheels
    if robot == "omni3":
        radii = {f"radius_{place}_m": wheel.radius_m for place, wheel in enumerate(wheels)}
        return {**radii, "base_m": math.hypot(wheels[0].x_m, wheels[0].y_m), **found}
    if robot == "diff":
        right, left = wheels
        radii = {"radius_right_m": right.radius_m, "radius_left_m": left.radius_m}
        return {**radii, "track_m": left.y_m - right.y_m, **found}
    front = wheels[0]
    zero_rad = math.radians(front.angle_deg)
    return {"radius_m": front.radius_m, "wheelbase_m": front.x_m, "steering_zero_rad": zero_rad, **found}


def half_widths(robot: str, result: GeometryResult) -> dict[str, float]:
    """Return half of the intervals of these numbers, those of independent numbers added in quadrature."""
    values = result.fit.values
    before = in_its_units(robot, result, values)
    squares = dict.fromkeys(before, 0.0)
    for each in result.fit.estimates:
        if each.is_shown:
            moved = {**values, each.number.name: each.value + each.half_width}
            for name, value in in_its_units(robot, result, moved).items():
                squares[name] += (value - before[name]) ** 2
    return {name: math.sqrt(square) for name, square in squares.items()}


def _rms(errors: Sequence[EndError]) -> float:
    return float(np.sqrt(np.mean([each.distance_m**2 for each in errors])))


def compare_with_reference(folder: Path) -> None:
    """Print the comparison for each robot."""
    reference = json.loads(RESULTS.read_text("utf-8"))
    for name, robot in REFERENCE_ROBOTS.items():
        expected = reference[name]
        recordings: dict[str, Recording] = {
            each.name: each for half in halves(folder / name) for each in half
        }
        names = [*expected["fitted"], *expected["end_errors_validation"]]
        with TemporaryDirectory() as place:
            tables = [next((folder / name).rglob(f"{each}.csv.gz")) for each in names]
            drives = [
                read_recorded(log) for log in import_tables(tables, columns_of(name), Path(place) / "logs")
            ]
        count = len(expected["fitted"])
        result = geometry_from_drives(drives[:count], drives[count:])
        ours, half = in_its_units(name, result, result.fit.values), half_widths(name, result)
        theirs = {key: number["value"] for key, number in expected["numbers"].items()}
        own_m, peer_m = (
            _rms([end_error(robot, recordings[each], values) for each in names[count:]])
            for values in (in_its_units(name, result, result.entered.values), theirs)
        )
        figure_m = math.sqrt(np.mean([each.end_m[1] ** 2 for each in result.errors]))
        inside = [key for key in ours if abs(ours[key] - theirs[key]) <= half[key]]
        print(
            f"{name}: {result.problem or 'accepted'}; error at the end {own_m:.4f} m, reference",
            f"{peer_m:.4f} m, ratio {own_m / peer_m:.2f} of {WORSE:g} at most, by the page {figure_m:.4f} m;",
            f"intervals contain {len(inside)} of {len(ours)} numbers",
        )
        for key, value in ours.items():
            mark = "" if key in inside else " OUTSIDE"
            their_half = expected["numbers"][key]["high"] - theirs[key]
            print(f"  {key:18} {value:9.5f} +- {half[key]:.5f}, {theirs[key]:9.5f} +- {their_half:.5f}{mark}")


# Simulated drives


def simulate(
    robot: TrueRobot, plan: Sequence[tuple[str, bool]], rng: np.random.Generator, folder: Path, columns: Path
) -> list[tuple[Path, Array]]:
    """Drive, record and import; return the log of each drive, and times and true poses, (n, 4).

    Args:
        robot: The robot.
        plan: Kind of motion of each drive, and whether it goes to the left.
        rng: For directions and noise.
        folder: For tables and logs.
        columns: What the tables hold.
    """
    recordings = []
    for kind, is_left in plan:
        direction = int(rng.integers(3)) * math.pi / 3.0 if robot.name == "omni3" else 0.0
        recordings.append(record(robot, commands(kind, is_left=is_left, direction=direction), rng))
    write(folder, "1", robot, recordings)
    tables = [folder / f"1_run-{number:02}.csv.gz" for number in range(1, len(plan) + 1)]
    logs = import_tables(tables, columns, folder / "logs")
    poses = [np.column_stack((each.t_s, each.pose)) for each in recordings]
    return list(zip(logs, poses, strict=True))


@dataclass(frozen=True, kw_only=True)
class Case:
    """What the page states of one simulated robot that drives two kinds of motion.

    Attributes:
        robot: Its name.
        lost: Share of a rotation on the spot that it loses.
        first, other: Kinds of motion: that of the fit, and the other one.
        problem: Why the numbers must not be used, by the page.
        differing: Numbers that differ between kinds of motion.
        worse: Kinds of motion in which the described numbers are better.
    """

    robot: str
    lost: float
    first: str
    other: str
    problem: str
    differing: Sequence[str]
    worse: Sequence[str]

    @property
    def is_stated(self) -> bool:
        """Whether the page states that the numbers do not hold."""
        return bool(self.differing or self.worse)


PAIRS = (("circle", "spot"), ("circle", "square"), ("spot", "circle"), ("square", "circle"))


def compare_kinds(seed: int, count: int) -> None:
    """Print what the page states of `count` robots that slip, and of as many that do not."""
    for slips in (True, False):
        stated = 0
        for number in range(count):
            case = _kinds_of(seed + number, slips=slips)
            stated += case.is_stated
            print(
                f"{seed + number} {case.robot:6} lost {case.lost:.3f} {case.first:6} -> {case.other:6}:",
                f"{', '.join(case.differing) or '-'}; worse: {', '.join(case.worse) or '-'}; {case.problem}",
                flush=True,
            )
        words = "with slip in rotations" if slips else "without slip"
        print(f"{words}: stated that the numbers do not hold in {stated} of {count}")


def _kinds_of(seed: int, *, slips: bool) -> Case:
    rng = np.random.default_rng([seed, int(slips)])
    name = list(ROBOTS)[seed % 3]
    first, other = PAIRS[(seed // 3) % len(PAIRS)]
    lost = float(rng.uniform(*LOST)) if slips else 0.0
    robot = draw(name, lost, rng)
    both = (True, False)
    plan = [(kind, left) for kind in ("straight", first, other) for left in both]
    with TemporaryDirectory() as place:
        logs = [log for log, _ in simulate(robot, plan, rng, Path(place), columns_of(name))]
        drives = [read_recorded(log) for log in logs]
    result = geometry_from_drives(drives[:4], drives[4:])
    return Case(
        robot=name,
        lost=lost,
        first=first,
        other=other,
        problem=result.problem,
        differing=[each.number.name for each in result.differences],
        worse=[each.kind for each in result.by_kind if each.is_worse],
    )


# Covariance


@dataclass(frozen=True, kw_only=True)
class Point:
    """Normalised error squared of x, y and yaw at one place of a drive."""

    robot: str
    lost: float
    kind: str
    entered: str
    is_end: bool
    nees: float


CONFIG = """schema = "rover-hil-config/1"
[loop]
rate_hz = 20
[roles]
wheels = "bus"
[devices.bus]
type = "can_wheels"
interface = "virtual"
channel = "none"
mapping = "none.toml"
"""
FITTED = tuple((kind, left) for kind in ("straight", "circle", "spot", "square") for left in (True, False))


def config_text(columns: Path) -> str:
    """Return a configuration of the rover of a file of columns."""
    text = columns.read_text("utf-8")
    return CONFIG + text[text.index("[rover]") :]


def diagnosed(logs: Sequence[Path], config: Path) -> str:
    """Diagnose drives and enter what is accepted; return the names of the sections that were entered."""
    folder = config.parent / "diagnosis"
    arguments = ("--config", str(config), "--enter", "--quick", "--force", "--out", str(folder))
    code, output = call("diagnose", *map(str, logs), *arguments)
    found = [
        line for line in output.splitlines() if line.startswith(("entered into", "nothing was accepted"))
    ]
    if code not in (0, 1) or not found:
        raise SystemExit(f"diagnose: {output.strip()[-500:]}")
    return found[0].rsplit(": ", 1)[-1] if found[0].startswith("entered") else "nothing"


def judge(
    log: Path, config: Path, true: Array, known: tuple[float, float] = (0.0, 0.0)
) -> Iterator[tuple[bool, float]]:
    """Yield whether it is the end, and the NEES, of every 2 m of a drive and of its end.

    Args:
        log: The drive.
        config: To replay it with.
        true: Times and true poses, (n, 4).
        known: Standard deviations of a true place and a true yaw.
    """
    reader, entered = LogReader(log), load_config(str(config))
    times, poses, covariances = list[float](), list[Array](), list[Array]()
    with restore_config(reader) as logged:
        for output in estimate_again(reader, with_controller_of(logged, entered)):
            own, wheels = output.estimate, output.odometry
            times.append((output.t_ns - reader.start_ns) * 1e-9)
            poses.append(np.array((own.x_m, own.y_m, own.yaw_rad, wheels.x_m, wheels.y_m)))
            xx, xy, xa, yy, ya, aa = own.covariance
            covariances.append(np.array(((xx, xy, xa), (xy, yy, ya), (xa, ya, aa))))
    steps_m = np.hypot(*np.diff(np.array(poses)[:, 3:], axis=0).T)
    way_m = np.concatenate(([0.0], np.cumsum(steps_m)))
    last = int(np.searchsorted(times, true[-1, 0])) - 1
    rows = np.searchsorted(way_m, np.arange(EVERY_M, way_m[-1], EVERY_M)).tolist()
    for row in (*(row for row in rows if row < last), last):
        error = _error(poses[row], poses[0], _at(times[row], true), _at(times[0], true))
        swing = np.array((-poses[row][1], poses[row][0], 1.0))
        noise = np.diag((2.0 * known[0] ** 2, 2.0 * known[0] ** 2, known[1] ** 2))
        covariance = covariances[row] + noise + known[1] ** 2 * np.outer(swing, swing)
        yield row == last, float(error @ np.linalg.solve(covariance, error))


def _at(t_s: float, true: Array) -> Array:
    return np.array([np.interp(t_s, true[:, 0], column) for column in true[:, 1:].T])


def _error(own: Array, own_start: Array, true: Array, true_start: Array) -> Array:
    """Return the error of x, y and yaw, both paths from one pose at the start."""
    turn_rad = own_start[2] - true_start[2]
    cos, sin = math.cos(turn_rad), math.sin(turn_rad)
    moved = np.array(((cos, -sin), (sin, cos))) @ (true[:2] - true_start[:2])
    yaw_rad = math.remainder(own[2] - true[2] - turn_rad, math.tau)
    return np.array((*(own[:2] - own_start[:2] - moved), yaw_rad))


def compare_covariance(seed: int, robots: int, drives: int, out: Path | None) -> None:
    """Print how often the region contains the ground truth after `diagnose --enter`."""
    points: list[Point] = []
    for number in range(robots):
        points += _points_of(seed + number, drives)
        if out is not None:
            out.write_text(json.dumps([asdict(each) for each in points]), "utf-8")
    print_points(points)


def _points_of(seed: int, count: int) -> list[Point]:
    rng = np.random.default_rng([seed, 7])
    name = list(ROBOTS)[seed % 3]
    lost = float(rng.uniform(*LOST)) if (seed // 3) % 2 else 0.0
    robot = draw(name, lost, rng)
    kinds = [kind for kind, _ in FITTED[::2]]
    points = []
    with TemporaryDirectory() as place:
        columns, config = Path(place) / "columns.toml", Path(place) / "config.toml"
        columns.write_text(_with_marker(columns_of(name).read_text("utf-8"), robot), "utf-8")
        config.write_text(config_text(columns), "utf-8")
        fitted = simulate(robot, FITTED, rng, Path(place) / "fitted", columns)
        entered = diagnosed([log for log, _ in fitted], config)
        plan = [(kinds[int(rng.integers(4))], bool(rng.integers(2))) for _ in range(count)]
        others = simulate(robot, plan, rng, Path(place) / "others", columns)
        for (kind, _), (log, poses) in zip(plan, others, strict=True):
            for is_end, nees in judge(log, config, poses):
                points.append(
                    Point(robot=name, lost=lost, kind=kind, entered=entered, is_end=is_end, nees=nees)
                )
        text = config.read_text("utf-8")
        shown = ("wheel_yaw", "slip", "cross", "noise")
        settings = [line for line in text.splitlines() if line.startswith(shown)]
    ends = [point.nees for point in points if point.is_end]
    print(
        f"{seed} {name:6} lost {lost:.3f}: entered {entered}; {'; '.join(settings)}; NEES / 3 at the ends",
        " ".join(f"{nees / 3.0:.2g}" for nees in ends),
        flush=True,
    )
    return points


def compare_halves(folder: Path, robots: Sequence[str]) -> None:
    """Print the same for each half of the recordings of each OptiOdom robot, with what the other half shows.

    The ground truth is not exact: its noise at both ends is added to the region.
    """
    points: list[Point] = []
    for name in robots:
        parts = halves(folder / name)
        for fitted, judged in (parts, parts[::-1]):
            with TemporaryDirectory() as place:
                columns, config = Path(place) / "columns.toml", Path(place) / "config.toml"
                columns.write_text(columns_of(name).read_text("utf-8"), "utf-8")
                config.write_text(config_text(columns), "utf-8")
                names = [each.name for each in (*fitted, *judged)]
                tables = [next((folder / name).rglob(f"{each}.csv.gz")) for each in names]
                logs = import_tables(tables, columns, Path(place) / "logs")
                entered = diagnosed(logs[: len(fitted)], config)
                marker = _fitted_marker(config.parent / "diagnosis" / "diagnosis.json")
                for log, each in zip(logs[len(fitted) :], judged, strict=True):
                    true = np.column_stack((each.t_s, _of_origin(each.marker, marker)))
                    for is_end, nees in judge(log, config, true, KNOWN):
                        points.append(
                            Point(robot=name, lost=0.0, kind="", entered=entered, is_end=is_end, nees=nees)
                        )
            print(f"{name}: entered {entered}", flush=True)
    print_points(points)


def _fitted_marker(record: Path) -> tuple[float, float, float]:
    numbers = json.loads(record.read_text("utf-8"))["geometry"]["numbers"]
    x, y, yaw = (
        numbers[name]["value"] if numbers[name]["is_shown"] else 0.0
        for name in (MARKER_X, MARKER_Y, MARKER_YAW)
    )
    return x, y, yaw


def _of_origin(poses: Array, marker: tuple[float, float, float]) -> Array:
    """Return the poses of the rover by those of its marker."""
    x, y, yaw = marker
    turned = poses[:, 2] - yaw
    cos, sin = np.cos(turned), np.sin(turned)
    return np.column_stack((poses[:, 0] - cos * x + sin * y, poses[:, 1] - sin * x - cos * y, turned))


def _with_marker(text: str, robot: TrueRobot) -> str:
    """Return a file of columns with the marker as somebody measures it: to 1 cm and 5 deg."""
    x, y, yaw = robot.marker
    degrees = 5.0 * round(math.degrees(yaw) / 5.0)
    marker = f"marker = {{ x_m = {x:.2f}, y_m = {y:.2f}, yaw_deg = {degrees:.0f} }}"
    return text.replace("[truth]", f"[truth]\n{marker}")


def print_points(points: Sequence[Point]) -> None:
    """Print shares inside and medians, of all and of parts."""
    parts: dict[str, Callable[[Point], str]] = {
        "": lambda _: "all",
        "slip": lambda point: "with slip" if point.lost else "without slip",
        "robot": lambda point: point.robot,
        "kind": lambda point: point.kind,
        "entered": lambda point: point.entered,
    }
    for key in parts.values():
        for name in dict.fromkeys(map(key, points)):
            for words, is_end in (("end", True), ("every 2 m", False)):
                nees = [each.nees for each in points if key(each) == name and each.is_end == is_end]
                if nees:
                    inside = share_text(sum(value <= LIMIT for value in nees), len(nees))
                    print(f"{name:24} {words:9} {len(nees):4} {inside:20} median {np.median(nees) / 3.0:.2f}")


def main() -> None:
    """Run one of the comparisons."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("reference", "kinds", "covariance", "halves"))
    parser.add_argument("folder", type=Path, nargs="?", help="of the OptiOdom recordings")
    parser.add_argument("--robot", choices=COLUMNS, action="append", help="of `halves`; all without it")
    parser.add_argument("--seed", type=int, default=1, help="of the first simulated robot")
    parser.add_argument("--robots", type=int, default=20, help="of each part")
    parser.add_argument("--drives", type=int, default=10, help="validation drives of each robot")
    parser.add_argument("--record", type=Path, help="file for the points of the covariance")
    options = parser.parse_args()
    if options.what == "reference":
        compare_with_reference(options.folder)
    elif options.what == "kinds":
        compare_kinds(options.seed, options.robots)
    elif options.what == "halves":
        compare_halves(options.folder, options.robot or list(COLUMNS))
    else:
        compare_covariance(options.seed, options.robots, options.drives, options.record)


if __name__ == "__main__":
    main()
