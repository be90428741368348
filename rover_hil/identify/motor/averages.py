"""Identify gain and droop of a motor's speed loop from averages over half a second of driving.

In steady travel speed = gain * setpoint - droop * current, for any load. Nothing else is determined:
the averages hold neither voltages nor a motion that changes, and friction of the motor cannot be
distinguished from the resistance of the ground.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
from scipy.stats import t as student

from controllers.slip.effort.motor_model import MotorSettings
from drivers.errors import LogError
from rover_hil.drives.arrays import Array, rms
from rover_hil.drives.robotino_csv import MOTORS, ROBOTINO, read_averages
from rover_hil.identify.motor.parameters import MOTOR_FIT
from rover_hil.identify.motor.record import cut_set_point
from rover_hil.identify.motor.report import UNITS, Estimate, MotorReport, estimate
from rover_hil.identify.motor.table import SCALE
from rover_hil.identify.slip.run_data import to_wheels

WHY = "averages of drives hold no voltages and no transients, and friction includes that of the ground"
CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SteadyMeans:
    """Means over steady drives with one motor, n of them; everything at the motor and positive.

    Attributes:
        log: Name of the file.
        motor: Its number, from 1.
        set_point: As the board obeys it, rad/s, (n,).
        speed: rad/s, (n,).
        current: A, (n,).
    """

    log: str
    motor: int
    set_point: Array
    speed: Array
    current: Array


def read_means(path: Path) -> list[SteadyMeans]:
    """Return the means of the three motors in a file of averages; the first row of a drive is left out.

    Raises:
        LogError: A column is missing or a cell holds no number.
    """
    read = read_averages(path, with_camera=False)
    gear_ratio, full_scale_a = MotorSettings().gear_ratio, MotorSettings().current_full_scale_a
    set_points = cut_set_point(read.command @ to_wheels(ROBOTINO).T * gear_ratio, SCALE.speed_rad_s)
    groups = [
        list(rows)[1:]
        for _, rows in groupby(range(len(set_points)), key=lambda row: tuple(read.command[row]))
    ]
    means: list[SteadyMeans] = []
    for motor in MOTORS:
        speed, current = read.wheel_rad_s[:, motor - 1] * gear_ratio, read.current_a[:, motor - 1]
        rows: list[tuple[float, float, float]] = []
        for group in groups:
            set_point = float(set_points[group[0], motor - 1]) if group else 0.0
            is_used = abs(set_point) >= MOTOR_FIT.averages.least_steps * SCALE.speed_rad_s
            if is_used and current[group].max() < full_scale_a:
                forward = math.copysign(1.0, set_point)
                rows.append((abs(set_point), forward * speed[group].mean(), current[group].mean()))
        table = np.array(rows).reshape(-1, 3)
        means.append(
            SteadyMeans(
                log=path.name, motor=motor, set_point=table[:, 0], speed=table[:, 1], current=table[:, 2]
            )
        )
    return means


def report_means(parts: Sequence[SteadyMeans]) -> MotorReport:
    """Identify one motor from all its drives.

    Raises:
        LogError: There are too few.
    """
    set_points = np.concatenate([part.set_point for part in parts])
    speed = np.concatenate([part.speed for part in parts])
    current = np.concatenate([part.current for part in parts])
    if len(set_points) < MOTOR_FIT.averages.least_drives:
        raise LogError(
            f"{parts[0].log}: motor {parts[0].motor} has {len(set_points)} steady drives with currents below "
            f"the sensor's end, fewer than {MOTOR_FIT.averages.least_drives}: give more"
        )
    value, half, rms_rad_s = _fit(set_points, speed, current)
    return MotorReport(
        motor=parts[0].motor,
        estimates=tuple(_estimates(value, half)),
        fitted=None,
        data_sheet=None,
        undetermined=("everything but gain and droop of the speed loop",),
        notes=(f"{len(set_points)} steady drives, their mean speed fitted within {rms_rad_s:.2f} rad/s rms",),
        speed_range_rad_s=(float(speed.min()), float(speed.max())),
        current_range_a=(float(current.min()), float(current.max())),
    )


def _fit(set_points: Array, speed: Array, current: Array) -> tuple[dict[str, float], dict[str, float], float]:
    """Return values and half widths of their intervals, and the rms residual of the speed."""
    matrix = np.column_stack((set_points, -current))
    coefficients, *_ = np.linalg.lstsq(matrix, speed, rcond=None)
    residual, freedom = speed - matrix @ coefficients, len(set_points) - matrix.shape[1]
    covariance = np.linalg.pinv(matrix.T @ matrix) * float(residual @ residual) / freedom
    half = student.ppf(0.5 + CONFIDENCE / 2, freedom) * np.sqrt(np.diag(covariance))
    names = ("gain", "droop_rad_s_per_a")
    values = dict(zip(names, coefficients.tolist(), strict=True))
    return values, dict(zip(names, half.tolist(), strict=True)), rms(residual)


def _estimates(value: dict[str, float], half: dict[str, float]) -> list[Estimate]:
    return [
        estimate(
            name, value.get(name), half.get(name, math.inf), "the interval is wide" if name in value else WHY
        )
        for name in UNITS
    ]
