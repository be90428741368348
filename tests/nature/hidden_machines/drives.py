"""Cases of `gap rover`: drives as tables with a file of columns, and what is hidden in them."""

import csv
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tests.nature.hidden_machines.draw import CLASSES
from tests.nature.hidden_machines.machine import Array
from tests.nature.hidden_machines.rover_motion import (
    ROVERS,
    SPEED_M_S,
    Rover,
    command,
    path,
    wheel_motion,
)
from tests.nature.hidden_machines.verdicts import expected

COLUMNS, CALL, DRIVES = "columns.toml", "case.toml", "drives"
DT_S, TICK_RAD = 0.02, 2.0 * np.pi / 4096.0
CAMERA_M, CAMERA_RAD, GYRO_RAD_S = 0.001, 0.002, 0.002
SPEED_NOISE, RATE_NOISE = 0.001, 0.002
"""What the documents state of the measured motion's accuracy, m/s and rad/s."""


@dataclass(frozen=True)
class Hidden:
    """An effect of a rover: name and range of its size, and what one unit of it shows, over the noise."""

    name: str
    parameter: str
    low: float
    high: float
    shown_per_size: float
    is_signed: bool = True
    needs_steering: bool = False
    equals: tuple[str, ...] = ()


_SPEED, _RATE = 0.7 * SPEED_M_S / SPEED_NOISE, 0.15 / RATE_NOISE
CATALOGUE = (
    Hidden("wheel_radius", "error", 0.012, 0.04, _SPEED, equals=("contact_stiffness", "rolling_resistance")),
    Hidden("base_radius", "error", 0.03, 0.09, _RATE),
    Hidden("uneven_wheel", "error", 0.01, 0.04, _SPEED),
    Hidden("gyro_scale", "error", 0.02, 0.06, _RATE),
    Hidden("gyro_bias", "rate", 0.005, 0.02, 1.0 / RATE_NOISE),
    Hidden("latency", "time", 0.08, 0.25, 0.1 / SPEED_NOISE, is_signed=False),
    Hidden("steering_offset", "angle_deg", 1.5, 5.0, np.radians(0.3 * SPEED_M_S) / SPEED_NOISE, True, True),
    Hidden("steering_ratio", "error", 0.03, 0.1, _RATE, True, True),
)
OUTSIDE = (
    Hidden("growing_tyres", "share_per_m_s", 0.08, 0.25, 0.1 * _SPEED, is_signed=False),
    Hidden("lost_ticks", "share_above_half_speed", 0.02, 0.08, 0.5 * _SPEED, is_signed=False),
    Hidden("side_slip_in_curves", "m_s_per_m_rad_s2", 0.08, 0.45, 0.02 / SPEED_NOISE),
    Hidden("gyro_square", "s_per_rad", 0.15, 0.5, 0.03 / RATE_NOISE),
)


@dataclass(frozen=True)
class DriveCase:
    """Drives of one rover and what is hidden in them."""

    seed: int
    kind: str
    number: int
    rover: Rover
    drives: int
    hidden: Hidden | None
    size: float
    wheel: int
    errors: dict[str, float] = field(default_factory=dict)
    """Small errors of base parameters, within their priors."""
    time_s: Array = field(default_factory=lambda: np.arange(0.0, 22.0, DT_S))


def draw_drives(seed: int, kind: str, number: int) -> DriveCase:
    """Return the drives of a seed, a class and a number."""
    rng = np.random.default_rng([seed, CLASSES.index(kind), number, 7])
    rover = ROVERS[int(rng.integers(len(ROVERS)))]
    pool = {"catalogue": CATALOGUE, "outside": OUTSIDE}.get(kind, ())
    able = [hidden for hidden in pool if rover.least_turn_m or not hidden.needs_steering]
    hidden = able[int(rng.integers(len(able)))] if able else None
    size = float(rng.uniform(hidden.low, hidden.high)) if hidden else 0.0
    if hidden and hidden.is_signed:
        size *= float(rng.choice([-1.0, 1.0]))
    steered = [k for k, wheel in enumerate(rover.wheels) if wheel.steers]
    steer = hidden is not None and hidden.name == "steering_offset"
    wheel = int(rng.choice(steered if steer else np.arange(len(rover.wheels))))
    spreads = {"radius": 0.002, "base": 0.004, "marker_x": 0.003, "marker_y": 0.003, "marker_yaw": 0.005}
    errors = {name: float(np.clip(rng.normal(), -2, 2) * spread) for name, spread in spreads.items()}
    return DriveCase(seed, kind, number, rover, int(rng.integers(6, 11)), hidden, size, wheel, errors)


