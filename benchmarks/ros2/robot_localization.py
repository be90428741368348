"""The filter of robot_localization with the parameters that are exported for it, against /odom.

EKF_REPLAY names the program that is built of `ekf_replay.cpp` here and of the sources of robot_localization.
It gets the messages of /odom of each log, and the parameters that `export --for robot_localization` writes.
Printed: how far its path is at most from that of /odom; its standard deviation over that of /odom, the least
and the greatest of all directions in the second half, and along the axes of both regions at 10, 30 and 60 s
and at the end; and that of its velocity over that of the messages, in the median.

    EKF_REPLAY=./ekf_replay python -m benchmarks.ros2.robot_localization LOG ...
"""

import argparse
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rover_hil.config.ros2_settings import Ros2Settings
from rover_hil.connect.odometry_record import OdometryRecorder
from rover_hil.connect.records import OdometryRecord
from rover_hil.connect.ros2.mapping import pose_covariance, twist_covariance
from rover_hil.exporting.robot_localization import robot_localization_text
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.recording.schema import ESTIMATE, ESTIMATE_SHAPE

PROGRAM = os.environ.get("EKF_REPLAY", "")
TIMES_S = (10.0, 30.0, 60.0)
POSE = [0, 1, 5]
"""x, y and yaw in the state of robot_localization."""
VELOCITY = [6, 7, 11]
Array = NDArray[np.float64]


def line_of(record: OdometryRecord) -> str:
    """Return the message of /odom as a line for the program."""
    names = Ros2Settings()
    pose = [record["x_m"], record["y_m"], record["yaw_rad"], *pose_covariance(record["covariance"])]
    velocity = [record["velocity_x_m_s"], record["velocity_y_m_s"], record["yaw_rate_rad_s"]]
    numbers = [*pose, *velocity, *twist_covariance(record["velocity_variance"])]
    words = ("odom", "/odom", str(record["time_ns"]), names.odom_frame, names.base_frame)
    return " ".join((*words, *map(repr, numbers)))


def replayed(program: str, parameters: Path, records: Sequence[OdometryRecord]) -> tuple[Array, Array]:
    """Return the states, (n, 15), and their covariances, (n, 15, 15), after each message.

    Raises:
        subprocess.CalledProcessError: The program refuses a parameter or a message; its words are printed.
    """
    lines = "\n".join(map(line_of, records))
    done = subprocess.run([program, parameters], input=lines, stdout=subprocess.PIPE, text=True, check=True)
    table = np.array([line.split()[1:] for line in done.stdout.splitlines()], dtype=float)
    return table[:, :15], table[:, 15:].reshape(-1, 15, 15)


def main() -> int:
    """Print the figures of each log; returns 2 without the program."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("log", type=Path, nargs="+")
    logs: list[Path] = parser.parse_args().log
    if not PROGRAM:
        print("EKF_REPLAY names no program", file=sys.stderr)
        return 2
    for path in logs:
        with tempfile.TemporaryDirectory() as folder:
            parameters = Path(folder) / "ekf.yaml"
            log = LogReader(path)
            with restore_config(log) as config:
                parameters.write_text(robot_localization_text(log, config, lambda: None), encoding="utf-8")
                recorder = OdometryRecorder(config.filter, config.ground)
                cycles = (
                    log.parse(each, ESTIMATE_SHAPE) for each in log.messages() if each.topic == ESTIMATE
                )
                records = [record for cycle in cycles if (record := recorder.record(0, cycle)) is not None]
            print_figures(path, records, *replayed(PROGRAM, parameters, records))
    return 0


def print_figures(path: Path, records: Sequence[OdometryRecord], states: Array, covariances: Array) -> None:
    """Print the figures of a log."""
    times_s = np.array([each["time_ns"] for each in records]) / 1e9
    times_s -= times_s[0]
    poses = np.array([(each["x_m"], each["y_m"], each["yaw_rad"]) for each in records])
    path_m = float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())
    sent = np.array([pose_covariance(each["covariance"]) for each in records]).reshape(-1, 6, 6)
    ours, theirs = sent[:, POSE][:, :, POSE], covariances[:, POSE][:, :, POSE]
    x_m, y_m, yaw_rad = poses[0]
    cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
    # The filter begins at 0.
    to_start = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    places = (poses - (x_m, y_m, yaw_rad)) @ to_start.T
    ours = to_start @ ours @ to_start.T
    apart = states[:, POSE] - places
    yaw_apart_rad = np.abs(np.angle(np.exp(1j * apart[:, 2])))
    print(f"{path}: {times_s[-1]:.0f} s, {path_m:.2f} m")
    print(f"  apart at most: {np.hypot(apart[:, 0], apart[:, 1]).max():.3f} m, {yaw_apart_rad.max():.3f} rad")
    late = np.nonzero(2.0 * times_s >= times_s[-1])[0]
    relative = np.linalg.solve(ours[late, :2, :2], theirs[late, :2, :2])
    ratios = np.sqrt(np.linalg.eigvals(relative).real)
    print(f"  second half, standard deviation over that of /odom: {ratios.min():.2f} to {ratios.max():.2f}")
    for time_s in (*(each for each in TIMES_S if each < times_s[-1]), times_s[-1]):
        place = min(int(np.searchsorted(times_s, time_s)), len(times_s) - 1)
        mine, its = (np.sqrt(np.linalg.eigvalsh(each[place, :2, :2])) for each in (ours, theirs))
        yaw = math.sqrt(theirs[place, 2, 2] / ours[place, 2, 2])
        axes = its / mine
        print(f"  at {time_s:.0f} s: widest {axes[1]:.2f}, narrowest {axes[0]:.2f}, yaw {yaw:.2f}")
    variances = np.array([each["velocity_variance"] for each in records])
    speeds = np.median(np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)[:, VELOCITY] / variances), axis=0)
    print(f"  velocity, standard deviation over that of the messages: {speeds.min():.2f}")


if __name__ == "__main__":
    sys.exit(main())
