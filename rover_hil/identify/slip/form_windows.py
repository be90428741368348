"""Cut measured runs into windows: wheel speeds, efforts and camera velocities over the same times.

The paper's data have pixel steps of 2 mm and a camera row every 31 ms: over less than half a second the
quantisation hides the motion. Windows begin and end at camera frames, and the camera's step is turned by the
heading in the middle of the window. Between noisy pose fixes a window grows until its slip is known well
enough.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from controllers.slip.effort.motor_model import EffortObserver, MotorSettings, WheelEffort
from drivers.errors import LogError
from rover_hil.drives.arrays import Array, Flags, in_body_frame
from rover_hil.identify.slip.parameters import SLIP_FIT
from rover_hil.identify.slip.run_data import WHEELS, AlignedReadings, RunWindows, to_wheels

NO_FIX = f"no pose fix for more than {SLIP_FIT.window.longest_s:g} s"
TOO_NOISY = f"too little motion within {SLIP_FIT.window.longest_s:g} s for the noise of the pose fixes"
CONTRADICTION = "a pose fix further away than the wheels can have moved"


def form_windows(run: AlignedReadings, motor: MotorSettings) -> RunWindows:
    """Return `run` in windows.

    Raises:
        LogError: The run is too short for one window.
    """
    spans, rejected = _spans(run)
    first, last = np.array(spans).T
    start_s, end_s = run.camera_t_s[first], run.camera_t_s[last]
    elapsed_s = end_s - start_s
    positions = _positions_at_frames(run)
    speeds = (positions[last] - positions[first]) / elapsed_s[:, None]
    efforts, flagged, unknown = _efforts(run, motor)
    # The readings of a window are those after its start, up to its end.
    begins = np.searchsorted(run.t_s, start_s, side="right")
    ends = np.searchsorted(run.t_s, end_s, side="right")
    slices = [slice(a, max(a + 1, b)) for a, b in zip(begins, ends, strict=True)]
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
        camera_velocity=_camera_velocity(run.camera[first], run.camera[last], elapsed_s),
        camera_in_pixels=run.camera_in_pixels,
        rover=run.rover,
        truth=run.truth,
        rejected=rejected,
    )


def slip_problem(run: AlignedReadings, start: int, end: int, moved_m: float) -> str:
    """Return why the slip between two camera frames is not known well enough; empty where it is.

    Args:
        run: With pose fixes or exact poses.
        start: Index of the first frame.
        end: Index of the last.
        moved_m: Distance that the fastest wheel turned in between.
    """
    if run.fix_sd_m is None:
        return ""
    sd_m = float(np.hypot(run.fix_sd_m[start], run.fix_sd_m[end]))
    if (
        np.hypot(*(run.camera[end] - run.camera[start])[:2])
        > SLIP_FIT.window.jump_share * moved_m + SLIP_FIT.window.jump_sd * sd_m
    ):
        return CONTRADICTION
    times_s = run.camera_t_s[start : end + 1]
    if np.diff(times_s).max() > SLIP_FIT.window.longest_s:
        return NO_FIX
    is_too_long = times_s[-1] - times_s[0] > SLIP_FIT.window.longest_s
    return TOO_NOISY if is_too_long or sd_m > SLIP_FIT.window.slip_sd * moved_m else ""


def _spans(run: AlignedReadings) -> tuple[list[tuple[int, int]], Counter[str]]:
    """Return the first and the last camera frame of each window, and how many were rejected, by reason."""
    t_s = run.camera_t_s
    frames = np.flatnonzero((t_s >= run.t_s[0]) & (t_s <= run.t_s[-1])).tolist()
    positions_m = _positions_at_frames(run) * run.rover.wheel_radius_m
    spans: list[tuple[int, int]] = []
    rejected: Counter[str] = Counter()
    start = frames[0] if frames else 0
    for frame in frames[1:]:
        is_last = frame == frames[-1]
        elapsed_s = t_s[frame] - t_s[start]
        if elapsed_s < (SLIP_FIT.window.least_length_s if is_last else SLIP_FIT.window.length_s):
            continue
        problem = slip_problem(
            run, start, frame, float(np.abs(positions_m[frame] - positions_m[start]).max())
        )
        if problem == TOO_NOISY and elapsed_s < SLIP_FIT.window.longest_s and not is_last:
            continue  # longer, it may be known well enough
        if problem:
            rejected[problem] += 1
        else:
            spans.append((start, frame))
        start = frame
    if rejected and not spans:
        counts = ", ".join(f"{reason} ({count})" for reason, count in rejected.items())
        raise LogError(f"{run.path}: no window of its {run.truth} can be used: {counts}")
    if not spans or len(run.t_s) < SLIP_FIT.window.least_readings:
        raise LogError(
            f"{run.path} holds less than {SLIP_FIT.window.length_s} s of camera "
            "and wheels together: give a longer run"
        )
    return spans, rejected


def _positions_at_frames(run: AlignedReadings) -> Array:
    columns = [np.interp(run.camera_t_s, run.t_s, run.position_rad[:, wheel]) for wheel in range(WHEELS)]
    return np.column_stack(columns)


def _camera_velocity(first: Array, last: Array, elapsed_s: Array) -> Array:
    steps = last - first
    middle_rad = 0.5 * (last[:, 2] + first[:, 2])
    forward, left = in_body_frame(steps[:, 0], steps[:, 1], middle_rad)
    body = np.column_stack((forward, left, steps[:, 2]))
    velocity: Array = body / elapsed_s[:, None]
    return velocity


def _efforts(run: AlignedReadings, motor: MotorSettings) -> tuple[tuple[Array, Array, Array], Flags, Flags]:
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
