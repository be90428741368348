"""Measured runs for identification: finds the files, names their surface, reads each kind into one form."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from controllers.slip.effort.motor_model import MotorSettings
from controllers.slip.effort.parameters import EFFORT
from drivers.errors import LogError
from drivers.files import resolved
from drivers.robotino_board.robotino_2 import ROBOTINO_BOARD, ROBOTINO_SCALES
from drivers.robotino_board.scales import MAX_RAW
from rover_hil.drives.marks import ENDING, FORMER_ENDING, marks_file
from rover_hil.drives.robotino_csv import board_counts, camera_poses, is_averages, read_record, record_names
from rover_hil.identify.slip.averages import read_average_runs
from rover_hil.identify.slip.form_windows import form_windows
from rover_hil.identify.slip.log_runs import read_log_run
from rover_hil.identify.slip.parameters import SLIP_FIT
from rover_hil.identify.slip.run_data import AlignedReadings, RunWindows

SUFFIXES = (".csv", ".csv.gz", ".mcap")
OF_A_LOG = (ENDING, FORMER_ENDING)
"""Files beside a log that are no runs of their own."""
SURFACE_ENDING = "_surface"


@dataclass(frozen=True, slots=True)
class RunFiles:
    """The files below some paths.

    Attributes:
        files: Those that may be runs.
        other_files: Files of another kind in the same folders, records of motors on a bench among them.
    """

    files: tuple[Path, ...]
    other_files: tuple[Path, ...]


def find_runs(paths: Sequence[Path]) -> RunFiles:
    """Return the run files among `paths` and in the folders among them, sorted.

    Raises:
        LogError: A path does not exist, or no file has a known ending.
    """
    files: set[Path] = set()
    other_files: set[Path] = set()
    for path in paths:
        if not path.exists():
            raise LogError(f"{path} does not exist: give a file or a folder of runs")
        inside = [path] if path.is_file() else sorted(item for item in path.rglob("*") if item.is_file())
        runs = [item for item in inside if item.name.endswith(SUFFIXES) and not item.name.endswith(OF_A_LOG)]
        if path.is_dir():
            runs = [item for item in runs if not _is_motor_record(item)]
        if not runs:
            raise LogError(
                f"{path} holds no run with a camera: expected files that end in {', '.join(SUFFIXES)}"
            )
        files.update(runs)
        of_runs = {marks_file(run) for run in runs}
        other_files.update(set(inside) - set(runs) - of_runs)
    return RunFiles(tuple(sorted(files)), tuple(sorted(other_files)))


def _is_motor_record(path: Path) -> bool:
    """Return whether a file is a record of the Robotino 2 data set without a camera."""
    names = [] if path.suffix == ".mcap" else record_names(path)
    return "m1pos" in names and "xpos" not in names


def surface_of(path: Path) -> str:
    """Return the surface that a file belongs to: its folder, or for averaged data the end of its name."""
    stem = path.name.split(".")[0]
    if stem.startswith("experimental_data_"):
        return stem.removeprefix("experimental_data_") + SURFACE_ENDING
    return resolved(path).parent.name


def surface_parts(name: str, known: Sequence[str]) -> list[str]:
    """Return the known surfaces in the name of a folder: `green_table` is green_surface and table_surface.

    A name that is known itself, or holds an unknown part, is returned as it is.
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
    if is_averages(path):
        return list(read_average_runs(path, surface, motor))
    run = read_log_run(path, surface) if path.suffix == ".mcap" else _read_csv_run(path, surface)
    _check_currents(run)
    return [form_windows(run, motor)]


def log_notes(runs: Sequence[AlignedReadings | RunWindows], rejected: Mapping[str, int]) -> list[str]:
    """Return which true poses the logs among runs were compared with, and how many windows were rejected."""
    truths = Counter(run.truth for run in runs if run.truth)
    notes = [f"truth of {count} log{'s' * (count > 1)}: {truth}" for truth, count in truths.items()]
    return notes + [
        f"{count} window{'s' * (count > 1)} rejected: {reason}" for reason, count in rejected.items()
    ]


def _read_csv_run(path: Path, surface: str) -> AlignedReadings:
    record = read_record(path, with_camera=True)
    counts, camera = board_counts(record), camera_poses(record.columns)
    t_ns = np.round(record.columns["t"] * 1e6)
    t_s = (t_ns - t_ns[0]) / 1e9
    poses = np.column_stack((camera.x_px, camera.y_px, camera.yaw_rad))
    currents_a = counts.current_raw * ROBOTINO_SCALES.current_a
    return AlignedReadings(
        path=path,
        surface=surface,
        t_s=t_s,
        position_rad=counts.ticks.astype(np.float64) * ROBOTINO_SCALES.position_rad,
        current_a=np.where(counts.current_raw < MAX_RAW, currents_a, np.inf),
        current_is_signed=False,
        set_speed_rad_s=record.of_motors("setvel") / ROBOTINO_BOARD.gear_ratio,
        camera_t_s=t_s[camera.is_new],
        camera=poses[camera.is_new],
        camera_in_pixels=True,
    )


def _check_currents(run: AlignedReadings) -> None:
    if len(run.t_s) < SLIP_FIT.window.least_run_readings:
        raise LogError(f"{run.path}: holds {len(run.t_s)} readings of the wheels: give the run of a drive")
    turned = np.abs(np.gradient(run.position_rad, run.t_s, axis=0)).max(axis=0) > EFFORT.motor.slowest_rad_s
    silent = turned & (np.abs(run.current_a) == 0.0).all(axis=0)
    if silent.any():
        wheel = int(np.argmax(silent))
        raise LogError(
            f"{run.path}: the current of wheel {wheel} is zero throughout although the wheel turns: "
            "it was not measured, and slip cannot be estimated from this run"
        )
