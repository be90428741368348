"""Samples of recorded drives in the formats of other programs, made from simulated ones."""

import csv
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from controllers.motion.settings import WaypointsMission
from drivers.robotino_board.robotino_2 import ROBOTINO_BOARD, ROBOTINO_SCALES
from rover_hil.config import Config, load_config
from rover_hil.config.shipped import rigs
from rover_hil.drives.arrays import Array
from rover_hil.drives.drive import Drive, read_drive
from rover_hil.drives.robotino_csv import CAMERA_UNITS, MOTORS, RECORD_UNITS
from rover_hil.exporting.can import write_can
from rover_hil.exporting.rosbag2 import write_rosbag2
from rover_hil.ftrace.log_frames import LogFrames
from rover_hil.ftrace.telemetry import NEEDED, RATES, SPEED
from rover_hil.recording.reader import LogReader
from rover_hil.run.driving import run_virtual
from rover_hil.scomp.columns import WHEELS
from rover_hil.scomp.files import TRUTH

ROBOTINO_S = 16.0
MM_PER_PX = 1.84
CAMERA_ORIGIN_PX = 400.0
CAMERA_TO_ROBOT_DEG = 90.0
ROBOTINO_NAMES = ("set_rad_s", "position_rad", "speed_rad_s", "current_a", "x_m", "y_m", "yaw_rad")
BAG_S = 15.0
BAG_TOPICS = """rover = "robotino"

[wheels]
topic = "/joint_states"
joints = ["wheel1", "wheel2", "wheel3"]

[imu]
topic = "/imu/imu"

[truth]
topic = "/ground_truth"
"""
TABLE_COLUMNS = """rover = "robotino"

[time]
column = "t"
unit = "ms"

[[wheel]]
position = { column = "wheel1", unit = "deg" }
current = { column = "current1", unit = "mA" }

[[wheel]]
position = { column = "wheel2", unit = "deg" }
current = { column = "current2", unit = "mA" }

[[wheel]]
position = { column = "wheel3", unit = "deg" }
current = { column = "current3", unit = "mA" }

[truth]
x = { column = "x", unit = "mm" }
y = { column = "y", unit = "mm" }
yaw = { column = "yaw", unit = "deg" }
"""
DRIVE_S = 100.0
DRIVE_POINTS_M = ((2.0, 0.0), (4.0, 1.5), (6.0, 0.5))
DRIVE_NAMES = ("position_rad", "heading_rad", "gyro_z_rad_s", "pitch_rad", "roll_rad")
DRIVE_COLUMNS = (*WHEELS, "heading_deg", "yaw_rate_deg_s", "pitch_deg", "roll_deg")
FRAMES_S = 14.0


def write_robotino(folder: Path) -> None:
    """Write a drive of the simulated Robotino in the format of BrOleg5/research-wheel-slippage."""
    mission = WaypointsMission(type="waypoints", points=((1.5, 0.6),), speed_m_s=0.15)
    config = load_config("robotino").model_copy(update={"slip": None, "mission": mission})
    table = _recorded(config, ROBOTINO_S).table(ROBOTINO_NAMES)
    gear = ROBOTINO_BOARD.gear_ratio
    columns = {"t": np.round(1e3 * (table["t_s"] - table["t_s"][0]), 3)}
    for motor in MOTORS:
        columns[f"m{motor}setvel"] = gear * table[f"set{motor}_rad_s"]
        columns[f"m{motor}pos"] = np.round(table[f"position{motor}_rad"] / ROBOTINO_SCALES.position_rad)
        columns[f"m{motor}vel"] = gear * table[f"speed{motor}_rad_s"]
        columns[f"m{motor}cur"] = np.abs(table[f"current{motor}_a"])
    columns["xpos"] = CAMERA_ORIGIN_PX + 1e3 * table["x_m"] / MM_PER_PX
    columns["ypos"] = CAMERA_ORIGIN_PX - 1e3 * table["y_m"] / MM_PER_PX
    columns["ang"] = np.degrees(table["yaw_rad"]) - CAMERA_TO_ROBOT_DEG
    units = {**RECORD_UNITS, **CAMERA_UNITS}
    header = [[f"{name} of the sample" for name in columns], [units[name] for name in columns], list(columns)]
    rows = np.column_stack(list(columns.values())).tolist()
    lines = [";".join(cells) for cells in header]
    lines += [";".join(f"{value:.6g}" if value % 1.0 else f"{value:.0f}" for value in row) for row in rows]
    (folder / "exp00.csv").write_text("\n".join(lines) + "\n", "utf-8")


