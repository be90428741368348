"""Motion of a recorded drive in windows of a second: by the wheels, and by the gyro."""

from dataclasses import dataclass

import numpy as np

from controllers.motion.kinematics import Kinematics
from rover_hil.drives.arrays import Array, Flags
from rover_hil.drives.channels import Channels
from rover_hil.drives.quality.drive_paths import integrated, rounded_angles, wheel_steps

WINDOW_S = 1.0
LEAST_WINDOWS = 8
"""Fewer windows in motion do not distinguish one error from another."""
LEAST_MOTION = 0.02
"""Windows with a smaller share of the greatest motion are standstill."""
LEAST_STANDSTILL = 2
"""So many windows at standstill show the bias of the gyro."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Windows:
    """What wheels and gyro of w wheels measured in n windows.

    Attributes:
        edges_s: n + 1, evenly spaced.
        turned_rad: How far each wheel turned, (n, w); 0 where it has no encoder.
        steering_rad: In the middle of each window, (n, w); None where none steers.
        gyro_rad: How far the rover turned by the gyro, less its bias at standstill, (n,); None without one.
        is_moving: Windows in which the wheels turn, (n,).
    """

    edges_s: Array
    turned_rad: Array
    steering_rad: Array | None
    gyro_rad: Array | None
    is_moving: Flags


def windows_of(rows: Channels, kinematics: Kinematics) -> Windows | None:
    """Return what wheels and gyro measured; None where a wheel is not measured, or they hardly move."""
    stepped = wheel_steps(rows, kinematics, WINDOW_S, LEAST_WINDOWS)
    if stepped is None:
        return None
    edges_ns, turned = stepped
    rim = np.abs(turned).max(axis=1)
    is_moving = rim > LEAST_MOTION * rim.max()
    if is_moving.sum() < LEAST_WINDOWS:
        return None
    return Windows(
        edges_s=edges_ns / 1e9,
        turned_rad=turned,
        steering_rad=_steering(rows, kinematics.wheel_count, 0.5 * (edges_ns[:-1] + edges_ns[1:])),
        gyro_rad=_gyro(rows, edges_ns, is_moving),
        is_moving=is_moving,
    )


def _steering(rows: Channels, count: int, middles_ns: Array) -> Array | None:
    readings = [rows[f"steer{wheel}_rad"] for wheel in range(1, count + 1)]
    if not any(map(len, readings)):
        return None
    angles = [
        np.interp(middles_ns, each.t_ns, each.value) if len(each) else np.zeros(len(middles_ns))
        for each in readings
    ]
    return rounded_angles(np.column_stack(angles))


def _gyro(rows: Channels, edges_ns: Array, is_moving: Flags) -> Array | None:
    rate = rows["gyro_z_rad_s"]
    if len(rate) < LEAST_WINDOWS or rate.t_ns[0] > edges_ns[1] or rate.t_ns[-1] < edges_ns[-2]:
        return None
    turned = np.diff(np.interp(edges_ns, rate.t_ns, integrated(rate)))
    still = turned[~is_moving]
    return turned - (np.median(still) if len(still) >= LEAST_STANDSTILL else 0.0)
