"""Guess which column of a table holds what: by names, units, and by how the numbers behave."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drivers.errors import LogError, RoverHilError
from rover_hil.drives.arrays import Array
from rover_hil.drives.files.array_table import Table, read_table
from rover_hil.drives.files.csv_table import CsvTable
from rover_hil.drives.files.flight_table import FlightTable
from rover_hil.drives.formats.table.columns import SI_PER_UNIT

MOST_COLUMNS = 16
"""So many columns are tried as a pose; more take long."""
MOST_GUESSED = 500
"""Columns of a table that is guessed at."""
SHORTEST_S, LONGEST_S = 0.001, 2.0
"""Between two rows of a drive."""
FOLLOWS = 0.8
"""Length of the mean vector of course less yaw from which on a yaw belongs to a path; at most 1."""
LEAST_TURN_RAD = 1.0
"""A path that turns less does not show which column is its yaw."""
PAIR_DIFFERS = 0.5
"""Correlation with the turn from which on the difference of two columns makes them left and right."""
ALIKE = 0.9
"""Correlation from which on one column is the change of another."""
NAMES = {
    "time": r"^(t|time|stamp|timestamp|sec|secs|seconds|t_s|time_s|zeit)\b|time",
    "x": r"^(x|pos_?x|position_?x|px|x_m|gt_?x)$",
    "y": r"^(y|pos_?y|position_?y|py|y_m|gt_?y)$",
    "yaw": r"yaw$|theta|heading|psi|^phi$|yaw_(rad|deg)",
    "gyro": r"gyro|yaw_?rate|omega_?z|^wz$|angular_?velocity_?z",
    "wheel": r"wheel|enc|tick|count|left|right|links|rechts|motor",
    "speed": r"^(v|vx|v_?x|speed|velocity|geschwindigkeit)(_|$|\b)",
    "distance": r"dist|^ds$|delta_?s|travel",
    "turn": r"^dyaw|dtheta|delta_?(yaw|theta)|turn",
}
SIDES = {
    "left": {"left", "links", "l", "fl", "rl", "bl", "ml", "wl", "lf", "lr", "lb", "lm"},
    "right": {"right", "rechts", "r", "fr", "rr", "br", "mr", "wr", "rf", "rb", "rm"},
}
"""Words of names: `rl` is rear left."""
UNITS = {
    "seconds": "s", "sec": "s", "msec": "ms", "µs": "us", "μs": "us", "degrees": "deg", "°": "deg",
    "°/s": "deg/s", "dps": "deg/s", "meter": "m", "rad/sec": "rad/s", "kmh": "km/h", "1/min": "rpm",
    "m/s²": "m/s2", "m/s^2": "m/s2", "a": "A", "ma": "mA",
}  # fmt: skip
TIMES = ("s", "ms", "us", "ns")
USUAL_M_S = (0.03, 30.0)
"""Speed of a rover in most of a drive; a unit that makes it another one is none."""
SEPARATE = 0.99
"""Cosine between distance and rotation up to which a drive shows which of them turns a wheel."""
LEAST_SIDE = 0.03
"""Share of a wheel's motion that a rotation must explain, so that it is at one side."""
EXPLAINED = 0.5
"""Of the squares of a wheel's steps, so much is explained by the motion of the path that it is a wheel of."""


@dataclass(frozen=True, slots=True)
class Guess:
    """What a column may hold.

    Attributes:
        key: Its place in the file of columns, such as "time" or "wheel.1.step"; "" where nothing is proposed.
        column: Number from 1.
        settings: Further keys, TOML values.
        reason: Why.
        is_doubtful: Whether the user must decide.
        side: "left" or "right" of a wheel, where something shows it.
    """

    key: str
    column: int
    settings: Mapping[str, str]
    reason: str
    is_doubtful: bool
    side: str = ""


class _Path(NamedTuple):
    """Motion ahead, in the unit of the pose, and turn in rad, since the row before; NaN in the first."""

    ahead: Array
    turn: Array


class _Drive(NamedTuple):
    """A table with the motion of its pose, by number of the column."""

    values: Mapping[int, Array]
    path: _Path


