"""The file of a study: one line of JSON for the study and one for each finished trial."""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from drivers.errors import ConfigError

SCHEMA = "rover-hil-study/1"
MOST_BYTES = 256 * 2**20


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt:
    """One finished trial.

    Attributes:
        number: Of the trial, from 0.
        values: What was tried, by dotted key.
        cost: On the training cases; None where the values were rejected or given up.
        at_least: Lower bound of the cost, where it was given up.
        refused: Why the values are rejected; empty when they are acceptable.
        is_start: These are the values that the study started from.
        case_costs: Cost of each mission driven, by its seed; empty for logs, which have one cost together.
        terms: Each measured value by its name: its quantile over the missions driven, or pooled over logs.
    """

    number: int
    values: dict[str, float]
    cost: float | None
    at_least: float
    refused: str
    is_start: bool
    case_costs: Mapping[int, float] = field(default_factory=dict)
    terms: Mapping[str, float] = field(default_factory=dict)


_ATTEMPTS = TypeAdapter(Attempt)


class Journal:
    """Finished trials in a file; a line that a killed process has not finished is dropped.

    Args:
        path: The file; made where it does not exist.
        name: Of the study.
        setting: Everything that costs and proposals depend on.

    Raises:
        ConfigError: The file belongs to another configuration, or is no journal.
    """

    def __init__(self, path: Path, name: str, setting: str) -> None:
        self._path = path
        self._attempts: dict[int, Attempt] = {}
        head = {"schema": SCHEMA, "study": name, "setting": setting}
        lines = self._read_lines()
        if not lines:
            self._append(head)
            return
        try:
            header = json.loads(lines[0])
            if header["schema"] != SCHEMA:
                raise ValueError
            self._attempts = {attempt.number: attempt for attempt in map(_ATTEMPTS.validate_json, lines[1:])}
        except (ValueError, KeyError, TypeError, ValidationError) as error:
            raise ConfigError(f"{path} is no study, or damaged: choose another --out") from error
        if header != head:
            raise ConfigError(f"{path} was begun with another configuration: choose another --study")

    def attempts(self) -> list[Attempt]:
        """Return the finished trials in the order of their numbers."""
        return [self._attempts[number] for number in sorted(self._attempts)]

    def add(self, attempt: Attempt) -> None:
        """Write a finished trial."""
        self._append(asdict(attempt))
        self._attempts[attempt.number] = attempt

    def _read_lines(self) -> list[bytes]:
        """Return the complete lines; remove what follows the last of them."""
        if not self._path.exists():
            return []
        with self._path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
        if len(data) > MOST_BYTES:
            raise ConfigError(f"{self._path} is no study, as it is too large: choose another --out")
        whole, _, torn = data.rpartition(b"\n")
        if torn and not whole:
            raise ConfigError(f"{self._path} is no study, or damaged: choose another --out")
        if torn:
            os.truncate(self._path, len(whole) + 1)
        return whole.splitlines()

    def _append(self, record: Mapping[str, object]) -> None:
        try:
            with self._path.open("ab") as file:
                file.write(json.dumps(record).encode() + b"\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise ConfigError(f"cannot write {self._path}: {error.strerror}; choose another --out") from error
