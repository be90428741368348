"""Delay of the wheels behind their setpoints, and noise and delay of the gyro, of each drive by a formula."""

import math
from collections.abc import Sequence

import numpy as np

from controllers.motion.kinematics import make_kinematics
from drivers.errors import LogError
from rover_hil.diagnose.replayed_drive import ReplayedDrive
from rover_hil.drives.arrays import Array
from rover_hil.drives.channels import Readings
from rover_hil.ready.time.fit import find_offsets, tracks_of

ROUNDS = 8
SETTLED_S = 1e-4
LONGEST_S = 1.0
"""A longer delay is none of the wheels."""
LEAST_READINGS = 50
THIRD_DIFFERENCE = (-1.0, 3.0, -3.0, 1.0)
MEDIAN_OF_NORMAL = 0.6745
"""Median of the absolute value of a standard normal number."""


def set_point_delays_s(drives: Sequence[ReplayedDrive]) -> list[list[float]]:
    """Return by how much each driven wheel is behind its setpoints, of each drive that shows it.

    The angle of a wheel is that of its setpoints some time before. Least squares over the delay, the share of
    the setpoints that the wheel reaches, the speed that friction takes, and the angle at the start; the delay
    by Newton's steps.
    """
    return [_delays_of(each) for each in drives]


def _delays_of(each: ReplayedDrive) -> list[float]:
    channels = each.drive.channels
    kinematics = make_kinematics(each.drive.config.rover)
    delays = []
    for wheel in range(1, kinematics.wheel_count + 1):
        angle, setpoint = channels[f"position{wheel}_rad"], channels[f"set{wheel}_rad_s"]
        if wheel - 1 in kinematics.undriven or min(len(angle), len(setpoint)) < LEAST_READINGS:
            continue
        delay_s = delay_behind_s(angle, setpoint)
        if math.isfinite(delay_s):
            delays.append(delay_s)
    return delays


def delay_behind_s(angle: Readings, setpoint: Readings) -> float:
    """Return the delay of one wheel; NaN where these readings do not show it."""
    start_ns = setpoint.t_ns[0]
    set_s, first = np.unique((setpoint.t_ns - start_ns) / 1e9, return_index=True)
    speed, steps_s = setpoint.value[first], np.diff(set_s)
    turned, taken = (
        np.concatenate(([0.0], np.cumsum(each[:-1] * steps_s))) for each in (speed, np.sign(speed))
    )
    t_s = (angle.t_ns - start_ns) / 1e9
    inside = (t_s > LONGEST_S) & (t_s < set_s[-1])
    t_s, measured = t_s[inside], angle.value[inside]
    if len(t_s) < LEAST_READINGS:
        return math.nan
    delay_s = 0.0
    for _ in range(ROUNDS):
        late_s = t_s - delay_s
        held = speed[np.clip(np.searchsorted(set_s, late_s, side="right") - 1, 0, None)]
        others = [np.interp(late_s, set_s, each) for each in (turned, taken)] + [np.ones(len(t_s))]
        columns = np.column_stack((*others, held))
        if np.linalg.matrix_rank(columns) == np.linalg.matrix_rank(columns[:, :-1]):
            return math.nan
        share, _, _, behind = np.linalg.lstsq(columns, measured, rcond=None)[0].tolist()
        if share < 0.5:  # the wheel does not follow
            return math.nan
        step_s = -behind / share
        delay_s += step_s
        if abs(step_s) < SETTLED_S:
            return max(delay_s, 0.0) if -SETTLED_S <= delay_s <= LONGEST_S else math.nan
    return math.nan


def gyro_noises_rad_s(drives: Sequence[ReplayedDrive], rate_hz: float) -> list[list[float]]:
    """Return the standard deviation of a reading of the gyro, if it sent so many per second, of each drive.

    Third differences leave the noise and little of the motion, and their median none of its edges.
    White noise of fewer readings is smaller, as a sensor takes means.
    """
    noises: list[list[float]] = []
    for each in drives:
        rate = each.drive.channels["gyro_z_rad_s"]
        if len(rate) < LEAST_READINGS:
            noises.append([])
            continue
        t_ns, first = np.unique(rate.t_ns, return_index=True)
        rest: Array = np.convolve(rate.value[first], THIRD_DIFFERENCE, "valid")
        size = math.sqrt(sum(share**2 for share in THIRD_DIFFERENCE)) * MEDIAN_OF_NORMAL
        own_hz = 1e9 / float(np.median(np.diff(t_ns)))
        noises.append([float(np.median(np.abs(rest))) / size * math.sqrt(rate_hz / own_hz)])
    return noises


def gyro_delays_s(drives: Sequence[ReplayedDrive]) -> list[list[float]]:
    """Return by how much the gyro is later than the wheels, of each drive that shows it: `calibrate time`."""
    delays: list[list[float]] = []
    for each in drives:
        try:
            tracks = tracks_of(each.drive)
        except LogError:  # it does not turn
            tracks = []
        pair = [track for track in tracks if track.kind in ("gyro", "wheels")]
        if len(pair) != 2 or pair[0].device != each.drive.config.roles.gyro:
            delays.append([])
            continue
        delays.append([-offset.offset_s for offset in find_offsets(pair) if not offset.problem])
    return delays