class _Columns:
    """The numbers of a table, and what is still to be guessed."""

    def __init__(self, table: Table) -> None:
        self.values: dict[int, Array] = {}
        for number, name in enumerate(table.names, start=1):
            try:
                values = table.numbers(name)
            except RoverHilError:  # text
                continue
            if len(values) and np.isfinite(values).mean() > 0.5:
                self.values[number] = np.nan_to_num(values)
        self._names = dict(enumerate(table.names, start=1))
        self._units = table.units if isinstance(table, CsvTable) else {}
        self.guesses: list[Guess] = []

    def name_is(self, number: int, kind: str) -> bool:
        return re.search(NAMES[kind], self._names[number].strip(), re.IGNORECASE) is not None

    def unit(self, number: int) -> str:
        """Return the unit of a column by its header or the end of its name; empty where none is there."""
        name = self._names[number]
        parts = name.strip().lower().split("_")
        stated = self._units.get(name, "").strip().lower()
        for text in (stated, "/".join(parts[-2:]), parts[-1] if len(parts) > 1 else ""):
            unit = UNITS.get(text, text)
            if unit in SI_PER_UNIT or unit == "ticks":
                return unit
        return ""

    def side(self, number: int) -> str:
        """Return "left" or "right" where a word of the name says so."""
        words = set(re.findall(r"[a-z]+", re.sub(r"([a-z])([A-Z])", r"\1 \2", self._names[number]).lower()))
        return next((side for side, names in SIDES.items() if words & names), "")

    def is_wheel(self, number: int) -> bool:
        """Return whether a column is one of a wheel by its name: also `l` and `r`, if there are both."""
        sides = {self.side(each) for each in self.values}
        return self.name_is(number, "wheel") or (bool(self.side(number)) and {"left", "right"} <= sides)

    def take(self, guess: Guess) -> None:
        self.guesses.append(guess)
        self.values.pop(guess.column, None)


def propose(path: Path, others: Sequence[Path] = ()) -> list[Guess]:
    """Return guesses for the columns of a table, each with its reason.

    Args:
        path: The table.
        others: Further drives with the same columns: what one does not show, another may.

    Raises:
        LogError: A table cannot be read or has other columns, or no column can be the time.
    """
    tables = [_read(each) for each in (path, *others)]
    for other in tables[1:]:
        if list(other.names) != list(tables[0].names):
            raise LogError(f"{other.path} has other columns than {path}: give tables of one kind at a time")
    all_values = [_Columns(table).values for table in tables]
    columns, path_moves = _Columns(tables[0]), None
    for table in tables:  # the first that shows which columns are the pose
        columns = _Columns(table)
        times_s = _take_time(table.path, columns)
        path_moves = _take_pose(columns, times_s)
        if path_moves is not None:
            break
    else:
        columns = _Columns(tables[0])
        times_s = _take_time(path, columns)
        _take_pose(columns, times_s)
    _take_gyro(columns, times_s, None if path_moves is None else path_moves.turn)
    _take_increments(columns, times_s)
    _take_wheels(columns, [] if path_moves is None else _drives(columns, all_values))
    _take_body(columns)
    taken = {guess.column for guess in columns.guesses}
    unused = [
        Guess("", number, {}, f"'{name}' is not used", is_doubtful=True)
        for number, name in enumerate(tables[0].names, start=1)
        if number not in taken
    ]
    return sorted([*columns.guesses, *unused], key=lambda guess: guess.column)


def _drives(columns: _Columns, tables: Sequence[Mapping[int, Array]]) -> list[_Drive]:
    """Return the tables with the motion of the pose that was guessed."""
    pose = {guess.key: guess for guess in columns.guesses if guess.key.startswith("truth.")}
    x, y, yaw = (pose[f"truth.{key}"].column for key in ("x", "y", "yaw"))
    per_unit = SI_PER_UNIT[pose["truth.yaw"].settings["unit"].strip('"')]
    return [
        _Drive(values, _moves(values, x, y, yaw, per_unit))
        for values in tables
        if {x, y, yaw} <= values.keys()
    ]


def _moves(values: Mapping[int, Array], x: int, y: int, yaw: int, per_unit: float) -> _Path:
    """Return the motion of a pose by the numbers of its columns and the unit of its yaw."""
    yaw_rad = values[yaw] * per_unit
    turn: Array = np.diff(np.unwrap(yaw_rad), prepend=np.nan)
    steps = np.diff(values[x] + 1j * values[y], prepend=np.nan) * np.exp(-1j * yaw_rad)
    return _Path(np.real(steps * np.exp(-1j * np.angle(np.nansum(steps)))), turn)


