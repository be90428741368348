"""Averaged measurements of the paper's Robotino as runs in windows."""

from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

import numpy as np

from controllers.slip.effort.motor_model import MotorSettings, paper_torque, wheel_torque
from controllers.slip.effort.parameters import EFFORT
from rover_hil.drives.arrays import Flags
from rover_hil.drives.robotino_csv import AVERAGE_S, ROBOTINO, Averages, read_averages
from rover_hil.identify.slip.run_data import WHEELS, RunWindows, to_wheels


def read_average_runs(path: Path, surface: str, motor: MotorSettings) -> Iterator[RunWindows]:
    """Yield the rows of each straight drive as a run; drives that only turn are left out.

    Raises:
        LogError: A column is missing or a cell holds no number.
    """
    means = read_averages(path, with_camera=True)
    for command, group in groupby(range(len(means.command)), key=lambda row: tuple(means.command[row])):
        rows = list(group)
        if command[2] == 0.0:
            yield _drive(path, surface, Averages(*(values[rows] for values in means)), motor)


def _drive(path: Path, surface: str, means: Averages, motor: MotorSettings) -> RunWindows:
    speeds, magnitudes_a = means.wheel_rad_s, means.current_a
    current_a = np.sign(speeds) * magnitudes_a
    pairs = list(zip(current_a.ravel().tolist(), speeds.ravel().tolist(), strict=True))
    paper_nm = [paper_torque(motor, amps, speed, float(np.sign(speed))) for amps, speed in pairs]
    wheel_nm = [wheel_torque(motor, amps, speed) for amps, speed in pairs]
    is_known: Flags = magnitudes_a < motor.current_full_scale_a
    return RunWindows(
        path=path,
        surface=surface,
        elapsed_s=np.full(len(speeds), AVERAGE_S),
        start_s=AVERAGE_S * np.arange(len(speeds), dtype=np.float64),
        wheel_speed_rad_s=speeds,
        current_a=current_a,
        paper_torque_nm=np.array(paper_nm).reshape(-1, WHEELS),
        wheel_torque_nm=np.array(wheel_nm).reshape(-1, WHEELS),
        usable=(np.abs(speeds) >= EFFORT.motor.slowest_rad_s) & is_known,
        work_known=np.logical_and.reduce(is_known, axis=1),
        encoder_velocity=speeds @ np.linalg.inv(to_wheels(ROBOTINO)).T,
        camera_velocity=means.velocity,
        camera_in_pixels=False,
    )
