"""Models by name or from a user's file, and their measured runs."""

import importlib
import importlib.util
import pkgutil
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np

from drivers.errors import ConfigError, RoverHilError
from drivers.files import is_file, resolved
from rover_hil.gap.data import readers
from rover_hil.gap.data.columns import LogModel, Reader
from rover_hil.gap.data.logs import find_logs, read_logs
from rover_hil.gap.data.parameters import DATA
from rover_hil.gap.data.table import read_table
from sim_backends import models
from sim_backends.fmu.read import read_unit_model
from sim_backends.models.interface import Array, Model, Run, RunReader, StretchReader

SHIPPED = tuple(one.name.replace("_", "-") for one in pkgutil.iter_modules(models.__path__) if one.ispkg)
FACTORY = "make_model"
PARTS = ("name", "channels", "condition_units", "parameters", "effects", "predict")
NULL_TOLERANCE = 1e-9
"""Difference, over the size of a prediction, below which an effect at its null changes nothing."""


def load_model(name: str) -> Model:
    """Return a shipped model, that of a functional mock-up unit, or the result of `file.py:factory`.

    Raises:
        ConfigError: There is no such model, or it lacks a part.
    """
    if name.endswith(".toml"):
        return read_unit_model(Path(name))
    if name in SHIPPED:
        factory_name = FACTORY
        module: object = importlib.import_module(f"{models.__name__}.{name.replace('-', '_')}.model")
    else:
        file, _, factory_name = name.rpartition(":")
        if not file and name.endswith(".py"):
            raise ConfigError(f"{name}: name the function that makes the model, like {name}:make")
        if not file.endswith(".py"):
            raise ConfigError(
                f"there is no model '{name}': use {', '.join(SHIPPED)}, file.py:factory or unit.toml"
            )
        module = _load_file(Path(file))
    factory = getattr(module, factory_name, None)
    if not callable(factory):
        raise ConfigError(f"{name}: there is no function '{factory_name}' to make the model")
    with name_model_errors(Path(name.rpartition(":")[0])):
        model = factory()
    missing = [part for part in PARTS if not hasattr(model, part)]
    if missing:
        raise ConfigError(f"{name}: the result of {factory_name}() has no '{missing[0]}'")
    return cast("Model", model)


def _load_file(path: Path) -> object:
    spec = importlib.util.spec_from_file_location(f"_user_model_{path.stem}", path)
    if spec is None or spec.loader is None or not is_file(path):
        raise ConfigError(f"cannot read the model file {path}: check the path")
    module = importlib.util.module_from_spec(spec)
    # Dataclasses look their module up by name.
    sys.modules[spec.name] = module
    with name_model_errors(path):
        spec.loader.exec_module(module)
    return module


@contextmanager
def name_model_errors(path: Path) -> Iterator[None]:
    """Give an exception that comes from a model of a user's own the file and line where it was raised.

    Raises:
        ConfigError: Raised instead of such an exception.
    """
    file = resolved(path)
    try:
        yield
    except RoverHilError:
        raise
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        lines = [frame.lineno for frame in frames if resolved(Path(frame.filename)) == file]
        if isinstance(error, SyntaxError):
            lines.append(error.lineno)
        if not lines:
            raise
        what = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise ConfigError(f"{path}, line {lines[-1]}: {what}; correct the model file") from error


def read_runs(model: Model, path: Path) -> list[Run]:
    """Return measured runs from logs, files of the model, or tables.

    Where there are too few drives to split, they are cut into stretches if the model can start in the middle.

    Raises:
        ConfigError, LogError: The data is unusable.
    """
    reader = reader_of(model)
    if not find_logs(path):
        runs = reader.read(path)
    elif reader.runs_of_log is not None:
        runs = read_logs(reader.runs_of_log, path)
    else:
        raise ConfigError(f"{path}: the model cannot be compared with logs; give its measurements as a table")
    if len(runs) < DATA.runs.least_series and reader.cut is not None:
        runs = [part for run in runs for part in reader.cut(run)]
    return runs


def reader_of(model: Model) -> Reader:
    """Return the reader of a model: its own methods, else that of the shipped model, else tables."""
    reader = _shipped(model.name) or Reader(read=partial(read_table, model))
    if isinstance(model, RunReader):
        reader = replace(reader, read=model.read_runs)
    if isinstance(model, LogModel):
        reader = replace(reader, runs_of_log=model.runs_of_log)
    if isinstance(model, StretchReader):
        reader = replace(reader, cut=model.stretches_of)
    return reader


def _shipped(model_name: str) -> Reader | None:
    name = model_name.replace("-", "_")
    if name not in {one.name for one in pkgutil.iter_modules(readers.__path__)}:
        return None
    reader: Reader = importlib.import_module(f"{readers.__name__}.{name}").READER
    return reader


def _check_tables(model: Model, runs: Sequence[Run], tables: object) -> None:
    """Check that there is a table for each run, with every channel in the shape of the measured one.

    Raises:
        ConfigError: There is not.
    """
    if not isinstance(tables, Sequence) or len(tables) != len(runs):
        raise ConfigError(
            f"model {model.name}: predict() must return a list of {len(runs)} tables, one per run"
        )
    for run, table in zip(runs, tables, strict=True):
        for channel in model.channels:
            if channel.name not in table:
                raise ConfigError(
                    f"model {model.name}: predict() returns no {channel.name} for run {run.name}"
                )
            shape = np.atleast_1d(table[channel.name]).shape  # steady runs may give a number
            measured = run.measured.get(channel.name)
            if measured is not None and shape != measured.shape:
                raise ConfigError(
                    f"model {model.name}: predict() returns {channel.name} with shape {shape} for run "
                    f"{run.name}, measured is {measured.shape}"
                )


def _check_repeated(
    model: Model, tables: Sequence[Mapping[str, Array]], again: Sequence[Mapping[str, Array]]
) -> None:
    """Check that a prediction is the same when repeated.

    Raises:
        ConfigError: It is not.
    """
    for one, other in zip(tables, again, strict=True):
        for channel in model.channels:
            if not np.array_equal(one[channel.name], other[channel.name], equal_nan=True):
                raise ConfigError(
                    f"model {model.name} is not deterministic: two predictions of {channel.name} differ; use "
                    "no random numbers and no memory between calls"
                )


def check_model(model: Model, runs: Sequence[Run]) -> None:
    """Check on a few runs that predictions are complete, and that effects at their null change nothing.

    Raises:
        ConfigError: A prediction lacks a channel or has the wrong shape, two predictions differ, or an effect
            changes a prediction at its null, or fails.
    """
    some = list(runs[:3])
    base = model.predict(some, {}, {})
    _check_tables(model, some, base)
    _check_repeated(model, base, model.predict(some, {}, {}))
    for card in model.effects:
        null = {item.name: item.nominal for item in card.parameters}
        try:
            changed = model.predict(some, {}, {card.name: null})
        except RoverHilError:
            raise
        except Exception as error:
            raise ConfigError(
                f"effect {card.name} cannot be predicted: {type(error).__name__}: {error}"
            ) from error
        for before, after in zip(base, changed, strict=True):
            for channel in model.channels:
                one, other = before[channel.name], after[channel.name]
                scale = max(float(np.nanmax(np.abs(one), initial=0.0)), 1e-12)
                if not np.allclose(one, other, rtol=0.0, atol=NULL_TOLERANCE * scale, equal_nan=True):
                    raise ConfigError(
                        f"effect {card.name} changes {channel.name} although its parameters are at their "
                        "nominal values: the null must be the base model"
                    )
