"""Write a drive: tables of its sensors, columns file, configuration, ground truth, answer."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.nature.region_drives.cases import FIRM_SD, Case
from tests.nature.region_drives.motion import ROW_S, Driven, drive, measured_steering, ticks
from tests.nature.region_drives.plans import STANDSTILL_S, commands

Array = NDArray[np.float64]

POSITION_ROWS = round(0.5 / ROW_S)
SEEN_SD = 4.0
CHECK_M = 2.0

LIMITS = "[limits]\nwheel_speed_rad_s = 60\nwheel_acceleration_rad_s2 = 500\n"
CONFIG = """schema = "rover-hil-config/1"

[loop]
rate_hz = 50

[roles]
wheels = "wheels"
gyro = "imu"

[devices.wheels]
type = "can_wheels"
interface = "virtual"
channel = "table"
mapping = "steered_wheel"

[devices.imu]
type = "xsens"
port = "table"

"""


def write_table(path: Path, names: list[str], columns: list[Array]) -> None:
    """Write columns of numbers with the names above them."""
    np.savetxt(path, np.column_stack(columns), fmt="%.9g", delimiter=",", header=",".join(names), comments="")


def write_case(case: Case, folder: Path) -> None:
    """Drive and write all files of a drive."""
    folder.mkdir(parents=True)
    wanted = commands(case.rover, case.shape, case.rng, case.length_m)
    driven = drive(case.rover, case.ground, wanted)
    counts = ticks(case.rover, driven.angles, case.rng)
    names, columns = ["t"], [driven.t_s]
    for wheel in range(len(case.rover.angles)):
        names.append(f"w{wheel}")
        columns.append(counts[:, wheel])
        if case.rover.steers:
            names.append(f"steering{wheel}")
            columns.append(measured_steering(driven.steering[:, wheel]))
    readings = case.gyro.readings(driven.rate, case.rng)
    write_table(folder / "drive.csv", [*names, "gyro"], [*columns, readings])
    if case.positions:
        _write_positions(case, driven, folder / "positions.csv")
    write_table(
        folder / "truth.csv",
        ["t", "x", "y", "yaw", "travel"],
        [driven.t_s, *driven.pose.T, driven.travel_m],
    )
    (folder / "columns.toml").write_text(_columns(case), "utf-8")
    (folder / "config.toml").write_text(_config(case), "utf-8")
    (folder / "answer.json").write_text(json.dumps(_answer(case, driven), indent=1) + "\n", "utf-8")


def _write_positions(case: Case, driven: Driven, path: Path) -> None:
    positions = case.positions
    assert positions
    rows = slice(POSITION_ROWS // 2, None, POSITION_ROWS)
    x, y, yaw = driven.pose[rows].T
    angle = case.rng.uniform(-math.pi, math.pi)
    east, north = case.rng.uniform(-5.0, 5.0, 2)
    noise = case.rng.standard_normal((3, len(x)))
    cos, sin = math.cos(angle), math.sin(angle)
    columns = [
        driven.t_s[rows],
        east + cos * x - sin * y + positions.noise_m * noise[0],
        north + sin * x + cos * y + positions.noise_m * noise[1],
    ]
    names = ["t", "x", "y"]
    if positions.yaw_noise_rad:
        names.append("yaw")
        columns.append(yaw + angle + positions.yaw_noise_rad * noise[2])
    write_table(path, names, columns)


def _columns(case: Case) -> str:
    """Return the columns file."""
    text = ['rate_hz = 50\ntime = { column = "t" }\n']
    for wheel in range(len(case.rover.angles)):
        unit = f'unit = "ticks", ticks_per_turn = {case.rover.ticks_per_turn}'
        text.append(f'[[wheel]]\nposition = {{ column = "w{wheel}", {unit} }}')
        if case.rover.steers:
            text.append(f'steering = {{ column = "steering{wheel}", unit = "rad" }}')
    text.append('\n[imu]\nyaw_rate = { column = "gyro", unit = "rad/s" }\n')
    if case.positions:
        text.append(
            '[fixes]\nfile = "positions.csv"\ntime = { column = "t" }\n'
            'x = { column = "x" }\ny = { column = "y" }'
        )
        if case.positions.yaw_noise_rad:
            text.append('yaw = { column = "yaw", unit = "rad" }')
        text.append(f"sigma_m = {case.positions.noise_m:g}\ncorrelation_s = 0.1\n")
    return "\n".join((*text, case.rover.rover_toml, LIMITS))


def _config(case: Case) -> str:
    """Return the configuration with rover and data sheet of the gyro, without `[ground]`."""
    gyro = case.gyro
    noise = f"""[filter]
