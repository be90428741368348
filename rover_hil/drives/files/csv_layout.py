"""How a text table is laid out: its letters, its delimiter, and the lines above its numbers."""

import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from rover_hil.drives.files.cell_numbers import is_measured
from rover_hil.drives.files.unreadable import UnreadableError

DELIMITERS = "\t;, "
SAMPLE_BYTES = 65_536
SAMPLE_LINES = 20
"""Of the sample so many lines show the delimiter, the last ones: above them is the header."""
MOST_HEADER_LINES = 1000
SAMPLE_ROWS = 50
PACKED = {b"PK\x03\x04": "a spreadsheet or an archive", b"\xd0\xcf\x11\xe0": "a spreadsheet"}
UTF_16 = (b"\xff\xfe", b"\xfe\xff")
IN_BRACKETS = re.compile(r"^(\[[^\]]*\]|\([^)]*\))$")
_UNIT_WORDS = (
    "s sec ms msec us µs μs ns min h d days hz khz rad mrad deg ° degrees rev rpm 1/min ticks tick counts "
    "count pix px m meter cm mm km m/s cm/s mm/s km/h m/s2 m/s² m/s^2 g rad/s deg/s °/s rev/s rad/s2 a ma v "
    "mv w n nm pa hpa bar k °c degc % - 1 bool utc"
)
UNITS = frozenset(_UNIT_WORDS.split())
"""What stands in a row of units, in small letters."""


class Header(NamedTuple):
    """The lines above the numbers.

    Attributes:
        lines: Their number.
        names: Which of them holds the names; None without any.
        units: Which of them holds the units; None without any.
    """

    lines: int
    names: int | None
    units: int | None


def as_text(raw: bytes) -> io.TextIOWrapper:
    """Return bytes as text: UTF-8, UTF-16 with its mark, or else Windows 1252.

    Raises:
        UnreadableError: They are none.
    """
    for begin, what in PACKED.items():
        if raw.startswith(begin):
            raise UnreadableError(f"it is {what}, not text: save the sheet as CSV")
    if raw.startswith(UTF_16):
        encoding = "utf-16"
    elif b"\0" in raw[:SAMPLE_BYTES].rstrip(b"\0"):
        raise UnreadableError("it holds binary data, not text: export it as CSV")
    else:
        encoding = "utf-8-sig" if _is_utf_8(raw) else "cp1252"
    return io.TextIOWrapper(io.BytesIO(raw), encoding, errors="replace", newline="")


def _is_utf_8(raw: bytes) -> bool:
    try:
        raw.decode("utf-8")
    except UnicodeDecodeError:
        return False
    return True


def likely_delimiter(sample: str) -> str:
    """Return the delimiter with which the most cells of a text are numbers; of equal ones the first."""
    lines = [line for line in sample.splitlines()[:-1] or [sample] if line.strip()]
    shares = {}
    for delimiter in DELIMITERS:
        rows = list(
            csv.reader(
                _stripped(lines[-SAMPLE_LINES:], delimiter), delimiter=delimiter, skipinitialspace=True
            )
        )
        width = Counter(map(len, rows)).most_common(1)[0][0] if rows else 0
        cells = [cell.strip() for row in rows if len(row) == width > 1 for cell in row]
        shares[delimiter] = sum(map(is_measured, cells)) / max(1, len(cells))
    best = max(shares, key=lambda each: shares[each])
    if shares[best] > 0.0:
        return best
    return next((each for each in DELIMITERS[:-1] if lines and each in lines[0]), ",")


def _stripped(lines: Sequence[str], delimiter: str) -> Sequence[str]:
    return [line.strip() for line in lines] if delimiter == " " else lines


def header_of(rows: Sequence[Sequence[str]], count: int | None) -> Header:
    """Return which rows are above the numbers, and what they hold.

    Args:
        rows: Of the table.
        count: How many are above the numbers; None for all above the first row of numbers.
    """
    if count is None:
        count = _first_numbers(rows)
    if not count or not rows:
        return Header(count, None, None)
    last = min(count, len(rows)) - 1
    if last > 0 and _are_units(rows[last]) and len(rows[last - 1]) >= len(rows[last]):
        return Header(count, last - 1, last)
    return Header(count, last, last - 1 if last > 0 and _are_units(rows[last - 1]) else None)


def _first_numbers(rows: Sequence[Sequence[str]]) -> int:
    """Return the number of rows above the first that holds numbers where the others do."""
    if not rows:
        return 0
    # Of lengths that are equally frequent the one that comes last: a header is above.
    width = Counter(map(len, reversed(rows))).most_common(1)[0][0]
    sample = [row for row in rows[len(rows) // 2 :] if len(row) == width][:SAMPLE_ROWS]
    numeric = [
        place
        for place in range(width)
        if 2 * sum(is_measured(row[place]) for row in sample) >= sum(bool(row[place]) for row in sample) > 0
    ]
    for count, row in enumerate(rows[: MOST_HEADER_LINES + 1]):
        filled = [row[place] for place in numeric if place < len(row) and row[place]]
        # A wrong cell in the first row of numbers is no reason to take it for a header.
        is_data = filled and is_measured(filled[0]) and 2 * sum(map(is_measured, filled)) >= len(filled)
        if len(row) == width and is_data:
            return count
    return len(rows)


def _are_units(row: Sequence[str]) -> bool:
    filled = [cell for cell in row if cell]
    units = [cell for cell in filled if cell.lower() in UNITS or IN_BRACKETS.match(cell)]
    return 2 * len(units) > len(filled)
