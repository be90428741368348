"""Measured Robotino 2 runs (BrOleg5/research-wheel-slippage, `datasets/*/expNN.csv`) as board replies.

A file has three header lines (names, units, short names) and one row about every 31 ms, `;`-separated. Each
row becomes the reply that an EA05 board sends for these numbers, so that a run can be replayed through the
same codec as a rover's serial port.

Camera frame. The image's x axis points right and its y axis down; `ang` grows counter-clockwise as seen in
the image, and the robot's x axis points to `ang` + 90 degrees. Here x_m = scale * xpos, y_m = -scale * ypos
and yaw = ang + 90 degrees, unwrapped: a right-handed frame with its origin at the image's upper left corner.
Found from the data (306 runs):

- Turn each encoder step by `ang`, add them up, compare with the way in the image. With y up and `ang`
  counter-clockwise the angle between the two is 90.8 degrees in every run, 1.0 degree standard deviation on
  the brown surface and 4.8 over all; with y down 19 degrees; with `ang` clockwise 102, no relation at all.
- Yaw from the encoders against the change of `ang`, brown surface: slope +1.01, correlation 0.99.
- The file's own dx, dy are the image step turned by -(ang + 90 degrees), y up: median difference 0.001 mm.

The camera's numbers repeat in one row of twelve while the robot moves (`truth_is_new`), and run 20 to 30 ms
behind the encoders on the two surfaces with the least slip.
"""

import gzip
import math
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.errors import ConfigError, LogError
from drivers.robotino_board.codec import MAX_RAW, MAX_SPEED_STEPS, BoardReply, build_reply, scales
from drivers.robotino_board.settings import RobotinoBoardSettings

START_NS = NANOSECONDS_PER_SECOND
"""Time given to t = 0 of a run: not zero, so that an unset time stamp cannot pass for a real one."""

UNITS = {
    "t": "ms",
    **dict.fromkeys(("m1setvel", "m2setvel", "m3setvel", "m1vel", "m2vel", "m3vel"), "rad/s"),
    **dict.fromkeys(("m1pos", "m2pos", "m3pos"), "ticks"),
    **dict.fromkeys(("m1cur", "m2cur", "m3cur"), "A"),
    **dict.fromkeys(("xpos", "ypos"), "pix"),
    "ang": "deg",
}
"""The columns that are read, by short name, and the unit each must have."""

MAX_TICKS = 2**31 - 1
LARGEST_MM_PER_PX = 1000.0

_HEADER_LINES = 3
_FIX = "take the line out or fetch the file again"
_BOARD = RobotinoBoardSettings(type="robotino_board", port="none", board="EA05")
_SCALES = scales(_BOARD)
_MOTOR_STEP_RAD_S = _SCALES.speed_rad_s * _BOARD.gear_ratio
_CAMERA_TO_ROBOT_RAD = math.pi / 2


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportedRow:
    """One row of a measured run.

    Attributes:
        t_ns: Time of the row; the run's t = 0 is `START_NS`.
        reply_frame: The board's reply with this row's ticks, speeds and currents. Battery and system current
            are 0, the bumper is free and the time count is the row's t: the file does not tell them.
        set_speed_rad_s: Set-point of each wheel, at the wheel.
        truth_x_m, truth_y_m, truth_yaw_rad: What the overhead camera saw, in the frame described above.
        truth_is_new: False when the camera's numbers are those of the row before.
    """

    t_ns: int
    reply_frame: bytes
    set_speed_rad_s: tuple[float, float, float]
    truth_x_m: float
    truth_y_m: float
    truth_yaw_rad: float
    truth_is_new: bool


@dataclass(frozen=True, slots=True)
class RobotinoRun:
    """A measured run and the file it comes from."""

    path: Path
    rows: tuple[ImportedRow, ...]


def read_run(path: Path, millimetres_per_pixel: float) -> RobotinoRun:
    """Read one run from a `.csv` or `.csv.gz` file.

    Args:
        path: The file.
        millimetres_per_pixel: Scale of the camera; the data set's own file says 1.84, the runs on the
            smooth table say 2.05 to 2.08.

    Raises:
        ConfigError: The scale is not a positive number, or too large for a camera.
        LogError: The file cannot be read, or holds something wrong; the message names line and column.
    """
    if not 0 < millimetres_per_pixel <= LARGEST_MM_PER_PX:
        msg = (
            f"millimetres per pixel must be a positive number up to {LARGEST_MM_PER_PX:g}, "
            f"not {millimetres_per_pixel}"
        )
        raise ConfigError(msg)
    lines = list(_lines(path))
    if not lines:
        msg = f"{path} holds no lines below its header: fetch the file again"
        raise LogError(msg)
    metres_per_pixel = millimetres_per_pixel / 1000.0
    camera = [tuple(line.numbers[name] for name in ("xpos", "ypos", "ang")) for line in lines]
    yaws_rad = np.unwrap(np.radians([angle for _, _, angle in camera])) + _CAMERA_TO_ROBOT_RAD
    rows = [
        ImportedRow(
            t_ns=START_NS + round(line.numbers["t"] * 1e6),
            reply_frame=_reply_frame(line),
            set_speed_rad_s=_set_speed_rad_s(line),
            truth_x_m=camera[index][0] * metres_per_pixel,
            truth_y_m=-camera[index][1] * metres_per_pixel,
            truth_yaw_rad=float(yaws_rad[index]),
            truth_is_new=index == 0 or camera[index] != camera[index - 1],
        )
        for index, line in enumerate(lines)
    ]
    return RobotinoRun(path, tuple(rows))