def _read(path: Path) -> Table:
    table = read_table(path, delimiter=None, header_lines=None)
    if isinstance(table, FlightTable):
        raise LogError(
            f"{path}: columns of a log of an autopilot have fixed names and units: nothing is guessed, "
            "copy the file of columns for PX4 or ArduPilot from docs/how-to/import_a_table.md"
        )
    if len(table.names) > MOST_GUESSED:
        raise LogError(
            f"{path} has {len(table.names):,} columns; guesses are made for {MOST_GUESSED} at most: write "
            "the file of columns by hand, or leave columns out"
        )
    columns = _Columns(table)
    if len(next(iter(columns.values.values()), ())) < 3:
        raise LogError(f"{path} has fewer than three rows of numbers: nothing can be proposed")
    return table


def _take_time(path: Path, columns: _Columns) -> Array:
    candidates = [
        number
        for number, values in columns.values.items()
        if (np.diff(values) >= 0.0).all() and np.median(np.diff(values)) > 0.0
    ]
    if not candidates:
        raise LogError(f"{path}: no column grows from row to row: none can be the time; name one by hand")
    named = [number for number in candidates if columns.name_is(number, "time")]
    number = min(named or candidates, key=lambda each: _unevenness(columns.values[each]))
    others = [_unevenness(columns.values[each]) for each in candidates if each != number]
    is_even = not others or _unevenness(columns.values[number]) < 0.5 * min(others)
    step = float(np.median(np.diff(columns.values[number])))
    fitting = [unit for unit in TIMES if SHORTEST_S <= step * SI_PER_UNIT[unit] <= LONGEST_S]
    unit = columns.unit(number) if columns.unit(number) in TIMES else (fitting or ["s"])[0]
    is_index = bool((np.diff(columns.values[number]) == 1.0).all())
    is_known = bool(columns.unit(number)) or len(fitting) == 1
    is_doubtful = is_index or not (is_even or len(named) == 1) or not is_known
    reason = f"it grows in every row, by {step:.4g} as a median" + (
        ", as a number of rows does" if is_index else ""
    )
    values = columns.values[number]
    columns.take(Guess("time", number, {"unit": f'"{unit}"'}, reason, is_doubtful))
    times_s: Array = (values - values[0]) * SI_PER_UNIT[unit]
    return times_s


def _unevenness(values: Array) -> float:
    """Return how much the steps of a column scatter, as a share of their median."""
    steps = np.diff(values)
    low, middle, high = np.quantile(steps, (0.25, 0.5, 0.75))
    return float((high - low) / middle)


def _length_unit(lengths: Array, times_s: Array) -> tuple[str, bool]:
    """Return the unit of what a rover moves from row to row, by its speed; and whether it is the only one."""
    elapsed_s = np.diff(times_s)
    speeds = np.abs(lengths[1:][elapsed_s > 0.0]) / elapsed_s[elapsed_s > 0.0]
    usual = float(np.quantile(speeds, 0.9)) if len(speeds) else 0.0
    fitting = [
        unit for unit in ("m", "mm", "cm") if USUAL_M_S[0] <= usual * SI_PER_UNIT[unit] <= USUAL_M_S[1]
    ]
    return (fitting or ["m"])[0], len(fitting) == 1


