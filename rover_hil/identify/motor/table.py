"""The motors in a measured record of the Robotino 2 data set, a run or a motor on a bench."""

from pathlib import Path

from drivers.errors import LogError
from drivers.robotino_board.robotino_2 import ROBOTINO_BOARD
from rover_hil.drives.robotino_csv import MOTORS, RobotinoRecord, read_record
from rover_hil.identify.motor.parameters import MOTOR_FIT
from rover_hil.identify.motor.record import MotorRecord, Scale, Series, cut_set_point

SCALE = Scale.of_board(ROBOTINO_BOARD)


def read_table(path: Path) -> list[MotorRecord]:
    """Return the three motors in a file.

    Raises:
        LogError: The file cannot be read or holds something wrong.
    """
    record = read_record(path, with_camera=False)
    count = len(record.columns["t"])
    if count < MOTOR_FIT.record.least_readings:
        raise LogError(f"{path}: holds {count} readings of the motors: give the record of a drive")
    return [_motor(record, motor) for motor in MOTORS]


def _motor(record: RobotinoRecord, motor: int) -> MotorRecord:
    columns = record.columns
    t_s = columns["t"] / 1000.0
    voltage = columns.get(f"m{motor}volt")
    return MotorRecord(
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
