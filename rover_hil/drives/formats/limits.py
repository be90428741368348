"""How much memory and processor time the reading of a file may take: it grows with the size of the file."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from drivers.files import MEGABYTE
from rover_hil.console.options import number_option

LEAST_MEMORY_BYTES = 512 * MEGABYTE
MOST_TIMES_LEAST = 8
"""The memory grows as the size up to a file of 8 MB: a table as text takes 25 times its size at most."""
MEMORY_PER_BYTE = 4
"""And further by this for each byte: a log of a CAN bus takes twice its size at most."""
SHARE_OF_MACHINE = 0.8
WRITTEN_PER_BYTE = 100
"""A written file may be so large for each byte; the log of a packed table has 25 times its size."""
LEAST_SILENT_S = 15.0
"""Processor time for each MB, 1 MB at least, in which some part of the drive must be done. Sound files of
1 MB take 1 to 5 s."""
MOST_SILENT_S = 4 * 3600.0
"""As much as a file of 1 GB has; so it also ends the larger ones."""
WRITING_S = 300.0
"""Processor time to write the drive of a file of 1 MB. A table as text takes 20 to 60 s."""
WRITING_S_PER_MB = 1200.0
"""For each further MB: an hour of a packed table takes 10 min, and may have 2 MB."""
GIGABYTE = 1e9
BLOCK_BYTES = 512
"""Unit of the blocks that a file takes on its disk."""

MemoryOption = Annotated[
    float | None,
    number_option(
        "Most memory that reading a file may take, in GB [default: 0.54, more for a file above 1 MB].",
        "GB",
        0.1,
        1000.0,
        "--most-memory-gb",
    ),
]
TimeOption = Annotated[
    float | None,
    number_option(
        "Most processor time that reading a file may take, in min [default: 0.25 to the first part of "
        "the drive and 5 in all for a file of 1 MB, less for a smaller and more for a larger one].",
        "min",
        0.01,
        100_000.0,
        "--most-minutes",
    ),
]
EstimateOption = Annotated[
    bool,
    typer.Option(
        "--no-estimate",
        help="Only convert, several times as fast: the log then has no estimate, and sensors and ground "
        "truth are not compared; `replay` with --out does that later.",
    ),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What the reading of a file may take.

    Attributes:
        memory_bytes: In addition to the memory of the program.
        silent_s: Processor time without progress, in s.
        total_s: Processor time in all, in s.
        file_bytes: Size of each file that it writes.
    """

    memory_bytes: int
    silent_s: float
    total_s: float
    file_bytes: int


@dataclass(frozen=True, slots=True)
class LimitSettings:
    """The options of a command that reads files; None for the limits by the size of each file.

    Attributes:
        most_memory_gb: In GB.
        most_minutes: Processor time, in min.
    """

    most_memory_gb: float | None = None
    most_minutes: float | None = None

    def of(self, path: Path) -> Limits:
        """Return the limits of a file, or of a folder with all its files."""
        return self.of_size(_size(path))

    def of_size(self, size: int) -> Limits:
        """Return the limits of so many bytes."""
        size_mb = size / MEGABYTE
        times = min(max(1.0, size_mb), MOST_TIMES_LEAST)
        machine = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        memory = min(times * LEAST_MEMORY_BYTES + MEMORY_PER_BYTE * size, SHARE_OF_MACHINE * machine)
        silent_s = min(LEAST_SILENT_S * max(1.0, size_mb), MOST_SILENT_S)
        total_s = silent_s + WRITING_S * min(size_mb, 1.0) + WRITING_S_PER_MB * max(0.0, size_mb - 1.0)
        if self.most_memory_gb is not None:
            memory = self.most_memory_gb * GIGABYTE
        if self.most_minutes is not None:
            silent_s = total_s = 60.0 * self.most_minutes
        return Limits(
            memory_bytes=round(memory),
            silent_s=silent_s,
            total_s=total_s,
            file_bytes=round(max(memory, WRITTEN_PER_BYTE * size)),
        )


def _size(path: Path) -> int:
    """Return the size of a file, or of the files in a folder; 0 where there is nothing to read.

    Holes and further names of a file do not count. Up to 1 MB the blocks are not asked: some file systems
    report none for a small or new file.
    """
    try:
        files = [path] if not path.is_dir() else [file for file in path.iterdir() if file.is_file()]
        stats = {(stat.st_dev, stat.st_ino): stat for stat in (file.stat() for file in files)}.values()
    except (OSError, ValueError):
        return 0
    allocated = BLOCK_BYTES * sum(stat.st_blocks for stat in stats)
    return min(sum(stat.st_size for stat in stats), max(allocated, MEGABYTE))
