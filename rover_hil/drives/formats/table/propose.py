"""Guess which column of a table holds what: by names, units, and by how the numbers behave."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path

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
    "wheel": r"wheel|enc|tick|count|left|right|motor|\b[fr][lr]\b",
    "distance": r"dist|^ds$|delta_?s|travel",
    "turn": r"^dyaw|dtheta|delta_?(yaw|theta)|turn",
}
UNITS = {"seconds": "s", "sec": "s", "msec": "ms", "degrees": "deg", "meter": "m", "rad/sec": "rad/s"}


@dataclass(frozen=True, slots=True)
class Guess:
    """What a column may hold.

    Attributes:
        key: Its place in the file of columns, such as "time" or "wheel.1.step".
        column: Number from 1.
        settings: Further keys, TOML values.
        reason: Why.
        is_doubtful: Whether the user must decide.
    """

    key: str
    column: int
    settings: Mapping[str, str]
    reason: str
    is_doubtful: bool


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
        unit = self._units.get(self._names[number], "").strip().lower()
        unit = UNITS.get(unit, unit)
        return unit if unit in SI_PER_UNIT else ""

    def take(self, guess: Guess) -> None:
        self.guesses.append(guess)
        self.values.pop(guess.column, None)


def propose(path: Path) -> list[Guess]:
    """Return guesses for the columns of a table, each with its reason.

    Raises:
        LogError: The table cannot be read, or no column can be its time.
    """
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
    times_s = _take_time(path, columns)
    path_turn = _take_pose(columns)
    _take_gyro(columns, times_s, path_turn)
    _take_increments(columns)
    _take_wheels(columns, path_turn)
    return sorted(columns.guesses, key=lambda guess: guess.column)


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
    fitting = [
        unit for unit in ("s", "ms", "us", "ns") if SHORTEST_S <= step * SI_PER_UNIT[unit] <= LONGEST_S
    ]
    unit = columns.unit(number) or (fitting or ["s"])[0]
    is_index = bool((np.diff(columns.values[number]) == 1.0).all())
    is_doubtful = is_index or not (is_even or len(named) == 1) or not fitting
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


def _take_pose(columns: _Columns) -> Array | None:
    """Take x, y and yaw of a path; return the turn of each row, None without a pose."""
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
    turn: Array = np.diff(np.unwrap(columns.values[yaw] * per_unit), prepend=np.nan)
    reason = f"the course of x and y less this yaw is constant (mean vector {length:.2f} long)"
    size = float(np.hypot(np.ptp(columns.values[x]), np.ptp(columns.values[y])))
    unit = "m" if size < 500.0 else "mm"
    for key, number in (("x", x), ("y", y)):
        known = columns.unit(number)
        columns.take(
            Guess(f"truth.{key}", number, {"unit": f'"{known or unit}"'}, reason, not known and unit != "m")
        )
    angle_unit = "rad" if per_unit == 1.0 else "deg"
    columns.take(Guess("truth.yaw", yaw, {"unit": f'"{angle_unit}"'}, reason, is_doubtful=False))
    return turn


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


def _take_increments(columns: _Columns) -> None:
    """Take distance and turn since the row before: two columns of increments, no more."""
    unused = [
        number for number, values in columns.values.items() if not _is_whole(values) and np.ptp(values) > 0.0
    ]
    distance = [number for number in unused if columns.name_is(number, "distance")]
    turn = [number for number in unused if columns.name_is(number, "turn")]
    reason = "by its name"
    if len(distance) != 1 or len(turn) != 1:
        if any(columns.name_is(number, "wheel") for number in unused):
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
    for key, number, usual in (("distance", distance[0], "m"), ("turn", turn[0], "rad")):
        unit = columns.unit(number) or usual
        columns.take(Guess(f"increments.{key}", number, {"unit": f'"{unit}"'}, reason, is_doubtful))


def _take_wheels(columns: _Columns, turn: Array | None) -> None:
    if any(guess.key.startswith("increments") for guess in columns.guesses):
        return
    moving = {number: values for number, values in columns.values.items() if np.ptp(values) > 0.0}
    named = [number for number in moving if columns.name_is(number, "wheel")]
    chosen = [number for number in (named or moving) if _is_whole(moving[number])] or named
    sides = _sides({number: moving[number] for number in chosen}, turn)
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
        kind = "position" if is_position else ("speed" if "/" in unit or unit == "rpm" else "step")
        reason += sides.get(number, "")
        columns.take(Guess(f"wheel.{place}.{kind}", number, settings, reason, is_doubtful=True))


def _sides(wheels: Mapping[int, Array], turn: Array | None) -> dict[int, str]:
    """Return what the difference of a pair of columns in turns says of each."""
    if turn is None or len(wheels) != 2:
        return {}
    (first, first_turns), (second, second_turns) = wheels.items()
    steps = [
        np.diff(each, prepend=np.nan) if _is_integral(each) else each for each in (first_turns, second_turns)
    ]
    known = np.isfinite(steps[0]) & np.isfinite(steps[1]) & np.isfinite(turn)
    correlation, slope = _relation(_smoothed(turn[known]), _smoothed((steps[1] - steps[0])[known]))
    if correlation < PAIR_DIFFERS:
        return {}
    right, left = (second, first) if slope > 0.0 else (first, second)
    return {
        right: "; faster than the other in turns to the left, as a right wheel",
        left: "; slower than the other in turns to the left, as a left wheel",
    }


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


def proposal_text(path: Path, guesses: Sequence[Guess]) -> str:
    """Return the file of columns for guesses, with their reasons as comments, `# ?` for doubtful ones."""
    lines = [
        f"# Proposed for {path.name}. Check every line; what follows '# ?' is doubtful.",
        "# ? the rover is not in the table: enter its wheels, in the order of [[wheel]], and their limits",
        'rover = { kinematics = "wheels", wheels = [',
        "  { x_m = 0.0, y_m = 0.2, radius_m = 0.1 },",
        "  { x_m = 0.0, y_m = -0.2, radius_m = 0.1 },",
        "] }",
        "limits = { wheel_speed_rad_s = 100, wheel_acceleration_rad_s2 = 500 }",
    ]
    by_section: dict[str, list[tuple[str, Guess]]] = {}
    for guess in sorted(guesses, key=lambda each: each.key != "time"):
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
