"""Plant 40 faults in measured drives of other people: which are named, which refused, which pass in silence?

    python -m benchmarks.datasets.planted_faults ../shared/data/vehicles [--only WORD] [--sound]

Which of the 40 these data can show is marked in `visible_faults.csv`, by somebody who had not seen the
program. The numbers alone say it, too: turn and distance in windows of a second, by the kinematics of a
textbook, are compared with the truth (or the gyro); a fault is visible where it changes them by more than
three times what truth and wheels differ without it. Where mark and numbers differ, that is printed. `--sound`
imports 40 drives as they are. Of each drive the first `--seconds` are used. Prints one line each and the
counts; exit code 1 where a bar is missed.
"""

import argparse
import csv
import math
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import can
import numpy as np
from cantools.database.can import Message
from numpy.typing import NDArray

from drivers.can_wheels.mapping_file import read_dbc
from drivers.errors import RoverHilError
from rover_hil.drives.drive import read_drive
from rover_hil.drives.files.csv_table import read_csv
from rover_hil.drives.formats.table.columns import read_columns, rover_of
from rover_hil.drives.formats.table.to_log import write_table_as_log
from rover_hil.drives.quality.judge import drive_findings
from rover_hil.drives.quality.oddities import NOT_SHOWN
from rover_hil.recording.reader import LogReader

Array = NDArray[np.float64]
VISIBLE = 3.0
WINDOW_S = 1.0
LIMITS = "[limits]\nwheel_speed_rad_s = {}\nwheel_acceleration_rad_s2 = 500\n"
SHARE_NAMED = 0.9
SILENT_FACTOR, SILENT_M = 3.0, 0.1


@dataclass(frozen=True)
class Measured:
    """A measured drive, as a table.

    Attributes:
        columns: By name, n rows; "t" is the time in s, truth "x", "y", "yaw", of a gyro "gyro" in rad/s.
        sections: TOML text of the file of columns, without [limits].
        motion: Returns turn and distance of each row by the columns, by a textbook.
        wheels: Names of the columns of wheels.
        limit_rad_s: No wheel is faster.
    """

    name: str
    columns: Mapping[str, Array]
    sections: str
    motion: Callable[[Mapping[str, Array]], tuple[Array, Array]]
    wheels: tuple[str, ...]
    limit_rad_s: float = 60.0


def steps(values: Array) -> Array:
    """Return the steps of a column, the first one zero."""
    return np.diff(values, prepend=values[0])


def section(names: Sequence[str], *, unit: str = "rad", kind: str = "position") -> str:
    """Return the [[wheel]] of columns."""
    return "".join(f'[[wheel]]\n{kind} = {{ column = "{name}", unit = "{unit}" }}\n' for name in names)


HEAD = 'rate_hz = 20\ntime = { column = "t" }\n'
TRUTH = '[truth]\nx = { column = "x" }\ny = { column = "y" }\nyaw = { column = "yaw" }\n'


def rows_of(path: Path) -> Array:
    """Return the numbers of a table without a header."""
    table = read_csv(path, header_lines=0)
    return np.column_stack([table.numbers(name) for name in table.names])


def marks() -> dict[tuple[str, str], str]:
    """Return "yes", "no", "elsewhere" or "unmarked" by drive and fault."""
    path = Path(__file__).with_name("visible_faults.csv")
    rows = csv.DictReader(line for line in path.read_text("utf-8").splitlines() if not line.startswith("#"))
    return {(row["drive"], row["fault"]): row["visible"] for row in rows}


def run_of(folder: Path, kind: str, name: str) -> Path:
    """Return the run of one robot by the beginning of its name."""
    return next(path for path in runs_of(folder, kind) if path.name.startswith(name))


def runs_of(folder: Path, kind: str) -> list[Path]:
    """Return the runs of one robot."""
    paths = (folder / "optiodom" / kind / "circular").glob("*/*_run-*.csv.gz")
    return sorted(path for path in paths if not path.name.endswith("_odo.csv.gz"))


