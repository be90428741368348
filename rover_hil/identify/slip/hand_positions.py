"""Poses between positions that were measured by hand while the rover stood, see `rover_hil.drives.marks`.

Between two of them the slip is taken as constant: the rover is put on the way from one to the other in
proportion to the travel of its wheels. So a leg shows the mean slip, and not how it scatters along the way.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.errors import LogError
from rover_hil.drives.arrays import Array
from rover_hil.drives.marks import Marks
from rover_hil.identify.slip.parameters import SLIP_FIT

Complex = NDArray[np.complex128]


def poses_between(marks: Marks, path: Path, t_s: Array, by_wheels_m: Complex) -> Array:
    """Return the pose at each reading of the wheels: rows of x, y in m, yaw in rad; NaN outside the legs.

    A leg on which the rover turned, or its wheels did not go straight, is none: where it was is not known.

    Args:
        marks: Those without a yaw are left out.
        path: Their file, for messages.
        t_s: Times of the readings since the start of the log, (n,).
        by_wheels_m: Place of rolling wheels at each, to the left as imaginary part, (n,).

    Raises:
        LogError: There are fewer than two, a time is outside the log or one at which the wheels turn, a leg
            is too short for the error of a tape or longer than the wheels' travel, or none is straight.
    """
    hand = SLIP_FIT.hand
    way_m = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(by_wheels_m)))))
    table = np.column_stack((marks.t_s, marks.x_m, marks.y_m, np.radians(marks.yaw_deg), marks.sigma_m))
    table = table[np.isfinite(table[:, 3])]
    if len(table) < 2:
        raise LogError(f"{path}: give at least two places with their yaw_deg")
    table[:, 3] = np.unwrap(table[:, 3])
    times_s = table[:, 0]
    if times_s[0] < t_s[0] - hand.rest_s or times_s[-1] > t_s[-1] + hand.rest_s:
        raise LogError(f"{path}: t_s must be within the log, {t_s[0]:.1f} to {t_s[-1]:.1f} s after its start")
    around_m = np.interp(times_s + 0.5 * hand.rest_s, t_s, way_m) - np.interp(
        times_s - 0.5 * hand.rest_s, t_s, way_m
    )
    if (around_m > hand.rest_m).any():
        moving_s = float(times_s[np.argmax(around_m > hand.rest_m)])
        raise LogError(
            f"{path}: the wheels turn at t_s = {moving_s:g}: give a time at which the rover stood; "
            "the report of the run shows the speeds over time, also by `rover-hil replay LOG --out FOLDER`"
        )
    at_m = np.interp(times_s, t_s, way_m)
    legs_m = np.diff(at_m)
    sd_m = float(table[:, 4].max())
    least_m = np.sqrt(2.0) * sd_m / SLIP_FIT.window.slip_sd
    if (legs_m < least_m).any():
        raise LogError(
            f"{path}: the wheels travel {legs_m.min():.2f} m between two places, too little for the error of "
            f"a tape ({1e3 * sd_m:g} mm): drive at least {least_m:.2f} m"
        )
    apart_m = np.hypot(*np.diff(table[:, 1:3], axis=0).T)
    too_far = apart_m > SLIP_FIT.window.jump_share * legs_m
    if too_far.any():
        leg = int(np.argmax(too_far))
        raise LogError(
            f"{path}: places {leg + 1} and {leg + 2} are {apart_m[leg]:.2f} m apart, further than the wheels "
            f"can have moved ({legs_m[leg]:.2f} m): check the numbers, in m"
        )
    chords_m = np.abs(np.diff(np.interp(times_s, t_s, by_wheels_m)))
    turns = np.abs(np.diff(table[:, 3])) > hand.most_turn_rad
    bends = turns | (chords_m < hand.straight_share * legs_m)
    if bends.all():
        raise LogError(f"{path}: the rover turns or bends on every leg: measure both ends of straight ones")
    poses: Array = np.column_stack([np.interp(way_m, at_m, column) for column in table[:, 1:4].T])
    poses[(way_m < at_m[0]) | (way_m > at_m[-1])] = np.nan
    for begin_m, end_m in zip(at_m[:-1][bends], at_m[1:][bends], strict=True):
        poses[(way_m > begin_m) & (way_m < end_m)] = np.nan
    return poses
