"""How measured runs of a model are read."""

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from rover_hil.gap.data import readers
from rover_hil.gap.data.columns import DriveLog, LogModel
from rover_hil.gap.data.table import read_table
from sim_backends.models.interface import Model, Run, RunReader, StretchReader


@dataclass(frozen=True, slots=True, kw_only=True)
class Reader:
    """How measured runs of a model are read.

    Attributes:
        read: Returns the runs in a file or folder.
        runs_of_log: Returns the runs in a log; None where the model cannot be compared with logs.
        cut: Cuts a long run into several; None where a run cannot begin in the middle of a drive.
    """

    read: Callable[[Path], list[Run]]
    runs_of_log: Callable[[DriveLog], list[Run]] | None = None
    cut: Callable[[Run], list[Run]] | None = None


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