def differential(path: Path) -> Measured:
    """Return a drive of the robot with two wheels; right, left."""
    rows, radius_m, track_m = rows_of(path), 0.042, 0.2
    turned = np.cumsum(rows[:, 4:6], axis=0) * math.tau / (64 * 43.7)

    def motion(columns: Mapping[str, Array]) -> tuple[Array, Array]:
        right, left = (radius_m * steps(columns[name]) for name in ("w0", "w1"))
        return (right - left) / track_m, 0.5 * (right + left)

    rover = f"""[rover]
kinematics = "wheels"
wheels = [
  {{ x_m = 0.0, y_m = -0.1, radius_m = {radius_m} }},
  {{ x_m = 0.0, y_m = 0.1, radius_m = {radius_m} }},
]
"""
    return Measured(
        path.name,
        with_truth(rows, turned),
        HEAD + TRUTH + section(("w0", "w1")) + rover,
        motion,
        ("w0", "w1"),
    )


def with_truth(rows: Array, turned: Array) -> dict[str, Array]:
    """Return time, truth and angles of a drive of the motion capture sets."""
    columns = dict(zip(("t", "x", "y", "yaw"), rows[:, :4].T, strict=True))
    return {**columns, **{f"w{number}": angle for number, angle in enumerate(turned.T)}}


def omnidirectional(path: Path) -> Measured:
    """Return a drive of the robot with three wheels; arrangement as in `omni3.toml`."""
    rows, radius_m, base_m = rows_of(path), 0.051, 0.195
    turned = -np.cumsum(rows[:, 4:7], axis=0) * math.tau / (1024 * 12.0)
    angles = np.radians((-60.0, 60.0, 180.0))
    inverse = np.linalg.inv(np.column_stack((-np.sin(angles), np.cos(angles), np.full(3, base_m))) / radius_m)

    def motion(columns: Mapping[str, Array]) -> tuple[Array, Array]:
        x, y, turn = inverse @ np.stack([steps(columns[f"w{wheel}"]) for wheel in range(3)])
        return turn, np.hypot(x, y)

    rover = f"""[rover]
kinematics = "omni3"
wheel_radius_m = {radius_m}
base_radius_m = {base_m}
wheel_angles_deg = [-60, 60, 180]
"""
    names = ("w0", "w1", "w2")
    return Measured(path.name, with_truth(rows, turned), HEAD + TRUTH + section(names) + rover, motion, names)


def tricycle(path: Path) -> Measured:
    """Return a drive of the robot with a driven and steered front wheel; no encoder on the others."""
    rows, radius_m, base_m = rows_of(path), 0.0325, 0.15
    turned = np.cumsum(rows[:, 4:5], axis=0) * math.tau / 1600

    def motion(columns: Mapping[str, Array]) -> tuple[Array, Array]:
        rolled, steering = radius_m * steps(columns["w0"]), columns["steer"]
        return rolled * np.sin(steering) / base_m, rolled * np.cos(steering)

    wheel = section(("w0",)) + 'steering = { column = "steer" }\n[[wheel]]\n[[wheel]]\n'
    rear = f"radius_m = {radius_m}, driven = false, measured = false"
    rover = f"""[rover]
kinematics = "wheels"
wheels = [
  {{ x_m = {base_m}, y_m = 0.0, radius_m = {radius_m}, steering = {{ low_deg = -90, high_deg = 90 }} }},
  {{ x_m = 0.0, y_m = 0.1, {rear} }},
  {{ x_m = 0.0, y_m = -0.1, {rear} }},
]
"""
    columns = {**with_truth(rows, turned), "steer": rows[:, 5]}
    return Measured(path.name, columns, HEAD + TRUTH + wheel + rover, motion, ("w0",))


