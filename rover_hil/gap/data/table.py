"""Runs from tables: one CSV file of all runs, or a folder of files with one run each.

A row is a steady experiment, or a sample of a series where several rows carry the same `run`. Columns:
`run`, the model's conditions, its channels, its inputs. Units are part of the header, `current [A]`, or of
the name, `speed_rad_s`; they must be those of the model. The times of a series are `t_s` or `time [s]`.
A few samples that a recorder dropped, as the times show, are missing values of the channels.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from drivers.errors import ConfigError
from rover_hil.drives.files.csv_table import CsvTable, read_csv
from rover_hil.gap.data.derivatives import Indices
from rover_hil.gap.data.parameters import DATA
from sim_backends.models.interface import Array, DrivenModel, Machine, Model, Run
from sim_backends.state_model.model import StateModel

TIME = "t_s"
OTHER_TIME = "time"
MOST_DIGITS = 9
"""Decimals that are tried to find how times were rounded."""


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
            raise ConfigError(
                f"{path} has no column '{name}' [{units[name]}]; it has {', '.join(cells.names)}"
            )
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
    index: Indices,
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
    series = {name: table[name][index] for name in _input_names(model)}
    measured = {item.name: table[item.name][index] for item in model.channels if item.name in table}
    missing: dict[str, tuple[int, int]] = {}
    if isinstance(model, Machine) and TIME in table:
        times, place = _times(table[TIME][index], f"{path}, run {name}", model.step_s)
        dropped = (times.size - place.size, times.size)
        missing = {one: dropped for one in series if one != TIME and dropped[0]}
        is_held = not isinstance(model, StateModel) or model.is_held
        series = {key: _bridged(values, place, is_held=is_held) for key, values in series.items()}
        series |= {TIME: times} if TIME in series else {}
        measured = {key: _with_gaps(values, place) for key, values in measured.items()}
    return Run(name=name, conditions=conditions, inputs=series, measured=measured, missing=missing)


def _bridged(values: Array, place: Indices, *, is_held: bool) -> Array:
    """Return an input at all samples, given those at some places: held, or interpolated."""
    every = np.arange(place[-1] + 1)
    if is_held:
        return values[np.searchsorted(place, every, side="right") - 1]
    filled: Array = np.interp(every, place, values)
    return filled


def _with_gaps(values: Array, place: Indices) -> Array:
    """Return a channel at all samples, NaN where there was none."""
    found = np.full(place[-1] + 1, np.nan)
    found[place] = values
    return found


def _columns(cells: CsvTable, units: Mapping[str, str]) -> dict[str, str]:
    """Return the column of each name that a model knows; its times may be called `time`, also as an input."""
    columns = {name: name for name in cells.names if name in units}
    if TIME in units and TIME not in columns and OTHER_TIME in cells.names:
        columns[TIME] = OTHER_TIME
    return columns


def _times(t_s: Array, where: str, step_s: float | None) -> tuple[Array, Indices]:
    """Return the times of all samples, and which of them the rows have.

    Even times come without what rounding in the file did to them, and with those of lost samples; uneven
    ones as they are.

    Raises:
        ConfigError: Times are missing, do not increase, or contradict the step of the model, or many samples
            in a row were dropped.
    """
    missing = int(np.sum(~np.isfinite(t_s)))
    if missing:
        raise ConfigError(f"{where}: {missing} of {t_s.size} times are missing; every sample needs its time")
    if t_s.size < 2:
        return t_s, np.arange(t_s.size)
    steps = np.diff(t_s)
    if steps.min() <= 0.0:
        place_s = float(t_s[int(np.argmin(steps))])
        raise ConfigError(
            f"{where}: the time does not increase after {place_s:g} s; give each record its own name in a "
            "column 'run', and keep one of two samples at one time"
        )
    counts = np.maximum(np.round(steps / np.median(steps)), 1.0).astype(np.intp)
    place = np.concatenate(([0], np.cumsum(counts)))
    step = float(t_s[-1] - t_s[0]) / int(place[-1])
    times = t_s[0] + step * np.arange(place[-1] + 1)
    errors_s = np.abs(steps - step * counts)
    error_s = float(errors_s.max())
    if error_s > DATA.runs.step_share * step and max(error_s, np.abs(times[place] - t_s).max()) > _rounding_s(
        t_s, step
    ):
        if step_s is not None:
            raise ConfigError(
                f"{where}: samples are {steps.min():.4g} to {steps.max():.4g} s apart, most unevenly near "
                f"{float(t_s[int(np.argmax(errors_s))]):g} s: leave step_s out of the model and the times of "
                "the data are used, or leave the times out of the data if only their stamps are uneven"
            )
        times, place = t_s, np.arange(t_s.size)
    if counts.max() > DATA.runs.most_dropped + 1:
        widest = int(np.argmax(counts))
        raise ConfigError(
            f"{where}: {counts[widest] - 1} samples are missing after {t_s[widest]:g} s, and at most "
            f"{DATA.runs.most_dropped} in a row can be bridged: give what follows its own name in a column "
            "'run'"
        )
    if step_s is not None and abs(step - step_s) > DATA.runs.step_share * step_s:
        raise ConfigError(
            f"{where}: samples are {step:.4g} s apart, the model has step_s = {step_s:g}: correct step_s, or "
            "leave it out and the times of the data are used"
        )
    return times, place


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
