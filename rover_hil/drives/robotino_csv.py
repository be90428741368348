"""The two CSV formats of measured Robotino runs, read here only.

Records (BrOleg5/research-wheel-slippage, `datasets/*/expNN.csv`): three header lines (names, units, short
names) and a row about every 31 ms, `;`-separated. Averages (BrOleg5/Slippage-compensation,
`experimental_data_*.csv`): one header line, then a row for the mean of about 13 readings over half a second;
their camera steps are in millimetres at the authors' own scale, which cannot be checked from these files.

Camera frame of records. The image's x axis points right and its y axis down; `ang` grows counter-clockwise as
seen in the image, and the robot's x axis points to `ang` + 90 degrees. Here x = xpos, y = -ypos and yaw =
ang + 90 degrees, unwrapped: a right-handed frame with its origin at the image's upper left corner. Found from
the data (306 runs):

- Turn each encoder step by `ang`, add them up, compare with the distance in the image. With y up and `ang`
  counter-clockwise the angle between the two is 90.8 degrees in every run, 1.0 degree standard deviation on
  the brown surface and 4.8 over all; with y down 19 degrees; with `ang` clockwise 102, no relation at all.
- Yaw from the encoders against the change of `ang`, brown surface: slope +1.01, correlation 0.99.
- The file's own dx, dy are the image step turned by -(ang + 90 degrees), y up: median difference 0.001 mm.

The camera's numbers repeat in one row of twelve while the robot moves, and run 20 to 30 ms behind the
encoders on the two surfaces with the least slip.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from controllers.motion.rover_geometry import OmniRoverSettings
from drivers.errors import LogError
from drivers.robotino_board.robotino_2 import ROBOTINO_BOARD, ROBOTINO_SCALES
from drivers.robotino_board.scales import MAX_RAW, MAX_SPEED_STEPS
from rover_hil.drives.arrays import Array, Flags, Times
from rover_hil.drives.files.csv_table import CsvTable, header_lines, read_csv

ROBOTINO = OmniRoverSettings(kinematics="omni3", wheel_radius_m=0.040, base_radius_m=0.125)
MOTORS = (1, 2, 3)
MOTOR_UNITS = {"setvel": "rad/s", "pos": "ticks", "vel": "rad/s", "cur": "A"}
CAMERA_UNITS = {"xpos": "pix", "ypos": "pix", "ang": "deg"}
VOLTAGES = {f"m{motor}volt": "V" for motor in MOTORS}
"""Optional: at the motor's terminals."""
RECORD_UNITS = {"t": "ms"} | {
    f"m{motor}{name}": unit for name, unit in MOTOR_UNITS.items() for motor in MOTORS
}
MAX_TICKS = 2**31 - 1
MAX_T_MS = 1e9
CAMERA_TO_ROBOT_RAD = math.pi / 2
FIX = "take the line out or fetch the file again"
IS_RECORD = "give a run of the Robotino 2 data set"

AVERAGES_BEGIN = "X axis speed, mm/s"
COMMANDS = (AVERAGES_BEGIN, "Y axis speed, mm/s", "Rotational speed, deg/s")
SPEEDS = tuple(f"Motor {motor} velocity, rpm" for motor in MOTORS)
CURRENTS = tuple(f"Motor {motor} current, A" for motor in MOTORS)
STEPS = ("Delta X, mm", "Delta Y, mm", "Delta angle, deg")
AVERAGE_S = 0.5


@dataclass(frozen=True, slots=True)
class RobotinoTable:
    """A measured record, n rows.

    Attributes:
        table: The file.
        columns: By short name, in the units of the file, (n,) each; all numbers are finite, `t` rises from 0
            or later.
    """

    table: CsvTable
    columns: Mapping[str, Array]

    def of_motors(self, name: str) -> Array:
        """Return a quantity of the three motors, (n, 3)."""
        return np.column_stack([self.columns[f"m{motor}{name}"] for motor in MOTORS])

    def wrong(self, row: int, column: str, what: str) -> LogError:
        """Return the error that names a cell."""
        number, unit = self.columns[column][row], self.table.units[column]
        return LogError(f"{self.table.where(row)}, column '{column}': {number:g} {unit} {what}: {FIX}")


class Averages(NamedTuple):
    """The rows of a file of averages, shape (n, 3) each, in m, rad and s.

    Attributes:
        command: Commanded motion of the body: forward, to the left, yaw rate.
        wheel_rad_s: Speed of each wheel.
        current_a: Magnitude of the current of each motor.
        velocity: Motion of the body by the camera, like `command`.
    """

    command: Array
    wheel_rad_s: Array
    current_a: Array
    velocity: Array


class BoardCounts(NamedTuple):
    """A record as its EA05 board counted it; shape (n, 3) each."""

    ticks: Times
    speed_steps: Times
    current_raw: Times


class CameraPoses(NamedTuple):
    """What the overhead camera of a record saw, in the frame described above; shape (n,) each.

    Attributes:
        x_px: To the right in the image.
        y_px: Up in the image.
        yaw_rad: Of the robot's x axis, unwrapped.
        is_new: False where the camera's numbers are those of the row before.
    """

    x_px: Array
    y_px: Array
    yaw_rad: Array
    is_new: Flags