def _take_pose(columns: _Columns, times_s: Array) -> _Path | None:
    """Take x, y and yaw of a path; return its moves, None without a pose."""
    smooth = [number for number, values in columns.values.items() if _is_integral(values)][:MOST_COLUMNS]
    best: tuple[float, int, int, int, float] | None = None
    for x, y in permutations(smooth, 2):
        steps = np.diff(columns.values[x]) + 1j * np.diff(columns.values[y])
        moves = np.abs(steps) > 0.2 * np.quantile(np.abs(steps), 0.9)
        course = np.unwrap(np.angle(steps[moves]))
        if moves.sum() < 10 or np.ptp(course) < LEAST_TURN_RAD:
            continue
        for yaw, values in columns.values.items():
            if yaw in (x, y):
                continue
            for unit in ("rad", "deg"):
                angle = values[:-1][moves] * SI_PER_UNIT[unit]
                if not np.ptp(np.unwrap(angle)) > LEAST_TURN_RAD or np.abs(np.diff(angle)).max() > 7.0:
                    continue
                length = float(np.abs(np.mean(np.exp(1j * (course - angle)))))
                if best is None or length > best[0] + 1e-9:
                    best = (length, x, y, yaw, SI_PER_UNIT[unit])
    if best is None or best[0] < FOLLOWS:
        _take_named_pose(columns)
        return None
    length, x, y, yaw, per_unit = best
    moves = _moves(columns.values, x, y, yaw, per_unit)
    lengths = np.abs(np.diff(columns.values[x] + 1j * columns.values[y], prepend=np.nan))
    reason = f"the course of x and y less this yaw is constant (mean vector {length:.2f} long)"
    unit, is_only = _length_unit(lengths, times_s)
    for key, number in (("x", x), ("y", y)):
        known = columns.unit(number)
        columns.take(
            Guess(f"truth.{key}", number, {"unit": f'"{known or unit}"'}, reason, not known and not is_only)
        )
    angle_unit = "rad" if per_unit == 1.0 else "deg"
    columns.take(Guess("truth.yaw", yaw, {"unit": f'"{angle_unit}"'}, reason, is_doubtful=False))
    return moves


def _take_named_pose(columns: _Columns) -> None:
    named = {
        key: [number for number in columns.values if columns.name_is(number, key)]
        for key in ("x", "y", "yaw")
    }
    if all(len(numbers) == 1 for numbers in named.values()):
        for key, (number,) in named.items():
            unit = columns.unit(number) or ("rad" if key == "yaw" else "m")
            columns.take(
                Guess(f"truth.{key}", number, {"unit": f'"{unit}"'}, "by its name", is_doubtful=True)
            )


def _is_integral(values: Array) -> bool:
    """Return whether a column moves in steps much smaller than its range, as a position does."""
    extent = float(np.ptp(values))
    return extent > 0.0 and float(np.abs(np.diff(values)).max()) < 0.2 * extent


def _take_gyro(columns: _Columns, times_s: Array, turn: Array | None) -> None:
    elapsed_s = np.diff(times_s, prepend=np.nan)
    for number, values in list(columns.values.items()):
        named = columns.name_is(number, "gyro")
        if turn is None or _is_whole(values):
            if named:
                unit = columns.unit(number) or ("deg/s" if np.abs(values).max() > 12.0 else "rad/s")
                columns.take(
                    Guess("imu.yaw_rate", number, {"unit": f'"{unit}"'}, "by its name", is_doubtful=True)
                )
                return
            continue
        known = np.isfinite(turn) & (elapsed_s > 0.0)
        rates = turn[known] / elapsed_s[known]
        correlation, slope = _relation(_smoothed(rates), _smoothed(values[known]))
        if correlation < ALIKE:
            continue
        fits = {unit: abs(math.log(abs(slope) * SI_PER_UNIT[unit])) for unit in ("rad/s", "deg/s")}
        unit = min(fits, key=lambda each: fits[each])
        if fits[unit] < 0.4:
            sign = {"sign": "-1"} if slope < 0.0 else {}
            reason = f"it is the change of the yaw with time (correlation {correlation:.2f})"
            columns.take(Guess("imu.yaw_rate", number, {"unit": f'"{unit}"', **sign}, reason, slope < 0.0))
            return


def _take_increments(columns: _Columns, times_s: Array) -> None:
    """Take distance and turn since the row before: two columns of increments, no more."""
    unused = [
        number for number, values in columns.values.items() if not _is_whole(values) and np.ptp(values) > 0.0
    ]
    distance = [number for number in unused if columns.name_is(number, "distance")]
    turn = [number for number in unused if columns.name_is(number, "turn")]
    reason = "by its name"
    if len(distance) != 1 or len(turn) != 1:
        if any(columns.is_wheel(number) for number in unused):
            return
        if (
            len(unused) != 2
            or len(columns.values) != 2
            or any(_is_integral(columns.values[each]) for each in unused)
        ):
            return
        one_sided = [
            abs(float(np.mean(columns.values[each]))) / float(np.std(columns.values[each])) for each in unused
        ]
        order = unused if one_sided[0] >= one_sided[1] else unused[::-1]
        distance, turn = order[:1], order[1:]
        reason = "of two columns of increments the one with one sign is the distance"
    is_doubtful = reason != "by its name"
    unit, is_only = _length_unit(columns.values[distance[0]], times_s)
    for key, number, usual, is_sure in (
        ("distance", distance[0], unit, is_only),
        ("turn", turn[0], "rad", False),
    ):
        known = columns.unit(number)
        settings = {"unit": f'"{known or usual}"'}
        columns.take(
            Guess(f"increments.{key}", number, settings, reason, is_doubtful or not (known or is_sure))
        )


