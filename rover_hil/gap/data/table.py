"""Runs from tables: one CSV file of all runs, or a folder of files with one run each.

A row is a steady experiment, or a sample of a series where several rows carry the same `run`. Columns:
`run`, the model's conditions, its channels, its inputs. Units are part of the header, `current [A]`, or of
the name, `speed_rad_s`; they must be those of the model. The times of a series are `t_s` or `time [s]`.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from drivers.errors import ConfigError
from rover_hil.datasets.csv_table import CsvTable, read_csv
from rover_hil.gap.data.parameters import DATA
from sim_backends.models.interface import Array, DrivenModel, Machine, Model, Run

TIME = "t_s"
OTHER_TIME = "time"
MOST_DIGITS = 9


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
    if isinstance(model, Machine):
        units.setdefault(TIME, "s")
    columns = _columns(cells, units)
    for name, column in columns.items():
        _check_unit(path, column, cells.units.get(column), units[name])
    for name in (*model.condition_units, *_input_names(model)):
        if name not in columns:
            raise ConfigError(f"{path} has no column '{name}' [{units[name]}]")
    table = {name: cells.numbers(column) for name, column in columns.items()}
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
    if isinstance(model, Machine) and TIME in table:
        even = _even_times(table[TIME][index], f"{path}, run {name}", model.step_s)
        table = {**table, TIME: table[TIME].copy()}
        table[TIME][index] = even
    return Run(
        name=name,
        conditions=conditions,
        inputs={key: table[key][index] for key in inputs},
        measured={
            channel.name: table[channel.name][index] for channel in model.channels if channel.name in table
        },
    )


def _columns(cells: CsvTable, units: Mapping[str, str]) -> dict[str, str]:
    """Return the column of each name that a model knows; its times may be called `time`, also as an input."""
    columns = {name: name for name in cells.names if name in units}
    if TIME in units and TIME not in columns and OTHER_TIME in cells.names:
        columns[TIME] = OTHER_TIME
    return columns


def _even_times(t_s: Array, where: str, step_s: float | None) -> Array:
    """Return the times of a series without what rounding in the file did to them.

    Raises:
        ConfigError: Times are missing, do not increase, are uneven, or contradict the model.
    """
    missing = int(np.sum(~np.isfinite(t_s)))
    if missing:
        raise ConfigError(f"{where}: {missing} of {t_s.size} times are missing; every sample needs its time")
    if t_s.size < 2:
        return t_s
    steps = np.diff(t_s)
    if steps.min() <= 0.0:
        place = float(t_s[int(np.argmin(steps))])
        raise ConfigError(
            f"{where}: the time does not increase after {place:g} s; give each record its own name in a "
            "column 'run'"
        )
    step = float(t_s[-1] - t_s[0]) / (t_s.size - 1)
    even = t_s[0] + step * np.arange(t_s.size)
    error_s = float(np.abs(steps - step).max())
    if error_s > DATA.runs.step_share * step and max(error_s, np.abs(even - t_s).max()) > _rounding_s(
        t_s, step
    ):
        place = float(t_s[int(np.argmax(np.abs(steps - step)))])
        raise ConfigError(
            f"{where}: samples are {steps.min():.4g} to {steps.max():.4g} s apart, most unevenly near "
            f"{place:g} s: interpolate to equal steps"
        )
    if step_s is not None and abs(step - step_s) > DATA.runs.step_share * step_s:
        raise ConfigError(
            f"{where}: samples are {step:.4g} s apart, the model has step_s = {step_s:g}: correct step_s, or "
            "leave it out and the times of the data are used"
        )
    times: Array = even
    return times


def _rounding_s(t_s: Array, step_s: float) -> float:
    """Return the last decimal place of times; 0 where it is too coarse to distinguish rounding from a gap."""
    scale = max(float(np.abs(t_s).max()), 1.0)
    for digits in range(MOST_DIGITS):
        if np.abs(np.round(t_s, digits) - t_s).max() <= 1e-12 * scale:
            place_s = float(10.0**-digits)
            return 1.01 * place_s if place_s <= 0.5 * step_s else 0.0
    return 0.0


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
