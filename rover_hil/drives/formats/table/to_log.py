"""Write a table as a log: its numbers pass through the codecs of a rover's devices, and replay like a run."""

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from controllers.motion.kinematics import Kinematics, make_kinematics
from drivers.errors import LogError
from drivers.samples import PoseFixSample
from rover_hil.config import Config
from rover_hil.drives.formats.drive import (
    START_NS,
    Contents,
    DriveLinks,
    InertialSensor,
    drive_config,
    write_drive,
)
from rover_hil.drives.formats.table.columns import Columns, FixColumns
from rover_hil.drives.formats.table.drive_table import Row
from rover_hil.drives.formats.table.place_feed import PlaceFeed
from rover_hil.drives.formats.table.rows import read_drive_table
from rover_hil.drives.formats.wheel_frames import write_mapping
from rover_hil.drives.quality.oddities import Evidence
from rover_hil.recording.schema import TruthRecord
from rover_hil.run.composition import ReplayLinks


def write_table_as_log(
    path: Path, columns: Columns, rover: Config, out: Path, *, with_estimate: bool = True
) -> Iterator[Contents]:
    """Write the log `out` of a table, cycle by cycle; yields what was used so far.

    Args:
        path: The table.
        columns: What its columns hold.
        rover: Configuration of the rover; its devices and its mission are not used.
        out: The log; must not exist.
        with_estimate: As for `write_drive`.

    Raises:
        LogError: The table cannot be read, or does not fit the rover.
    """
    kinematics = make_kinematics(rover.rover)
    drive = read_drive_table(path, columns, rover)
    contents = Contents(notes=drive.notes, oddities=drive.oddities)
    if columns.rover is None:
        contents.notes.append(
            "no [rover] is described: two wheels of radius 0.1 m, 0.4 m apart, stand for it; the motion does "
            "not depend on them"
        )
    held = {row.section for row in drive.rows}
    has_both = any(wheel.speed and (wheel.position or wheel.step) for wheel in columns.wheel)
    contents.evidence = Evidence(
        sections=frozenset(held), has_own_turn=bool(columns.wheel), has_both=has_both
    )
    if drive.filter is not None:
        rover = rover.model_copy(update={"filter": drive.filter})
    if drive.is_gyro_coarse:
        contents.notes.append("the steps of the yaw rate are coarse: its readings do not show a dead gyro")
        safety = rover.safety.model_copy(update={"gyro_stuck_s": LONGEST_S})
        rover = rover.model_copy(update={"safety": safety})

    def make_feed(links: ReplayLinks) -> Callable[[Row], Iterator[TruthRecord | PoseFixSample]]:
        return _Feeder(links, kinematics, contents, columns.fixes).feed

    with TemporaryDirectory(prefix="rover_hil_") as folder:
        mapping = write_mapping(Path(folder), [None] * kinematics.wheel_count, drive.quantities, ())
        config = drive_config(rover, "table", mapping, _inertial(columns, held), has_fixes="fixes" in held)
        for _ in write_drive(
            out,
            f"imported from {path.name}",
            config,
            drive.rows,
            make_feed,
            contents,
            with_estimate=with_estimate,
        ):
            yield contents
    if not contents.used.keys() & {"wheels", "increments"}:
        raise LogError(f"{path}: no row holds a number of the wheels: name other columns")


LONGEST_S = 3600.0
"""The rule of readings that stay the same waits so long."""


def _inertial(columns: Columns, held: Collection[str]) -> InertialSensor | None:
    """Return what the inertial sensor of a drive measures; None without one."""
    imu = columns.imu
    if imu is None:  # of the increments
        return InertialSensor(has_rate=True) if "imu" in held else None
    return InertialSensor(imu.yaw_rate is not None, imu.heading is not None, imu.heading_reference)


class _Feeder:
    """Turns rows into what the devices would have sent."""

    def __init__(
        self, links: ReplayLinks, kinematics: Kinematics, contents: Contents, fixes: FixColumns | None
    ) -> None:
        self._places = PlaceFeed(fixes)
        self._drive = DriveLinks(links, kinematics)
        self._contents = contents

    def feed(self, row: Row) -> Iterator[TruthRecord | PoseFixSample]:
        """Feed one row into the links; yields the true pose or the fix that it holds, if any."""
        t_ns, values, is_used = START_NS + row.t_ns, row.values, False
        match row.section:
            case "wheels":
                for quantity, numbers in values.items():
                    is_used |= self._drive.put_wheels(t_ns, quantity, numbers)
            case "increments":
                x_m, y_m, turn_rad = values["move"]
                is_used = self._drive.move(t_ns, x_m, y_m, turn_rad)
            case "imu":
                is_used = self._feed_imu(t_ns, values)
            case _:
                for record in self._places.records(row):
                    is_used = True
                    yield record
        self._contents.count(row.section, is_used=is_used)

    def _feed_imu(self, t_ns: int, values: Mapping[str, Sequence[float]]) -> bool:
        held = {name: numbers for name, numbers in values.items() if all(map(math.isfinite, numbers))}
        heading_rad = None if "heading" not in held else held["heading"][0]
        orientation = (
            None
            if heading_rad is None
            else (math.cos(0.5 * heading_rad), 0.0, 0.0, math.sin(0.5 * heading_rad))
        )
        if held:
            self._drive.put_imu(t_ns, held.get("rate"), held.get("acceleration"), orientation)
            return True
        return False
