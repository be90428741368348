"""How measured runs of a model are read."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rover_hil.gap.data.columns import DriveLog
from sim_backends.models.interface import Run


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
