"""Averaged measurements of the paper's Robotino (BrOleg5/Slippage-compensation, `experimental_data_*.csv`).

One header line, then one row for the mean of about 13 readings over half a second, `;`-separated. The
camera's steps are in millimetres at the authors' own scale, which cannot be checked from these files.
"""

from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np

from controllers.slip.effort.motor_model import SLOWEST_RAD_S, MotorSettings, paper_torque, wheel_torque
from drivers.errors import LogError
from rover_hil.identify.run_data import ROBOTINO, WHEELS, Array, Flags, RunWindows, to_wheels

ROW_S = 0.5
FIRST_COLUMN = "X axis speed, mm/s"
COMMANDS = (FIRST_COLUMN, "Y axis speed, mm/s", "Rotational speed, deg/s")
SPEEDS = tuple(f"Motor {wheel} velocity, rpm" for wheel in (1, 2, 3))
CURRENTS = tuple(f"Motor {wheel} current, A" for wheel in (1, 2, 3))
STEPS = ("Delta X, mm", "Delta Y, mm", "Delta angle, deg")


def is_averaged_csv(path: Path) -> bool:
    """Tell whether `path` begins like a file of averages."""
    if path.suffix != ".csv":
        return False
    with path.open(encoding="utf-8", errors="replace") as stream:
        return stream.readline().startswith(FIRST_COLUMN)


def read_columns(path: Path, wanted: Sequence[str]) -> dict[str, Array]:
    """Return all columns of a file of averages by name.

    Raises:
        LogError: A wanted column is missing or a cell is no number.
    """
    header, *lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    names = header.split(";")
    for name in wanted:
        if name not in names:
            msg = f"{path} line 1 names no column '{name}': fetch the file again"
            raise LogError(msg)
    table = _table(path, lines, len(names))
    return {name: table[:, place] for place, name in enumerate(names)}


def read_averaged_csv(path: Path, surface: str, motor: MotorSettings) -> Iterator[RunWindows]:
    """Yield the rows of each straight drive as a run; drives that only turn are passed over.

    Raises:
        LogError: A column is missing or a cell is no number.
    """
    columns = read_columns(path, (*COMMANDS, *SPEEDS, *CURRENTS, *STEPS))
    commands = np.column_stack([columns[name] for name in COMMANDS])
    for command, group in groupby(range(len(commands)), key=lambda row: tuple(commands[row])):
        rows = list(group)
        if command[2] == 0.0:
            yield _drive(path, surface, {name: columns[name][rows] for name in columns}, motor)


def _table(path: Path, lines: list[str], width: int) -> Array:
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=2):
        try:
            row = [float(cell) for cell in line.split(";")]
        except ValueError:
            row = []
        if len(row) != width or not np.isfinite(row).all():
            msg = f"{path} line {number} does not hold {width} numbers: fetch the file again"
            raise LogError(msg)
        rows.append(row)
    if not rows:
        msg = f"{path} holds no line below its header: fetch the file again"
        raise LogError(msg)
    return np.array(rows)


def _drive(path: Path, surface: str, columns: dict[str, Array], motor: MotorSettings) -> RunWindows:
    rpm_to_wheel = 2.0 * np.pi / 60.0 / motor.gear_ratio
    speeds = np.column_stack([columns[name] for name in SPEEDS]) * rpm_to_wheel
    magnitudes_a = np.column_stack([columns[name] for name in CURRENTS])
    steps = np.column_stack([columns[name] for name in STEPS])
    current_a = np.sign(speeds) * magnitudes_a
    pairs = list(zip(current_a.ravel().tolist(), speeds.ravel().tolist(), strict=True))
    paper_nm = [paper_torque(motor, amps, speed, float(np.sign(speed))) for amps, speed in pairs]
    wheel_nm = [wheel_torque(motor, amps, speed) for amps, speed in pairs]
    is_known: Flags = magnitudes_a < motor.current_full_scale_a
    return RunWindows(
        path=path,
        surface=surface,
        elapsed_s=np.full(len(speeds), ROW_S),
        start_s=ROW_S * np.arange(len(speeds), dtype=np.float64),
        wheel_speed_rad_s=speeds,
        current_a=current_a,
        paper_torque_nm=np.array(paper_nm).reshape(-1, WHEELS),
        wheel_torque_nm=np.array(wheel_nm).reshape(-1, WHEELS),
        usable=(np.abs(speeds) >= SLOWEST_RAD_S) & is_known,
        work_known=np.logical_and.reduce(is_known, axis=1),
        encoder_velocity=speeds @ np.linalg.inv(to_wheels(ROBOTINO)).T,
        camera_velocity=steps * np.array([1e-3, 1e-3, np.pi / 180.0]) / ROW_S,
        camera_in_pixels=False,
    )