def mower(folder: Path) -> Measured:
    """Return the drive of the mower by increments from its fifth minute on, with its truth at the rows."""
    increments, truth = (read_csv(folder / "mower" / name) for name in ("increments.csv.gz", "truth.csv.gz"))
    t_s, distance, turn = (increments.numbers(name) for name in increments.names)
    true_s, *pose = (truth.numbers(name) for name in truth.names)
    pose[2] = np.unwrap(pose[2])
    inside = (t_s >= true_s[0] + 300.0) & (t_s <= true_s[-1])
    columns = {"t": t_s[inside], "d": distance[inside], "a": turn[inside]}
    columns |= {
        name: np.interp(columns["t"], true_s, values)
        for name, values in zip(("x", "y", "yaw"), pose, strict=True)
    }
    text = HEAD + TRUTH + '[increments]\ndistance = { column = "d" }\nturn = { column = "a" }\n'
    rover = """[rover]
kinematics = "wheels"
wheels = [ { x_m = 0.0, y_m = 0.25, radius_m = 0.1 }, { x_m = 0.0, y_m = -0.25, radius_m = 0.1 } ]
"""
    return Measured("mower", columns, text + rover, lambda each: (each["a"], each["d"]), ("d", "a"))


def value_of(message: Message, frame: can.Message, signal: str) -> float:
    """Return a signal of a frame."""
    held = message.decode(bytes(frame.data), decode_choices=False)
    assert isinstance(held, dict)
    value = held[signal]
    assert isinstance(value, int | float)
    return float(value)


def car(folder: Path) -> Measured:
    """Return the Mustang by the speeds of its rear wheels and its yaw rate; no truth."""
    dbc = read_dbc(folder / "can_wheels" / "ford_lincoln_base_pt.dbc")
    speeds, yaw = dbc.get_message_by_frame_id(0x217), dbc.get_message_by_frame_id(0x077)
    rows: list[tuple[float, float, float, float]] = []
    rate = 0.0
    for frame in can.LogReader(folder / "can_wheels" / "mustang_s550.log.gz"):
        if frame.arbitration_id == yaw.frame_id:
            rate = math.radians(value_of(yaw, frame, "VehYawComp_W_Actl"))
        elif frame.arbitration_id == speeds.frame_id:
            left, right = (value_of(speeds, frame, f"WhlR{side}_W_Meas") for side in "lr")
            rows.append((frame.timestamp, left, right, rate))
    table = np.array(rows)
    table[:, 0] -= table[0, 0]
    columns = dict(zip(("t", "w0", "w1", "gyro"), table.T, strict=True))

    def motion(each: Mapping[str, Array]) -> tuple[Array, Array]:
        left, right = (0.33 * each[name] * steps(each["t"]) for name in ("w0", "w1"))
        return (right - left) / 1.62, 0.5 * (left + right)

    text = (
        HEAD + section(("w0", "w1"), unit="rad/s", kind="speed") + '[imu]\nyaw_rate = { column = "gyro" }\n'
    )
    rover = """[rover]
kinematics = "wheels"
wheels = [ { x_m = 0.0, y_m = 0.81, radius_m = 0.33 }, { x_m = 0.0, y_m = -0.81, radius_m = 0.33 } ]
"""
    return Measured("mustang_s550", columns, text + rover, motion, ("w0", "w1"), limit_rad_s=200.0)


Change = Callable[[Measured], Measured]


def change(**columns: Callable[[Mapping[str, Array]], Array]) -> Change:
    """Return a fault that replaces columns."""

    def planted(drive: Measured) -> Measured:
        new = {name: make(drive.columns) for name, make in columns.items()}
        return replace(drive, columns={**drive.columns, **new})

    return planted


def reversed_(*names: str) -> Change:
    return change(**{name: lambda each, name=name: -each[name] for name in names})


def scaled(factor: float, *names: str) -> Change:
    return change(**{name: lambda each, name=name: factor * each[name] for name in names})


def swapped(first: str, second: str) -> Change:
    return change(**{first: lambda each: each[second], second: lambda each: each[first]})


