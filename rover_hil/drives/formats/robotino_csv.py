"""Measured Robotino 2 runs as replies of their board, so that they can be replayed through its codec."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.errors import ConfigError
from drivers.robotino_board.codec import BoardReply, Counts, build_reply
from drivers.robotino_board.robotino_2 import ROBOTINO_BOARD
from rover_hil.drives.robotino_csv import board_counts, camera_poses, read_record
from rover_hil.recording.schema import TruthRecord

LARGEST_MM_PER_PX = 1000.0
START_NS = NANOSECONDS_PER_SECOND
"""Time given to t = 0 of a run: not zero, so that an unset time stamp cannot pass for a real one."""


class BoardRow(NamedTuple):
    """One row of a measured run.

    Attributes:
        t_ns: Its time; the run's t = 0 is `START_NS`.
        reply_frame: The board's reply with this row's ticks, speeds and currents. Battery and system current
            are 0, the bumper is free and the time count is the row's t: the file does not hold them.
        set_speed_rad_s: Setpoint of each wheel, at the wheel.
        truth: Pose by the overhead camera; its frame is described in `rover_hil.drives.robotino_csv`. Not new
            where the camera's numbers are those of the row before.
    """

    t_ns: int
    reply_frame: bytes
    set_speed_rad_s: tuple[float, float, float]
    truth: TruthRecord


def read_run(path: Path, millimetres_per_pixel: float) -> list[BoardRow]:
    """Read one run from a `.csv` or `.csv.gz` file.

    Args:
        path: The file.
        millimetres_per_pixel: Scale of the camera: 1.84 in the data set's own file, 2.05 to 2.08 by
            the runs on the smooth table.

    Raises:
        ConfigError: The scale is not a positive number, or too large for a camera.
        LogError: The file cannot be read, or holds something wrong; the message names line and column.
    """
    if not 0 < millimetres_per_pixel <= LARGEST_MM_PER_PX:
        raise ConfigError(
            f"millimetres per pixel must be a positive number up to {LARGEST_MM_PER_PX:g}, "
            f"not {millimetres_per_pixel}"
        )
    record = read_record(path, with_camera=True)
    counts, camera = board_counts(record), camera_poses(record.columns)
    m_per_px = millimetres_per_pixel / 1000.0
    set_speeds = record.of_motors("setvel") / ROBOTINO_BOARD.gear_ratio
    times_ms = record.columns["t"]
    columns = zip(
        (START_NS + np.round(times_ms * 1e6).astype(np.int64)).tolist(),
        np.round(times_ms).astype(np.int64).tolist(),
        zip(*(np.asarray(values).tolist() for values in counts), strict=True),
        set_speeds.tolist(),
        (camera.x_px * m_per_px).tolist(),
        (camera.y_px * m_per_px).tolist(),
        camera.yaw_rad.tolist(),
        camera.is_new.tolist(),
        strict=True,
    )
    return [
        BoardRow(
            t_ns,
            _reply_frame(t_ms, *map(tuple, counted)),
            tuple(set_speed),
            {"t_ns": t_ns, "x_m": x_m, "y_m": y_m, "yaw_rad": yaw_rad, "is_new": is_new},
        )
        for t_ns, t_ms, counted, set_speed, x_m, y_m, yaw_rad, is_new in columns
    ]


def _reply_frame(t_ms: int, ticks: Counts, steps: Counts, currents: Counts) -> bytes:
    return build_reply(
        BoardReply(
            ticks=ticks,
            speed_steps=steps,
            current_raw=currents,
            battery_raw=0,
            system_current_raw=0,
            bumper_pressed=False,
            time_ms=t_ms,
            board=ROBOTINO_BOARD.board,
        )
    )
