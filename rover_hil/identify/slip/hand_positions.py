"""True poses of a log that were measured by hand while the rover stood: by tape, in a file beside the log.

Between two of them the slip is taken as constant: the rover is put on the way from one to the other in
proportion to the travel of its wheels. So a leg shows the mean slip, and not how it scatters along the way.
"""

from pathlib import Path

import numpy as np

from drivers.errors import LogError
from rover_hil.datasets.arrays import Array
from rover_hil.datasets.csv_table import read_csv
from rover_hil.identify.slip.parameters import SLIP_FIT

ENDING = ".positions.csv"
NAMES = ("t_s", "x_m", "y_m", "yaw_deg")


def positions_file(log: Path) -> Path:
    """Return where the positions of a log would be: `run.positions.csv` beside `run.mcap`."""
    return log.with_name(log.name.removesuffix(".mcap") + ENDING)


def read_hand_positions(path: Path) -> Array:
    """Return rows of time in s since the start of the log, x and y in m, and yaw in rad, unwrapped.

    Raises:
        LogError: The file cannot be read, lacks a column, holds fewer than two rows, or its times do not
            increase.
    """
    table = read_csv(path)
    missing = [name for name in NAMES if name not in table.names]
    if missing:
        raise LogError(
            f"{path} has no column '{missing[0]}': its first line must be {','.join(NAMES)}, then a line for "
            "each place where the rover stood"
        )
    rows: Array = np.column_stack([table.numbers(name, is_needed=True) for name in NAMES])
    if len(rows) < 2 or (np.diff(rows[:, 0]) <= 0.0).any():
        raise LogError(f"{path}: give at least two places, their times t_s increasing")
    rows[:, 3] = np.unwrap(np.radians(rows[:, 3]))
    return rows


def poses_between(positions: Array, path: Path, t_s: Array, way_m: Array) -> Array:
    """Return the pose at each reading of the wheels: rows of x, y in m, yaw in rad; NaN outside the legs.

    Args:
        positions: By `read_hand_positions`.
        path: Their file, for messages.
        t_s: Times of the readings since the start of the log, (n,).
        way_m: Distance that the wheels have travelled until each, (n,).

    Raises:
        LogError: A time is outside the log or one at which the wheels turn, or a leg is too short for the
            error of a tape, or longer than the wheels' travel.
    """
    times_s = positions[:, 0]
    hand = SLIP_FIT.hand
    if times_s[0] < t_s[0] - hand.rest_s or times_s[-1] > t_s[-1] + hand.rest_s:
        raise LogError(f"{path}: t_s must be within the log, {t_s[0]:.1f} to {t_s[-1]:.1f} s after its start")
    around_m = np.interp(times_s + 0.5 * hand.rest_s, t_s, way_m) - np.interp(
        times_s - 0.5 * hand.rest_s, t_s, way_m
    )
    if (around_m > hand.rest_m).any():
        moving_s = float(times_s[np.argmax(around_m > hand.rest_m)])
        raise LogError(
            f"{path}: the wheels turn at t_s = {moving_s:g}: give a time at which the rover stood; "
            "`rover-hil report` shows the speeds over time"
        )
    at_m = np.interp(times_s, t_s, way_m)
    legs_m = np.diff(at_m)
    least_m = np.sqrt(2.0) * hand.tape_sd_m / SLIP_FIT.window.slip_sd
    if (legs_m < least_m).any():
        raise LogError(
            f"{path}: the wheels travel {legs_m.min():.2f} m between two places, too little for the error of "
            f"a tape ({1e3 * hand.tape_sd_m:g} mm): drive at least {least_m:.2f} m"
        )
    apart_m = np.hypot(*np.diff(positions[:, 1:3], axis=0).T)
    too_far = apart_m > SLIP_FIT.window.jump_share * legs_m
    if too_far.any():
        leg = int(np.argmax(too_far))
        raise LogError(
            f"{path}: places {leg + 1} and {leg + 2} are {apart_m[leg]:.2f} m apart, further than the wheels "
            f"can have moved ({legs_m[leg]:.2f} m): check the numbers, in m"
        )
    poses: Array = np.column_stack([np.interp(way_m, at_m, column) for column in positions[:, 1:].T])
    poses[(way_m < at_m[0]) | (way_m > at_m[-1])] = np.nan
    return poses
