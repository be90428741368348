"""Measured records of motors: the Robotino 2 data sets, tables, and logs of drives.

Robotino records (BrOleg5/research-wheel-slippage): three header lines, the last `t;m1setvel;...`; setpoints,
speeds and currents at the motor. Tables: `t_s`, `set_point_rad_s` or `voltage_v`, `speed_rad_s`, `current_a`,
perhaps `others_current_a`, `integral` and `run`; one run per file without `run`.
"""

from pathlib import Path

import numpy as np

from drivers.errors import ConfigError
from drivers.robotino_board.scales import scales
from drivers.robotino_board.settings import RobotinoBoardSettings
from rover_hil.drives.drive import Drive
from rover_hil.gap.data.columns import (
    Columns,
    Reader,
    check_times,
    need,
    read_columns,
    read_runs_by_name,
    table_files,
    whole_rows,
)
from rover_hil.gap.data.logs import log_columns
from sim_backends.models.interface import Array, Run
from sim_backends.models.robotino_motor.model import CURRENT_STEP_A, SPEED_STEP_RAD_S

MOTORS = (1, 2, 3)
WITHOUT_INTEGRAL = "without_integral"
WITH_INTEGRAL = "with_integral"
BOARD = {"speed_step_rad_s": SPEED_STEP_RAD_S, "current_step_a": CURRENT_STEP_A, "is_unsigned": 1.0}


def read_motor_runs(path: Path) -> list[Run]:
    """Return one run per motor of each record in a file or folder.

    Raises:
        ConfigError: A file cannot be read, a column is missing, or the time does not rise.
    """
    files = table_files(path)
    runs: list[Run] = []
    for file in files:
        columns = read_columns(file)
        if "m1setvel" in columns:
            runs += _record(file, columns)
        else:
            runs += [_tabled(file, name, one) for name, one in read_runs_by_name(file).items()]
    return runs


def motor_runs_of_log(drive: Drive) -> list[Run]:
    """Return one run per wheel that has setpoints or voltages, speeds and currents.

    Raises:
        ConfigError: No wheel has.
    """
    device, columns = drive.config.devices[drive.config.roles.wheels], log_columns(drive)
    gear, speed_step_rad_s, current_step_a = 1.0, 0.0, 0.0
    if isinstance(device, RobotinoBoardSettings):
        counts, gear = scales(device), device.gear_ratio
        speed_step_rad_s, current_step_a = counts.speed_rad_s, counts.current_step_a
    wheels = [wheel for wheel in range(1, 9) if f"current{wheel}_a" in columns]
    kinds = ("current{}_a", "speed{}_rad_s", "set{}_rad_s", "voltage{}_v")
    names = [kind.format(wheel) for wheel in wheels for kind in kinds]
    rows = whole_rows(columns, ["t_s", *(name for name in names if name in columns)])
    columns = {name: values[rows] for name, values in columns.items()}
    total = np.sum([np.abs(columns[f"current{wheel}_a"]) for wheel in wheels], axis=0)
    labels = {"speed_step_rad_s": gear * speed_step_rad_s, "current_step_a": current_step_a}
    runs = []
    for wheel in wheels:
        given = _drive_of(columns, wheel, gear)
        speed = columns.get(f"speed{wheel}_rad_s")
        if given is None or speed is None:
            continue
        current = columns[f"current{wheel}_a"]
        is_unsigned = float(not np.any(current < 0.0))
        runs.append(
            Run(
                name=f"{drive.name} wheel {wheel}",
                conditions={"integral": 0.0, **labels, "is_unsigned": is_unsigned},
                inputs={"t_s": columns["t_s"], **given, "others_current_a": total - np.abs(current)},
                measured={"speed_rad_s": gear * speed, "current_a": current},
            )
        )
    if not runs:
        raise ConfigError(
            f"{drive.name} holds no wheel with setpoints, speeds and currents: use a log with them"
        )
    return runs


def _drive_of(columns: Columns, wheel: int, gear: float) -> dict[str, Array] | None:
    if f"voltage{wheel}_v" in columns:
        return {"voltage_v": columns[f"voltage{wheel}_v"]}
    if f"set{wheel}_rad_s" in columns:
        return {"set_point_rad_s": gear * columns[f"set{wheel}_rad_s"]}
    return None


def _record(path: Path, columns: Columns) -> list[Run]:
    names = [f"m{motor}{kind}" for motor in MOTORS for kind in ("setvel", "vel", "cur")]
    need(columns, ("t", *names), str(path), "use a record of the Robotino 2 data set")
    t_s = columns["t"] / 1000.0
    check_times(t_s, str(path))
    total = np.sum([np.abs(columns[f"m{motor}cur"]) for motor in MOTORS], axis=0)
    integral = float(WITH_INTEGRAL in path.name and WITHOUT_INTEGRAL not in path.name)
    return [
        Run(
            name=f"{path.name.split('.csv')[0]} motor {motor}",
            conditions={"integral": integral, "motor": float(motor), **BOARD},
            inputs={
                "t_s": t_s,
                "set_point_rad_s": columns[f"m{motor}setvel"],
                "others_current_a": total - np.abs(columns[f"m{motor}cur"]),
            },
            measured={"speed_rad_s": columns[f"m{motor}vel"], "current_a": columns[f"m{motor}cur"]},
        )
        for motor in MOTORS
    ]


def _tabled(path: Path, name: str, columns: Columns) -> Run:
    drive = "voltage_v" if "voltage_v" in columns else "set_point_rad_s"
    need(columns, ("t_s", drive, "speed_rad_s", "current_a"), f"{path}, run {name}", "the model needs it")
    check_times(columns["t_s"], f"{path}, run {name}")
    current = columns["current_a"]
    others = columns.get("others_current_a", np.zeros(current.size))
    integral = columns.get("integral", np.zeros(1))
    return Run(
        name=name,
        conditions={"integral": float(integral[0]), "is_unsigned": float(not np.any(current < 0.0))},
        inputs={"t_s": columns["t_s"], drive: columns[drive], "others_current_a": others},
        measured={"speed_rad_s": columns["speed_rad_s"], "current_a": current},
    )


READER = Reader(read=read_motor_runs, runs_of_log=motor_runs_of_log)