def read_record(path: Path, *, with_camera: bool) -> RobotinoTable:
    """Read a record from a `.csv` or `.csv.gz` file.

    Args:
        path: The file.
        with_camera: Its camera's columns are needed too.

    Raises:
        LogError: The file cannot be read, or holds something wrong; the message names line and column.
    """
    table = read_csv(path, delimiter=";", header_lines=3)
    units = RECORD_UNITS | (CAMERA_UNITS if with_camera else {})
    table.require(units, IS_RECORD)
    units = units | {name: unit for name, unit in VOLTAGES.items() if name in table.names}
    for name, unit in units.items():
        if table.units.get(name) != unit:
            raise LogError(f"{path} line 2, column '{name}': the unit is not {unit}: convert the column")
    table.check_shape(FIX)
    record = RobotinoTable(table, {name: table.numbers(name, fix=FIX, is_needed=True) for name in units})
    # Times become whole nanoseconds.
    t_ns = np.round(np.clip(record.columns["t"], -1.0, MAX_T_MS + 1.0) * 1e6)
    wrong = np.flatnonzero((t_ns < 0.0) | (t_ns > MAX_T_MS * 1e6) | (np.diff(t_ns, prepend=-1.0) <= 0.0))
    if wrong.size:
        row = int(wrong[0])
        is_late = record.columns["t"][row] > MAX_T_MS
        what = f"is above {MAX_T_MS:g}" if is_late else "is negative or not after the line before"
        raise record.wrong(row, "t", what)
    return record


def record_names(path: Path) -> list[str]:
    """Return the short names in the header of a record; empty for a file that is none."""
    try:
        lines = header_lines(path, 3)
    except LogError:
        return []
    return lines[-1].split(";") if len(lines) == 3 else []


def board_counts(record: RobotinoTable) -> BoardCounts:
    """Return the counts that an EA05 board would have sent for a record.

    Raises:
        LogError: A number is out of the board's range.
    """
    step_rad_s = ROBOTINO_SCALES.speed_rad_s * ROBOTINO_BOARD.gear_ratio
    for motor in MOTORS:
        name = f"m{motor}pos"
        broken = np.flatnonzero(record.columns[name] % 1.0)
        if broken.size:
            raise record.wrong(int(broken[0]), name, "is not a whole number")
    return BoardCounts(
        ticks=_counted(record, "pos", 1.0, -MAX_TICKS, MAX_TICKS),
        speed_steps=_counted(record, "vel", step_rad_s, -MAX_SPEED_STEPS, MAX_SPEED_STEPS),
        current_raw=_counted(record, "cur", ROBOTINO_SCALES.current_a, 0, MAX_RAW),
    )


def camera_poses(columns: Mapping[str, Array]) -> CameraPoses:
    """Return the poses in the camera's columns of a record."""
    x_px, y_px, angle_deg = (columns[name] for name in CAMERA_UNITS)
    changes = (np.diff(values, prepend=np.inf) != 0.0 for values in (x_px, y_px, angle_deg))
    return CameraPoses(
        x_px=x_px,
        y_px=-y_px,
        yaw_rad=np.unwrap(np.radians(angle_deg)) + CAMERA_TO_ROBOT_RAD,
        is_new=np.logical_or.reduce(list(changes)),
    )


def is_averages(path: Path) -> bool:
    """Return whether a file begins like a file of averages."""
    return path.suffix == ".csv" and "".join(header_lines(path, 1)).startswith(AVERAGES_BEGIN)


def read_averages(path: Path, *, with_camera: bool) -> Averages:
    """Return the rows of a file of averages.

    Args:
        path: The file.
        with_camera: Its camera's columns are needed too; else `velocity` is NaN.

    Raises:
        LogError: The file cannot be read, a column is missing, or a cell holds no number.
    """
    fix = "fetch the file again"
    table = read_csv(path, delimiter=";")
    groups = (COMMANDS, SPEEDS, CURRENTS, *((STEPS,) if with_camera else ()))
    table.require([name for names in groups for name in names], fix)
    table.check_shape(fix)
    command, rpm, current_a, *steps = (
        np.column_stack([table.numbers(name, fix=fix, is_needed=True) for name in names]) for names in groups
    )
    units = (1e-3, 1e-3, math.pi / 180.0)
    wheel_rad_s = rpm * (math.tau / 60.0 / ROBOTINO_BOARD.gear_ratio)
    velocity = steps[0] * units / AVERAGE_S if steps else np.full_like(command, np.nan)
    return Averages(command * units, wheel_rad_s, current_a, velocity)


def _counted(record: RobotinoTable, name: str, unit: float, low: int, high: int) -> Times:
    for motor in MOTORS:
        values = record.columns[f"m{motor}{name}"]
        outside = np.flatnonzero((values < low * unit) | (values > high * unit))
        if outside.size:
            what = f"is not within {low * unit:g} to {high * unit:g}"
            raise record.wrong(int(outside[0]), f"m{motor}{name}", what)
    return np.round(record.of_motors(name) / unit).astype(np.int64)
