"""The motors in the files of the Robotino data sets: records reading by reading, and averages.

Averages over half a second of driving give gain and droop of the speed loop. In steady travel
speed = gain * setpoint - droop * current, for any load. Nothing else is determined: the averages hold neither
voltages nor a motion that changes, and friction of the motor cannot be distinguished from the resistance of
the ground.
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
from drivers.robotino_board.robotino_2 import ROBOTINO_BOARD
from rover_hil.drives.arrays import Array, rms
from rover_hil.drives.robotino_csv import MOTORS, ROBOTINO, RobotinoTable, read_averages, read_record
from rover_hil.identify.motor.parameters import MOTOR_FIT
from rover_hil.identify.motor.record import MotorSignals, Scale, cut_set_point
from rover_hil.identify.motor.report import UNITS, Estimate, MotorReport, estimate
from rover_hil.identify.slip.run_data import to_wheels
from rover_hil.report.tracks import Series

WHY = "averages of drives hold no voltages and no transients, and friction includes that of the ground"
CONFIDENCE = 0.95
SCALE = Scale.of_board(ROBOTINO_BOARD)


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


def read_table(path: Path) -> list[MotorSignals]:
    """Return the three motors in a record, of a drive or of a motor on a bench.

    Raises:
        LogError: The file cannot be read or holds something wrong.
    """
    record = read_record(path, with_camera=False)
    count = len(record.columns["t"])
    if count < MOTOR_FIT.record.least_readings:
        raise LogError(f"{path}: holds {count} readings of the motors: give the record of a drive")
    return [_motor(record, motor) for motor in MOTORS]


def _motor(record: RobotinoTable, motor: int) -> MotorSignals:
    columns = record.columns
    t_s = columns["t"] / 1000.0
    voltage = columns.get(f"m{motor}volt")
    return MotorSignals(
        log=record.table.path.name,
        motor=motor,
        is_robotino=True,
        set_point=Series(t_s, cut_set_point(columns[f"m{motor}setvel"], SCALE.speed_rad_s)),
        position=Series(t_s, columns[f"m{motor}pos"] * SCALE.position_rad),
        speed=Series(t_s, columns[f"m{motor}vel"]),
        current=Series(t_s, columns[f"m{motor}cur"]),
        current_is_signed=False,
        voltage=None if voltage is None else Series(t_s, voltage),
        scale=SCALE,
    )


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
