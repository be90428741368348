"""Logs of a rover on any set of wheels, as runs of its model."""

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from controllers.motion.rover_geometry import RoverSettings
from drivers.errors import ConfigError, LogError
from rover_hil.drives.drive import Drive, read_drive
from rover_hil.drives.ground_truth import TruePoses
from rover_hil.drives.marks import mark_files
from rover_hil.drives.windows import Windows, body_rates
from rover_hil.gap.data.described_wheels import wheels_of
from rover_hil.gap.data.logs import find_logs
from rover_hil.gap.data.parameters import DATA
from rover_hil.gap.data.stretches import stretches, windows_over
from rover_hil.parallel.calls import HERE, Calls
from sim_backends.models.interface import Array, Run
from sim_backends.wheels_model.model import GYRO, HEADING, STRETCHES, WheelsModel
from sim_backends.wheels_model.stretches import STRETCH_S, over_stretches, windows_of_stretch


def read_rover_runs(
    model: WheelsModel, paths: Sequence[Path], calls: Calls = HERE, rover: RoverSettings | None = None
) -> list[Run]:
    """Return one run per log, or their stretches where there are too few logs to split.

    Args:
        model: Of the rover.
        paths: Logs, and folders of them.
        calls: Where the logs are read.
        rover: Geometry that all logs must have; without it the number of their wheels must be that of the
            model.

    Raises:
        ConfigError: There is no log, or a log is of another rover, or of too short a drive.
        LogError: A log cannot be read, or contains neither the true pose nor enough pose fixes.
    """
    files = [file for path in paths for file in find_logs(path)]
    if not files:
        raise ConfigError(f"{paths[0]} holds no log: give run.mcap files of the rover, or folders of them")
    folder = Path(os.path.commonpath([file.resolve().parent for file in files]))
    runs = []
    rng = np.random.default_rng(0)
    logs = list(dict.fromkeys(files))
    for file, drive in zip(logs, calls.map_files(read_drive, logs, mark_files), strict=True):
        drive.log.path = file  # marks are beside it, wherever it was read
        name = file.resolve().relative_to(folder).with_suffix("").as_posix()
        if rover is not None and drive.config.rover != rover:
            raise ConfigError(
                f"log {name} has another [rover] than {logs[0].name}: give logs of one rover, or name its "
                "configuration first"
            )
        runs.append(_run(model, drive, name, rng))
    if len(runs) < DATA.runs.least_series:
        runs = [part for run in runs for part in stretches(run)]
    return [_with_stretches(run, rng) for run in runs]


def _with_stretches(run: Run, rng: np.random.Generator) -> Run:
    """Return a run with its motion over stretches.

    The accuracy of the model's rates adds up in a stretch. Stretches that overlap share it: together they
    must not count for more than one, so that each has noise of its own in their number.
    """
    t_s, (before, after) = run.inputs["t_s"], run.overlap
    rates = np.stack([run.measured[name] for name in ("forward_m_s", "left_m_s", "turn_rad_s")], axis=1)
    size, measured = windows_of_stretch(t_s) - 1, dict(run.measured)
    accuracy = (DATA.windows.balance_m_s, DATA.windows.balance_m_s, DATA.windows.balance_rad_s)
    inner = slice(before, t_s.size - after)
    for name, values, one in zip(
        STRETCHES, over_stretches(t_s[inner], rates[inner]).T, accuracy, strict=True
    ):
        series = np.full(t_s.size, np.nan)
        series[inner] = values + (size + 1) ** 0.5 * STRETCH_S * one * rng.standard_normal(values.size)
        measured[name] = series
    return replace(run, measured=measured, overlap=(before + size, after))


