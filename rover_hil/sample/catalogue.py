"""The samples: what each writes, for which examples, and what makes it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from rover_hil.sample import board, drives, runs, test_stands


@dataclass(frozen=True, slots=True)
class Sample:
    """Data for examples.

    Attributes:
        line: What it is, in one line.
        paths: The files and folders it writes, relative to the current folder.
        make: Writes them into an empty folder.
    """

    line: str
    paths: tuple[str, ...]
    make: Callable[[Path], None]


SAMPLES: Mapping[str, Sample] = {
    "rover": Sample("a configuration to edit, a copy of `robotino`", ("my_rover.toml",), runs.write_rover),
    "runs": Sample(
        "two drives of the Robotino, the second with a smaller gain",
        ("runs/first", "runs/second"),
        runs.write_runs,
    ),
    "sand": Sample("a drive on sand with a rear camera", ("runs/sand",), runs.write_sand),
    "floors": Sample(
        "straight drives on two floors, to fit slip maps and to test them",
        ("floors", "floors_test"),
        runs.write_floors,
    ),
    "wheels": Sample(
        "drives of a rover whose left wheel is 3 % larger than its configuration states",
        ("my_wheels.toml", "drives"),
        runs.write_wheels,
    ),
    "noise": Sample(
        "drives of a rover whose sensors have less noise than its configuration states",
        ("noisy.toml", "noise"),
        runs.write_noise,
    ),
    "robotino": Sample(
        "a drive in the format of a measured Robotino run", ("exp00.csv",), drives.write_robotino
    ),
    "bag": Sample(
        "a drive as a ROS 2 bag, and which of its topics hold what",
        ("first_rosbag2", "topics.toml"),
        drives.write_bag,
    ),
    "can": Sample("a drive of `el-dorado` as a log of its CAN bus", ("drive.log",), drives.write_can_log),
    "table": Sample(
        "a drive as a table, and which of its columns hold what",
        ("table.csv", "columns.toml"),
        drives.write_table,
    ),
    "drive": Sample(
        "a drive on sand as a CSV file, and its tracked path",
        ("drive.csv", "tracker.csv"),
        drives.write_drive,
    ),
    "frames": Sample(
        "pictures of a rear camera, its calibration, and the telemetry",
        ("frames", "rig.json", "telemetry.csv"),
        drives.write_frames,
    ),
    "board": Sample(
        "pictures of a calibration board", ("pictures", "ground.png", "rover.json"), board.write_board
    ),
    "test_bed": Sample("plate and wheel tests of a sand", ("test_bed",), test_stands.write_test_bed),
    "slope": Sample(
        "traverses of a side slope whose soil flows downhill, unlike the model's",
        ("measured",),
        test_stands.write_slope,
    ),
}
"""By name, in the order of the list."""
