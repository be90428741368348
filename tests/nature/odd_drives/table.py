"""The table of a drive and its file of columns, as a recorder of some kit of sensors writes them."""

import gzip
import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tests.nature.odd_drives.motion import Array, Drive

EARTH_M = 6378137.0
ECCENTRICITY_2 = 0.00669437999
ORIGIN_DEG = (48.1371, 11.5754)


@dataclass(frozen=True, kw_only=True)
class Kit:
    """What a rover measures, and how well."""

    rate_hz: float = 50.0
    wheels: str = "position"
    """`position`, `speed`, or `both`."""
    ticks: int = 0
    """Ticks of a turn of the wheel; 0: angles in rad."""
    wrap: int = 0
    speed_unit: str = "rad/s"
    speed_noise_rad_s: float = 0.02
    gyro: bool = True
    gyro_noise_rad_s: float = 0.003
    gyro_bias_rad_s: float | None = None
    gyro_gain: float = 1.0
    gyro_step_deg_s: float = 0.0
    truth: str = ""
    """`pose`, `position`, `geodetic`, or none."""
    truth_file: bool = False
    truth_sigma_m: float = 0.001
    fixes: str = ""
    fix_hz: float = 5.0
    fix_sigma_m: float = 0.02
    fix_correlation_s: float = 0.0
    late_s: dict[str, float] = field(default_factory=dict)
    """How much later than the wheels the readings of gyro, truth, fixes or steering are stamped."""
    jitter_s: float = 0.0003


UNIT_OF_SPEED = {"rad/s": 1.0, "deg/s": math.degrees(1.0), "rpm": 30.0 / math.pi, "rev/s": 0.5 / math.pi}


@dataclass(kw_only=True)
class Table:
    """Columns in order, the time of each row in seconds since the start, and the file of columns."""

    time: Array
    columns: dict[str, Array]
    decimals: dict[str, int]
    spec: dict[str, Any]
    stamp: Callable[[float], str] = "{:.4f}".format
    files: dict[str, "Table"] = field(default_factory=dict)
    """Further tables by name."""

    def rows(self) -> list[str]:
        """Return the lines of the table, with the line of names."""
        lines = [",".join(["t", *self.columns])]
        formats = [self.decimals.get(name, 6) for name in self.columns]
        for moment, row in zip(self.time, np.stack(list(self.columns.values()), axis=1), strict=True):
            cells = (
                "" if math.isnan(value) else f"{value:.{decimals}f}"
                for value, decimals in zip(row, formats, strict=True)
            )
            lines.append(",".join([self.stamp(float(moment)), *cells]))
        return lines

    def keep(self, rows: Any) -> None:
        """Keep these rows only, in this order."""
        self.time = self.time[rows]
        self.columns = {name: values[rows] for name, values in self.columns.items()}

    def write(self, folder: Path) -> list[str]:
        """Write table and file of columns. Return the arguments of the import."""
        (folder / "columns.toml").write_text(toml(self.spec), encoding="utf-8")
        with gzip.open(folder / "table.csv.gz", "wt", encoding="utf-8") as stream:
            stream.write("\n".join(self.rows()) + "\n")
        for name, table in self.files.items():
            (folder / name).write_text("\n".join(table.rows()) + "\n", encoding="utf-8")
        return ["table", "table.csv.gz", "--columns", "columns.toml"]