def _size(case: DriveCase, name: str) -> float:
    return case.size if case.hidden and case.hidden.name == name else 0.0


def drive(case: DriveCase, rng: np.random.Generator, noise: np.random.Generator) -> dict[str, Array]:
    """Return the columns of one drive; `rng` draws the motion, `noise` the readings' errors."""
    time_s, rover = case.time_s, case.rover
    speed, rate = command(rover, time_s, rng)
    sideways = _size(case, "side_slip_in_curves") * speed * rate
    x, y, yaw = path(speed, sideways, rate, DT_S)
    x, y, yaw = _seen_by_camera(case, x, y, yaw, rng)
    columns = {"t": time_s}
    for place in range(len(rover.wheels)):
        columns |= _wheel_columns(case, place, speed, rate)
    gyro = rate * (1.0 + _size(case, "gyro_scale")) + _size(case, "gyro_bias")
    columns["gyro"] = gyro + _size(case, "gyro_square") * rate**2 + noise.normal(0.0, GYRO_RAD_S, rate.size)
    columns["x"] = x + noise.normal(0.0, CAMERA_M, x.size)
    columns["y"] = y + noise.normal(0.0, CAMERA_M, x.size)
    columns["yaw"] = yaw + noise.normal(0.0, CAMERA_RAD, x.size)
    return columns


