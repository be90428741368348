"""One fault each, put into a recorded table: its clock, its columns, or what the file of columns says."""

import copy
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from tests.nature.odd_drives.motion import Array, Drive
from tests.nature.odd_drives.table import Table

Fault = Callable[[Table, Drive, np.random.Generator], None]
EPOCH_S = 1_700_000_000


def moving(drive: Drive, share: float) -> float:
    """Return a time near this share of the drive at which the rover is fast."""
    speed = np.abs(drive.speeds).mean(axis=1)
    fast = drive.t[speed > 0.6 * speed.max()]
    return float(fast[np.argmin(np.abs(fast - share * drive.t[-1]))])


def stamped(write: Callable[[float], str], unit: str) -> Fault:
    """Times are written in one way, and described in `unit`."""

    def fault(table: Table, drive: Drive, rng: np.random.Generator) -> None:
        table.stamp = write
        table.spec["time"]["unit"] = unit
        for other in table.files.values():
            other.stamp = write

    return fault


def scaled_time(factor: float, unit: str, *, first: float = 0.0, decimals: int = 3) -> Fault:
    """Return the fault of times that are `first` plus seconds times `factor`, described in `unit`."""
    return stamped(lambda t: f"{first + t * factor:.{decimals}f}", unit)


def relative(factor: float, unit: str) -> Fault:
    """Each time counts from the row before."""

    def fault(table: Table, drive: Drive, rng: np.random.Generator) -> None:
        table.time = np.diff(table.time, prepend=table.time[0])
        scaled_time(factor, unit)(table, drive, rng)

    return fault


def clock_set(by_s: float, share: float, *, first: float = 0.0) -> Fault:
    """The clock of the recorder is set during the drive, in motion."""

    def fault(table: Table, drive: Drive, rng: np.random.Generator) -> None:
        table.time = np.where(table.time > moving(drive, share), table.time + by_s, table.time)
        table.stamp = lambda t: f"{first + t:.4f}"

    return fault


def wraps(bits: int, per_s: float, unit: str, share: float) -> Fault:
    """A counter of `bits` starts again at 0 after this share of the drive."""

    def fault(table: Table, drive: Drive, rng: np.random.Generator) -> None:
        first = 2**bits - round(share * float(drive.t[-1]) * per_s)
        table.stamp = lambda t: str((first + round(t * per_s)) % 2**bits)
        table.spec["time"]["unit"] = unit

    return fault


def batches(table: Table, drive: Drive, rng: np.random.Generator) -> None:
    """Rows arrive in batches of 1 to 4, and all of a batch have the time of its last row."""
    start = 0
    times = table.time.copy()
    while start < len(times):
        end = min(start + int(rng.integers(1, 5)), len(times))
        times[start:end] = times[end - 1]
        start = end
    table.time = times


def interleaved_clocks(table: Table, drive: Drive, rng: np.random.Generator) -> None:
    """Rows of the wheels have the time of day, those of the gyro the time since its start."""
    count = len(table.time)
    is_gyro = np.tile([False, True], count)
    for name in table.columns:
        doubled = np.repeat(table.columns[name], 2)
        doubled[is_gyro != (name == "gyro")] = np.nan
        table.columns[name] = doubled
    table.time = np.repeat(table.time, 2)
    table.time[is_gyro] -= 1e9
    table.stamp = lambda t: f"{t + 1e9 + 812.307:.4f}" if t < -1e6 else f"{EPOCH_S + t:.4f}"


def two_loggers(table: Table, drive: Drive, rng: np.random.Generator) -> None:
    """Every second row is of another logger, whose clock is 40 s ahead; each logger writes all columns."""
    table.time = np.where(np.arange(len(table.time)) % 2 == 1, table.time + 40.0, table.time)


def truth_clock(by_s: float) -> Fault:
    """The file of the ground truth has another clock."""

    def fault(table: Table, drive: Drive, rng: np.random.Generator) -> None:
        table.stamp = lambda t: f"{EPOCH_S + t:.4f}"
        table.files["truth.csv"].stamp = lambda t: f"{EPOCH_S + by_s + t:.4f}"

    return fault


