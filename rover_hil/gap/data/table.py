"""Runs from tables: one CSV file of all runs, or a folder of files with one run each.

A row is a steady experiment, or a sample of a series where several rows carry the same `run`. Columns:
`run`, the model's conditions, its channels, its inputs. Units are part of the header, `current [A]`, or of
the name, `speed_rad_s`; they must be those of the model.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from drivers.errors import ConfigError
from rover_hil.datasets.csv_table import read_csv
from sim_backends.models.interface import Array, DrivenModel, Model, Run


def read_table(model: Model, path: Path) -> list[Run]:
    """Return the runs in a CSV file, or in all CSV files of a folder.

    Raises:
        ConfigError: A column or a unit is missing, or a cell holds no number; the message contains the place.
    """
    files = sorted(path.glob("*.csv")) if path.is_dir() else [path]
    if not files:
        raise ConfigError(f"{path} holds no .csv file")
    runs: list[Run] = []
    for file in files:
        runs += _read_file(model, file)
    return runs


def _read_file(model: Model, path: Path) -> list[Run]:
    cells = read_csv(path, ConfigError)
    if not cells.rows:
        raise ConfigError(f"{path} holds no runs: a header line and one row per run or sample are needed")
    units = {channel.name: channel.unit for channel in model.channels} | dict(model.condition_units)
    if isinstance(model, DrivenModel):
        units |= dict(model.input_units)
    for name in cells.names:
        if name in units:
            _check_unit(path, name, cells.units.get(name), units[name])
    for name in (*model.condition_units, *_input_names(model)):
        if name not in cells.names:
            raise ConfigError(f"{path} has no column '{name}' [{units[name]}]")
    table = {name: cells.numbers(name) for name in cells.names if name in units}
    names = cells.text("run") if "run" in cells.names else [path.stem] * len(cells.rows)
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


def _check_unit(path: Path, name: str, given: str | None, unit: str) -> None:
    if given is None:
        if _plain(unit) != "1" and not name.lower().endswith(f"_{_plain(unit)}"):
            raise ConfigError(f"{path}: column '{name}' has no unit; write '{name} [{unit}]'")
    elif _plain(given) != _plain(unit):
        raise ConfigError(f"{path}: column '{name}' is in {given or 'no unit'}, the model has {unit}")


def _plain(unit: str) -> str:
    """Return a unit as in the end of a name: rad/s is rad_s, N m is nm, % is percent."""
    text = unit.strip().lower().replace("%", "percent").replace("°", "deg").replace("/", "_")
    return re.sub(r"[\s·*.]", "", text) or "1"