def _value(value: object) -> str:
    """Return a TOML value on one line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_value(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    return json.dumps(value)


def toml(spec: dict[str, Any]) -> str:
    """Return a TOML file of one level of tables."""
    lines = [f"{key} = {_value(value)}" for key, value in spec.items() if not _is_table(value)]
    for key, value in spec.items():
        if not _is_table(value):
            continue
        for table in value if isinstance(value, list) else [value]:
            lines += ["", f"[[{key}]]" if isinstance(value, list) else f"[{key}]"]
            lines += [f"{name} = {_value(item)}" for name, item in table.items()]
    return "\n".join(lines) + "\n"


def _is_table(value: object) -> bool:
    """Return whether a value stands below a header of its own."""
    return isinstance(value, dict) or (
        isinstance(value, list) and all(isinstance(item, dict) for item in value)
    )


def geodetic(
    east_m: Array, north_m: Array, origin_deg: tuple[float, float] = ORIGIN_DEG
) -> tuple[Array, Array]:
    """Return latitude and longitude in degrees."""
    latitude, longitude = origin_deg
    shape = 1.0 - ECCENTRICITY_2 * math.sin(math.radians(latitude)) ** 2
    north_radius = EARTH_M * (1.0 - ECCENTRICITY_2) / shape**1.5
    east_radius = EARTH_M / math.sqrt(shape) * math.cos(math.radians(latitude))
    return latitude + np.degrees(north_m / north_radius), longitude + np.degrees(east_m / east_radius)


def record(drive: Drive, kit: Kit, rng: np.random.Generator) -> Table:
    """Return the table of a drive."""
    count = int(drive.t[-1] * kit.rate_hz)
    time = np.arange(count) / kit.rate_hz + rng.normal(0.0, kit.jitter_s, count).clip(
        -0.3 / kit.rate_hz, 0.3 / kit.rate_hz
    )
    time = np.round(np.maximum(time, 0.0), 4)
    table = Table(time=time, columns={}, decimals={}, spec={"time": {"column": "t", "unit": "s"}})
    _add_wheels(table, drive, kit, rng)
    if kit.gyro:
        _add_gyro(table, drive, kit, rng)
    if kit.fixes:
        _add_path(table, "fixes", drive, kit, rng)
    if kit.truth:
        _add_path(table, "truth", drive, kit, rng)
    table.spec["rover"] = drive.rover.description
    table.spec["limits"] = {"wheel_speed_rad_s": drive.rover.limit_rad_s, "wheel_acceleration_rad_s2": 500}
    return table


def _add_wheels(table: Table, drive: Drive, kit: Kit, rng: np.random.Generator) -> None:
    """Add the columns of the wheels, and of the steering."""
    angles, speeds = drive.at(drive.angles, table.time), drive.at(drive.speeds, table.time)
    wheels: list[dict[str, Any]] = []
    for index, name in enumerate(drive.rover.wheels):
        entry: dict[str, Any] = {}
        if kit.wheels in ("position", "both"):
            entry["position"] = _add_angle(table, name, angles[:, index], kit, rng)
        if kit.wheels in ("speed", "both"):
            entry["speed"] = _add_speed(table, f"v_{name}", speeds[:, index], drive, kit, rng)
        wheels.append(entry)
    if drive.rover.wheelbase_m > 0.0:
        late = table.time - kit.late_s.get("steering", 0.0)
        steering = np.degrees(drive.at(drive.steering, late)) + rng.normal(0.0, 0.05, len(late))
        table.columns["steer"] = np.round(steering, 2)
        table.decimals["steer"] = 2
        wheels.append({"steering": {"column": "steer", "unit": "deg"}})
    table.spec["wheel"] = wheels


def _add_angle(table: Table, name: str, angles: Array, kit: Kit, rng: np.random.Generator) -> dict[str, Any]:
    """Add the angle of a wheel. Return its entry."""
    if not kit.ticks:
        table.columns[name] = angles + rng.normal(0.0, 0.0005, len(angles))
        table.decimals[name] = 5
        return {"column": name, "unit": "rad"}
    ticks = np.floor(angles / math.tau * kit.ticks + float(rng.uniform()))
    entry = {"column": name, "unit": "ticks", "ticks_per_turn": kit.ticks}
    if kit.wrap:
        ticks = np.mod(ticks + int(rng.integers(kit.wrap)), kit.wrap)
        entry["wrap"] = kit.wrap
    table.columns[name] = ticks
    table.decimals[name] = 0
    return entry


def _add_speed(
    table: Table, name: str, speeds: Array, drive: Drive, kit: Kit, rng: np.random.Generator
) -> dict[str, Any]:
    """Add the speed of a wheel; at standstill it reads 0. Return its entry."""
    noise = rng.normal(0.0, kit.speed_noise_rad_s, len(speeds))
    measured = np.where(np.abs(speeds) < 1e-6, 0.0, speeds + noise)
    rims = {"m/s": drive.rover.radius_m, "km/h": drive.rover.radius_m * 3.6}
    table.columns[name] = measured * (UNIT_OF_SPEED | rims)[kit.speed_unit]
    table.decimals[name] = 4
    return {"column": name, "unit": kit.speed_unit}


def _add_gyro(table: Table, drive: Drive, kit: Kit, rng: np.random.Generator) -> None:
    """Add the yaw rate."""
    late = table.time - kit.late_s.get("gyro", 0.0)
    bias = float(rng.uniform(-0.002, 0.002)) if kit.gyro_bias_rad_s is None else kit.gyro_bias_rad_s
    noise = rng.normal(0.0, kit.gyro_noise_rad_s, len(late))
    rate = drive.at(drive.yaw_rate, late) * kit.gyro_gain + bias + noise
    if kit.gyro_step_deg_s:
        step = math.radians(kit.gyro_step_deg_s)
        rate = np.round(rate / step) * step
    table.columns["gyro"] = rate
    table.decimals["gyro"] = 5
    table.spec["imu"] = {"yaw_rate": {"column": "gyro", "unit": "rad/s"}}


def _scatter(count: int, sigma_m: float, correlation: float, rng: np.random.Generator) -> Array:
    """Return errors of two coordinates; `correlation` is that of neighbours."""
    noise = rng.normal(0.0, sigma_m, (count, 2))
    for index in range(1, count):
        noise[index] = correlation * noise[index - 1] + math.sqrt(1.0 - correlation**2) * noise[index]
    return noise


def _add_path(table: Table, section: str, drive: Drive, kit: Kit, rng: np.random.Generator) -> None:
    """Add the ground truth or the positions: into the table, or as a file."""
    is_truth = section == "truth"
    kind = kit.truth if is_truth else kit.fixes
    every = 1 if is_truth else max(1, round(kit.rate_hz / kit.fix_hz))
    has_file = is_truth and kit.truth_file
    time = np.arange(round(drive.t[-1] * 50.0), dtype=np.float64) / 50.0 if has_file else table.time
    rows = np.arange(0, len(time), every)
    pose = drive.at(drive.pose, time[rows] - kit.late_s.get(section, 0.0))
    decay = math.exp(-every / kit.rate_hz / kit.fix_correlation_s) if kit.fix_correlation_s else 0.0
    sigma = kit.truth_sigma_m if is_truth else kit.fix_sigma_m
    pose[:, :2] += _scatter(len(rows), sigma, 0.0 if is_truth else decay, rng)
    prefix = "true_" if is_truth else "fix_"
    target = Table(time=time, columns={}, decimals={}, spec={}) if has_file else table
    entries: dict[str, Any] = {}
    if has_file:
        target.stamp = table.stamp
        table.files["truth.csv"] = target
        entries["file"] = "truth.csv"
    for key, values, unit, decimals in _coordinates(kind, pose, rng):
        column = np.full(len(time), np.nan)
        column[rows] = values
        target.columns[prefix + key] = column
        target.decimals[prefix + key] = decimals
        entries[key] = {"column": prefix + key, "unit": unit}
    if not is_truth:
        entries["sigma_m"] = kit.fix_sigma_m
        if kit.fix_correlation_s:
            entries["correlation_s"] = kit.fix_correlation_s
    table.spec[section] = entries


def _coordinates(kind: str, pose: Array, rng: np.random.Generator) -> list[tuple[str, Array, str, int]]:
    """Return key, values, unit and decimals of each coordinate of a path."""
    if kind == "geodetic":
        latitude, longitude = geodetic(pose[:, 0], pose[:, 1])
        return [("latitude", latitude, "deg", 9), ("longitude", longitude, "deg", 9)]
    columns = [("x", pose[:, 0], "m", 4), ("y", pose[:, 1], "m", 4)]
    if kind == "pose":
        columns.append(("yaw", pose[:, 2] + rng.normal(0.0, 0.002, len(pose)), "rad", 4))
    return columns