def clock(factor: float) -> Change:
    return change(t=lambda each: each["t"][0] + factor * (each["t"] - each["t"][0]))


def wrapped(range_ticks: int, ticks_per_turn: float) -> Change:
    """Return angles as ticks that start again after a range, and a file of columns that does not say so."""

    def planted(drive: Measured) -> Measured:
        names = drive.wheels
        new = {
            name: np.round(drive.columns[name] * ticks_per_turn / math.tau) % range_ticks for name in names
        }
        text = drive.sections
        for name in names:
            old = f'position = {{ column = "{name}", unit = "rad" }}'
            ticks = f'position = {{ column = "{name}", unit = "ticks", ticks_per_turn = {ticks_per_turn!r} }}'
            text = text.replace(old, ticks)

        def motion(each: Mapping[str, Array]) -> tuple[Array, Array]:
            return drive.motion({**each, **{name: each[name] * math.tau / ticks_per_turn for name in names}})

        return replace(drive, columns={**drive.columns, **new}, sections=text, motion=motion)

    return planted


def by_speed(factor: float = 1.0) -> Change:
    """Return speeds instead of angles, in rad/s times a factor."""

    def planted(drive: Measured) -> Measured:
        elapsed_s = steps(drive.columns["t"])
        elapsed_s[0] = elapsed_s[1]
        new = {name: factor * steps(drive.columns[name]) / elapsed_s for name in drive.wheels}
        text = drive.sections
        for name in drive.wheels:
            text = text.replace(
                f'position = {{ column = "{name}", unit = "rad" }}',
                f'speed = {{ column = "{name}", unit = "rad/s" }}',
            )

        def motion(each: Mapping[str, Array]) -> tuple[Array, Array]:
            angles = {name: np.cumsum(each[name] * elapsed_s) for name in drive.wheels}
            return drive.motion({**each, **angles})

        return replace(drive, columns={**drive.columns, **new}, sections=text, motion=motion)

    return planted


@dataclass(frozen=True)
class Case:
    """One planted fault.

    Attributes:
        words: One of them is in a finding, or in the refusal, that names the fault.
        is_none: Nothing is wrong: the drive must be right.
    """

    drive: str
    fault: str
    plant: Change
    words: tuple[str, ...] = ()
    is_none: bool = False


DEGREES = ("deg where rad", "correct the unit")
"""A wheel that is too fast for its limit is refused as one of a wrong unit."""
DEG, RPM, KMH = math.degrees(1.0), 60.0 / math.tau, 3.6
EXCHANGED, REVERSED, CLOCK, WRAP = (
    ("exchanged",),
    ("reversed",),
    ("clock",),
    ("wrap", "starts again", "jumps"),
)