def _take_wheels(columns: _Columns, drives: Sequence[_Drive]) -> None:
    if any(guess.key.startswith("increments") for guess in columns.guesses):
        return
    moving = {number: values for number, values in columns.values.items() if np.ptp(values) > 0.0}
    named = [number for number in moving if columns.is_wheel(number)]
    chosen = [number for number in (named or moving) if _is_whole(moving[number])] or named
    for place, number in enumerate(chosen):
        values = moving[number]
        is_whole = _is_whole(values)
        unit = columns.unit(number) or ("ticks" if is_whole else "rad")
        settings = {"unit": f'"{unit}"'} | ({"ticks_per_turn": "1000"} if unit == "ticks" else {})
        wrap = _wrap_of(values)
        is_position = wrap > 0.0 or _is_integral(values)
        reason = "whole numbers" if is_whole else "by its name"
        reason += (
            ", each as the one before and a little more" if is_position else ", about the same in each row"
        )
        if wrap:
            settings["wrap"] = f"{wrap:.0f}"
            reason += f", that start again after {wrap:.0f}"
        is_speed = "/" in unit or unit == "rpm"
        kind = "speed" if is_speed else ("position" if is_position else "step")
        side, sign, evidence = _side_of(
            columns.side(number), [each for each in drives if number in each.values], number, kind
        )
        if sign < 0:
            settings["sign"] = "-1"
        key = f"wheel.{place}.{kind}"
        columns.take(Guess(key, number, settings, reason + evidence, is_doubtful=True, side=side))


def _side_of(named: str, drives: Sequence[_Drive], number: int, kind: str) -> tuple[str, int, str]:
    """Return the side of a wheel, its sign, and what shows them: the paths rather than the name.

    Args:
        named: The side by the name; "" for none.
        drives: Their motion.
        number: Of the column.
        kind: What it holds: "position", "step" or "speed".
    """
    by_name = f"; by its name a {named} wheel" if named else ""
    if not drives:
        return named, 1, by_name
    parts = []
    for values, path in drives:
        steps = np.diff(values[number], prepend=np.nan) if kind == "position" else values[number]
        known = np.isfinite(steps) & np.isfinite(path.ahead)
        parts.append(np.column_stack([_smoothed(each[known]) for each in (*path, steps)]))
    together = np.concatenate(parts)
    moves, turned = together[:, :2], together[:, 2]
    if _relation_about_zero(moves) > SEPARATE:
        return named, 1, f"{by_name}; an even bend does not show its side: give drives of other motions, too"
    (ahead, turn), *_ = np.linalg.lstsq(moves, turned, rcond=None)
    rest = float(np.sum((turned - moves @ (ahead, turn)) ** 2))
    if rest > (1.0 - EXPLAINED) * float(np.sum(turned**2)) or ahead == 0.0 or turn == 0.0:
        return named, 1, by_name
    if abs(turn) * np.linalg.norm(moves[:, 1]) < LEAST_SIDE * np.linalg.norm(turned):
        return named, 1 if ahead > 0.0 else -1, f"{by_name}; alike in turns to both sides, as in the middle"
    side, sign = ("right" if turn / ahead > 0.0 else "left"), (1 if ahead > 0.0 else -1)
    change = "faster" if side == "right" else "slower"
    evidence = f"; {change} in turns to the left, as a {side} wheel"
    if named not in ("", side):
        evidence += f", but by its name a {named} one: exchanged?"
    return side, sign, evidence + ("; it counts backwards" if sign < 0 else "")


def _take_body(columns: _Columns) -> None:
    """Take speed and yaw rate of the rover where there are no wheels."""
    if any(guess.key.startswith(("increments", "wheel")) for guess in columns.guesses):
        return
    rate = next((guess for guess in columns.guesses if guess.key == "imu.yaw_rate"), None)
    speed = next((number for number in columns.values if columns.name_is(number, "speed")), None)
    if rate is None or speed is None:
        return
    known = columns.unit(speed)
    columns.guesses.append(replace(rate, key="body.yaw_rate"))
    columns.take(Guess("body.speed", speed, {"unit": f'"{known or "m/s"}"'}, "by its name", not known))


