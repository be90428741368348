"""Measured runs for identification: finds the files, names their surface, reads each kind into one form."""

import gzip
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from controllers.slip.effort.motor_model import SLOWEST_RAD_S, MotorSettings
from drivers.errors import LogError
from drivers.robotino_board.codec import MAX_RAW, parse_reply, scales
from drivers.robotino_board.settings import RobotinoBoardSettings
from rover_hil.identify.averaged_csv import is_averaged_csv, read_averaged_csv
from rover_hil.identify.log_runs import read_log_run
from rover_hil.identify.run_data import MeasuredRun, RunWindows
from rover_hil.identify.windows import form_windows
from rover_hil.importing.robotino_csv import read_run

SUFFIXES = (".csv", ".csv.gz", ".mcap")
SURFACE_ENDING = "_surface"
NAMES_LINE = 3

_BOARD = RobotinoBoardSettings(type="robotino_board", port="none", board="EA05")
_SCALES = scales(_BOARD)
_TRUTH_SCALE_MM_PER_PX = 1000.0
"""With this scale the camera's metres are pixels: the true scale is found later."""


@dataclass(frozen=True, slots=True)
class RunFiles:
    """The files below some paths.

    Attributes:
        files: Those that may be runs.
        passed_over: Those that lie in a folder with them and are of another kind; also records of motors on a
            bench, without a camera.
    """

    files: tuple[Path, ...]
    passed_over: tuple[Path, ...]


def find_runs(paths: Sequence[Path]) -> RunFiles:
    """Return the run files among `paths` and in the folders among them, sorted.

    Raises:
        LogError: A path does not exist, or no file has a known ending.
    """
    found: set[Path] = set()
    passed_over: set[Path] = set()
    for path in paths:
        if not path.exists():
            msg = f"{path} does not exist: give a file or a folder of runs"
            raise LogError(msg)
        inside = [path] if path.is_file() else sorted(item for item in path.rglob("*") if item.is_file())
        runs = [item for item in inside if item.name.endswith(SUFFIXES)]
        if path.is_dir():
            runs = [item for item in runs if not _is_motor_record(item)]
        if not runs:
            msg = f"{path} holds no run with a camera: expected files that end in {', '.join(SUFFIXES)}"
            raise LogError(msg)
        found.update(runs)
        passed_over.update(set(inside) - set(runs))
    return RunFiles(tuple(sorted(found)), tuple(sorted(passed_over)))


def _is_motor_record(path: Path) -> bool:
    """Tell whether a file is a wheel record of the Robotino 2 data set without a camera in its header."""
    if path.suffix == ".mcap":
        return False
    opened = gzip.open if path.suffix == ".gz" else open
    try:
        with opened(path, "rt", encoding="utf-8") as stream:
            names = [stream.readline() for _ in range(NAMES_LINE)][-1].split(";")
    except (OSError, EOFError, zlib.error, UnicodeDecodeError):
        return False  # reading it as a run says what is wrong with it
    return "m1pos" in names and "xpos" not in names


def surface_of(path: Path) -> str:
    """Return the surface that a file belongs to: its folder, or for averaged data the end of its name."""
    stem = path.name.split(".")[0]
    if stem.startswith("experimental_data_"):
        return stem.removeprefix("experimental_data_") + SURFACE_ENDING
    return path.resolve().parent.name


def surface_parts(name: str, known: Sequence[str]) -> list[str]:
    """Return the known surfaces that a folder's name tells: `green_table` is green_surface and table_surface.

    A name that is known itself, or tells something unknown, is returned as it is.
    """
    by_stem = {surface.removesuffix(SURFACE_ENDING): surface for surface in known}
    stems = name.removesuffix(SURFACE_ENDING).split("_")
    if name in known or len(stems) < 2 or not all(stem in by_stem for stem in stems):
        return [name]
    return [by_stem[stem] for stem in stems]


def read_windows(path: Path, motor: MotorSettings) -> list[RunWindows]:
    """Return the runs in one file, cut into windows.

    Raises:
        LogError: It cannot be read, or lacks something that identification needs; the message names it.
    """
    surface = surface_of(path)
    if is_averaged_csv(path):
        return list(read_averaged_csv(path, surface, motor))
    run = read_log_run(path, surface) if path.suffix == ".mcap" else _read_csv_run(path, surface)
    _check_currents(run)
    return [form_windows(run, motor)]


def _read_csv_run(path: Path, surface: str) -> MeasuredRun:
    rows = read_run(path, _TRUTH_SCALE_MM_PER_PX).rows
    replies = [parse_reply(row.reply_frame) for row in rows]
    seen = [row for row in rows if row.truth_is_new]
    t0_ns = rows[0].t_ns
    current_raw = np.array([reply.current_raw for reply in replies], dtype=np.float64)
    return MeasuredRun(
        path=path,
        surface=surface,
        t_s=np.array([(row.t_ns - t0_ns) / 1e9 for row in rows]),
        position_rad=np.array([reply.ticks for reply in replies]) * _SCALES.position_rad,
        current_a=np.where(current_raw < MAX_RAW, current_raw * _SCALES.current_a, np.inf),
        current_is_signed=False,
        set_speed_rad_s=np.array([row.set_speed_rad_s for row in rows]),
        camera_t_s=np.array([(row.t_ns - t0_ns) / 1e9 for row in seen]),
        camera=np.array([(row.truth_x_m, row.truth_y_m, row.truth_yaw_rad) for row in seen]),
        camera_in_pixels=True,
    )


def _check_currents(run: MeasuredRun) -> None:
    turned = np.abs(np.gradient(run.position_rad, run.t_s, axis=0)).max(axis=0) > SLOWEST_RAD_S
    silent = turned & (np.abs(run.current_a) == 0.0).all(axis=0)
    if silent.any():
        wheel = int(np.argmax(silent))
        msg = (
            f"{run.path}: the current of wheel {wheel} is zero throughout although the wheel turns: "
            "it was not measured, and slip cannot be told from this run"
        )
        raise LogError(msg)