def cases() -> list[Case]:
    """Return the 40 faults."""
    both = ("w0", "w1")
    recorded = [
        Case("diff", "left and right swapped", swapped(*both), EXCHANGED),
        Case("diff", "right wheel reversed", reversed_("w0"), REVERSED),
        Case("diff", "left wheel reversed", reversed_("w1"), REVERSED),
        Case("diff", "both wheels reversed", reversed_(*both), REVERSED),
        Case("diff", "clock 1.01 times too fast", clock(1.01), CLOCK),
        Case("diff", "clock 10 times too fast", clock(10.0), CLOCK),
        Case("diff", "ticks wrap at 8192", wrapped(8192, 64 * 43.7), WRAP),
        Case("diff", "ticks wrap at 32768", wrapped(32768, 64 * 43.7), WRAP),
        Case("diff", "deg called rad", scaled(DEG, *both), DEGREES),
        Case("diff", "rpm called rad/s", by_speed(RPM), ("rpm where rad/s",)),
        Case("diff", "km/h called m/s", by_speed(KMH), ("km/h where m/s",)),
        Case("diff", "speeds only", by_speed(), is_none=True),
        Case("omni3", "two wheels swapped", swapped(*both), EXCHANGED),
        Case("omni3", "a wheel reversed", reversed_("w1"), REVERSED),
        Case("omni3", "all wheels reversed", reversed_("w0", "w1", "w2"), REVERSED),
        Case("omni3", "clock 1.01 times too fast", clock(1.01), CLOCK),
        Case("omni3", "clock 10 times too fast", clock(10.0), CLOCK),
        Case("omni3", "ticks wrap at 8192", wrapped(8192, 1024 * 12.0), WRAP),
        Case("omni3", "deg called rad", scaled(DEG, "w0", "w1", "w2"), DEGREES),
        Case("omni3", "rpm called rad/s", by_speed(RPM), ("rpm where rad/s",)),
        Case("omni3", "speeds only", by_speed(), is_none=True),
        Case("tricycle", "wheel reversed", reversed_("w0"), REVERSED),
        Case("tricycle", "steering reversed", reversed_("steer"), ("the steering reversed",)),
        Case("tricycle", "steering in deg called rad", scaled(DEG, "steer"), ("the steering in deg",)),
        Case("tricycle", "clock 1.01 times too fast", clock(1.01), CLOCK),
        Case("tricycle", "clock 10 times too fast", clock(10.0), CLOCK),
        Case("tricycle", "ticks wrap at 8192", wrapped(8192, 1600.0), WRAP),
        Case("tricycle", "deg called rad", scaled(DEG, "w0"), DEGREES),
        Case("tricycle", "speeds only", by_speed(), is_none=True),
        Case("mower", "distance reversed", reversed_("d"), REVERSED),
        Case("mower", "turn reversed", reversed_("a"), ("exchanged", "reversed")),
        Case("mower", "turn in deg called rad", scaled(DEG, "a"), ("deg",)),
        Case("mower", "distance in cm called m", scaled(100.0, "d"), ("cm where m", "correct the unit")),
        Case("mower", "clock 1.01 times too fast", clock(1.01), CLOCK),
        Case("car", "left and right swapped", swapped(*both), ("exchanged",)),
        Case("car", "left wheel reversed", reversed_("w0"), ("reversed", "gyro")),
        Case("car", "gyro reversed", reversed_("gyro"), ("sign",)),
        Case("car", "deg/s called rad/s", scaled(DEG, "gyro"), ("deg/s", "unit")),
        Case("car", "rpm called rad/s", scaled(RPM, *both), ("correct the unit",)),
        Case("car", "clock 10 times too fast", clock(10.0), CLOCK),
    ]
    assert len(recorded) == 40
    return recorded


def drives(folder: Path) -> dict[str, Measured]:
    """Return the drives that faults are planted in."""
    return {
        "diff": differential(runs_of(folder, "diff")[0]),
        "omni3": omnidirectional(run_of(folder, "omni3", "221220201701_run-01")),
        "tricycle": tricycle(runs_of(folder, "tricyc")[0]),
        "mower": mower(folder),
        "car": car(folder),
    }


def sound_drives(folder: Path) -> Iterator[Measured]:
    """Yield 40 drives as they are."""
    paths = [(differential, path) for path in runs_of(folder, "diff")]
    paths += [(tricycle, path) for path in runs_of(folder, "tricyc")[:8]]
    paths += [(omnidirectional, path) for path in runs_of(folder, "omni3")]
    for make, path in paths[:38]:
        yield make(path)
    yield mower(folder)
    yield car(folder)


def windowed(drive: Measured, t_s: Array) -> Array:
    """Return turn and distance of the wheels in windows of a second, k x 2."""
    edges = np.searchsorted(t_s, np.arange(t_s[0], t_s[-1], WINDOW_S))
    turn, distance = drive.motion(drive.columns)
    sums = [np.diff(np.cumsum(values)[edges]) for values in (turn, np.abs(distance))]
    signed = np.diff(np.cumsum(distance)[edges])
    return np.column_stack((sums[0], np.abs(signed)))