def _run(model: WheelsModel, drive: Drive, name: str, rng: np.random.Generator) -> Run:
    rover = drive.config.rover
    wheels_of_rover = wheels_of(rover)
    if wheels_of_rover is None or len(wheels_of_rover) != model.wheel_count:
        raise ConfigError(
            f"log {name} is of a rover with other wheels ({rover.kinematics}) than the {model.wheel_count} "
            "of the configuration: give logs of this rover"
        )
    if drive.channels.has_computed_wheels:
        raise LogError(
            f"log {name} was imported from a path: the angles of its wheels are computed with the radii of "
            "[rover], so they cannot show an error of these: import the wheels themselves"
        )
    poses = drive.true_poses()
    true_s = drive.seconds(poses.t_ns)
    width_s = _window_s(poses, true_s, name)
    numbers = range(1, model.wheel_count + 1)
    wheels = {number: drive.channels[f"position{number}_rad"] for number in numbers}
    # A wheel without a motor need not have a sensor: it rolls as the ground does.
    wheels = {number: one for number, one in wheels.items() if number in model.driven or len(one)}
    if any(len(one) < DATA.runs.least_rows for one in wheels.values()):
        raise LogError(f"log {name} holds too few wheel positions: give the log of a drive")
    times_s = {number: drive.seconds(one.t_ns) for number, one in wheels.items()}
    first_s = max(float(true_s[0]), *(float(t_s[0]) for t_s in times_s.values()))
    last_s = min(float(true_s[-1]), *(float(t_s[-1]) for t_s in times_s.values()))
    windows = windows_over(first_s, last_s, f"log {name}")
    if windows.middle_s[1] - windows.middle_s[0] < width_s:
        count = max(int((last_s - first_s) / width_s), DATA.windows.least)
        windows = Windows(np.linspace(first_s, last_s, count + 1))
    forward, left, turn = body_rates(windows, true_s, poses.x_m, poses.y_m, poses.yaw_rad)
    inputs = {"t_s": windows.middle_s, HEADING: np.interp(windows.middle_s, true_s, poses.yaw_rad)}
    for number, readings in wheels.items():
        inputs[f"wheel_{number}_rad_s"] = windows.rate(times_s[number], readings.value)
    if model.steers:
        inputs |= {f"steering_{number}_rad": _steering(drive, number, windows) for number in numbers}
    measured = {"forward_m_s": forward, "left_m_s": left, "turn_rad_s": turn}
    gyro = drive.channels["gyro_z_rad_s"]
    if len(gyro) >= DATA.runs.least_rows:
        measured[GYRO] = windows.mean(drive.seconds(gyro.t_ns), gyro.value)
    for channel, values in measured.items():
        is_speed = channel in ("forward_m_s", "left_m_s")
        size = DATA.windows.balance_m_s if is_speed else DATA.windows.balance_rad_s
        measured[channel] = values + size * rng.standard_normal(values.size)
    speed_m_s = round(float(np.hypot(forward, left).mean()), 2)
    return Run(name=name, conditions={"speed_m_s": speed_m_s}, inputs=inputs, measured=measured)


def _window_s(poses: TruePoses, true_s: Array, name: str) -> float:
    """Return the least length of windows, in which the poses change by more than their noise.

    Raises:
        LogError: There are too few poses.
    """
    if true_s.size < DATA.windows.least:
        raise LogError(f"log {name} holds {true_s.size} poses: {DATA.windows.least} or more are needed")
    interval_s = float(np.median(np.diff(true_s)))
    if interval_s > DATA.windows.slowest_pose_s:
        raise LogError(
            f"log {name} holds a pose every {interval_s:.1f} s: one in {DATA.windows.slowest_pose_s:g} s or "
            "less is needed, set frame_rate_hz of the overhead camera"
        )
    return max(DATA.windows.window_s, 2.0 * interval_s)


def _steering(drive: Drive, number: int, windows: Windows) -> Array:
    """Return the steering angle of a wheel: measured, else its setpoint, else 0."""
    for name in (f"steer{number}_rad", f"set_steer{number}_rad"):
        readings = drive.channels[name]
        if len(readings):
            return windows.mean(drive.seconds(readings.t_ns), readings.value)
    return np.zeros(windows.middle_s.size)
