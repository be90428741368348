"""Synthetic runs with known slip: as windows, and as files of the Robotino 2 data set."""

import gzip
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from rover_hil.drives.robotino_csv import ROBOTINO
from rover_hil.identify.slip.run_data import RunWindows, to_wheels

NAMES = (
    "t;xsetspeed;m1setvel;m2setvel;m3setvel;m1pos;m2pos;m3pos;"
    "m1vel;m2vel;m3vel;m1cur;m2cur;m3cur;xpos;ypos;ang;"
)
UNITS = "ms;m/s;rad/s;rad/s;rad/s;ticks;ticks;ticks;rad/s;rad/s;rad/s;A;A;A;pix;pix;deg;"
TICKS_PER_RAD = 2000 * 16 / math.tau
PERIOD_MS = 31.0


def windows(
    direction_rad: float,
    surface: str,
    *,
    slip: Callable[[np.ndarray], np.ndarray],
    torque_nm: np.ndarray,
    speed_m_s: float = 0.2,
    noise: np.random.Generator | None = None,
) -> RunWindows:
    """Return a run whose wheels' slips are `slip` of their torques; current and M go with the torque."""
    count = len(torque_nm)
    body = np.array([speed_m_s * math.cos(direction_rad), speed_m_s * math.sin(direction_rad), 0.0])
    speeds = np.tile(to_wheels(ROBOTINO) @ body, (count, 1))
    slips = slip(torque_nm)
    if noise is not None:
        slips = slips + noise.normal(0.0, 0.01, slips.shape)
    effective = speeds * (1.0 - slips)
    signed = np.sign(speeds) * torque_nm
    inverse = np.linalg.inv(to_wheels(ROBOTINO)).T
    return RunWindows(
        path=Path(f"{surface}/exp.csv"),
        surface=surface,
        elapsed_s=np.full(count, 0.5),
        start_s=0.5 * np.arange(1, count + 1, dtype=np.float64),
        wheel_speed_rad_s=speeds,
        current_a=signed,
        paper_torque_nm=signed,
        wheel_torque_nm=signed,
        usable=np.abs(speeds) >= 0.53,
        work_known=np.ones(count, dtype=np.bool_),
        encoder_velocity=speeds @ inverse,
        camera_velocity=effective @ inverse,
        camera_in_pixels=False,
    )


def write_drive(
    path: Path,
    *,
    slip: float,
    direction_deg: float = 30.0,
    speed_m_s: float = 0.2,
    current_a: float = 0.8,
    mm_per_px: float = 2.0,
    duration_s: float = 5.0,
    turn_rad_s: float = 0.2,
) -> Path:
    """Write a straight drive with this slip, seen by a camera while the body turns; returns the path."""
    direction_rad = math.radians(direction_deg)
    body = np.array([speed_m_s * math.cos(direction_rad), speed_m_s * math.sin(direction_rad), turn_rad_s])
    speeds = to_wheels(ROBOTINO) @ body
    rows: list[str] = []
    for index in range(round(duration_s * 1000.0 / PERIOD_MS)):
        t_s = index * PERIOD_MS / 1000.0
        turned_rad = turn_rad_s * (1.0 - slip) * t_s
        x_m, y_m = _way(body[:2] * (1.0 - slip), turn_rad_s * (1.0 - slip), t_s)
        camera = (x_m * 1000.0 / mm_per_px, -y_m * 1000.0 / mm_per_px, math.degrees(turned_rad) - 90.0)
        cells = [f"{t_s * 1000.0:g}", f"{body[0]:g}", *(f"{speed * 16:g}" for speed in speeds)]
        cells += [str(round(speed * t_s * TICKS_PER_RAD)) for speed in speeds]
        cells += ["0", "0", "0", *(f"{current_a * min(1.0, abs(speed)):g}" for speed in speeds)]
        cells += [f"{value:.6f}" for value in camera]
        rows.append(";".join(cells) + ";")
    return write_rows(path, rows)


def write_rows(path: Path, rows: Sequence[str], *, names: str = NAMES, units: str = UNITS) -> Path:
    """Write a file of the data set; packed when its name ends so."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = "\n".join(("long names;", units, names, *rows, "")).encode()
    path.write_bytes(gzip.compress(text) if path.suffix == ".gz" else text)
    return path


def _way(velocity_m_s: np.ndarray, rate_rad_s: float, t_s: float) -> tuple[float, float]:
    """Return where a steady velocity in a turning body leads."""
    vx, vy = velocity_m_s.tolist()
    if rate_rad_s == 0.0:
        return vx * t_s, vy * t_s
    sine, cosine = math.sin(rate_rad_s * t_s) / rate_rad_s, (1.0 - math.cos(rate_rad_s * t_s)) / rate_rad_s
    return vx * sine - vy * cosine, vx * cosine + vy * sine