def reference(drive: Measured, t_s: Array) -> Array:
    """Return the same by the truth; without one the turn by the gyro, and no distance."""
    edges = np.searchsorted(t_s, np.arange(t_s[0], t_s[-1], WINDOW_S))
    columns = drive.columns
    if "gyro" in columns:
        turn = np.diff(np.cumsum(columns["gyro"] * steps(columns["t"]))[edges])
        return np.column_stack((turn, np.full(len(turn), math.nan)))
    turn = np.diff(np.unwrap(columns["yaw"])[edges])
    path = np.hypot(np.diff(columns["x"][edges]), np.diff(columns["y"][edges]))
    return np.column_stack((turn, path))


def is_visible(sound: Measured, planted: Measured) -> bool:
    """Return whether the numbers show a fault."""
    t_s = sound.columns["t"]
    natural = windowed(sound, t_s) - reference(sound, t_s)
    wrong = windowed(planted, t_s) - reference(planted, t_s)
    known = ~np.isnan(natural).any(axis=0)
    sizes = [np.sqrt(np.mean(each[:, known] ** 2, axis=0)) for each in (natural, wrong - natural)]
    return bool((sizes[1] > VISIBLE * sizes[0]).any())


@dataclass
class Outcome:
    """What became of an import.

    Attributes:
        refusal: "" where it was imported.
        error_m: Root mean square distance between estimate and truth, from one beginning; NaN without truth.
    """

    refusal: str = ""
    findings: list[str] = field(default_factory=list)
    told: list[str] = field(default_factory=list)
    unseen: list[str] = field(default_factory=list)
    error_m: float = math.nan


def write_table(drive: Measured, folder: Path) -> tuple[Path, Path]:
    """Write a drive as a table and a file of columns; return both."""
    table, columns = folder / "drive.csv", folder / "columns.toml"
    rows = np.column_stack(list(drive.columns.values())).tolist()
    text = [",".join(drive.columns), *(",".join(map(repr, row)) for row in rows)]
    table.write_text("\n".join(text) + "\n", "utf-8")
    columns.write_text(drive.sections + LIMITS.format(drive.limit_rad_s), "utf-8")
    return table, columns


def import_drive(drive: Measured, folder: Path) -> Outcome:
    """Import a drive, and compare its estimate with the truth."""
    table, columns_path = write_table(drive, folder)
    log = folder / "drive.mcap"
    log.unlink(missing_ok=True)
    try:
        columns = read_columns(columns_path)
        *_, contents = write_table_as_log(table, columns, rover_of(columns, columns_path), log)
        contents.findings += drive_findings(log)
    except RoverHilError as error:
        return Outcome(refusal=str(error))
    unseen = [odd.what for odd in contents.oddities if odd.done == NOT_SHOWN]
    told = [odd.what for odd in contents.oddities if odd.done != NOT_SHOWN] + contents.notes
    return Outcome("", [finding.text for finding in contents.findings], told, unseen, error_m(log))


def error_m(log: Path) -> float:
    """Return the root mean square distance between estimate and truth; NaN without truth."""
    if not len(read_drive(log).channels["x_m"]):
        return math.nan
    truth = read_drive(log).true_poses()
    poses = [
        (record["t_ns"], record["x_m"], record["y_m"])
        for message in LogReader(log).messages()
        if message.topic == "/estimate" and isinstance(record := message.json()["estimate"], dict)  # type: ignore[index]
    ]
    t_ns, x_m, y_m = np.array(poses).T
    x, y = (np.interp(truth.t_ns, t_ns, values) for values in (x_m, y_m))
    cos, sin = math.cos(truth.yaw_rad[0]), math.sin(truth.yaw_rad[0])
    east, north = truth.x_m - truth.x_m[0], truth.y_m - truth.y_m[0]
    errors = np.hypot(x - x[0] - (cos * east + sin * north), y - y[0] - (cos * north - sin * east))
    return float(np.sqrt(np.mean(errors**2)))


