"""Tables of drives for the judge of recorded drives: robots, grounds and sensors, sound or with one fault.

It knows nothing of the program: wheels are commanded, and the ground decides how far the rover goes and turns
(slip along, in turning and to the side, that changes along the drive); the pose is the integral.
"""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Leg = tuple[float, float, float, float]
"""Seconds, ahead and left in m/s, yaw rate in rad/s; of a robot that steers by its wheels 1/m instead."""
STEP_S = 0.005
EARTH_M_PER_DEG = 111_319.5


@dataclass(frozen=True, kw_only=True)
class Robot:
    """Where the wheels stand (x, y, axle of the roller in deg or None), and what the file says of them."""

    wheels: Sequence[tuple[float, float, float | None]]
    radius_m: float
    speed: float
    turn: float
    limit_rad_s: float
    wheelbase_m: float = 0.0
    """Above 0: a front wheel, listed last, steers. It is measured if `is_front_driven`."""
    is_front_driven: bool = False
    skid_track_m: float = 0.0

    def description(self) -> dict[str, Any]:
        """Return the section `[rover]`."""
        if self.skid_track_m:
            return {
                "kinematics": "skid_steer_4",
                "wheel_radius_m": self.radius_m,
                "track_m": self.skid_track_m,
            }
        wheels: list[dict[str, Any]] = []
        for x, y, roller in self.wheels:
            wheel: dict[str, Any] = {"x_m": x, "y_m": y, "radius_m": self.radius_m}
            if roller is not None:
                wheel["roller_deg"] = roller
            wheels.append(wheel)
        if self.wheelbase_m:
            steering = {"low_deg": -85, "high_deg": 85}
            if self.is_front_driven:
                wheels[-1]["steering"] = steering
                for wheel in wheels[:-1]:
                    wheel |= {"driven": False, "measured": False}
            else:
                front = {"x_m": self.wheelbase_m, "y_m": 0.0, "radius_m": self.radius_m}
                wheels.append(front | {"driven": False, "measured": False, "steering": steering})
        return {"kinematics": "wheels", "wheels": wheels}


def _sides(*x: float, half_m: float) -> list[tuple[float, float, float | None]]:
    return [(each, side * half_m, None) for each in x for side in (1.0, -1.0)]


DIFF = Robot(wheels=_sides(0.0, half_m=0.18), radius_m=0.08, speed=0.6, turn=0.9, limit_rad_s=15.0)
HEAVY = Robot(wheels=_sides(-0.2, half_m=0.4), radius_m=0.2, speed=1.6, turn=0.7, limit_rad_s=15.0)
SKID4 = Robot(
    wheels=_sides(0.2, -0.2, half_m=0.25),
    radius_m=0.1,
    speed=0.7,
    turn=1.2,
    limit_rad_s=20.0,
    skid_track_m=0.5,
)
SKID6 = Robot(
    wheels=_sides(0.35, 0.0, -0.35, half_m=0.3), radius_m=0.12, speed=0.6, turn=1.2, limit_rad_s=20.0
)
MECANUM = Robot(
    wheels=[(0.2, 0.15, 45.0), (0.2, -0.15, -45.0), (-0.2, 0.15, -45.0), (-0.2, -0.15, 45.0)],
    radius_m=0.05,
    speed=0.4,
    turn=0.8,
    limit_rad_s=30.0,
)
TRICYCLE = Robot(
    wheels=[*_sides(0.0, half_m=0.3), (1.1, 0.0, None)],
    radius_m=0.12,
    speed=1.0,
    turn=0.8,
    limit_rad_s=25.0,
    wheelbase_m=1.1,
    is_front_driven=True,
)
CAR = Robot(
    wheels=_sides(0.0, half_m=0.8), radius_m=0.32, speed=7.0, turn=0.1, limit_rad_s=120.0, wheelbase_m=2.8
)


@dataclass(kw_only=True)
class Ground:
    """What becomes of a commanded motion."""

    slip: tuple[float, float] = (0.01, 0.03)
    """Least and greatest slip of each side along the drive."""
    turning: tuple[float, float] = (1.0, 1.0)
    """Least and greatest share of a rotation that is left of it."""
    slide: float = 0.0
    """Share of the speed by which the rover slides to world -y."""
    uneven: float = 0.0
    """Slip of the lower side of a slope that descends to world -y."""
    change_s: float = 8.0


