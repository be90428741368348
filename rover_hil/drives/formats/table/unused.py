"""What a table and its folder hold that nothing uses: columns that are not named, and ranges to beacons."""

import gzip
import re
from collections.abc import Collection, Iterator
from pathlib import Path

from rover_hil.drives.files.csv_table import CsvTable
from rover_hil.drives.quality.oddities import TOLD, Oddity

RANGES = re.compile(r"\b(ranges?(_m)?|beacons?(_id)?|anchors?(_id)?)\b", re.IGNORECASE)
"""In the header of a table of ranges to beacons."""
MOST_BYTES = 4096
"""Of a header."""
MOST_NAMES = 10
MOST_TABLES = 200
"""More tables of a folder are not opened."""


def unused_parts(table: CsvTable, used: Collection[str], files: Collection[str]) -> Iterator[Oddity]:
    """Yield the columns of a table that are not used, and tables of ranges to beacons beside it.

    Args:
        table: The table of a drive.
        used: Names of its columns that are used.
        files: Names of other tables that are used.
    """
    unused = [name for name in table.names if name not in used]
    if unused:
        more = f" and {len(unused) - MOST_NAMES} more" if len(unused) > MOST_NAMES else ""
        where = f"{', '.join(unused[:MOST_NAMES])}{more}"
        yield Oddity(what="columns that are not used", where=where, count=len(unused), done=TOLD)
    tables = (path for path in table.path.parent.iterdir() if path.name.endswith((".csv", ".csv.gz")))
    for path in sorted(tables)[:MOST_TABLES]:
        if path.name not in (table.path.name, *files) and RANGES.search(_header(path)):
            what = "a table of ranges to beacons, or of their places, which nothing uses"
            yield Oddity(what=what, where=path.name, count=1, done=TOLD)


def _header(path: Path) -> str:
    """Return the beginning of a text table; "" where it cannot be read."""
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            return file.readline(MOST_BYTES).decode("utf-8", "replace")
    except OSError:
        return ""
