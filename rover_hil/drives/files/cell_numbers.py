"""What the cells of a text table are as numbers: decimals, words, dates and times of day."""

import math
import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import NamedTuple

WORDS = {"": math.nan, "true": 1.0, "false": 0.0}
DECIMAL_COMMA = re.compile(r"^([+-]?\d*),(\d+(?:[eE][+-]?\d+)?)$")
DECIMAL_POINT = re.compile(r"^[+-]?\d*\.\d+(?:[eE][+-]?\d+)?$")
THOUSANDS = re.compile(r"^[+-]?[1-9]\d{0,2},\d{3}$")
CLOCK = re.compile(
    r"(?:(?:(?P<year>\d{4})[-/](?P<month>\d\d?)[-/](?P<day>\d\d?)|(?P<d>\d\d?)\.(?P<m>\d\d?)\.(?P<y>\d{4}))"
    r"(?:[T_]|\s+))?(?P<hour>\d\d?):(?P<minute>\d\d):(?P<second>\d\d)(?:[.,](?P<fraction>\d{1,12}))?"
    r"\s*(?P<half>[AaPp][Mm])?\s*(?P<zone>Z|UTC|[+-]\d\d:?\d\d)?",
    re.ASCII,
)
"""A time of day, perhaps behind a date: ISO 8601, or day, month and year with points between them."""
EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
DAY_S = 86400.0


class _Reading(NamedTuple):
    """What a clock showed.

    Attributes:
        t_s: Since 1970, or since midnight.
        has_date: Whether it is since 1970.
    """

    t_s: float
    has_date: bool


def number_of(cell: str) -> float | None:
    """Return a cell as a number; NaN for an empty one, None where it holds no number."""
    try:
        return float(cell)
    except ValueError:
        return WORDS.get(cell.lower())


def is_measured(cell: str) -> bool:
    """Return whether a cell is a number, also with a decimal comma, or a time of a clock."""
    number = number_of(cell)
    if number is not None:
        return cell.lower() not in WORDS
    return DECIMAL_COMMA.match(cell) is not None or CLOCK.fullmatch(cell) is not None


def clock_seconds(cells: Sequence[str]) -> list[float] | None:
    """Return dates and times of day in s, NaN for empty cells; None where a cell is something else.

    With a date they count from 1970, else from midnight before the first one, on over the next midnight.
    """
    times_s: list[float] = []
    days = 0
    before: _Reading | None = None
    for cell in cells:
        if not cell:
            times_s.append(math.nan)
            continue
        reading = _read_clock(cell)
        if reading is None or (before is not None and reading.has_date is not before.has_date):
            return None
        if before is not None and not reading.has_date and reading.t_s < before.t_s - 0.5 * DAY_S:
            days += 1
        before = reading
        times_s.append(reading.t_s + days * DAY_S)
    return times_s if before is not None else None


def _read_clock(cell: str) -> _Reading | None:
    """Return a cell as the reading of a clock; None where it is none."""
    match = CLOCK.fullmatch(cell)
    if match is None:
        return None
    hour, minute, second = int(match["hour"]), int(match["minute"]), int(match["second"])
    if match["half"]:
        hour = hour % 12 + 12 * (match["half"].lower() == "pm")
    if hour > 23 or minute > 59 or second > 60:
        return None
    day_s = hour * 3600 + minute * 60 + second + float(f"0.{match['fraction'] or 0}")
    date = [match[name] for name in (("year", "month", "day") if match["year"] else ("y", "m", "d"))]
    if date[0] is None:
        return _Reading(day_s, has_date=False)
    try:
        midnight = datetime(*map(int, date), tzinfo=UTC)  # type: ignore[arg-type, misc]
    except ValueError:
        return None
    return _Reading((midnight - EPOCH - _zone_of(match["zone"])).total_seconds() + day_s, has_date=True)


def _zone_of(text: str | None) -> timedelta:
    if not text or text in {"Z", "UTC"}:
        return timedelta()
    minutes = int(text[1:3]) * 60 + int(text[-2:])
    return timedelta(minutes=-minutes if text[0] == "-" else minutes)


def with_decimal_points(rows: Sequence[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Return rows with a point in numbers that have a decimal comma.

    1,234 alone may be a thousand: a column has decimal commas where another of its numbers cannot be one and
    none has a decimal point; all columns have them where one has and no number of the table has a point.
    """
    commas: dict[int, bool] = {}
    for cells in rows:
        for place, cell in enumerate(cells):
            if "," in cell and DECIMAL_COMMA.match(cell):
                commas[place] = commas.get(place, False) or not THOUSANDS.match(cell)
    decimal = {place for place, is_sure in commas.items() if is_sure}
    if not decimal:
        return list(rows)
    pointed = {
        place
        for cells in rows
        for place, cell in enumerate(cells)
        if "." in cell and DECIMAL_POINT.match(cell)
    }
    decimal = decimal - pointed if pointed else set(commas)
    return [
        tuple(
            [
                DECIMAL_COMMA.sub(r"\1.\2", cell) if place in decimal else cell
                for place, cell in enumerate(cells)
            ]
        )
        for cells in rows
    ]
