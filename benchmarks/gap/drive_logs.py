"""Logs of made drives, as a rover records them."""

import math
from pathlib import Path
from typing import Any, Literal, TypeAlias

from drivers.samples import PoseFixSample, RateSample, Sample, WheelSample
from rover_hil.config import Config
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.schema import TRUTH
from rover_hil.recording.writer import LogWriter
from tests.nature.differential_drive import Array, Recorded

START_NS = 1_000_000_000
CAMERA: dict[str, Any] = {
    "type": "overhead_camera",
    "source": "live_folder",
    "path": "frames",
    "frame_rate_hz": 20.0,
    "max_age_s": 1.0,
    "marker_id": 7,
    "marker_size_m": 0.12,
    "marker_height_m": 0.2,
    "calibration": "simulated",
}
Poses: TypeAlias = Literal["truth", "fixes", "none"]


def write_log(
    path: Path, config: Config, drive: Recorded, poses: Poses = "truth", steering_rad: Array | None = None
) -> None:
    """Write a drive as a log; fixes come at every third row.

    Args:
        path: Of the log; its folder must not exist.
        config: Of the rover.
        drive: Its sensors; what is NaN was not measured.
        poses: Where its poses go.
        steering_rad: Measured angles of the wheels, shape (n, wheels); None where none steers.
    """
    if poses == "fixes":
        table = config.model_dump(by_alias=True)
        table["devices"]["overhead"], table["roles"]["fixes"] = CAMERA, ["overhead"]
        config = Config.model_validate(table)
    config_json = config.model_dump_json(by_alias=True).encode()
    path.parent.mkdir(parents=True)
    with LogWriter(path, START_NS, config_json, collect_data_files(config), "virtual") as log:
        for index, t_s in enumerate(drive.t_s):
            t_ns = START_NS + round(t_s * 1e9)
            samples: list[Sample] = [
                WheelSample(
                    device="wheels",
                    t_ns=t_ns,
                    wheel=wheel,
                    position_rad=float(angle),
                    steering_rad=None if steering_rad is None else float(steering_rad[index, wheel]),
                )
                for wheel, angle in enumerate(drive.wheels_rad[index])
                if math.isfinite(angle)
            ]
            rate = float(drive.gyro_rad_s[index])
            if math.isfinite(rate):
                samples.append(RateSample(device="imu", t_ns=t_ns, rate_z_rad_s=rate))
            x_m, y_m, yaw_rad = drive.pose[index].tolist()
            if poses == "truth":
                log.write_json(TRUTH, t_ns, {"t_ns": t_ns, "x_m": x_m, "y_m": y_m, "yaw_rad": yaw_rad})
            elif poses == "fixes" and index % 3 == 0:
                samples.append(
                    PoseFixSample(
                        device="overhead",
                        t_ns=t_ns,
                        t_capture_ns=t_ns,
                        x_m=x_m,
                        y_m=y_m,
                        yaw_rad=math.remainder(yaw_rad, math.tau),
                        position_std_m=0.001,
                        yaw_std_rad=0.001,
                    )
                )
            log.samples(t_ns, samples)
