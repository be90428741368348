"""Rows with ground truth or measured places, as what a log holds of them."""

import math
from collections.abc import Iterator

from drivers.samples import PoseFixSample
from rover_hil.drives.formats.drive import START_NS
from rover_hil.drives.formats.fixes import FixMaker
from rover_hil.drives.formats.table.columns import FixColumns
from rover_hil.drives.formats.table.drive_table import Row
from rover_hil.recording.schema import TruthRecord


class PlaceFeed:
    """Makes records of rows.

    Args:
        fixes: How the places were measured; None where there are none.
    """

    def __init__(self, fixes: FixColumns | None) -> None:
        self._fixes = None if fixes is None else FixMaker(fixes, fixes.marker)

    def records(self, row: Row) -> Iterator[TruthRecord | PoseFixSample]:
        """Yield the ground truth, with yaw where it is measured, or the pose fix in a row."""
        t_ns = START_NS + row.t_ns
        if row.section == "fixes":
            fix = None if self._fixes is None else self._fixes.make(t_ns, *row.values["fix"])
            if fix is not None:
                yield fix
            return
        if all(map(math.isfinite, row.values["pose"])):
            x_m, y_m, *yaw_rad = row.values["pose"]
            record: TruthRecord = {"t_ns": t_ns, "x_m": x_m, "y_m": y_m, "is_new": True}
            if yaw_rad:
                record["yaw_rad"] = yaw_rad[0]
            yield record
