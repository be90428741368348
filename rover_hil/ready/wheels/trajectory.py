"""Trajectories of recorded drives: by the wheels with other numbers, and by the ground truth."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import RoverSettings
from drivers.errors import LogError
from rover_hil.drives.arrays import Array
from rover_hil.drives.drive import Drive, read_drive
from rover_hil.drives.quality.drive_paths import (
    DrivePath,
    integrated,
    places_of,
    wheel_steps,
)
from rover_hil.ready.wheels.geometry import DELAY, MARKER_X, MARKER_Y, MARKER_YAW

Places: TypeAlias = NDArray[np.complex128]
"""Places in the plane, the second coordinate as imaginary part."""
STEP_S = 0.025
"""Of the integration: a rover that turns by 1 rad/s leaves the chord by 0.01 % of the radius."""
LEAST_STEPS = 80
SAMPLE_S = 0.2
"""Poses of the ground truth that are closer together add nothing: their errors are alike."""
LEAST_POSES = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedDrive:
    """What a drive has measured, in steps.

    Attributes:
        path: The log.
        rover: Its description in the log.
        t_s: Times of the edges of n steps, (n + 1,), from the start of the log.
        turned_rad: How far each wheel turned, (n, wheels).
        steering_rad: In the middle of each step, (n, wheels); None where none steers.
        gyro_rad: Integral of the gyro at the edges, (n + 1,); None without one.
        truth: Known places, and yaw where it is measured; at most one each `SAMPLE_S`.
        source: What measured them.
    """

    path: Path
    rover: RoverSettings
    t_s: Array
    turned_rad: Array
    steering_rad: Array | None
    gyro_rad: Array | None
    truth: DrivePath
    source: str


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Poses along a drive; the first is at the origin.

    Attributes:
        place_m: (m,).
        yaw_rad: (m,).
    """

    place_m: Places
    yaw_rad: Array


def read_recorded(path: Path) -> RecordedDrive:
    """Return a drive with its ground truth, else with its positions.

    Raises:
        LogError: The log is damaged, a wheel is not measured, or there is no ground truth.
    """
    return recorded_of(read_drive(path))


def recorded_of(drive: Drive) -> RecordedDrive:
    """Return a drive that has been read with its ground truth, else with its positions.

    Raises:
        LogError: A wheel is not measured, or there is no ground truth.
    """
    path = drive.log.path
    if drive.channels.has_computed_wheels:
        raise LogError(
            f"log {path}: the angles of its wheels are computed from a path, not measured: import the wheels "
            "themselves ([[wheel]], with steering where one steers)"
        )
    kinematics = make_kinematics(drive.config.rover)
    stepped = wheel_steps(drive.channels, kinematics, STEP_S, LEAST_STEPS)
    if stepped is None:
        raise LogError(
            f"log {path}: not every wheel is measured, or for less than {LEAST_STEPS * STEP_S:g} s"
        )
    edges_ns, turned_rad = stepped
    known = next(places_of(drive.channels), None)
    if known is None:
        raise LogError(
            f"log {path}: it has neither ground truth nor positions, which the wheels are compared with: "
            "give known distances and turns by --line and --spin"
        )
    start_ns = drive.log.start_ns
    t_s = (edges_ns - start_ns) / 1e9
    name, truth = known
    truth = _thinned(truth, start_ns / 1e9, t_s)
    if len(truth.t_s) < LEAST_POSES:
        raise LogError(f"log {path}: {len(truth.t_s)} poses of its {name} are in the drive: too few")
    rate = drive.channels["gyro_z_rad_s"]
    covers = len(rate) > LEAST_STEPS and rate.t_ns[0] <= edges_ns[40] and rate.t_ns[-1] >= edges_ns[-40]
    middles_ns = 0.5 * (edges_ns[:-1] + edges_ns[1:])
    steering = [drive.channels[f"steer{wheel}_rad"] for wheel in range(1, kinematics.wheel_count + 1)]
    return RecordedDrive(
        path=path,
        rover=drive.config.rover,
        t_s=t_s,
        turned_rad=turned_rad,
        steering_rad=np.column_stack(
            [
                np.interp(middles_ns, each.t_ns, each.value) if len(each) else np.zeros(len(middles_ns))
                for each in steering
            ]
        )
        if any(map(len, steering))
        else None,
        gyro_rad=np.interp(edges_ns, rate.t_ns, integrated(rate)) if covers else None,
        truth=truth,
        source=name,
    )


def wheel_trajectory(moves: Array) -> Trajectory:
    """Return the trajectory of the origin of the rover at the edges of the steps; between them are arcs.

    Args:
        moves: Ahead and left in m, yaw in rad, of each step, (n, 3).
    """
    yaw_rad = np.concatenate(([0.0], np.cumsum(moves[:, 2])))
    middle_rad = 0.5 * (yaw_rad[1:] + yaw_rad[:-1])
    chords = (moves[:, 0] + 1j * moves[:, 1]) * np.sinc(moves[:, 2] / math.tau) * np.exp(1j * middle_rad)
    return Trajectory(np.concatenate(([0j], np.cumsum(chords))), yaw_rad)


def of_marker(drive: RecordedDrive, path: Trajectory, values: Mapping[str, float]) -> Trajectory:
    """Return the trajectory of the marker at the times of the ground truth.

    Args:
        drive: The drive.
        path: Of the origin of the rover, at the edges of the steps.
        values: Numbers of the marker that differ from the description, by name.
    """
    at_s = drive.truth.t_s - values.get(DELAY, 0.0)
    yaw_rad = np.interp(at_s, drive.t_s, path.yaw_rad)
    place_m = np.interp(at_s, drive.t_s, path.place_m)
    lever = complex(values.get(MARKER_X, 0.0), values.get(MARKER_Y, 0.0)) + drive.truth.arm_m
    return Trajectory(place_m + lever * np.exp(1j * yaw_rad), yaw_rad + values.get(MARKER_YAW, 0.0))


def _thinned(truth: DrivePath, start_s: float, t_s: Array) -> DrivePath:
    """Return the poses within the drive, at most one each `SAMPLE_S`, by its times."""
    times_s = truth.t_s - start_s
    inside = np.flatnonzero((times_s >= t_s[0]) & (times_s <= t_s[-1]))
    slots = np.floor(times_s[inside] / SAMPLE_S)
    use = inside[np.concatenate(([True], np.diff(slots) > 0.0))] if inside.size else inside
    return DrivePath(
        times_s[use],
        truth.x_m[use],
        truth.y_m[use],
        None if truth.yaw_rad is None else truth.yaw_rad[use],
        truth.sd_m,
        truth.arm_m,
    )