def _seen_by_camera(
    case: DriveCase, x: Array, y: Array, yaw: Array, rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Return the pose of the marker in the frame of the camera, perhaps late."""
    late = case.time_s - _size(case, "latency")
    x, y, yaw = (np.interp(late, case.time_s, series) for series in (x, y, yaw))
    ahead, left = case.errors["marker_x"], case.errors["marker_y"]
    x, y = x + ahead * np.cos(yaw) - left * np.sin(yaw), y + ahead * np.sin(yaw) + left * np.cos(yaw)
    about, (east, north) = float(rng.uniform(-3.0, 3.0)), rng.uniform(-1.0, 1.0, 2)
    turned = np.cos(about) * x - np.sin(about) * y, np.sin(about) * x + np.cos(about) * y
    return turned[0] + east, turned[1] + north, yaw + about + case.errors["marker_yaw"]


def _wheel_columns(case: DriveCase, place: int, speed: Array, rate: Array) -> dict[str, Array]:
    """Return what the encoders of one wheel read."""
    share = (1.0 + _size(case, "base_radius")) * (1.0 + case.errors["base"])
    wheel = case.rover.wheels[place]
    real = type(wheel)(wheel.x_m * share, wheel.y_m * share, wheel.steers)
    rolling, angle = wheel_motion(real, speed, rate)
    uneven = _size(case, "uneven_wheel") if place == case.wheel else 0.0
    larger = (1.0 + _size(case, "wheel_radius")) * (1.0 + case.errors["radius"]) * (1.0 + uneven)
    radius = case.rover.radius_m * larger * (1.0 + _size(case, "growing_tyres") * np.abs(rolling))
    turning = rolling / radius
    if place == case.wheel:
        fast = np.abs(rolling) > 0.5 * SPEED_M_S
        turning = turning * np.where(fast, 1.0 - _size(case, "lost_ticks"), 1.0)
    turned = np.concatenate([[0.0], np.cumsum(0.5 * DT_S * (turning[1:] + turning[:-1]))])
    columns = {f"wheel{place}": TICK_RAD * np.round(turned / TICK_RAD)}
    if wheel.steers:
        zero = np.radians(_size(case, "steering_offset")) if place == case.wheel else 0.0
        reading = angle / (1.0 + _size(case, "steering_ratio")) - zero
        columns[f"steer{place}"] = TICK_RAD * np.round(reading / TICK_RAD)
    return columns


def write_drives(case: DriveCase, folder: Path, variant: int = 0) -> None:
    """Write the drives of a variant, the file of their columns and the call."""
    (folder / DRIVES).mkdir(parents=True, exist_ok=True)
    start = [case.seed, CLASSES.index(case.kind), case.number, 7]
    order = list(range(case.drives))
    if variant:
        np.random.default_rng([*start, 500 + variant]).shuffle(order)
    for label, run in enumerate(order):
        noise = np.random.default_rng([*start, 1000 + variant, run])
        columns = drive(case, np.random.default_rng([*start, run]), noise)
        with (folder / DRIVES / f"drive{label}.csv").open("w", newline="", encoding="utf-8") as file:
            table = csv.writer(file)
            table.writerow(columns)
            table.writerows(zip(*(np.round(column, 6).tolist() for column in columns.values()), strict=True))
    (folder / COLUMNS).write_text(columns_text(case.rover), "utf-8")
    names = [f"{DRIVES}/drive{label}.csv" for label in range(case.drives)]
    quoted = ", ".join(f'"{name}"' for name in ["gap", "rover", COLUMNS, *names])
    (folder / CALL).write_text(f"arguments = [{quoted}]\n", "utf-8")


def columns_text(rover: Rover) -> str:
    """Return the file of columns."""
    lines = ['time = { column = "t", unit = "s" }', ""]
    for place, wheel in enumerate(rover.wheels):
        lines += ["[[wheel]]", f'position = {{ column = "wheel{place}", unit = "rad" }}']
        lines += [f'steering = {{ column = "steer{place}", unit = "rad" }}'] if wheel.steers else []
        lines += [""]
    lines += ["[imu]", 'yaw_rate = { column = "gyro", unit = "rad/s" }', "", "[truth]"]
    lines += [f'{axis} = {{ column = "{axis}", unit = "m" }}' for axis in ("x", "y")]
    lines += ['yaw = { column = "yaw", unit = "rad" }', "", "[rover]", 'kinematics = "wheels"', "wheels = ["]
    for wheel in rover.wheels:
        steering = ", steering = { low_deg = -60, high_deg = 60, rate_deg_s = 90 }" if wheel.steers else ""
        lines += [f"  {{ x_m = {wheel.x_m}, y_m = {wheel.y_m}, radius_m = {rover.radius_m}{steering} }},"]
    lines += ["]", "", "[limits]", "wheel_speed_rad_s = 15", "wheel_acceleration_rad_s2 = 50", ""]
    return "\n".join(lines)


def answer_drives(case: DriveCase) -> dict[str, object]:
    """Return what is hidden in the drives, and the verdict that a sensible person expects."""
    hidden = case.hidden
    priors = {"wheel_radius": "radius", "base_radius": "base"}
    size = case.size
    if hidden and hidden.name in priors:
        size = (1.0 + size) * (1.0 + case.errors[priors[hidden.name]]) - 1.0
    listed = hidden in CATALOGUE
    effects = []
    if hidden:
        effects = [{"name": hidden.name, "parameter": hidden.parameter, "size": size, "is_listed": listed}]
    ratio = abs(case.size) * hidden.shown_per_size if hidden else 0.0
    alike = hidden.equals if hidden else ()
    verdict, accepted, reason = expected(case.kind, case.drives, ratio, alike)
    return {
        "case": f"{case.kind}-{case.seed}-{case.number}",
        "class": case.kind,
        "machine": f"rover_{case.rover.name}",
        "runs": case.drives,
        "noise_correlation": 0.0,
        "effects": effects,
        "terms": [],
        "ratio": ratio,
        "ratio_with_best_other": ratio,
        "alike": list(alike),
        "expected": verdict,
        "accepted": accepted,
        "reason": reason,
    }
