"""The numbers of a drive in SI units, from the columns of a table."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controllers.estimation.settings import FilterSettings
from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import RoverSettings, WheelsRoverSettings
from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.errors import LogError
from drivers.settings import Settings
from rover_hil.config import Config
from rover_hil.datasets.array_table import Table, read_table
from rover_hil.datasets.arrays import Array, Flags
from rover_hil.datasets.csv_table import CsvTable
from rover_hil.datasets.flight_table import FlightTable
from rover_hil.importing.drive import check_steering, check_straight
from rover_hil.importing.fixes import invented_poses
from rover_hil.importing.oddities import NO_FAULT, REPAIRED, TOLD, Oddity
from rover_hil.importing.rosbag.joints import REGULAR, Steps
from rover_hil.importing.table.columns import (
    LENGTHS,
    SI_PER_UNIT,
    TURN_RAD,
    AngleColumn,
    Column,
    Columns,
    FixColumns,
    IncrementColumns,
    PlaceColumns,
    SpeedColumn,
    SteeredWheelColumns,
    TimeColumn,
    TruthColumns,
    TurnColumn,
    WheelColumns,
)
from rover_hil.importing.table.gyro_rests import GyroRest, learn_bias

FIX = "correct the cell or the file of columns"
LONGEST_S = 1e6
"""A drive is not longer."""
LONGEST_GAP_S = 1.0
"""In a longer gap of the table the path of the rover is worth a word."""
REST_SHARE = 0.005
"""Speeds below this share of the fast ones are jitter of the encoders."""
LEAST_REST_S = 0.5
"""Shorter stands of a drive by increments are no rests: the rover may still swing."""
LEAST_WRAP = 256
"""Fewer ticks are no counter."""
DEGREES = {"deg": 1.0, "1e-7 deg": 1e-7}
MOST_JUMPS = 0.02
"""Share of the rows in which a wheel may turn faster than the limits say: chosen by hand, as for a bag."""


class Row(NamedTuple):
    """What was measured at one time.

    Attributes:
        t_ns: Since the first row.
        section: `wheels`, `increments`, `imu`, `fixes` or `truth`.
        values: By quantity; one number for each wheel, else one for each axis.
    """

    t_ns: int
    section: str
    values: Mapping[str, Sequence[float]]


@dataclass
class Drive:
    """A recorded drive.

    Attributes:
        rows: In the order of their times.
        quantities: Which the wheels have.
        filter: Noise of the sensors, where the drive itself shows it; else None.
        notes: What a user must know of it, one sentence each.
        oddities: What is odd in it, and what was done about it.
    """

    rows: list[Row] = field(default_factory=list)
    quantities: tuple[str, ...] = ("Position",)
    filter: FilterSettings | None = None
    notes: list[str] = field(default_factory=list)
    oddities: list[Oddity] = field(default_factory=list)


def read_drive_table(path: Path, columns: Columns, rover: Config) -> Drive:
    """Return the drive in a table.

    Args:
        path: The table.
        columns: What its columns hold.
        rover: Its wheels and their limits.

    Raises:
        LogError: The table cannot be read or holds something wrong; names file, row, column and fix.
    """
    return _Reader(path, columns, rover).read()


class _Reader:
    def __init__(self, path: Path, columns: Columns, rover: Config) -> None:
        self._columns = columns
        self._rover = rover
        self._table = self._open(path)
        self._drive = Drive()
        self._others: dict[str, Table] = {}
        if isinstance(self._table, CsvTable):
            self._table = self._without_cut_row(self._table)
        if isinstance(self._table, FlightTable):
            found = self._table.oddities.items()
            self._drive.oddities += [Oddity(what=what, count=count, done=TOLD) for what, count in found]
        times = self._times_s(self._table, columns.time)
        self._start_s = float(times[0])
        self._used = self._not_repeated(times)
        times = times[self._used]
        self._elapsed_s = np.diff(times)
        self._t_ns = self._nanoseconds(times)

    def read(self) -> Drive:
        """Return the drive."""
        columns, drive = self._columns, self._drive
        if columns.wheel:
            self._take_wheels(columns.wheel)
        elif columns.increments is not None:
            self._take_increments(columns.increments)
        elif columns.tricycle is not None:
            self._take_tricycle(columns.tricycle)
        if columns.imu is not None:
            self._take_imu()
        if columns.fixes is not None:
            self._take_fixes(columns.fixes)
        if columns.truth is not None:
            self._take_truth(columns.truth)
        self._note_rows()
        drive.rows.sort(key=lambda row: row.t_ns)  # stable, so that rows of one time keep their order
        return drive

    def _open(self, path: Path) -> Table:
        columns = self._columns
        named = {column.column for column in _named_columns(columns)}
        wanted = (
            {name for name in named if isinstance(name, str)}
            if not any(isinstance(name, int) for name in named)
            else None
        )
        return read_table(path, delimiter=columns.delimiter, header_lines=columns.header_lines, wanted=wanted)

    def _without_cut_row(self, table: CsvTable) -> CsvTable:
        """Return a table without a last row that has fewer cells than all others: the file was cut in it.

        Raises:
            LogError: A row has more cells than there are names.
        """
        for row, cells in enumerate(table.rows):
            if len(cells) > len(table.names):
                raise LogError(
                    f"{table.where(row)} has {len(cells)} cells, more than the {len(table.names)} names: "
                    "correct the row, or give the delimiter in the file of columns"
                )
        widths = set(map(len, table.rows[:-1]))
        if len(widths) != 1 or len(table.rows[-1]) >= min(widths):
            return table
        self._drive.oddities.append(Oddity(what="a last row that is cut", where=table.where(-1), count=1))
        return replace(table, rows=table.rows[:-1], lines=table.lines[:-1])

    def _note_rows(self) -> None:
        """Note where rows or cells are missing."""
        drive, elapsed_s = self._drive, self._elapsed_s
        if len(elapsed_s) and elapsed_s.max() > LONGEST_GAP_S:
            drive.notes.append(
                f"no row for up to {elapsed_s.max():.1f} s: the path meanwhile is not measured"
            )
        if isinstance(self._table, FlightTable):
            return
        positive_s = elapsed_s[elapsed_s > 0.0]
        usual_s = float(np.median(positive_s)) if len(positive_s) else 0.0
        # Where the rows come regularly, a gap of nearly whole periods is rows that are missing.
        if len(positive_s) and np.quantile(positive_s, 0.9) < REGULAR * usual_s:
            missing = int(np.round(positive_s[positive_s > REGULAR * usual_s] / usual_s - 1.0).sum())
            if missing:
                drive.oddities.append(
                    Oddity(what="rows missing between others", count=missing, done=NO_FAULT)
                )
        for column in _all_columns(self._columns):
            name = self._name(self._table, column)
            empty = int(np.isnan(self._table.numbers(name, fix=FIX)).sum())
            if empty:
                drive.oddities.append(Oddity(what="empty cells", where=name, count=empty, done=NO_FAULT))

    def _name(self, table: Table, column: Column) -> str:
        """Return the name of a column given by name or number.

        Raises:
            LogError: The table has no such column.
        """
        name = column.column
        if isinstance(name, int):
            if name > len(table.names):
                raise LogError(
                    f"{table.path} has {len(table.names)} columns, no column {name}: correct the file of "
                    "columns, or give the delimiter there"
                )
            name = table.names[name - 1]
        known = ", ".join(list(table.names)[:20])
        table.require((name,), f"it has {known}; correct the file of columns, or give the delimiter there")
        return name

    def _numbers(self, column: Column, *, is_needed: bool = False) -> Array:
        name = self._name(self._table, column)
        numbers: Array = column.sign * self._table.numbers(name, fix=FIX, is_needed=is_needed)[self._used]
        return numbers

    def _times_s(self, table: Table, time: TimeColumn) -> Array:
        """Return the times of all rows, which never run back.

        Raises:
            LogError: They do, or are not the times of a drive.
        """
        name = self._name(table, time)
        times_s = time.sign * SI_PER_UNIT[time.unit] * table.numbers(name, fix=FIX, is_needed=True)
        back = np.flatnonzero(np.diff(times_s) < 0.0)
        if back.size:
            row = int(back[0]) + 1
            raise LogError(
                f"{table.where(row)}, column '{name}': the time runs back by "
                f"{times_s[row - 1] - times_s[row]:.6g} s, {back.size} times in all: divide the file there, "
                "or name another column"
            )
        if times_s[-1] - times_s[0] > LONGEST_S:
            raise LogError(
                f"{table.path}, column '{name}': {times_s[-1] - times_s[0]:.3g} s from the first row to the "
                "last, more than 11 days: correct its unit, which may be ms, us or ns"
            )
        return times_s

    def _nanoseconds(self, times_s: Array) -> list[int]:
        numbers: list[int] = np.round((times_s - self._start_s) * NANOSECONDS_PER_SECOND).astype(int).tolist()
        return numbers

    def _not_repeated(self, times_s: Array) -> Array:
        """Return which rows are not the row before once more, time included."""
        table = self._table
        names = [self._name(table, column) for column in _all_columns(self._columns)]
        numbers = np.column_stack([table.numbers(name, fix=FIX) for name in names])
        same = (np.diff(times_s) == 0.0) & np.all(np.diff(numbers, axis=0) == 0.0, axis=1)
        if same.any():
            self._drive.oddities.append(Oddity(what="rows that repeat the one before", count=int(same.sum())))
        return np.concatenate(([True], ~same))

    def _steps(self, column: Column, unit: float) -> Array:
        """Return increments in SI units; each is needed, because what one held is in no other row."""
        return self._numbers(column, is_needed=True) * unit

    def _take_wheels(self, wheels: Sequence[WheelColumns]) -> None:
        radii_m = _radii_m(self._rover.rover)
        if len(wheels) != len(radii_m):
            raise LogError(
                f"the file of columns has {len(wheels)} [[wheel]], but the rover {len(radii_m)} wheels: give "
                "one for each, in the rover's order"
            )
        kinematics = make_kinematics(self._rover.rover)
        for place, wheel in enumerate(wheels):
            is_given = not (wheel.position is None and wheel.step is None and wheel.speed is None)
            if is_given == (place in kinematics.unmeasured):
                has = "is not measured by [rover], but has a column: correct one of them"
                lacks = "has neither position nor step nor speed: add one, or measured = false in [rover]"
                raise LogError(f"{self._table.path}: wheel {place} {has if is_given else lacks}")
        steered = [place for place, wheel in enumerate(wheels) if wheel.steering is not None]
        check_steering(kinematics, steered, self._table.path, "add steering to its [[wheel]]")
        none = np.full(len(self._t_ns), math.nan)
        quantities: dict[str, list[Array]] = {}
        for place, (wheel, radius_m) in enumerate(zip(wheels, radii_m, strict=True)):
            found = {
                "Position": self._angles_rad(place, wheel, radius_m),
                "Speed": None if wheel.speed is None else self._speeds_rad_s(place, wheel.speed, radius_m),
                "Current": None
                if wheel.current is None
                else self._numbers(wheel.current) * SI_PER_UNIT[wheel.current.unit],
                "Steering": None if wheel.steering is None else self._angle_rad(wheel.steering),
            }
            for quantity, values in found.items():
                quantities.setdefault(quantity, []).append(none if values is None else values)
        given = {name: rows for name, rows in quantities.items() if not all(row is none for row in rows)}
        self._drive.quantities = tuple(dict.fromkeys(("Position", *given)))
        stacks = {name: np.column_stack(rows) for name, rows in given.items()}
        held = np.any([np.isfinite(stack).any(axis=1) for stack in stacks.values()], axis=0)
        self._add("wheels", {name: stack.tolist() for name, stack in stacks.items()}, held)

    def _angles_rad(self, place: int, wheel: WheelColumns, radius_m: float) -> Array | None:
        """Return how far a wheel has turned in every row, NaN where that is not known."""
        column = wheel.step or wheel.position
        if column is None:
            if wheel.speed is None:
                return None
            self._drive.notes.append(f"wheel {place}: no angles, its speeds are integrated")
            return None
        unit = _turn_unit(column, radius_m)
        if wheel.step is not None:
            turned = np.cumsum(self._numbers(column, is_needed=True)) * unit
        else:
            turned = self._unwrapped(place, column, unit)
        self._check_jumps(place, turned, self._name(self._table, column))
        return turned

    def _unwrapped(self, place: int, column: TurnColumn, unit: float) -> Array:
        values = self._numbers(column)
        known = np.flatnonzero(np.isfinite(values))
        if len(known) < 2:
            return values * unit
        steps = np.diff(values[known])
        wrap = column.wrap or self._certain_wrap(place, column, values[known])
        if wrap is None:
            return values * unit
        limit = self._rover.limits.wheel_speed_rad_s / abs(unit)
        elapsed_s = np.diff(np.asarray(self._t_ns)[known]) / NANOSECONDS_PER_SECOND
        if not Steps(elapsed_s, steps, float(np.ptp(values[known])), limit).are_counted(wrap):
            name = self._name(self._table, column)
            raise LogError(
                f"{self._table.path}, column '{name}': it wraps after {wrap:g}, and the wheel may "
                "turn by more than half of that between two rows at limits.wheel_speed_rad_s = "
                f"{self._rover.limits.wheel_speed_rad_s:g}: "
                "lower that limit if the wheels are slower, or record faster"
            )
        steps = steps - wrap * np.round(steps / wrap)
        values[known] = values[known[0]] + np.concatenate(([0.0], np.cumsum(steps)))
        return values * unit

    def _certain_wrap(self, place: int, column: TurnColumn, values: Array) -> float | None:
        """Return the range of a counter that starts again, where it is certain; None else.

        Whole numbers jump by one power of two, at least twice, always to the other end, and the wheel goes on
        in between.
        """
        steps = np.diff(values)
        extent = float(np.ptp(values))
        if column.unit != "ticks" or extent < LEAST_WRAP / 2 or (values != np.round(values)).any():
            return None
        wrap = 2.0 ** math.ceil(math.log2(extent + 1.0))
        far = np.abs(steps) > 0.5 * wrap
        turned = np.abs(steps - wrap * np.round(steps / wrap))
        usual = float(np.quantile(turned[~far], 0.99)) if (~far).any() else math.inf
        if far.sum() < 2 or (turned[far] > REGULAR * usual + 1.0).any() or usual > 0.1 * wrap:
            return None
        self._drive.oddities.append(
            Oddity(
                what=f"the counter starts again after {wrap:.0f}",
                where=f"wheel {place}",
                count=int(far.sum()),
                done=REPAIRED,
            )
        )
        return wrap

    def _check_jumps(self, place: int, turned_rad: Array, name: str) -> None:
        """Check that a wheel is not faster than it can be, which a wrong unit or an unknown wrap makes it.

        Raises:
            LogError: It is, often.
        """
        known = np.flatnonzero(np.isfinite(turned_rad))
        elapsed_s = np.diff(np.asarray(self._t_ns)[known]) / NANOSECONDS_PER_SECOND
        limit_rad_s = self._rover.limits.wheel_speed_rad_s
        # Rows come late by up to a period: the wheel may have turned since long before.
        slack_s = 2.0 * float(np.median(elapsed_s)) if len(elapsed_s) else 0.0
        fast = np.abs(np.diff(turned_rad[known])) > limit_rad_s * (elapsed_s + slack_s)
        if not fast.any():
            return
        rows = np.flatnonzero(self._used)[known[1:][fast]]
        where = self._table.where(int(rows[0]))
        if fast.sum() > max(3.0, MOST_JUMPS * len(fast)):
            raise LogError(
                f"{where}, column '{name}': wheel {place} turns faster than limits.wheel_speed_rad_s = "
                f"{limit_rad_s:g} there and in {int(fast.sum())} rows in all: correct the unit, "
                "ticks_per_turn or gear_ratio, give the wrap, or raise that limit"
            )
        what = f"the angle jumps by more than the wheel can turn, first in {where}"
        self._drive.oddities.append(
            Oddity(what=what, where=f"wheel {place}", count=int(fast.sum()), done=NO_FAULT)
        )

    def _speeds_rad_s(self, place: int, column: SpeedColumn, radius_m: float) -> Array:
        """Return the speed of a wheel.

        Raises:
            LogError: It is often faster than it can be.
        """
        unit = SI_PER_UNIT[column.unit] / (radius_m if column.unit in LENGTHS else column.gear_ratio)
        speeds = self._numbers(column) * unit
        limit_rad_s = self._rover.limits.wheel_speed_rad_s
        fast = np.flatnonzero(np.abs(speeds) > limit_rad_s)
        if fast.size > max(3.0, MOST_JUMPS * np.isfinite(speeds).sum()):
            where = self._table.where(int(np.flatnonzero(self._used)[fast[0]]))
            raise LogError(
                f"{where}, column '{self._name(self._table, column)}': wheel {place} turns faster than "
                f"limits.wheel_speed_rad_s = {limit_rad_s:g} there and in {fast.size} rows in all: correct "
                "the unit or gear_ratio, or raise that limit"
            )
        return speeds

    def _angle_rad(self, column: AngleColumn) -> Array:
        return (self._numbers(column) - column.sign * column.zero) * _angle_unit(column)

    def _take_increments(self, increments: IncrementColumns) -> None:
        distance, turn = increments.distance, increments.turn
        forward_m = self._steps(distance, SI_PER_UNIT[distance.unit])
        turn_rad = self._steps(turn, _angle_unit(turn))
        if increments.turn_by_gyro:
            forward_m, turn_rad = self._with_gyro(forward_m, turn_rad)
        self._take_moves(forward_m, np.zeros_like(forward_m), turn_rad, distance)

    def _with_gyro(self, forward_m: Array, turn_rad: Array) -> tuple[Array, Array]:
        """Take the turns as readings of a gyro where rests show that it has a bias.

        Returns the increments of the wheels, which then stand in the rests: encoders jitter there, and the
        gyro has its bias. What they count in a rest goes to the row behind it.
        """
        rates = self._rates_rad_s(turn_rad)
        rests = self._rests(forward_m)
        if not rests:
            self._drive.notes.append("no rest of half a second: the bias of the gyro is not known")
            return forward_m, turn_rad
        t_s = np.asarray(self._t_ns) / NANOSECONDS_PER_SECOND
        steps = np.diff(np.unique(rates))
        learned = learn_bias(
            [
                GyroRest(float(t_s[first:after].mean()), float(rates[first:after].mean()), after - first)
                for first, after in rests
            ],
            float(steps.min()) if len(steps) else 0.0,
            self._rover.filter,
        )
        bias = f"bias of the gyro by {len(rests)} rests {learned.bias_rad_s:+.2g} rad/s, standard deviation "
        bias += f"{learned.sd_rad_s:.2g} rad/s"
        if not learned.is_significant:
            self._drive.notes.append(f"{bias}: it may be none, and is not corrected")
            return forward_m, turn_rad
        self._drive.notes.append(f"{bias}: it is corrected")
        self._drive.filter = learned.filter
        zeros = np.zeros_like(rates)
        self._add("imu", {"rate": np.column_stack((zeros, zeros, rates)).tolist()})
        forward_m, turn_rad = forward_m.copy(), turn_rad.copy()
        for first, after in rests:
            moved_m = float(forward_m[first:after].sum())
            forward_m[first:after] = turn_rad[first:after] = 0.0
            if after < len(forward_m):
                forward_m[after] += moved_m
        return forward_m, turn_rad

    def _rests(self, forward_m: Array) -> list[tuple[int, int]]:
        """Return first row and row behind the last of each rest."""
        t_s = np.asarray(self._t_ns) / NANOSECONDS_PER_SECOND
        elapsed_s = np.diff(t_s, prepend=t_s[0])
        speeds = np.abs(forward_m) / np.where(elapsed_s > 0.0, elapsed_s, math.inf)
        is_slow = np.concatenate(([False], speeds < REST_SHARE * np.quantile(speeds, 0.95), [False]))
        edges = np.flatnonzero(np.diff(is_slow.astype(int))).tolist()
        return [
            (first, after)
            for first, after in zip(edges[::2], edges[1::2], strict=True)
            if elapsed_s[first:after].sum() >= LEAST_REST_S
        ]

    def _take_tricycle(self, tricycle: SteeredWheelColumns) -> None:
        """Take the motion of a rolling wheel that leads or follows an axle: no wheel slips sideways."""
        rolled_m = (
            self._steps(tricycle.step, _turn_unit(tricycle.step, tricycle.radius_m)) * tricycle.radius_m
        )
        if tricycle.steering_step is not None:
            column = tricycle.steering_step
            steering_rad = np.cumsum(self._numbers(column, is_needed=True)) * _angle_unit(column)
        else:
            assert tricycle.steering is not None  # noqa: S101 the model has checked it
            column = tricycle.steering
            steering_rad = (self._numbers(column, is_needed=True) - column.sign * column.zero) * _angle_unit(
                column
            )
        # In the middle of the step, where the wheel pointed on average.
        middle_rad = steering_rad - 0.5 * np.diff(steering_rad, prepend=steering_rad[0])
        forward_m = rolled_m * np.cos(middle_rad)
        turn_rad = rolled_m * np.sin(middle_rad) / tricycle.wheelbase_m
        self._take_moves(forward_m, np.zeros_like(forward_m), turn_rad, tricycle.step)

    def _take_moves(self, x_m: Array, y_m: Array, turn_rad: Array, source: Column) -> None:
        kinematics = make_kinematics(self._rover.rover)
        check_straight(kinematics, self._table.path)
        # What the first row holds was driven before the drive begins.
        for values in (x_m, y_m, turn_rad):
            values[0] = 0.0
        moves = zip(x_m.tolist(), y_m.tolist(), turn_rad.tolist(), strict=True)
        turned_rad = np.cumsum([kinematics.wheel_speeds(*move) for move in moves], axis=0)
        for place, angles_rad in enumerate(turned_rad.T):
            self._check_jumps(place, angles_rad, self._name(self._table, source))
        self._drive.notes.append(
            "the wheels get the angles that give this path: identify neither slip nor motors with them"
        )
        self._add("increments", {"move": np.column_stack((x_m, y_m, turn_rad)).tolist()})

    def _take_imu(self) -> None:
        imu = self._columns.imu
        if imu is None:
            return
        values: dict[str, list[list[float]]] = {}
        held = np.zeros(len(self._t_ns), bool)
        if imu.yaw_rate is not None:
            rates = self._numbers(imu.yaw_rate) * SI_PER_UNIT[imu.yaw_rate.unit]
            zeros = np.zeros_like(rates)
            values["rate"] = np.column_stack((zeros, zeros, rates)).tolist()
            held |= np.isfinite(rates)
        if imu.heading is not None:
            headings = self._angle_rad(imu.heading)
            values["heading"] = headings[:, np.newaxis].tolist()
            held |= np.isfinite(headings)
        axes = [axis for axis in (imu.acceleration_x, imu.acceleration_y, imu.acceleration_z) if axis]
        if axes:
            stack = np.column_stack([self._numbers(axis) * SI_PER_UNIT[axis.unit] for axis in axes])
            values["acceleration"] = stack.tolist()
        self._add("imu", values, held)

    def _rates_rad_s(self, turns_rad: Array) -> Array:
        """Return the rates at the rows whose integral by the trapezoid rule is that of the turns."""
        elapsed_s = np.diff(np.asarray(self._t_ns)) / NANOSECONDS_PER_SECOND
        means = turns_rad[1:] / np.where(elapsed_s > 0.0, elapsed_s, math.inf)
        return np.concatenate((means[:1], means))

    def _take_truth(self, truth: TruthColumns) -> None:
        t_ns, x_m, y_m, yaw_rad = self._places(truth)
        invented = invented_poses(x_m, y_m, yaw_rad, self._drive.oddities)
        yaw_rad = yaw_rad - math.radians(truth.marker.yaw_deg)
        cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
        x_m = x_m - (cosine * truth.marker.x_m - sine * truth.marker.y_m)
        y_m = y_m - (sine * truth.marker.x_m + cosine * truth.marker.y_m)
        poses = np.column_stack((x_m, y_m, yaw_rad)).tolist()
        rows = [
            Row(t, "truth", {"pose": pose})
            for place, (t, pose) in enumerate(zip(t_ns, poses, strict=True))
            if place not in invented
        ]
        self._keep(rows, truth, "true poses")

    def _take_fixes(self, fixes: FixColumns) -> None:
        t_ns, x_m, y_m, yaw_rad = self._places(fixes)
        std_m = np.full(len(x_m), math.nan)
        if fixes.sigma is not None:
            std_m = self._place_numbers(fixes, fixes.sigma) * SI_PER_UNIT[fixes.sigma.unit]
        values = np.column_stack((x_m, y_m, yaw_rad, std_m)).tolist()
        rows = [Row(t, "fixes", {"fix": fix}) for t, fix in zip(t_ns, values, strict=True)]
        self._keep(rows, fixes, "fixes")

    def _keep(self, rows: Sequence[Row], place: PlaceColumns, what: str) -> None:
        """Take the rows between the first and the last of the drive, without empty ones."""
        last_ns = self._t_ns[-1]
        if isinstance(self._table, FlightTable):
            rows = [row for row in rows if math.isfinite(next(iter(row.values.values()))[0])]
        kept = [row for row in rows if 0 <= row.t_ns <= last_ns]
        if not kept:
            raise LogError(
                f"{self._table.path if place.file is None else place.file}: none of the {what} lies between "
                f"the first and the last row of {self._table.path}: correct the time columns or their units"
            )
        if len(kept) < len(rows):
            outside = f"{what} before the first or behind the last row"
            self._drive.oddities.append(Oddity(what=outside, count=len(rows) - len(kept)))
        self._drive.rows.extend(kept)

    def _place_table(self, place: PlaceColumns) -> Table:
        if place.file is None:
            return self._table
        if place.file not in self._others:
            self._others[place.file] = self._open(self._table.path.parent / place.file)
        return self._others[place.file]

    def _place_numbers(self, place: PlaceColumns, column: Column) -> Array:
        table = self._place_table(place)
        values: Array = column.sign * table.numbers(self._name(table, column), fix=FIX)
        return values if place.file is not None else values[self._used]

    def _places(self, place: PlaceColumns) -> tuple[list[int], Array, Array, Array]:
        """Return times, places and yaws of the marker; NaN where there is none."""
        table, t_ns, used = self._place_table(place), self._t_ns, self._used
        if place.file is not None:
            times_s = self._times_s(table, place.time or self._columns.time)
            used = np.ones(len(times_s), bool)
            t_ns = self._nanoseconds(times_s)
        if place.latitude is not None and place.longitude is not None:
            x_m, y_m = self._east_north_m(
                table,
                np.flatnonzero(used),
                self._place_numbers(place, place.latitude) * DEGREES[place.latitude.unit],
                self._place_numbers(place, place.longitude) * DEGREES[place.longitude.unit],
            )
        else:
            assert place.x is not None  # noqa: S101 the model has checked it
            assert place.y is not None  # noqa: S101
            x_m = self._place_numbers(place, place.x) * SI_PER_UNIT[place.x.unit]
            y_m = self._place_numbers(place, place.y) * SI_PER_UNIT[place.y.unit]
        if place.yaw is None:
            return t_ns, x_m, y_m, np.full(len(x_m), math.nan)
        numbers = self._place_numbers(place, place.yaw)
        yaw_rad = (numbers - place.yaw.sign * place.yaw.zero) * _angle_unit(place.yaw)
        return t_ns, x_m, y_m, yaw_rad

    def _east_north_m(
        self, table: Table, rows: NDArray[np.intp], latitude_deg: Array, longitude_deg: Array
    ) -> tuple[Array, Array]:
        """Return places from the first one, on its tangent plane.

        Raises:
            LogError: There is none, or these are no latitudes and longitudes.
        """
        from pymap3d import geodetic2enu

        known = np.flatnonzero(np.isfinite(latitude_deg) & np.isfinite(longitude_deg))
        if not known.size:
            raise LogError(f"{table.path}: no row holds a latitude and a longitude: {FIX}")
        wrong = np.flatnonzero((np.abs(latitude_deg) > 90.0) | (np.abs(longitude_deg) > 360.0))
        if wrong.size:
            raise LogError(
                f"{table.where(int(rows[wrong[0]]))}: a latitude of {latitude_deg[wrong[0]]:g} and a "
                f"longitude of {longitude_deg[wrong[0]]:g} are none in degrees: {FIX}"
            )
        first = float(latitude_deg[known[0]]), float(longitude_deg[known[0]])
        east_m, north_m, _ = geodetic2enu(latitude_deg, longitude_deg, 0.0, *first, 0.0)
        return east_m, north_m

    def _add(
        self, section: str, tables: Mapping[str, Sequence[Sequence[float]]], held: Flags | None = None
    ) -> None:
        """Add a row for each row of the table that holds a number."""
        names = list(tables)
        rows = enumerate(zip(self._t_ns, *tables.values(), strict=True))
        self._drive.rows.extend(
            Row(t_ns, section, dict(zip(names, values, strict=True)))
            for place, (t_ns, *values) in rows
            if held is None or held[place]
        )


def _all_columns(columns: Columns) -> Iterator[Column]:
    """Yield all columns of the table of the drive."""
    yield from _named_columns(columns, is_drive=True)


def _named_columns(columns: Columns, *, is_drive: bool = False) -> Iterator[Column]:
    """Yield all columns, of other tables too unless `is_drive`."""
    yield columns.time
    groups: list[Settings | None] = [*columns.wheel, columns.increments, columns.tricycle, columns.imu]
    groups += [
        place
        for place in (columns.fixes, columns.truth)
        if place is not None and not (is_drive and place.file is not None)
    ]
    for group in groups:
        for _, value in group or ():
            if isinstance(value, Column):
                yield value


def _radii_m(rover: RoverSettings) -> list[float]:
    """Return the radius of each wheel, in the rover's order."""
    if isinstance(rover, WheelsRoverSettings):
        return [wheel.radius_m for wheel in rover.wheels]
    return [rover.wheel_radius_m] * (3 if rover.kinematics == "omni3" else 4)


def _turn_unit(column: TurnColumn, radius_m: float) -> float:
    """Return the size of the unit of a column in rad of the wheel."""
    if column.ticks_per_turn is not None:
        return TURN_RAD / (column.ticks_per_turn * column.gear_ratio)
    return SI_PER_UNIT[column.unit] / (radius_m if column.unit in LENGTHS else column.gear_ratio)


def _angle_unit(column: AngleColumn) -> float:
    """Return the size of the unit of a column in rad."""
    return SI_PER_UNIT[column.unit] if column.ticks_per_turn is None else TURN_RAD / column.ticks_per_turn
