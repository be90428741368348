"""Read the motors behind the wheels of a drive from a log of this software."""

from itertools import count, takewhile
from pathlib import Path

import numpy as np

from drivers.errors import LogError
from drivers.robotino_board.settings import RobotinoBoardSettings
from rover_hil.drives.drive import Drive, read_drive
from rover_hil.identify.motor.parameters import MOTOR_FIT
from rover_hil.identify.motor.record import (
    MotorSignals,
    Scale,
    check_times,
    cut_set_point,
)
from rover_hil.report.tracks import Series

FIELDS = ("position{}_rad", "speed{}_rad_s", "current{}_a", "voltage{}_v")


def read_log(path: Path) -> list[MotorSignals]:
    """Return the motors in a log, one record for each wheel.

    Raises:
        LogError: The log cannot be read, or lacks wheels, currents or setpoints.
    """
    drive = read_drive(path)
    rows = drive.channels
    driven = list(takewhile(lambda motor: f"set{motor}_rad_s" in rows, count(1)))
    measured = [motor for motor in driven if any(field.format(motor) in rows for field in FIELDS)]
    if not measured or len(rows["set1_rad_s"]) < MOTOR_FIT.record.least_readings:
        raise LogError(f"{path} holds no wheel samples or no setpoints: give the log of a drive")
    check_times(drive.seconds(rows["set1_rad_s"].t_ns), f"{path}, setpoints")
    missing = sorted(set(driven) - set(measured))
    if missing:
        raise LogError(f"{path} has setpoints but no samples of motor {missing[0]}: check its encoder")
    return [_record(path, drive, motor) for motor in driven]


def _record(path: Path, drive: Drive, motor: int) -> MotorSignals:
    device = drive.config.devices[drive.config.roles.wheels]
    where = f"{path} motor {motor}"
    gear, scale = 1.0, Scale()
    if isinstance(device, RobotinoBoardSettings):
        gear, scale = device.gear_ratio, Scale.of_board(device)
    position = _series(drive, f"position{motor}_rad", where, gear)
    speed = _series(drive, f"speed{motor}_rad_s", where, gear)
    current = _series(drive, f"current{motor}_a", where)
    if current is None:
        raise LogError(f"{where}: no motor currents in the log: use a drive that reports them")
    if position is None and speed is None:
        raise LogError(f"{where}: neither positions nor speeds in the log: use a drive that reports them")
    sent = drive.channels[f"set{motor}_rad_s"]
    set_point = sent.value * gear
    if scale.speed_rad_s:
        set_point = cut_set_point(set_point, scale.speed_rad_s)
    return MotorSignals(
        log=path.name,
        motor=motor,
        is_robotino=isinstance(device, RobotinoBoardSettings),
        set_point=Series(drive.seconds(sent.t_ns), set_point),
        position=position,
        speed=speed,
        current=current,
        current_is_signed=motor not in drive.channels.unsigned_wheels,
        voltage=_series(drive, f"voltage{motor}_v", where),
        scale=scale,
    )


def _series(drive: Drive, name: str, where: str, factor: float = 1.0) -> Series | None:
    """Return finite readings over time; None when there are too few."""
    readings = drive.channels[name]
    use = np.isfinite(readings.value)
    if np.count_nonzero(use) < MOTOR_FIT.record.least_readings:
        return None
    t_s = drive.seconds(readings.t_ns[use])
    check_times(t_s, f"{where}, {name}")
    return Series(t_s, readings.value[use] * factor)