def zero_times(count: int, *, together: bool, empty: bool) -> Fault:
    """Rows in the middle have time 0; with `empty` all their values are 0, too."""

    def fault(table: Table, drive: Drive, rng: np.random.Generator) -> None:
        rows = len(table.time)
        start = rows // 2
        chosen = np.arange(start, start + count)
        if not together:
            chosen = np.sort(rng.choice(np.arange(rows // 4, rows - 50), count, replace=False))
        table.time[chosen] = -1.0
        table.stamp = lambda t: "0" if t < -0.5 else str(184_000_000 + round(t * 1e6))
        table.spec["time"]["unit"] = "us"
        if empty:
            for values in table.columns.values():
                values[chosen] = 0.0

    return fault


def unsigned(table: Table, drive: Drive, rng: np.random.Generator) -> None:
    """Speeds of wheels lose their sign."""
    for name in drive.rover.wheels:
        table.columns[f"v_{name}"] = np.abs(table.columns[f"v_{name}"])


def _wheel_columns(table: Table, name: str) -> list[str]:
    return [column for column in (name, f"v_{name}") if column in table.columns]


def reversed_wheels(*names: str, share: float = 0.0) -> Fault:
    """These wheels count backwards, from this share of the drive on."""

    def fault(table: Table, drive: Drive, rng: np.random.Generator) -> None:
        late = table.time >= (moving(drive, share) if share else 0.0)
        for name in names:
            for column in _wheel_columns(table, name):
                table.columns[column] = _changed(table.columns[column], late, column, lambda values: -values)

    return fault


def exchanged_wheels(first: str, second: str, share: float = 0.0) -> Fault:
    """The columns of two wheels are exchanged, from this share of the drive on."""

    def fault(table: Table, drive: Drive, rng: np.random.Generator) -> None:
        late = table.time >= (moving(drive, share) if share else 0.0)
        pairs = zip(_wheel_columns(table, first), _wheel_columns(table, second), strict=True)
        for one, two in pairs:
            old = table.columns[one], table.columns[two]
            table.columns[one] = _replaced(*old, late, one)
            table.columns[two] = _replaced(old[1], old[0], late, two)

    return fault


def _changed(values: Array, late: Any, column: str, change: Callable[[Array], Array]) -> Array:
    """Return speeds or the increments of positions, changed in some rows."""
    return _replaced(values, change(values), late, column)


def _replaced(values: Array, others: Array, late: Any, column: str) -> Array:
    """Return values with the increments (speeds: the values) of others in some rows."""
    if column.startswith("v_"):
        return np.where(late, others, values)
    steps = np.where(late, np.diff(others, prepend=others[0]), np.diff(values, prepend=values[0]))
    return np.asarray(values[0] + np.cumsum(steps))


def dead_encoder(name: str, share: float, seconds: float) -> Fault:
    """An encoder repeats its count for some seconds, then counts on from there."""

    def fault(table: Table, drive: Drive, rng: np.random.Generator) -> None:
        start = moving(drive, share)
        dead = (table.time >= start) & (table.time < start + seconds)
        steps = np.diff(table.columns[name], prepend=table.columns[name][0])
        table.columns[name] = table.columns[name][0] + np.cumsum(np.where(dead, 0.0, steps))

    return fault


def scaled_columns(factor: float, *names: str) -> Fault:
    """Columns hold their values times a factor."""

    def fault(table: Table, drive: Drive, rng: np.random.Generator) -> None:
        for name in names:
            table.columns[name] = table.columns[name] * factor

    return fault


def described(change: Callable[[dict[str, Any]], None]) -> Fault:
    """The file of columns says something wrong."""

    def fault(table: Table, drive: Drive, rng: np.random.Generator) -> None:
        table.spec = copy.deepcopy(table.spec)
        change(table.spec)

    return fault


def wrong_radius(factor: float, *, only: int | None = None) -> Fault:
    """The radius in the description is wrong by a factor, of all wheels or of one."""

    def change(spec: dict[str, Any]) -> None:
        rover = spec["rover"]
        if "wheel_radius_m" in rover:
            rover["wheel_radius_m"] *= factor
            return
        for index, wheel in enumerate(rover["wheels"]):
            if only is None or index == only:
                wheel["radius_m"] = round(wheel["radius_m"] * factor, 5)

    return described(change)


def wrong_track(factor: float) -> Fault:
    """The track in the description is wrong by a factor."""

    def change(spec: dict[str, Any]) -> None:
        rover = spec["rover"]
        for key in ("track_m", "base_radius_m"):
            if key in rover:
                rover[key] *= factor
        for wheel in rover.get("wheels", []):
            wheel["y_m"] = round(wheel["y_m"] * factor, 5)

    return described(change)


def wheel_entry(**values: object) -> Fault:
    """Every wheel's position or speed is described with these values."""

    def change(spec: dict[str, Any]) -> None:
        for wheel in spec["wheel"]:
            for key in ("position", "speed"):
                if key in wheel:
                    wheel[key].update(values)

    return described(change)


def ticks_as_rad(table: Table, drive: Drive, rng: np.random.Generator) -> None:
    """Ticks are described as radians."""

    def change(spec: dict[str, Any]) -> None:
        for wheel in spec["wheel"]:
            wheel["position"] = {"column": wheel["position"]["column"], "unit": "rad"}

    described(change)(table, drive, rng)


def gyro_unit(unit: str) -> Fault:
    """The yaw rate is described in another unit."""

    def change(spec: dict[str, Any]) -> None:
        spec["imu"]["yaw_rate"]["unit"] = unit

    return described(change)


def exchanged_coordinates(section: str) -> Fault:
    """Latitude and longitude are exchanged in the file of columns."""

    def change(spec: dict[str, Any]) -> None:
        entries = spec[section]
        entries["latitude"], entries["longitude"] = entries["longitude"], entries["latitude"]

    return described(change)


def first_positions_zero(section: str, count: int) -> Fault:
    """The first positions of a receiver are latitude 0 and longitude 0."""
    prefix = {"fixes": "fix_", "truth": "true_"}[section]

    def fault(table: Table, drive: Drive, rng: np.random.Generator) -> None:
        for name in (f"{prefix}latitude", f"{prefix}longitude"):
            valid = np.flatnonzero(np.isfinite(table.columns[name]))[:count]
            table.columns[name][valid] = 0.0

    return fault


def held(rows: int, *names: str) -> Fault:
    """Columns keep their value for some rows: they are sampled more slowly than the table."""

    def fault(table: Table, drive: Drive, rng: np.random.Generator) -> None:
        source = np.arange(len(table.time)) // rows * rows
        for name in names:
            table.columns[name] = table.columns[name][source]

    return fault


def lost(section: str, share: float, seconds: float) -> Fault:
    """No readings for some seconds: empty cells. Not a fault, but what receivers do."""
    prefix = {"fixes": "fix_", "truth": "true_"}[section]

    def fault(table: Table, drive: Drive, rng: np.random.Generator) -> None:
        start = share * float(drive.t[-1])
        gone = (table.time >= start) & (table.time < start + seconds)
        for name, values in table.columns.items():
            if name.startswith(prefix):
                values[gone] = np.nan

    return fault


def steering_wheel(ratio: float) -> Fault:
    """The column holds the angle of the steering wheel, not that of the front wheel."""
    return scaled_columns(ratio, "steer")


def day_fraction(t: float) -> str:
    """Return a time as spreadsheets store it: days since 1899-12-30."""
    return f"{45_231.4 + t / 86_400:.9f}"


def whole_seconds(t: float) -> str:
    """Return a time of day without its fraction."""
    return str(math.floor(EPOCH_S + 0.37 + t))
