"""Write a table as a log: its numbers pass through the codecs of a rover's devices, and replay like a run."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from controllers.motion.kinematics import Kinematics, make_kinematics
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.errors import LogError
from drivers.registry import AnyDeviceSettings
from drivers.xsens.settings import XsensSettings
from rover_hil.config import Config, RoleSettings
from rover_hil.importing.drive import IMU, SILENT_S, START_NS, WHEELS, Contents, DriveLinks, write_drive
from rover_hil.importing.table.columns import Columns
from rover_hil.importing.table.rows import Row, read_drive_table
from rover_hil.importing.wheel_frames import write_mapping
from rover_hil.recording.schema import TruthRecord
from rover_hil.run.composition import ReplayLinks


def write_table_as_log(path: Path, columns: Columns, rover: Config, out: Path) -> Iterator[Contents]:
    """Write the log `out` of a table, cycle by cycle; yields what was used so far.

    Args:
        path: The table.
        columns: What its columns hold.
        rover: Configuration of the rover; its devices and its mission are not used.
        out: The log; must not exist.

    Raises:
        LogError: The table cannot be read, or does not fit the rover.
    """
    kinematics = make_kinematics(rover.rover)
    drive = read_drive_table(path, columns, rover)
    contents = Contents(notes=drive.notes)
    if drive.filter is not None:
        rover = rover.model_copy(update={"filter": drive.filter})

    def make_feed(links: ReplayLinks) -> Callable[[Row], Iterator[TruthRecord]]:
        return _Feeder(links, kinematics, contents).feed

    with TemporaryDirectory(prefix="rover_hil_") as folder:
        config = _config(
            rover,
            Path(folder),
            kinematics,
            drive.quantities,
            has_imu=any(row.section == "imu" for row in drive.rows),
        )
        for _ in write_drive(out, f"imported from {path.name}", config, drive.rows, make_feed, contents):
            yield contents
    if not contents.used.keys() & {"wheels", "increments"}:
        raise LogError(f"{path}: no row holds a number of the wheels: name other columns")


def _config(
    rover: Config, folder: Path, kinematics: Kinematics, quantities: tuple[str, ...], *, has_imu: bool
) -> Config:
    mapping = write_mapping(folder, [None] * kinematics.wheel_count, quantities, ())
    devices: dict[str, AnyDeviceSettings] = {
        WHEELS: CanWheelsSettings(
            interface="virtual", channel="table", mapping=str(mapping), max_age_s=SILENT_S
        )
    }
    if has_imu:
        devices[IMU] = XsensSettings(port="table", max_age_s=SILENT_S)
    roles = RoleSettings(wheels=WHEELS, gyro=IMU if has_imu else None)
    none = dict.fromkeys(("mission", "slip", "scomp", "simulation", "tune"))
    return rover.model_copy(update={"devices": devices, "roles": roles, **none})


class _Feeder:
    """Turns rows into what the devices would have sent."""

    def __init__(self, links: ReplayLinks, kinematics: Kinematics, contents: Contents) -> None:
        self._drive = DriveLinks(links, kinematics)
        self._contents = contents

    def feed(self, row: Row) -> Iterator[TruthRecord]:
        """Feed one row into the links; yields the true pose that it holds, if any."""
        t_ns, values, is_used = START_NS + row.t_ns, row.values, False
        match row.section:
            case "wheels":
                for quantity, numbers in values.items():
                    is_used |= self._drive.put_wheels(t_ns, quantity, numbers)
            case "increments":
                x_m, y_m, turn_rad = values["move"]
                is_used = self._drive.move(t_ns, x_m, y_m, turn_rad)
            case "imu":
                is_used = all(math.isfinite(number) for numbers in values.values() for number in numbers)
                if is_used:
                    self._drive.put_imu(t_ns, values["rate"], values.get("acceleration"), None)
            case _:
                x_m, y_m, yaw_rad = values["pose"]
                is_used = all(map(math.isfinite, values["pose"]))
                if is_used:
                    yield {"t_ns": t_ns, "x_m": x_m, "y_m": y_m, "yaw_rad": yaw_rad, "is_new": True}
        self._contents.count(row.section, is_used=is_used)