gyro_noise_rad_sqrt_s = {gyro.walk_rad_sqrt_s:g}
gyro_rate_noise_rad_s = {gyro.reading_sd_rad_s:.6g}
gyro_bias_rad_s = {gyro.bias_sd_rad_s:g}
gyro_bias_walk_rad_s_sqrt_s = {gyro.bias_walk_rad_s_sqrt_s:g}
"""
    return "\n".join((CONFIG + case.rover.rover_toml, LIMITS, noise))


def _answer(case: Case, driven: Driven) -> dict[str, Any]:
    """Return what the drive is, and at which rows it is judged."""
    travel = driven.travel_m
    rows = np.searchsorted(travel, np.arange(CHECK_M, travel[-1], CHECK_M)).tolist()
    answer: dict[str, Any] = {
        "name": case.name,
        "rover": case.rover.name,
        "shape": case.shape,
        "travel_m": float(travel[-1]),
        "setting": case.setting,
        "about": case.about,
        "gyro": {"walk_rad_sqrt_s": case.gyro.walk_rad_sqrt_s, "factor": case.gyro.factor},
        "rows": rows,
        "end": len(travel) - 1,
        "contradicts": case.contradicts,
    }
    if case.contradicts:
        begin = int(np.searchsorted(travel, case.begin_m))
        answer |= {"begin_s": float(driven.t_s[begin]), "seen_s": seen_s(case, driven, begin)}
    return answer


def seen_s(case: Case, driven: Driven, begin: int) -> float | None:
    """Return when the difference since the slip began exceeds four standard deviations.

    Positions: distance between the true place and the place by the wheels, with the true yaw, against the
    noise of one position. Gyro: yaw by the wheels less the true yaw, against the integrated gyro and one
    count of the encoders. The variance of `firm` is added: what it explains contradicts nothing. None: never
    in this drive.
    """
    since = slice(begin, None)
    elapsed = driven.t_s[since] - driven.t_s[begin]
    firm_m = FIRM_SD * (driven.travel_m[since] - driven.travel_m[begin])
    if case.positions:
        yaw = driven.pose[since, 2]
        forward, left = driven.nominal[since, 0], driven.nominal[since, 1]
        steps = np.stack(
            (np.cos(yaw) * forward - np.sin(yaw) * left, np.sin(yaw) * forward + np.cos(yaw) * left)
        )
        by_wheels = np.cumsum(steps, axis=1) * ROW_S
        truly = (driven.pose[since, :2] - driven.pose[begin, :2]).T
        difference = np.linalg.norm(by_wheels - truly, axis=0)
        sd = np.hypot(case.positions.noise_m, firm_m)
    else:
        difference = np.abs(np.cumsum(driven.nominal[since, 2] - driven.rate[since]) * ROW_S)
        track_m = float(np.ptp(case.rover.spots[:, 1]))
        count_m = math.tau * case.rover.radius_m / case.rover.ticks_per_turn
        wheels_rad = math.sqrt(2.0) * np.hypot(firm_m, count_m) / track_m
        sd = np.hypot(case.gyro.yaw_sd_rad(elapsed, STANDSTILL_S), wheels_rad)
    seen = np.flatnonzero(difference > SEEN_SD * sd)
    return float(driven.t_s[begin + seen[0]]) if len(seen) else None
