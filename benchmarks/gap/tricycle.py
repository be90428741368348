"""A simulated tricycle: its front wheel is driven, steered and measured; the rear ones only carry."""

from pathlib import Path

import numpy as np

from benchmarks.gap.drive_logs import write_log
from benchmarks.gap.reference_rovers import Array
from rover_hil.config import Config, load_config
from tests.nature.differential_drive import Recorded

ROOT = Path(__file__).parents[2]
TICKS_PER_TURN = 1600.0
WHEELS = """[[rover.wheels]]
x_m = 0.15
y_m = 0.0
steering = { low_deg = -90.0, high_deg = 90.0 }
motor = { stall_torque_nm = 4.0, no_load_rad_s = 20.0, stall_current_a = 8.0 }
radius_m = 0.0325

[[rover.wheels]]
x_m = 0.0
y_m = 0.08
driven = false
radius_m = 0.0325

[[rover.wheels]]
x_m = 0.0
y_m = -0.08
driven = false
radius_m = 0.0325

"""


def write_config(path: Path) -> Config:
    """Write the configuration and return it: that of the differential example with other wheels."""
    text = (ROOT / "docs/examples/differential.toml").read_text("utf-8")
    head, tail = text[: text.index("[[rover.wheels]]")], text[text.index("[loop]") :]
    tail = tail[: tail.index("[[simulation.plant.castors]]")].replace("mass_kg = 8.0", "mass_kg = 3.0")
    tail = tail.replace("centre_of_mass_x_m = -0.03", "centre_of_mass_x_m = 0.05")
    path.write_text(head + WHEELS + tail.replace("can/differential.toml", "can/mecanum.toml"), "utf-8")
    return load_config(str(path))


def write_drive(path: Path, config: Config, run: Array) -> None:
    """Write a drive as a log, its pose on /truth.

    Args:
        path: Of the log.
        config: Of the tricycle.
        run: Rows of time, x, y, yaw, ticks of the front wheel since the row before, its steering angle.
    """
    drive = Recorded(
        t_s=run[:, 0],
        wheels_rad=np.cumsum(run[:, 4:5], axis=0) * 2.0 * np.pi / TICKS_PER_TURN,
        gyro_rad_s=np.full(len(run), np.nan),
        pose=np.column_stack((run[:, 1:3], np.unwrap(run[:, 3]))),
    )
    write_log(path, config, drive, steering_rad=run[:, 5:6])
