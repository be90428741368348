"""Read our own logs for identification of slip: wheel positions, currents and the true pose.

The true pose is that in the file of positions beside the log, see `hand_positions`, else that in the log.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from controllers.motion.rover_geometry import OmniRoverSettings
from drivers.errors import LogError
from rover_hil.drives.arrays import Array, Flags
from rover_hil.drives.channels import Channels
from rover_hil.drives.drive import Drive, read_drive
from rover_hil.drives.marks import marks_beside, read_marks
from rover_hil.identify.slip.hand_positions import poses_between
from rover_hil.identify.slip.parameters import SLIP_FIT
from rover_hil.identify.slip.run_data import WHEELS, AlignedReadings


def read_log_run(path: Path, surface: str) -> AlignedReadings:
    """Return the run in the log `path`.

    Raises:
        LogError: The log is damaged, is of another kind of rover, or lacks wheels, currents or the true pose.
    """
    drive = read_drive(path)
    rover, rows = drive.config.rover, drive.channels
    if not isinstance(rover, OmniRoverSettings):
        raise LogError(
            f"{path} is of a rover with kinematics '{rover.kinematics}': "
            "slip maps need three omnidirectional wheels"
        )
    for wheel in range(WHEELS):
        for name, word in ((f"position{wheel + 1}_rad", "positions"), (f"current{wheel + 1}_a", "currents")):
            if name not in rows:
                raise LogError(
                    f"log {path} holds no {word} of wheel {wheel}: slip cannot be measured with it"
                )
    position = [_series(rows, f"position{wheel}_rad") for wheel in range(1, WHEELS + 1)]
    current = [_series(rows, f"current{wheel}_a") for wheel in range(1, WHEELS + 1)]
    by_hand = marks_beside(path)
    fix_sd_m: Array | None
    if by_hand is not None:
        truth = _truth_by_hand(by_hand, drive)
        # No noise makes a window longer, but one outside the legs has no pose near.
        source, fix_sd_m = f"positions in {by_hand.name}", np.zeros(len(truth))
    else:
        true = drive.true_poses()
        truth = np.column_stack((true.t_ns / 1e9, true.x_m, true.y_m, true.yaw_rad))
        source = true.source
        fix_sd_m = np.hypot(true.position_sd_m, rover.base_radius_m * true.yaw_sd_rad)
        fix_sd_m = None if true.is_exact else fix_sd_m
    _check_numbers(path, (*position, *current, truth))
    _check_clock(path, (*position, *current, truth))
    t_s = position[0][:, 0]
    _check_positions(path, position, t_s)
    origin_s = float(t_s[0])
    return AlignedReadings(
        path=path,
        surface=surface,
        t_s=t_s - origin_s,
        position_rad=np.column_stack([np.interp(t_s, table[:, 0], table[:, 1]) for table in position]),
        current_a=np.column_stack(
            [np.where(_is_near(table, t_s), np.interp(t_s, *table.T), np.nan) for table in current]
        ),
        current_is_signed=1 not in rows.unsigned_wheels,
        set_speed_rad_s=np.column_stack([_held(_series(rows, f"set{n}_rad_s"), t_s) for n in (1, 2, 3)]),
        camera_t_s=truth[:, 0] - origin_s,
        camera=truth[:, 1:],
        camera_in_pixels=False,
        rover=rover,
        truth=source,
        fix_sd_m=fix_sd_m,
    )


def _truth_by_hand(path: Path, drive: Drive) -> Array:
    """Return rows of time in s, x, y, yaw at the readings of the first wheel between positions in a file."""
    rolled = drive.rolled(1)
    assert rolled is not None  # noqa: S101 the wheels have positions
    t_s, moved = rolled[0] / 1e9, np.diff(rolled[1], axis=0)
    yaw = np.cumsum(moved[:, 2]) - 0.5 * moved[:, 2]
    steps_m = (moved[:, 0] + 1j * moved[:, 1]) * np.exp(1j * yaw)
    by_wheels_m = np.concatenate(([0.0], np.cumsum(steps_m)))
    poses = poses_between(read_marks(path), path, t_s - drive.log.start_ns / 1e9, by_wheels_m)
    known = np.isfinite(poses).all(axis=1)
    return np.column_stack((t_s, poses))[known]


def _series(rows: Channels, name: str) -> Array:
    """Return rows of time in s and value."""
    readings = rows[name]
    return np.column_stack((readings.t_ns / 1e9, readings.value))


def _check_numbers(path: Path, tables: Sequence[Array]) -> None:
    if not all(np.isfinite(table).all() for table in tables):
        raise LogError(
            f"log {path} holds samples or true poses that are not numbers: it is damaged, record it again"
        )


def _check_clock(path: Path, tables: Sequence[Array]) -> None:
    if any((np.diff(table[:, 0]) <= 0.0).any() for table in tables):
        raise LogError(f"log {path}: its clock goes backwards or does not advance: the run cannot be used")


def _check_positions(path: Path, tables: Sequence[Array], t_s: Array) -> None:
    for wheel, table in enumerate(tables):
        silent = ~_is_near(table, t_s)
        if silent.any():
            begins_s = float(t_s[np.argmax(silent)] - t_s[0])
            raise LogError(
                f"log {path}: wheel {wheel} gives no position {begins_s:.2f} s after wheel 0's first, while "
                "others do: check its encoder, the run cannot be used"
            )


def _is_near(table: Array, t_s: Array) -> Flags:
    """Return which times have a reading of `table` near enough."""
    after = np.searchsorted(table[:, 0], t_s).clip(0, len(table) - 1)
    before = (after - 1).clip(0)
    away_s = np.minimum(np.abs(table[after, 0] - t_s), np.abs(table[before, 0] - t_s))
    near: Flags = away_s <= SLIP_FIT.window.longest_gap_s
    return near


def _held(set_points: Array, t_s: Array) -> Array:
    """Return the newest setpoint at each time; NaN before the first."""
    table = np.concatenate(([(0.0, np.nan)], set_points))
    held: Array = table[np.searchsorted(table[:, 0], t_s, side="right") - 1, 1]
    return held