@dataclass(kw_only=True)
class Sensors:
    """How a drive is recorded."""

    rate_hz: float = 50.0
    wheels: str = "position"
    ticks: int = 0
    wheel_lag_s: float = 0.0
    wheel_noise_rad: float = 0.0003
    gyro: bool = True
    bias_deg_s: float = 0.1
    gain: float = 1.0
    gyro_lag_s: float = 0.0
    gyro_late_s: float = 0.0
    truth: str = ""
    truth_hz: float = 0.0
    truth_m: float = 0.002
    truth_rad: float = 0.003
    truth_late_s: float = 0.0
    arm_m: complex = 0j
    marker_deg: float = 0.0
    is_marker_given: bool = False
    fixes: str = ""
    fix_hz: float = 5.0
    fix_m: float = 0.02
    fix_correlation_s: float = 0.0
    fix_late_s: float = 0.0


@dataclass
class Table:
    """A table, its times and its file of columns."""

    t_s: Array
    columns: dict[str, Array] = field(default_factory=dict)
    spec: dict[str, Any] = field(default_factory=dict)
    speed: Array = field(default_factory=lambda: np.zeros(0))
    """Ahead, for faults that choose their moment."""

    def write(self, folder: Path) -> list[str]:
        """Write both files; return the arguments of the import."""
        folder.mkdir(parents=True, exist_ok=True)
        rows = [",".join(["t", *self.columns])]
        for values in np.column_stack([self.t_s, *self.columns.values()]).tolist():
            cells = (
                "" if math.isnan(value) else f"{value:.{4 if place == 0 else 8}f}"
                for place, value in enumerate(values)
            )
            rows.append(",".join(cells))
        (folder / "table.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
        (folder / "columns.toml").write_text(_toml(self.spec), encoding="utf-8")
        return ["table", str(folder / "table.csv"), "--columns", str(folder / "columns.toml")]


Fault = Callable[[Table], None]


def _toml(spec: dict[str, Any]) -> str:
    def value(of: object) -> str:
        if isinstance(of, dict):
            return "{ " + ", ".join(f"{key} = {value(item)}" for key, item in of.items()) + " }"
        if isinstance(of, list):
            return "[" + ", ".join(map(value, of)) + "]"
        return json.dumps(of)

    lines = []
    for key, tables in spec.items():
        for table in tables if isinstance(tables, list) else [tables]:
            lines.append(f"[[{key}]]" if isinstance(tables, list) else f"[{key}]")
            lines += [f"{name} = {value(item)}" for name, item in table.items()]
    return "\n".join(lines) + "\n"


def wander(rng: np.random.Generator, t: Array, span: tuple[float, float], change_s: float) -> Array:
    """Return values that wander between two bounds."""
    knots = np.arange(0.0, t[-1] + 2.0 * change_s, change_s)
    return np.asarray(np.interp(t, knots, rng.uniform(*span, len(knots))), np.float64)


def lagged(t: Array, values: Array, lag_s: float) -> Array:
    """Return values behind a filter of the first order."""
    if lag_s <= 0.0:
        return values
    step = float(t[1] - t[0])
    kernel = np.exp(-np.arange(0.0, 8.0 * lag_s, step) / lag_s)
    result: Array = np.convolve(values - values[0], kernel / kernel.sum())[: len(values)] + values[0]
    return result


def record(
    robot: Robot, legs: Sequence[Leg], ground: Ground, sensors: Sensors, rng: np.random.Generator
) -> Table:
    """Drive and record."""
    counts = [round(leg[0] / STEP_S) for leg in legs]
    ahead, left, turn = (np.repeat([leg[place] for leg in legs], counts) for place in (1, 2, 3))
    ramp = np.ones(max(1, round((0.4 + 0.3 * robot.speed) / STEP_S)))
    ahead, left, turn = (np.convolve(each, ramp / ramp.sum(), "same") for each in (ahead, left, turn))
    t = np.arange(len(ahead), dtype=np.float64) * STEP_S
    steering = np.arctan(turn * robot.wheelbase_m) if robot.wheelbase_m else np.zeros(len(t))
    rate = turn * ahead if robot.wheelbase_m else turn
    slips = [wander(rng, t, ground.slip, ground.change_s) for _ in range(2)]
    turning = wander(rng, t, ground.turning, ground.change_s)
    half = max(abs(y) for _, y, _ in robot.wheels)
    pose = np.zeros((len(t), 3))
    rates = np.zeros(len(t))
    x = y = 0.0
    yaw = float(rng.uniform(-math.pi, math.pi))
    for place in range(len(t)):
        lower = ground.uneven * math.cos(yaw)
        side = [1.0 - slips[0][place] - max(0.0, -lower), 1.0 - slips[1][place] - max(0.0, lower)]
        if robot.wheelbase_m:
            v = ahead[place] * (side[0] + side[1]) / 2
            w = v * turn[place] * turning[place]
        else:
            rims = [(ahead[place] + sign * rate[place] * half) * side[sign > 0] for sign in (-1, 1)]
            v, w = sum(rims) / 2, (rims[1] - rims[0]) / (2 * half) * turning[place]
        u = left[place] * side[0]
        slide = ground.slide * abs(v)
        pose[place], rates[place] = (x, y, yaw), w
        middle = yaw + 0.5 * w * STEP_S
        x += (v * math.cos(middle) - u * math.sin(middle)) * STEP_S
        y += (v * math.sin(middle) + u * math.cos(middle) - slide) * STEP_S
        yaw += w * STEP_S
    speeds = []
    for wheel_x, wheel_y, roller in robot.wheels:
        if roller is not None:
            tangent = math.tan(math.radians(roller))
            rim = ahead - rate * wheel_y - (left + rate * wheel_x) * tangent**-1
        elif robot.is_front_driven and wheel_x > 0.0:
            rim = ahead / np.cos(steering)
        else:
            rim = ahead - rate * wheel_y
        speeds.append(lagged(t, rim / robot.radius_m, sensors.wheel_lag_s))
    return _table(robot, t, pose, rates, speeds, steering, ahead, sensors, rng)


def _table(
    robot: Robot,
    t: Array,
    pose: Array,
    rates: Array,
    speeds: list[Array],
    steering: Array,
    ahead: Array,
    sensors: Sensors,
    rng: np.random.Generator,
) -> Table:
    t_s = np.arange(0.0, t[-1], 1.0 / sensors.rate_hz, dtype=np.float64).round(4)
    table = Table(t_s, speed=np.interp(t_s, t, ahead))
    wheels: list[dict[str, Any]] = [{}, {}] if robot.is_front_driven else []
    measured = [2] if robot.is_front_driven else range(len(speeds))
    for wheel in measured:
        entry: dict[str, Any] = {}
        if sensors.wheels in ("position", "both"):
            angles = np.interp(t_s, t, np.cumsum(speeds[wheel]) * STEP_S)
            angles = angles + rng.normal(0.0, sensors.wheel_noise_rad, len(t_s))
            entry["position"] = {"column": f"a{wheel}", "unit": "rad"}
            if sensors.ticks:
                angles = np.floor(angles / math.tau * sensors.ticks)
                entry["position"] |= {"unit": "ticks", "ticks_per_turn": sensors.ticks}
            table.columns[f"a{wheel}"] = angles
        if sensors.wheels in ("speed", "both"):
            table.columns[f"v{wheel}"] = np.interp(t_s, t, speeds[wheel])
            entry["speed"] = {"column": f"v{wheel}", "unit": "rad/s"}
        wheels.append(entry)
    if robot.wheelbase_m:
        table.columns["steer"] = np.interp(t_s, t, steering)
        if not robot.is_front_driven:
            wheels.append({})
        wheels[-1] |= {"steering": {"column": "steer", "unit": "rad"}}
    table.spec = {"time": {"column": "t", "unit": "s"}, "wheel": wheels}
    if sensors.gyro:
        _gyro(table, t, rates, sensors, rng)
    if sensors.truth:
        hz = sensors.truth_hz or sensors.rate_hz
        _places(
            table, t, pose, "truth", sensors.truth, hz, sensors.truth_m, sensors.truth_late_s, sensors, rng
        )
    if sensors.fixes:
        _places(
            table,
            t,
            pose,
            "fixes",
            sensors.fixes,
            sensors.fix_hz,
            sensors.fix_m,
            sensors.fix_late_s,
            sensors,
            rng,
        )
    table.spec["rover"] = robot.description()
    table.spec["limits"] = {"wheel_speed_rad_s": robot.limit_rad_s, "wheel_acceleration_rad_s2": 500}
    return table


def _gyro(table: Table, t: Array, rates: Array, sensors: Sensors, rng: np.random.Generator) -> None:
    rate = lagged(t, rates, sensors.gyro_lag_s)
    values = np.interp(table.t_s - sensors.gyro_late_s, t, rate) * sensors.gain
    noise = rng.normal(0.0, 0.003, len(table.t_s))
    table.columns["gyro"] = values + math.radians(sensors.bias_deg_s) + noise
    table.spec["imu"] = {"yaw_rate": {"column": "gyro", "unit": "rad/s"}}


def _places(
    table: Table,
    t: Array,
    pose: Array,
    section: str,
    kind: str,
    hz: float,
    sd_m: float,
    late_s: float,
    sensors: Sensors,
    rng: np.random.Generator,
) -> None:
    rows = np.arange(0, len(table.t_s), max(1, round(sensors.rate_hz / hz)))
    x, y, yaw = (np.interp(table.t_s[rows] - late_s, t, pose[:, place]) for place in range(3))
    arm = sensors.arm_m * np.exp(1j * yaw)
    noise = rng.normal(0.0, sd_m, (len(rows), 2))
    if section == "fixes" and sensors.fix_correlation_s:
        decay = math.exp(-1.0 / hz / sensors.fix_correlation_s)
        for row in range(1, len(noise)):
            noise[row] = decay * noise[row - 1] + math.sqrt(1.0 - decay**2) * noise[row]
    x, y = x + arm.real + noise[:, 0], y + arm.imag + noise[:, 1]
    named: dict[str, tuple[Array, str]] = {"x": (x, "m"), "y": (y, "m")}
    if kind == "geodetic":
        length = EARTH_M_PER_DEG * math.cos(math.radians(48.0))
        named = {"latitude": (48.0 + y / EARTH_M_PER_DEG, "deg"), "longitude": (11.0 + x / length, "deg")}
    if kind == "pose":
        turned = yaw + math.radians(sensors.marker_deg) + rng.normal(0.0, sensors.truth_rad, len(rows))
        named["yaw"] = (np.angle(np.exp(1j * turned)), "rad")
    entry: dict[str, Any] = {}
    for key, (values, unit) in named.items():
        column = np.full(len(table.t_s), np.nan)
        column[rows] = values
        table.columns[f"{section}_{key}"] = column
        entry[key] = {"column": f"{section}_{key}", "unit": unit}
    if sensors.is_marker_given:
        entry["marker"] = {
            "x_m": sensors.arm_m.real,
            "y_m": sensors.arm_m.imag,
            "yaw_deg": sensors.marker_deg,
        }
    if section == "fixes":
        entry["sigma_m"] = sd_m
        if sensors.fix_correlation_s:
            entry["correlation_s"] = sensors.fix_correlation_s
    table.spec[section] = entry


def tour(robot: Robot, rng: np.random.Generator, seconds: float = 50.0, back: bool = False) -> list[Leg]:
    """Return straights, bends, stops and rotations; with parts backwards."""
    legs: list[Leg] = [(2.5, 0.0, 0.0, 0.0)]
    while sum(leg[0] for leg in legs) < seconds:
        speed, sense = robot.speed * float(rng.uniform(0.5, 1.0)), float(rng.choice((-1.0, 1.0)))
        turn = robot.turn * float(rng.uniform(0.4, 1.0)) * sense
        legs.append((float(rng.uniform(2, 6)), speed, 0.0, 0.0))
        legs.append((float(rng.uniform(2, 6)), 0.7 * speed, 0.0, turn if robot.wheelbase_m else 0.6 * turn))
        if any(roller is not None for *_, roller in robot.wheels):
            legs.append((float(rng.uniform(2, 4)), 0.2 * speed, -sense * speed, 0.0))
        legs.append((2.0, 0.0, 0.0, 0.0))
        if not robot.wheelbase_m:
            legs.append((float(rng.uniform(1.5, 3.0)), 0.0, 0.0, -turn))
        if back:
            legs.append((float(rng.uniform(2, 5)), -0.7 * speed, 0.0, -0.5 * turn))
            legs.append((2.0, 0.0, 0.0, 0.0))
    return [*legs, (2.5, 0.0, 0.0, 0.0)]
