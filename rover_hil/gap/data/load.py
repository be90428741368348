"""Models by name, and models in files of a user's own."""

import importlib
import importlib.util
import sys
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import cast

import numpy as np

from drivers.errors import ConfigError, RoverHilError
from rover_hil.gap.data.logs import find_logs, read_logs
from rover_hil.gap.data.table import read_table
from rover_hil.gap.plan import LEAST_RUNS
from sim_backends.models.interface import Model, Run, RunReader, StretchReader

SHIPPED = ("side-slope", "single-wheel", "robotino-motor", "robotino-drive", "four-wheel-drive")
FACTORY = "make_model"
PARTS = ("name", "channels", "condition_units", "parameters", "effects", "predict")
NULL_TOLERANCE = 1e-9


def load_model(name: str) -> Model:
    """Return a shipped model, or what `file.py:factory` makes.

    Raises:
        ConfigError: There is no such model, or it is none.
    """
    if name in SHIPPED:
        module_name, factory_name = f"sim_backends.models.{name.replace('-', '_')}", FACTORY
        try:
            module: object = importlib.import_module(module_name)
        except ModuleNotFoundError as error:
            raise ConfigError(f"model {name} is not part of this installation") from error
    else:
        file, _, factory_name = name.rpartition(":")
        if not file.endswith(".py"):
            raise ConfigError(f"there is no model '{name}': use {', '.join(SHIPPED)} or file.py:factory")
        module = _load_file(Path(file))
    factory = getattr(module, factory_name, None)
    if not callable(factory):
        raise ConfigError(f"{name}: there is no function '{factory_name}' that makes the model")
    with name_model_errors(Path(name.rpartition(":")[0])):
        model = factory()
    missing = [part for part in PARTS if not hasattr(model, part)]
    if missing:
        raise ConfigError(f"{name}: what {factory_name}() returns has no '{missing[0]}'")
    return cast("Model", model)


def _load_file(path: Path) -> object:
    spec = importlib.util.spec_from_file_location(f"_user_model_{path.stem}", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise ConfigError(f"cannot read the model file {path}: is the path right?")
    module = importlib.util.module_from_spec(spec)
    # Dataclasses look their module up by name.
    sys.modules[spec.name] = module
    with name_model_errors(path):
        spec.loader.exec_module(module)
    return module


@contextmanager
def name_model_errors(path: Path) -> Iterator[None]:
    """Give an exception that comes from a model of a user's own the file and line where it was raised.

    Args:
        path: The file of the model.

    Raises:
        ConfigError: In place of such an exception.
    """
    file = path.resolve()
    try:
        yield
    except RoverHilError:
        raise
    except (Exception, SystemExit) as error:
        frames = traceback.extract_tb(error.__traceback__)
        lines = [frame.lineno for frame in frames if Path(frame.filename).resolve() == file]
        if isinstance(error, SyntaxError):
            lines.append(error.lineno)
        if not lines:
            raise
        what = f"{type(error).__name__}: {' '.join(str(error).split())}"
        raise ConfigError(f"{path}, line {lines[-1]}: {what}; correct the model file") from error


def read_runs(model: Model, path: Path) -> list[Run]:
    """Return measured runs: from logs, by the model's own reader, or from a table.

    Drives that are too few to split are cut into stretches, where the model can begin in the middle of one.

    Raises:
        ConfigError, LogError: The data is not what it should be.
    """
    if find_logs(path):
        runs = read_logs(model, path)
    else:
        runs = model.read_runs(path) if isinstance(model, RunReader) else read_table(model, path)
    if len(runs) < LEAST_RUNS[False] and isinstance(model, StretchReader):
        runs = [part for run in runs for part in model.stretches_of(run)]
    return runs


def check_model(model: Model, runs: Sequence[Run]) -> None:
    """Try a model on a few runs: every effect at its null must change nothing.

    Raises:
        ConfigError: A card is wrong.
    """
    some = list(runs[:3])
    base = model.predict(some, {}, {})
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
