"""Paths of a recorded drive: by its wheels, its gyro, its ground truth and its positions."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from controllers.motion.kinematics import Kinematics
from drivers.samples import UNKNOWN_YAW_STD_RAD
from rover_hil.drives.arrays import Array, Times
from rover_hil.drives.channels import Channels, Readings
from rover_hil.drives.ground_truth import measured_poses

STEP_S = 0.1
"""Of the path of the wheels."""
LEAST_STEPS = 20
LONGEST_S = 1e6
"""A drive of more, eleven days, is one with a gap of days in it: it is not compared."""
STEERING_STEP = 0.001
"""Share of the largest steering angle to which all are rounded: equal angles are computed once."""
JITTERS = 3.0
"""Errors of positions last longer than from one to the next."""
GROUND_TRUTH, POSITIONS = "ground truth", "positions"


@dataclass(frozen=True, slots=True)
class DrivePath:
    """Poses along a drive, n.

    Attributes:
        yaw_rad: Unwrapped; None where it is not measured.
        sd_m: Standard deviation of x and of y, at most; 0 where none is known.
        arm_m: Where on the rover the places are, ahead as real part; 0 where the origin is.
    """

    t_s: Array
    x_m: Array
    y_m: Array
    yaw_rad: Array | None
    sd_m: float = 0.0
    arm_m: complex = 0j

    def steps(self, edges_s: Array) -> tuple[Array, Array]:
        """Return chords and turns between times; turns of zero where the yaw is not measured."""
        x_m, y_m = (np.diff(np.interp(edges_s, self.t_s, values)) for values in (self.x_m, self.y_m))
        if self.yaw_rad is None:
            return np.hypot(x_m, y_m), np.zeros(len(x_m))
        return np.hypot(x_m, y_m), np.diff(np.interp(edges_s, self.t_s, self.yaw_rad))


def integrated(rate: Readings) -> Array:
    """Return the integral of a rate up to each of its readings, from 0."""
    steps = 0.5 * (rate.value[1:] + rate.value[:-1]) * np.diff(rate.t_ns) / 1e9
    return np.concatenate(([0.0], np.cumsum(steps)))


def wheel_angles(rows: Channels, wheel: int) -> tuple[Times, Array] | None:
    """Return how far a wheel, from 1, has turned; by its speeds where it has no angle; None without both."""
    readings = rows[f"position{wheel}_rad"]
    if len(readings) > 1:
        return readings.t_ns, readings.value
    readings = rows[f"speed{wheel}_rad_s"]
    if len(readings) < 2:
        return None
    return readings.t_ns, integrated(readings)


def wheel_steps(
    rows: Channels, kinematics: Kinematics, step_s: float, least: int
) -> tuple[Array, Array] | None:
    """Return edges of n equal steps in ns, (n + 1,), and how far each wheel turned, (n, wheels).

    Zero for a wheel without an encoder; None where another is not measured, or for `least` steps and fewer.
    """
    count = kinematics.wheel_count
    measured = [wheel for wheel in range(count) if wheel not in kinematics.unmeasured]
    known = [series for wheel in measured if (series := wheel_angles(rows, wheel + 1)) is not None]
    if len(known) < len(measured) or not known:
        return None
    begin_ns, end_ns = max(times[0] for times, _ in known), min(times[-1] for times, _ in known)
    if end_ns - begin_ns > LONGEST_S * 1e9:
        return None
    edges_ns = np.arange(begin_ns, end_ns, step_s * 1e9)
    if len(edges_ns) <= least:
        return None
    turned = np.zeros((len(edges_ns) - 1, count))
    turned[:, measured] = np.column_stack(
        [np.diff(np.interp(edges_ns, times, angles)) for times, angles in known]
    )
    return edges_ns, turned


def places_of(rows: Channels) -> Iterator[tuple[str, DrivePath]]:
    """Yield `GROUND_TRUTH` and `POSITIONS`, where there are such, and their places."""
    x, y, yaw = (rows[name] for name in ("x_m", "y_m", "yaw_rad"))
    if len(x) > 1:
        yaw_rad = np.unwrap(yaw.value) if len(yaw) == len(x) else None
        yield GROUND_TRUTH, DrivePath(x.t_ns / 1e9, x.value, y.value, yaw_rad)
    fixes = measured_poses(rows)
    if fixes is not None and len(fixes.t_ns) > 1:
        has_yaw = bool((fixes.yaw_sd_rad < UNKNOWN_YAW_STD_RAD).all())
        yaw_rad = fixes.yaw_rad if has_yaw else None
        # A reported standard deviation may be a guess: what changes from reading to reading bounds it.
        places = fixes.x_m + 1j * fixes.y_m
        jitter_m = float(np.median(np.abs(np.diff(places, 2)))) if len(places) > 2 else math.inf
        sd_m = min(float(np.median(fixes.position_sd_m)), JITTERS * jitter_m)
        arm_m = 0j if has_yaw else fixes.arm_m
        yield POSITIONS, DrivePath(fixes.t_ns / 1e9, fixes.x_m, fixes.y_m, yaw_rad, sd_m, arm_m)


def rounded_angles(steering_rad: Array) -> Array:
    """Return steering angles, of any shape, in steps that are finer than any steering is set up."""
    step_rad = STEERING_STEP * float(np.abs(steering_rad).max(initial=0.0))
    return np.round(steering_rad / step_rad) * step_rad if step_rad > 0.0 else steering_rad


def effects_of(kinematics: Kinematics, steering_rad: Array | None) -> Array:
    """Return the motion of the body per angle of each wheel, shape (n or 1, wheels, 3).

    Args:
        kinematics: Of the wheels.
        steering_rad: Steering angles, shape (n, wheels); None where none steers.
    """
    if steering_rad is None:
        return np.array([kinematics.wheel_effects()])
    angles, places = np.unique(steering_rad, axis=0, return_inverse=True)
    return np.array([kinematics.wheel_effects(row) for row in map(tuple, angles.tolist())])[places.ravel()]


def moves_of(turned_rad: Array, effects: Array) -> Array:
    """Return the motion of the body, shape (n, 3), by the angles of its wheels, shape (n, wheels)."""
    moves: Array = (turned_rad[:, :, np.newaxis] * effects).sum(axis=1)
    return moves


def path_of_gyro(rows: Channels) -> DrivePath | None:
    """Return how the rover turned by its gyro, at one place; None without one."""
    rate = rows["gyro_z_rad_s"]
    if len(rate) <= LEAST_STEPS:
        return None
    nowhere = np.zeros(len(rate))
    return DrivePath(rate.t_ns / 1e9, nowhere, nowhere, integrated(rate))


def path_of_wheels(rows: Channels, kinematics: Kinematics, late_s: float | None = None) -> DrivePath | None:
    """Return the path by the wheels, in steps; None where a wheel is not measured.

    Args:
        rows: The drive.
        kinematics: Of the wheels.
        late_s: Steering angles are corrected by so much, and the result is None where none steers.
    """
    stepped = wheel_steps(rows, kinematics, STEP_S, LEAST_STEPS)
    if stepped is None:
        return None
    edges_ns, turned = stepped
    readings = [rows[f"steer{wheel}_rad"] for wheel in range(1, kinematics.wheel_count + 1)]
    if late_s is not None and not any(map(len, readings)):
        return None
    steering = np.zeros_like(turned)
    for wheel, angles in enumerate(readings):
        if len(angles):
            steering[:, wheel] = np.interp(edges_ns[1:] + (late_s or 0.0) * 1e9, angles.t_ns, angles.value)
    has_steering = any(map(len, readings))
    moves = moves_of(turned, effects_of(kinematics, rounded_angles(steering) if has_steering else None))
    yaw_rad = np.concatenate(([0.0], np.cumsum(moves[:, 2])))
    along = (moves[:, 0] + 1j * moves[:, 1]) * np.exp(1j * 0.5 * (yaw_rad[1:] + yaw_rad[:-1]))
    place_m = np.concatenate(([0j], np.cumsum(along)))
    return DrivePath(edges_ns / 1e9, place_m.real, place_m.imag, yaw_rad)