def _wrap_of(values: Array) -> float:
    """Return the power of two after which a column starts again; 0 for none."""
    steps = np.abs(np.diff(values))
    far = steps > 0.5 * np.ptp(values)
    if not 0 < far.sum() < 0.05 * len(steps) or np.ptp(values) < 100.0:
        return 0.0
    power = 2.0 ** math.ceil(math.log2(float(np.ptp(values)) + 1.0))
    return power if float(np.ptp(values)) > 0.8 * power else 0.0


def _is_whole(values: Array) -> bool:
    return bool((values == np.round(values)).all())


def _smoothed(values: Array) -> Array:
    width = max(1, min(9, len(values) // 10))
    return np.convolve(values, np.ones(width) / width, "valid")


def _relation(cause: Array, effect: Array) -> tuple[float, float]:
    """Return size of the correlation and slope of `effect` on `cause`."""
    cause, effect = cause - cause.mean(), effect - effect.mean()
    squares = float(cause @ cause), float(effect @ effect)
    if not min(squares) > 0.0:
        return 0.0, 0.0
    product = float(cause @ effect)
    return abs(product) / math.sqrt(squares[0] * squares[1]), product / squares[0]


def _relation_about_zero(moves: Array) -> float:
    """Return the cosine between two columns: 1 where one is a multiple of the other."""
    sizes = np.linalg.norm(moves, axis=0)
    return float(abs(moves[:, 0] @ moves[:, 1]) / max(float(sizes.prod()), 1e-30))


def _wheel_lines(wheels: Sequence[Guess]) -> list[str]:
    """Return a wheel of [rover] for each guessed one, y by its side; two where none is guessed."""
    if not wheels:
        return [f"  {{ x_m = 0.0, y_m = {y_m}, radius_m = 0.1 }}," for y_m in (0.2, -0.2)]
    lines = []
    for place, wheel in enumerate(wheels):
        y_m = {"left": 0.2, "right": -0.2}.get(wheel.side, -0.2 if place % 2 else 0.2)
        side = wheel.side or "? left or right"
        lines.append(f"  {{ x_m = 0.0, y_m = {y_m}, radius_m = 0.1 }},  # column {wheel.column}: {side}")
    return lines


def proposal_text(path: Path, guesses: Sequence[Guess]) -> str:
    """Return the file of columns for guesses, with their reasons as comments, `# ?` for doubtful ones."""
    wheels = [guess for guess in guesses if guess.key.startswith("wheel.")]
    rover = [
        'rover = { kinematics = "wheels", wheels = [',
        *_wheel_lines(wheels),
        "] }",
        "limits = { wheel_speed_rad_s = 100, wheel_acceleration_rad_s2 = 500 }",
    ]
    why = "# ? the rover is not in the table: enter its wheels, in the order of [[wheel]], and their limits"
    if not wheels and any(guess.key.startswith(("increments.", "body.")) for guess in guesses):
        why = "# the motion needs no wheels; to describe the rover all the same, enter it and remove '# '"
        rover = [f"# {line}" for line in rover]
    lines = [
        f"# Proposed for {path.name}. Check every line; what follows '# ?' is doubtful.",
        why,
        *rover,
    ]
    by_section: dict[str, list[tuple[str, Guess]]] = {}
    lines += [f"# ? column {guess.column}: {guess.reason}" for guess in guesses if not guess.key]
    for guess in sorted(filter(lambda each: each.key, guesses), key=lambda each: each.key != "time"):
        section, _, key = guess.key.rpartition(".")
        by_section.setdefault(section, []).append((key, guess))
    for section, keys in by_section.items():
        header = "[[wheel]]" if section.startswith("wheel") else f"[{section}]"
        lines += ["", header] if section else []
        for key, guess in keys:
            words = ", ".join(f"{name} = {value}" for name, value in guess.settings.items())
            lines.append(f"# {'? ' if guess.is_doubtful else ''}{guess.reason}")
            lines.append(f"{key} = {{ column = {guess.column}, {words} }}")
    return "\n".join(lines) + "\n"