def write_can_log(folder: Path) -> None:
    """Write the frames on the CAN bus of a drive of the four-wheel rover as candump does."""
    config = load_config("el-dorado")
    with TemporaryDirectory(prefix="rover_hil_") as name:
        log = Path(name) / "run.mcap"
        run_virtual(config, log, BAG_S, None)
        write_can(LogReader(log), config, folder / "drive.log")


def write_bag(folder: Path) -> None:
    """Write a drive of the simulated Robotino as a ROS 2 bag, and the file of its topics."""
    with TemporaryDirectory(dir=folder) as place:
        log = Path(place) / "run.mcap"
        run_virtual(load_config("robotino"), log, BAG_S, None)
        write_rosbag2(LogReader(log), folder / "first_rosbag2", lambda: None)
    (folder / "topics.toml").write_text(BAG_TOPICS, "utf-8")


def write_table(folder: Path) -> None:
    """Write a drive of the simulated Robotino as a table, and the file of its columns."""
    table = _recorded(load_config("robotino"), BAG_S).table(ROBOTINO_NAMES)
    columns = {"t": 1e3 * table["t_s"]}
    for motor in MOTORS:
        columns[f"wheel{motor}"] = np.degrees(table[f"position{motor}_rad"])
        columns[f"current{motor}"] = 1e3 * table[f"current{motor}_a"]
    columns |= {"x": 1e3 * table["x_m"], "y": 1e3 * table["y_m"], "yaw": np.degrees(table["yaw_rad"])}
    _write(folder / "table.csv", columns)
    (folder / "columns.toml").write_text(TABLE_COLUMNS, "utf-8")


def write_drive(folder: Path) -> None:
    """Write a drive of the simulated El-Dorado over a mound of sand, and its true path."""
    config = load_config("el-dorado")
    mission = WaypointsMission(
        type="waypoints",
        points=DRIVE_POINTS_M,
        speed_m_s=0.08,
        heading="along_path",
        heading_gain_per_s=0.5,
        yaw_rate_limit_rad_s=0.1,
    )
    drive = _recorded(
        config.model_copy(
            update={
                "mission": mission,
                "scomp": None,
                "roles": config.roles.model_copy(update={"camera": None}),
                "devices": {name: device for name, device in config.devices.items() if name != "camera"},
            }
        ),
        DRIVE_S,
    )
    table = drive.table(DRIVE_NAMES)
    _write(folder / "drive.csv", {name: table[name] for name in ("t_s", *DRIVE_COLUMNS)})
    true = drive.true_poses()
    columns = (drive.seconds(true.t_ns), true.x_m, true.y_m, true.yaw_rad)
    _write(folder / "tracker.csv", dict(zip(TRUTH, columns, strict=True)))


def write_frames(folder: Path) -> None:
    """Write what the rear camera of the simulated El-Dorado saw, with its calibration and telemetry."""
    with TemporaryDirectory(dir=folder) as place:
        log = Path(place) / "run.mcap"
        run_virtual(load_config("el-dorado"), log, FRAMES_S, None)
        frames = LogFrames(log)
        (folder / "frames").mkdir()
        for frame in frames:
            cv2.imwrite(str(folder / "frames" / f"{frame.number:05d}.jpg"), frame.image)
        unknown = (np.nan, np.nan, np.nan)
        rows = [
            (
                number,
                row.t_s,
                np.nan if row.wheel_speed_m_s is None else row.wheel_speed_m_s,
                *np.degrees(row.rates_rad_s or unknown),
            )
            for number, row in frames.telemetry.items()
        ]
    _write(folder / "telemetry.csv", dict(zip((*NEEDED, SPEED, *RATES), np.array(rows).T, strict=True)))
    (folder / "rig.json").write_bytes((resources.files(rigs) / "el-dorado.json").read_bytes())


def _recorded(config: Config, duration_s: float) -> Drive:
    with TemporaryDirectory() as place:
        log = Path(place) / "run.mcap"
        run_virtual(config, log, duration_s, None)
        return read_drive(log)


def _write(path: Path, columns: Mapping[str, Array]) -> None:
    """Write columns as a CSV file; a cell without a number stays empty."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for row in zip(*(values.tolist() for values in columns.values()), strict=True):
            writer.writerow(_cells(row))


def _cells(row: Sequence[float]) -> list[str]:
    return ["" if np.isnan(value) else f"{value:.8g}" for value in row]