@dataclass(frozen=True, slots=True)
class _Line:
    """The numbers of one line by short name, and where they stand."""

    where: str
    numbers: Mapping[str, float]

    def wrong(self, column: str, what: str) -> LogError:
        return _wrong(self.where, column, f"{self.numbers[column]:g} {UNITS[column]} {what}")

    def whole(self, column: str, unit: float, low: int, high: int) -> int:
        """Return a number in whole units, rounded.

        Raises:
            LogError: It is less than `low` or more than `high` units.
        """
        number = self.numbers[column]
        if not low * unit <= number <= high * unit:
            raise self.wrong(column, f"is not within {low * unit:g} to {high * unit:g}")
        return round(number / unit)


def _set_speed_rad_s(line: _Line) -> tuple[float, float, float]:
    w0, w1, w2 = (line.numbers[column] / _BOARD.gear_ratio for column in ("m1setvel", "m2setvel", "m3setvel"))
    return (w0, w1, w2)


def _reply_frame(line: _Line) -> bytes:
    columns = ("m1pos", "m2pos", "m3pos")
    for column in columns:
        if not line.numbers[column].is_integer():
            raise line.wrong(column, "is not a whole number")
    t0, t1, t2 = (line.whole(column, 1.0, -MAX_TICKS, MAX_TICKS) for column in columns)
    s0, s1, s2 = (
        line.whole(column, _MOTOR_STEP_RAD_S, -MAX_SPEED_STEPS, MAX_SPEED_STEPS)
        for column in ("m1vel", "m2vel", "m3vel")
    )
    c0, c1, c2 = (line.whole(column, _SCALES.current_a, 0, MAX_RAW) for column in ("m1cur", "m2cur", "m3cur"))
    return build_reply(
        BoardReply(
            ticks=(t0, t1, t2),
            speed_steps=(s0, s1, s2),
            current_raw=(c0, c1, c2),
            battery_raw=0,
            system_current_raw=0,
            bumper_pressed=False,
            time_ms=round(line.numbers["t"]),
            board=_BOARD.board,
        )
    )


def _lines(path: Path) -> Iterator[_Line]:
    text = _read_text(path).splitlines()
    places = _places(path, text)
    width = len(text[_HEADER_LINES - 1].split(";"))
    t_before_ms = -math.inf
    for number, row in enumerate(text[_HEADER_LINES:], start=_HEADER_LINES + 1):
        where = f"{path} line {number}"
        cells = row.split(";")
        if len(cells) != width:
            msg = f"{where} has {len(cells)} cells, its header {width}: {_FIX}"
            raise LogError(msg)
        line = _Line(where, {name: _number(where, name, cells[place]) for name, place in places.items()})
        t_ms = line.numbers["t"]
        if t_ms < 0 or t_ms <= t_before_ms:
            raise line.wrong("t", "is negative or not after the line before")
        t_before_ms = t_ms
        yield line


def _places(path: Path, text: Sequence[str]) -> dict[str, int]:
    """Return where each column stands; names and units are looked at."""
    if len(text) < _HEADER_LINES:
        msg = f"{path} has {len(text)} lines, no header of three: give a run of the Robotino 2 data set"
        raise LogError(msg)
    units, names = text[_HEADER_LINES - 2].split(";"), text[_HEADER_LINES - 1].split(";")
    places: dict[str, int] = {}
    for name, unit in UNITS.items():
        if name not in names:
            msg = f"{path} line 3 names no column '{name}': give a run of the Robotino 2 data set"
            raise LogError(msg)
        place = names.index(name)
        if units[place : place + 1] != [unit]:
            msg = f"{path} line 2, column '{name}': the unit is not {unit}: convert the column"
            raise LogError(msg)
        places[name] = place
    return places


def _number(where: str, column: str, cell: str) -> float:
    try:
        number = float(cell)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise _wrong(where, column, f"'{cell}' is not a number")
    return number


def _wrong(where: str, column: str, what: str) -> LogError:
    return LogError(f"{where}, column '{column}': {what}: {_FIX}")


def _read_text(path: Path) -> str:
    try:
        raw = path.read_bytes()
        return (gzip.decompress(raw) if path.suffix == ".gz" else raw).decode()
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        msg = f"cannot read {path}: {error}: give a .csv or .csv.gz file"
        raise LogError(msg) from error
