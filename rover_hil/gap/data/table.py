"""Runs from tables: one CSV file of all runs, or a folder of files with one run each.

A row is a steady experiment, or a sample of a series where several rows carry the same `run`. Columns:
`run`, the model's conditions, its channels, its inputs. Units stand in the header, `current [A]`, or in the
name, `speed_rad_s`; they must be the model's.
"""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from drivers.errors import ConfigError
from sim_backends.models.interface import Array, DrivenModel, Model, Run

HEADER = re.compile(r"^(?P<name>[^\[\(]+?)\s*(?:[\[\(](?P<unit>[^\]\)]*)[\]\)])?$")


def read_table(model: Model, path: Path) -> list[Run]:
    """Return the runs in a CSV file, or in all CSV files of a folder.

    Raises:
        ConfigError: A column or a unit is missing, or a cell holds no number; the message says where.
    """
    files = sorted(path.glob("*.csv")) if path.is_dir() else [path]
    if not files:
        raise ConfigError(f"{path} holds no .csv file")
    runs: list[Run] = []
    for file in files:
        runs += _read_file(model, file)
    return runs


def _read_file(model: Model, path: Path) -> list[Run]:
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            rows = [row for row in csv.reader(stream) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"cannot read {path} as a table: {error}") from error
    if len(rows) < 2:
        raise ConfigError(f"{path} holds no runs: a header line and one row per run or sample are needed")
    columns = _columns(model, path, rows[0])
    names = [row[columns["run"]].strip() if "run" in columns else path.stem for row in rows[1:]]
    table = {
        name: _numbers(path, name, [row[position] if position < len(row) else "" for row in rows[1:]])
        for name, position in columns.items()
        if name != "run"
    }
    members: dict[str, list[int]] = {}
    for index, name in enumerate(names):
        members.setdefault(name, []).append(index)
    return [_run(model, path, name, np.array(index), table) for name, index in members.items()]


def _run(
    model: Model,
    path: Path,
    name: str,
    index: "np.ndarray[tuple[int, ...], np.dtype[np.intp]]",
    table: Mapping[str, Array],
) -> Run:
    conditions = {}
    for condition in model.condition_units:
        values = table[condition][index]
        if np.isfinite(values).all() and np.ptp(values) > 1e-9 * max(1.0, float(np.abs(values).max())):
            raise ConfigError(
                f"{path}, run {name}: {condition} changes within the run; it must be one number"
            )
        conditions[condition] = float(values[0])
    inputs = _input_names(model)
    return Run(
        name=name,
        conditions=conditions,
        inputs={key: table[key][index] for key in inputs},
        measured={
            channel.name: table[channel.name][index] for channel in model.channels if channel.name in table
        },
    )


def _input_names(model: Model) -> Sequence[str]:
    return list(model.input_units) if isinstance(model, DrivenModel) else []


def _columns(model: Model, path: Path, header: Sequence[str]) -> dict[str, int]:
    """Return the place of each column the model knows, after a check of its unit."""
    units = {channel.name: channel.unit for channel in model.channels} | dict(model.condition_units)
    if isinstance(model, DrivenModel):
        units |= dict(model.input_units)
    positions: dict[str, int] = {}
    for position, cell in enumerate(header):
        match = HEADER.match(cell.strip())
        if match is None:
            continue
        name = match["name"].strip()
        if name == "run":
            positions[name] = position
        elif name in units:
            _check_unit(path, name, match["unit"], units[name])
            positions[name] = position
    needed = [*model.condition_units, *_input_names(model)]
    missing = [name for name in needed if name not in positions]
    if missing:
        raise ConfigError(f"{path} has no column '{missing[0]}' [{units[missing[0]]}]")
    return positions


def _check_unit(path: Path, name: str, given: str | None, unit: str) -> None:
    if given is None:
        if _plain(unit) != "1" and not name.lower().endswith(f"_{_plain(unit)}"):
            raise ConfigError(f"{path}: column '{name}' has no unit; write '{name} [{unit}]'")
    elif _plain(given) != _plain(unit):
        raise ConfigError(f"{path}: column '{name}' is in {given or 'no unit'}, the model has {unit}")


def _plain(unit: str) -> str:
    """Return a unit as it stands at the end of a name: rad/s is rad_s, N m is nm, % is percent."""
    text = unit.strip().lower().replace("%", "percent").replace("°", "deg").replace("/", "_")
    return re.sub(r"[\s·*.]", "", text) or "1"


def _numbers(path: Path, name: str, cells: Sequence[str]) -> Array:
    values = []
    for row, cell in enumerate(cells, start=2):
        text = cell.strip()
        try:
            values.append(float(text) if text else math.nan)
        except ValueError as error:
            raise ConfigError(f"{path}, line {row}: {name} is '{text}', no number") from error
    return np.array(values, dtype=np.float64)
