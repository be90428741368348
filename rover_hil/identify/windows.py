"""Cut measured runs into windows: wheel speeds, efforts and camera velocities over the same times.

The paper's data have pixel steps of 2 mm and a camera row every 31 ms: over less than half a second the
quantisation hides the motion. Windows begin and end at camera frames, and the camera's step is turned by the
heading in the middle of the window.
"""

from collections.abc import Sequence

import numpy as np

from controllers.slip.effort.motor_model import EffortObserver, MotorSettings, WheelEffort
from drivers.errors import LogError
from rover_hil.identify.run_data import WHEELS, Array, Flags, MeasuredRun, RunWindows, to_wheels

WINDOW_S = 0.5
LEAST_WINDOW_S = 0.25
LEAST_READINGS = 4


def form_windows(run: MeasuredRun, motor: MotorSettings) -> RunWindows:
    """Return `run` in windows.

    Raises:
        LogError: The run is too short for one window.
    """
    edges = _edges(run)
    start_s, end_s = run.camera_t_s[edges[:-1]], run.camera_t_s[edges[1:]]
    elapsed_s = end_s - start_s
    positions = [
        np.interp(run.camera_t_s[edges], run.t_s, run.position_rad[:, wheel]) for wheel in range(WHEELS)
    ]
    speeds = np.diff(np.array(positions).T, axis=0) / elapsed_s[:, None]
    efforts, flagged, unknown = _efforts(run, motor)
    # The readings of a window are those after its start, up to its end.
    first = np.searchsorted(run.t_s, start_s, side="right")
    last = np.searchsorted(run.t_s, end_s, side="right")
    slices = [slice(a, max(a + 1, b)) for a, b in zip(first, last, strict=True)]
    current_a, paper_nm, wheel_nm = (
        np.array([values[part].mean(axis=0) for part in slices]) for values in efforts
    )
    return RunWindows(
        path=run.path,
        surface=run.surface,
        elapsed_s=elapsed_s,
        start_s=start_s,
        wheel_speed_rad_s=speeds,
        current_a=current_a,
        paper_torque_nm=paper_nm,
        wheel_torque_nm=wheel_nm,
        usable=np.array([flagged[part].mean(axis=0) < 0.5 for part in slices]),
        work_known=np.array([(unknown[part].mean(axis=0) < 0.5).all() for part in slices]),
        encoder_velocity=speeds @ np.linalg.inv(to_wheels(run.rover)).T,
        camera_velocity=_camera_velocity(run.camera[edges], elapsed_s),
        camera_in_pixels=run.camera_in_pixels,
        rover=run.rover,
    )


def _edges(run: MeasuredRun) -> list[int]:
    """Return the indices of the camera frames that part the windows."""
    inside = (run.camera_t_s >= run.t_s[0]) & (run.camera_t_s <= run.t_s[-1])
    frames = np.flatnonzero(inside)
    edges: list[int] = []
    for frame in frames.tolist():
        if not edges or run.camera_t_s[frame] - run.camera_t_s[edges[-1]] >= WINDOW_S:
            edges.append(frame)
    if edges and run.camera_t_s[frames[-1]] - run.camera_t_s[edges[-1]] >= LEAST_WINDOW_S:
        edges.append(int(frames[-1]))
    if len(edges) < 2 or len(run.t_s) < LEAST_READINGS:
        msg = f"{run.path} holds less than {WINDOW_S} s of camera and wheels together: give a longer run"
        raise LogError(msg)
    return edges


def _camera_velocity(poses: Array, elapsed_s: Array) -> Array:
    steps = np.diff(poses, axis=0)
    middle_rad = 0.5 * (poses[1:, 2] + poses[:-1, 2])
    cosine, sine = np.cos(middle_rad), np.sin(middle_rad)
    body = np.column_stack(
        (
            cosine * steps[:, 0] + sine * steps[:, 1],
            cosine * steps[:, 1] - sine * steps[:, 0],
            steps[:, 2],
        )
    )
    velocity: Array = body / elapsed_s[:, None]
    return velocity


def _efforts(run: MeasuredRun, motor: MotorSettings) -> tuple[tuple[Array, Array, Array], Flags, Flags]:
    """Return current, M and wheel torque of each reading, which are flagged, and whose work is unknown."""
    elapsed_s = np.diff(run.t_s, prepend=run.t_s[0] - 1.0)
    speeds = np.diff(run.position_rad, axis=0, prepend=run.position_rad[:1]) / elapsed_s[:, None]
    columns: list[Sequence[WheelEffort]] = []
    for wheel in range(WHEELS):
        observer = EffortObserver(motor, current_is_signed=run.current_is_signed)
        readings = zip(
            elapsed_s.tolist(),
            _known(np.minimum(run.current_a[:, wheel], motor.current_full_scale_a)),
            speeds[:, wheel].tolist(),
            _known(run.set_speed_rad_s[:, wheel]),
            strict=True,
        )
        columns.append([observer.step(*reading) for reading in readings])
    values = tuple(
        np.array([[getattr(effort, name) for effort in column] for column in columns]).T
        for name in ("current_a", "paper_torque_nm", "wheel_torque_nm")
    )
    flagged = np.array([[bool(effort.flags) for effort in column] for column in columns]).T
    unknown = np.array([[effort.unknown_work is not None for effort in column] for column in columns]).T
    return (values[0], values[1], values[2]), flagged, unknown


def _known(values: Array) -> list[float | None]:
    return [None if np.isnan(value) else float(value) for value in values]