def judge(case: Case, outcome: Outcome, sound: Outcome) -> str:
    """Return "named", "refused", "told", "told as unseen", "right" or "silent"; or "wrong"."""
    said = " ".join((*outcome.findings, outcome.refusal, *outcome.told)).lower()
    is_right = not outcome.error_m > SILENT_FACTOR * sound.error_m + SILENT_M
    if case.is_none:
        return "right" if is_right and not outcome.findings and not outcome.refusal else "wrong"
    if any(word.lower() in said for word in case.words):
        return "named"
    if outcome.refusal:
        return "refused"
    if outcome.findings:
        return "told"
    if any(word in " ".join(outcome.unseen) for word in case.words):
        return "told as unseen"
    return "right" if is_right and not math.isnan(outcome.error_m) else "silent"


def beginning(drive: Measured, duration_s: float) -> Measured:
    """Return the first part of a drive."""
    t_s = drive.columns["t"]
    kept = t_s - t_s[0] <= duration_s
    return replace(drive, columns={name: values[kept] for name, values in drive.columns.items()})


def run_planted(folder: Path, place: Path, only: str, duration_s: float) -> bool:
    """Run the planted faults; returns whether the bars hold."""
    measured = {name: beginning(drive, duration_s) for name, drive in drives(folder).items()}
    marked, sound = marks(), {}
    counts: Counter[tuple[str, str]] = Counter()
    named_by_numbers = visible_by_numbers = silent = 0
    for case in cases():
        if only not in f"{case.drive}/{case.fault}":
            continue
        drive, mark = measured[case.drive], marked[case.drive, case.fault]
        if case.drive not in sound:
            sound[case.drive] = import_drive(drive, place)
        planted = case.plant(drive)
        by_numbers = not case.is_none and is_visible(drive, planted)
        outcome = import_drive(planted, place)
        verdict = judge(case, outcome, sound[case.drive])
        counts[mark, verdict] += 1
        visible_by_numbers += by_numbers
        named_by_numbers += by_numbers and verdict == "named"
        silent += verdict in ("silent", "wrong")
        differs = " (numbers differ)" if mark in ("yes", "no") and by_numbers != (mark == "yes") else ""
        first = (*outcome.findings, outcome.refusal)[0][:160]
        print(
            f"{case.drive:9} {case.fault:28} {mark + differs:26} {verdict:15}",
            f"{outcome.error_m:8.3f} m  {first}",
            flush=True,
        )
    for (mark, verdict), count in sorted(counts.items()):
        print(f"marked {mark}: {count} {verdict}")
    visible = sum(count for (mark, _), count in counts.items() if mark == "yes")
    print(f"visible by the marks {visible}, of these named {counts['yes', 'named']}; silent wrong {silent}")
    print(f"visible by the numbers {visible_by_numbers}, of these named {named_by_numbers}")
    return counts["yes", "named"] >= SHARE_NAMED * visible and not silent


def run_sound(folder: Path, place: Path, duration_s: float) -> bool:
    """Import the sound drives; returns whether none has a finding."""
    count = false = 0
    for drive in sound_drives(folder):
        outcome = import_drive(beginning(drive, duration_s), place)
        count += 1
        false += bool(outcome.findings or outcome.refusal)
        print(
            f"{drive.name:34} {outcome.error_m:8.3f} m  {outcome.findings or outcome.refusal or ''}",
            flush=True,
        )
    print(f"{count} drives with nothing planted: {false} with a finding")
    return not false


def main() -> int:
    """Run; returns 1 where a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="")
    parser.add_argument("--sound", action="store_true")
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    with TemporaryDirectory() as name:
        place = Path(name)
        if options.sound:
            return int(not run_sound(options.folder, place, options.seconds))
        return int(not run_planted(options.folder, place, options.only, options.seconds))


if __name__ == "__main__":
    sys.exit(main())
