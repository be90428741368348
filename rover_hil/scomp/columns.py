"""Turn the columns of a recorded drive into a `SensorRows`, for any set of sensors."""

from collections.abc import Mapping

import numpy as np

from drivers.errors import LogError
from rover_hil.drives.arrays import Array
from rover_hil.scomp.drive import SensorRows

WHEELS = ("position1_rad", "position2_rad", "position3_rad", "position4_rad")
"""Front left, front right, rear left, rear right; the order matters without a gyro only."""
LEFT = ("position1_rad", "position3_rad")
SENSORS = (
    "heading_deg",
    "yaw_rate_deg_s",
    "pitch_deg",
    "roll_deg",
    "beta_ftrace_deg",
    "beta_valid",
    "beta_new",
    "steering_deg",
)
FIXES = ("fix_x_m", "fix_y_m")
KNOWN = ("t_s", *WHEELS, *SENSORS, *FIXES)

LONGEST_HOLD_S = 1.0
"""A compass that repeats a reading for a longer time has not moved."""
LONGEST_FILLED_S = 1.0
"""Longer gaps of a sensor are reported."""
LARGEST_ENCODER_DIFFERENCE = 0.3


def drive_of(columns: Mapping[str, Array], where: str) -> tuple[SensorRows, list[str]]:
    """Return the drive, and a sentence for each change to the data.

    Args:
        columns: By name as in `KNOWN`, all of one length, NaN for empty cells; only `t_s` and one encoder
            are required.
        where: Name of the source in errors.

    Raises:
        LogError: A column is missing or the times do not increase.
    """
    t_s = _times(columns, where)
    notes: list[str] = []
    turned = _wheels(columns, t_s, where, notes)
    left = [turned[name] for name in turned if name in LEFT]
    right = [turned[name] for name in turned if name not in LEFT]
    difference = np.zeros_like(t_s) if not (left and right) else 0.5 * (_mean(right) - _mean(left))
    fix = [columns[name] for name in FIXES if name in columns]
    drive = SensorRows(
        t_s=t_s,
        wheel_rad=_mean(list(turned.values())),
        wheel_yaw_rad=difference,
        compass_rad=_compass(columns, t_s),
        gyro_rad_s=_filled(columns, "yaw_rate_deg_s", t_s, notes),
        pitch_rad=_filled(columns, "pitch_deg", t_s, notes),
        roll_rad=_filled(columns, "roll_deg", t_s, notes),
        trace_rad=_trace(columns),
        steering_rad=_filled(columns, "steering_deg", t_s, notes),
        fix_m=np.column_stack(fix) if len(fix) == 2 and np.isfinite(fix[0]).any() else None,
    )
    return drive, notes


def _times(columns: Mapping[str, Array], where: str) -> Array:
    if "t_s" not in columns:
        raise LogError(f"{where} has no column 't_s': give the times in seconds")
    t_s = columns["t_s"]
    if len(t_s) < 2:
        raise LogError(f"{where} has {len(t_s)} rows, an odometry needs two: give a longer log")
    wrong = np.flatnonzero(~(np.diff(t_s) > 0.0))
    if wrong.size:
        raise LogError(
            f"{where}: the time does not increase or is missing after {t_s[wrong[0]]:g} s: sort the rows"
        )
    return t_s


def _wheels(columns: Mapping[str, Array], t_s: Array, where: str, notes: list[str]) -> dict[str, Array]:
    """Return the angles turned since the start, without wheels that contradict the others."""
    turned: dict[str, Array] = {}
    for name in WHEELS:
        values = _numbers(columns, name)
        if values is None:
            notes.append(f"no {name}: the mean of the other wheels is used")
            continue
        seen = np.isfinite(values)
        filled = np.interp(t_s, t_s[seen], values[seen])
        turned[name] = filled - filled[0]
    if not turned:
        raise LogError(f"{where} has no wheel encoder: give at least one of {', '.join(WHEELS)}")
    typical = float(np.median([abs(values[-1]) for values in turned.values()]))
    forward = sum(values[-1] > 0.5 * typical for values in turned.values())
    backwards = [name for name, values in turned.items() if values[-1] < -0.5 * typical]
    if 0 < len(backwards) < forward:
        notes.append(f"{', '.join(backwards)} turned against the others: its sign is inverted")
        turned = {name: -values if name in backwards else values for name, values in turned.items()}
    centre = float(np.median([values[-1] for values in turned.values()]))
    odd = [n for n, v in turned.items() if abs(v[-1] - centre) > LARGEST_ENCODER_DIFFERENCE * abs(centre)]
    if odd and len(odd) < len(turned):
        notes.append(f"{', '.join(odd)} turned by another angle than the other wheels: not used")
        turned = {name: values for name, values in turned.items() if name not in odd}
    return turned


def _compass(columns: Mapping[str, Array], t_s: Array) -> Array | None:
    """Return the compass' readings; a reading equal to the last is a repetition and NaN."""
    values = _numbers(columns, "heading_deg")
    if values is None:
        return None
    fresh = values.copy()
    last, last_s = np.nan, -np.inf
    for index, value in enumerate(values.tolist()):
        if value == last and t_s[index] - last_s < LONGEST_HOLD_S:
            fresh[index] = np.nan
        elif np.isfinite(value):
            last, last_s = value, t_s[index]
    seen = np.isfinite(fresh)
    unwrapped = np.full_like(fresh, np.nan)
    unwrapped[seen] = np.unwrap(np.radians(fresh[seen]))
    return unwrapped


def _trace(columns: Mapping[str, Array]) -> Array | None:
    """Return new, valid trace angles; without `beta_new` an angle is new when it changes."""
    values = _numbers(columns, "beta_ftrace_deg")
    if values is None:
        return None
    use = np.isfinite(values)
    valid = _numbers(columns, "beta_valid")
    if valid is not None:
        use &= valid > 0.5
    new = _numbers(columns, "beta_new")
    if new is not None:
        use &= new > 0.5
    else:
        use[1:] &= values[1:] != values[:-1]
    return np.where(use, np.radians(values), np.nan) if use.any() else None


def _filled(columns: Mapping[str, Array], name: str, t_s: Array, notes: list[str]) -> Array | None:
    """Return a column in deg as rad, its empty cells interpolated linearly."""
    values = _numbers(columns, name)
    if values is None:
        return None
    seen = np.isfinite(values)
    # Also before the first and after the last.
    gap_s = float(np.diff(np.concatenate((t_s[:1], t_s[seen], t_s[-1:]))).max())
    if gap_s > LONGEST_FILLED_S:
        notes.append(f"{name} has no data for {gap_s:.1f} s: interpolated linearly")
    filled: Array = np.radians(np.interp(t_s, t_s[seen], values[seen]))
    return filled


def _numbers(columns: Mapping[str, Array], name: str) -> Array | None:
    values = columns.get(name)
    return None if values is None or not np.isfinite(values).any() else values


def _mean(values: list[Array]) -> Array:
    mean: Array = np.mean(values, axis=0)
    return mean
