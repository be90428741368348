"""Paths of a recorded drive: by its wheels, by its truth and by its fixes."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controllers.motion.kinematics import Kinematics
from drivers.samples import UNKNOWN_YAW_STD_RAD
from rover_hil.drives.arrays import Array, Times
from rover_hil.drives.channels import Channels
from rover_hil.drives.ground_truth import measured_poses

STEP_S = 0.1
"""Of the path of the wheels."""
LEAST_STEPS = 20


@dataclass(frozen=True, slots=True)
class DrivePath:
    """Poses along a drive, n.

    Attributes:
        yaw_rad: Unwrapped; None where it is not measured.
    """

    t_s: Array
    x_m: Array
    y_m: Array
    yaw_rad: Array | None

    def body_steps(self, edges_s: Array) -> NDArray[np.complex128]:
        """Return what the rover went between times in its own frame, to the left as imaginary part.

        Zero where the yaw is not measured.
        """
        if self.yaw_rad is None:
            return np.zeros(max(0, len(edges_s) - 1), complex)
        x_m, y_m, yaw_rad = (
            np.interp(edges_s, self.t_s, values) for values in (self.x_m, self.y_m, self.yaw_rad)
        )
        middle_rad = 0.5 * (yaw_rad[1:] + yaw_rad[:-1])
        steps: NDArray[np.complex128] = (np.diff(x_m) + 1j * np.diff(y_m)) * np.exp(-1j * middle_rad)
        return steps

    def steps(self, edges_s: Array) -> tuple[Array, Array]:
        """Return chords and turns between times; turns of zero where the yaw is not measured."""
        x_m, y_m = (np.diff(np.interp(edges_s, self.t_s, values)) for values in (self.x_m, self.y_m))
        if self.yaw_rad is None:
            return np.hypot(x_m, y_m), np.zeros(len(x_m))
        return np.hypot(x_m, y_m), np.diff(np.interp(edges_s, self.t_s, self.yaw_rad))


def wheel_angles(rows: Channels, wheel: int) -> tuple[Times, Array] | None:
    """Return how far a wheel, from 1, has turned; by its speeds where it has no angle; None without both."""
    readings = rows[f"position{wheel}_rad"]
    if len(readings) > 1:
        return readings.t_ns, readings.value
    readings = rows[f"speed{wheel}_rad_s"]
    if len(readings) < 2:
        return None
    steps = 0.5 * (readings.value[1:] + readings.value[:-1]) * np.diff(readings.t_ns) / 1e9
    return readings.t_ns, np.concatenate(([0.0], np.cumsum(steps)))


def places_of(rows: Channels) -> Iterator[tuple[str, DrivePath]]:
    """Yield "truth" and "fixes", where there are such, and their places."""
    x, y, yaw = (rows[name] for name in ("x_m", "y_m", "yaw_rad"))
    if min(map(len, (x, y, yaw))) > 1:
        yield "truth", DrivePath(x.t_ns / 1e9, x.value, y.value, np.unwrap(yaw.value))
    fixes = measured_poses(rows)
    if fixes is not None and len(fixes.t_ns) > 1:
        has_yaw = bool((fixes.yaw_sd_rad < UNKNOWN_YAW_STD_RAD).all())
        yield "fixes", DrivePath(fixes.t_ns / 1e9, fixes.x_m, fixes.y_m, fixes.yaw_rad if has_yaw else None)


def effects_of(kinematics: Kinematics, steering_rad: Array | None) -> Array:
    """Return the motion of the body per angle of each wheel, shape (n or 1, wheels, 3).

    Args:
        kinematics: Of the wheels.
        steering_rad: Steering angles, shape (n, wheels); None where none steers.
    """
    if steering_rad is None:
        return np.array([kinematics.wheel_effects()])
    return np.array([kinematics.wheel_effects(row) for row in map(tuple, steering_rad.tolist())])


def moves_of(turned_rad: Array, effects: Array) -> Array:
    """Return the motion of the body, shape (n, 3), by the angles of its wheels, shape (n, wheels)."""
    moves: Array = (turned_rad[:, :, np.newaxis] * effects).sum(axis=1)
    return moves


def path_of_wheels(rows: Channels, kinematics: Kinematics) -> DrivePath | None:
    """Return the path by the wheels, in steps; None where a wheel is not measured."""
    count = kinematics.wheel_count
    measured = [wheel for wheel in range(count) if wheel not in kinematics.unmeasured]
    known = [series for wheel in measured if (series := wheel_angles(rows, wheel + 1)) is not None]
    if len(known) < len(measured) or not known:
        return None
    begin_ns, end_ns = max(times[0] for times, _ in known), min(times[-1] for times, _ in known)
    edges_ns = np.arange(begin_ns, end_ns, STEP_S * 1e9)
    if len(edges_ns) <= LEAST_STEPS:
        return None
    turned = np.zeros((len(edges_ns) - 1, count))
    turned[:, measured] = np.column_stack(
        [np.diff(np.interp(edges_ns, times, angles)) for times, angles in known]
    )
    readings = [rows[f"steer{wheel}_rad"] for wheel in range(1, count + 1)]
    steering = np.zeros_like(turned)
    for wheel, angles in enumerate(readings):
        if len(angles):
            steering[:, wheel] = np.interp(edges_ns[1:], angles.t_ns, angles.value)
    moves = moves_of(turned, effects_of(kinematics, steering if any(map(len, readings)) else None))
    yaw_rad = np.concatenate(([0.0], np.cumsum(moves[:, 2])))
    along = (moves[:, 0] + 1j * moves[:, 1]) * np.exp(1j * 0.5 * (yaw_rad[1:] + yaw_rad[:-1]))
    place_m = np.concatenate(([0j], np.cumsum(along)))
    return DrivePath(edges_ns / 1e9, place_m.real, place_m.imag, yaw_rad)
