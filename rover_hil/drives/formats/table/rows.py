"""The rows of a drive in SI units, from the columns of a table."""

import math
from pathlib import Path

import numpy as np

from drivers.units import STANDARD_GRAVITY_M_S2
from rover_hil.config import Config
from rover_hil.drives.arrays import Array
from rover_hil.drives.formats.table.columns import SI_PER_UNIT, Columns, ImuColumns
from rover_hil.drives.formats.table.drive_table import DriveTable, ImportedRows
from rover_hil.drives.formats.table.increments import take_body, take_increments, take_tricycle
from rover_hil.drives.formats.table.places import take_fixes, take_truth
from rover_hil.drives.formats.table.wheels import take_wheels


def read_drive_table(path: Path, columns: Columns, rover: Config) -> ImportedRows:
    """Return the drive in a table.

    Args:
        path: The table.
        columns: What its columns hold.
        rover: Its wheels and their limits.

    Raises:
        LogError: The table cannot be read or holds something wrong; names file, row, column and fix.
    """
    source = DriveTable(path, columns, rover)
    if columns.wheel:
        take_wheels(source, columns.wheel)
    elif columns.increments is not None:
        take_increments(source, columns.increments)
    elif columns.body is not None:
        take_body(source, columns.body)
    elif columns.tricycle is not None:
        take_tricycle(source, columns.tricycle)
    if columns.imu is not None:
        _take_imu(source, columns.imu)
    if columns.fixes is not None:
        take_fixes(source, columns.fixes)
    if columns.truth is not None:
        take_truth(source, columns.truth)
    source.note_rows()
    source.drive.rows.sort(key=lambda row: row.t_ns)  # stable, so that rows of one time keep their order
    return source.drive


COARSE_RAD_S = math.radians(0.1)
"""With steps of the readings above this, noise does not change them: a car's gyro on a straight road."""
LEAST_CHANGES = 4
"""Of the readings of a gyro that is alive."""


def _is_coarse(rates_rad_s: Array) -> bool:
    steps_rad_s = np.abs(np.diff(rates_rad_s[np.isfinite(rates_rad_s)]))
    steps_rad_s = steps_rad_s[steps_rad_s > 0.0]
    return len(steps_rad_s) >= LEAST_CHANGES and float(steps_rad_s.min()) > COARSE_RAD_S


def _take_imu(drive: DriveTable, imu: ImuColumns) -> None:
    source = drive.of_sensor(imu)
    values: dict[str, list[list[float]]] = {}
    held = np.zeros(len(source.t_ns), bool)
    if imu.yaw_rate is not None:
        rates = source.numbers(imu.yaw_rate) * SI_PER_UNIT[imu.yaw_rate.unit]
        source.drive.is_gyro_coarse = _is_coarse(rates)
        zeros = np.zeros_like(rates)
        values["rate"] = np.column_stack((zeros, zeros, rates)).tolist()
        held |= np.isfinite(rates)
    if imu.heading is not None:
        headings = source.angle_rad(imu.heading)
        values["heading"] = headings[:, np.newaxis].tolist()
        held |= np.isfinite(headings)
    axes = (imu.acceleration_x, imu.acceleration_y, imu.acceleration_z)
    if any(axes):
        stack = np.column_stack(
            [
                np.full(len(held), level) if axis is None else source.numbers(axis) * SI_PER_UNIT[axis.unit]
                for axis, level in zip(axes, (0.0, 0.0, STANDARD_GRAVITY_M_S2), strict=True)
            ]
        )
        values["acceleration"] = stack.tolist()
        held |= np.isfinite(stack).all(axis=1)
    source.add("imu", values, held)
