"""The records of a log as tables: a row for each record, a column for each number or word in it."""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from drivers.errors import LogError
from rover_hil.recording.reader import LogMessage, LogReader
from rover_hil.recording.schema import (
    COMMAND,
    CYCLE,
    ESTIMATE,
    HEALTH,
    LINK,
    SAMPLES,
    SET_POINT,
    TRUTH,
    WATCHDOG,
)

Value: TypeAlias = float | int | str | bool | None

TIME = "t_s"
"""First column of every table: time since the start of the log."""
MOST_COLUMNS = 1000
WHOLE_TABLES = {
    COMMAND: "command",
    CYCLE: "cycle",
    ESTIMATE: "estimate",
    SET_POINT: "set_point",
    TRUTH: "truth",
}
TABLES_OF_SAMPLES = {
    "WheelSample": "wheels",
    "HeadingSample": "headings",
    "AttitudeSample": "attitudes",
    "RateSample": "rates",
    "AccelerationSample": "accelerations",
    "PowerSample": "power",
    "BumperSample": "bumper",
    "PoseFixSample": "pose_fixes",
    "FrameSample": "frames",
    "FaultSample": "faults",
    "LinkSample": "links",
}
COVARIANCE = ("xx", "xy", "x_yaw", "yy", "y_yaw", "yaw_yaw")
MATRIX = "covariance"


@dataclass
class Table:
    """Rows that need not have the same columns; `columns` has all, in the order of first occurrence."""

    columns: dict[str, None] = field(default_factory=lambda: {TIME: None})
    rows: list[dict[str, Value]] = field(default_factory=list)

    def add(self, t_s: float, record: object) -> None:
        """Add a record.

        Raises:
            ValueError: It would make more than `MOST_COLUMNS` columns.
        """
        row: dict[str, Value] = {TIME: t_s}
        row.update(_flat(record, ""))
        self.columns.update(dict.fromkeys(row))
        if len(self.columns) > MOST_COLUMNS:
            raise ValueError(f"more than {MOST_COLUMNS} columns")
        self.rows.append(row)

    def column(self, name: str) -> list[Value]:
        """Return a column; None where a row has no such value."""
        return [row.get(name) for row in self.rows]


def read_tables(log: LogReader, on_message: Callable[[], None] = lambda: None) -> Mapping[str, Table]:
    """Return the tables of a log by name, those without rows left out.

    Samples have a table for each kind; of a wheel, `wheel` counts from 0. Names of nested values are joined
    by `_`, those of wheels have their number, from 1. Units are in the names. Raw bytes, camera frames and
    columns without any value are left out.

    Args:
        log: The log.
        on_message: Called after each message, to show progress.

    Raises:
        LogError: The log is damaged.
    """
    tables: dict[str, Table] = {}
    for message in log.messages():
        try:
            for name, t_ns, record in _records(message):
                tables.setdefault(name, Table()).add((t_ns - log.start_ns) / 1e9, record)
        except (ValueError, TypeError, AttributeError) as error:
            raise LogError(f"{log.path} is damaged: {message.topic} at {message.t_ns} ns: {error}") from error
        on_message()
    for table in tables.values():
        filled = {name for row in table.rows for name, value in row.items() if value is not None}
        table.columns = {name: None for name in table.columns if name in filled}
    return tables


def _records(message: LogMessage) -> Iterator[tuple[str, int, object]]:
    topic = message.topic
    if topic in WHOLE_TABLES:
        yield WHOLE_TABLES[topic], message.t_ns, message.json()
    elif topic == SAMPLES:
        for kind, samples in _mapping(message.json()).items():
            for sample in samples if isinstance(samples, list) else ():
                t_ns = _mapping(sample).get("t_ns")
                yield (
                    TABLES_OF_SAMPLES.get(kind, kind),
                    t_ns if isinstance(t_ns, int) else message.t_ns,
                    sample,
                )
    elif topic == HEALTH:
        devices = message.json()
        for device in devices if isinstance(devices, list) else ():
            yield "health", message.t_ns, device
    elif topic == WATCHDOG:
        yield "events", message.t_ns, {"event": "watchdog", "device": "", "reason": "the drive was stopped"}
    elif topic.startswith(LINK):
        change = _mapping(message.json())
        event = "link up" if change.get("up") else "link down"
        device = topic.removeprefix(LINK)
        yield "events", message.t_ns, {"event": event, "device": device, "reason": str(change.get("reason"))}


def _mapping(record: object) -> Mapping[str, object]:
    if not isinstance(record, dict):
        raise TypeError("not a JSON object")
    return record


def _flat(record: object, name: str) -> Iterator[tuple[str, Value]]:
    if isinstance(record, dict):
        for key, value in record.items():
            yield from _flat(value, f"{name}_{key}" if name else key)
    elif isinstance(record, list):
        if name.endswith(MATRIX) and len(record) == len(COVARIANCE):
            for part, value in zip(COVARIANCE, record, strict=True):
                yield from _flat(value, f"{name}_{part}")
        elif name == "innovations":
            for innovation in record:
                inner = dict(_mapping(innovation))
                yield from _flat(inner, f"innovation_{inner.pop('name', '')}")
        else:
            for number, value in enumerate(record, start=1):
                yield from _flat(value, _numbered(name, number))
    elif isinstance(record, float | int | str | bool) or record is None:
        yield name, record
    else:
        yield name, json.dumps(record)


def _numbered(name: str, number: int) -> str:
    """Return the name of one of several values: `speed_rad_s` of wheel 2 becomes `speed2_rad_s`."""
    for unit in ("_rad_s", "_rad", "_a", "_m"):
        if name.endswith(unit):
            return f"{name.removesuffix(unit)}{number}{unit}"
    return f"{name}{number}"
