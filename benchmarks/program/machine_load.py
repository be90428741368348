"""A loaded machine: two busy processes for each processor and one that writes to the disk, at usual priority.

    python -m benchmarks.program.machine_load [--seconds S] [--folder FOLDER]

Alone it loads the machine until ctrl-C. Benchmarks use `loaded_machine`.
"""

import argparse
import multiprocessing
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from ctypes import c_uint64
from multiprocessing.sharedctypes import RawArray
from pathlib import Path
from typing import Any

from drivers.clock import SystemClock, nanoseconds

BUSY_PER_PROCESSOR = 2
BLOCK_BYTES = 1 << 20
FILE_BLOCKS = 256
SYNC_BLOCKS = 8
"""So many blocks are written before the disk must have them."""


class Load:
    """What the load has done so far.

    Args:
        rounds: Rounds of each busy process, then the blocks that were written.
    """

    def __init__(self, rounds: Any) -> None:
        self._rounds = rounds

    @property
    def busy_rounds(self) -> list[int]:
        """Rounds of computing of each busy process."""
        return list(self._rounds[:-1])

    @property
    def written_mib(self) -> int:
        """MiB that the disk has taken."""
        return int(self._rounds[-1])


@contextmanager
def loaded_machine(folder: Path | None = None) -> Iterator[Load]:
    """Load the machine while the context lasts.

    Args:
        folder: Where at most 256 MiB are written, again and again; None for the folder of temporary files.
    """
    context = multiprocessing.get_context("spawn")
    busy = BUSY_PER_PROCESSOR * (os.cpu_count() or 1)
    rounds = RawArray(c_uint64, busy + 1)
    with tempfile.TemporaryDirectory(dir=folder) as name:
        processes = [context.Process(target=_compute, args=(rounds, number)) for number in range(busy)]
        processes.append(context.Process(target=_write, args=(rounds, Path(name) / "load")))
        for process in processes:
            process.daemon = True
            process.start()
        try:
            clock = SystemClock()
            while not all(rounds):
                clock.sleep_until(clock.now_ns() + nanoseconds(0.05))
            yield Load(rounds)
            assert all(process.is_alive() for process in processes), "a part of the load has ended"
        finally:
            for process in processes:
                process.kill()
                process.join()


def _compute(rounds: Any, number: int) -> None:
    while True:
        sum(range(10_000))
        rounds[number] += 1


def _write(rounds: Any, path: Path) -> None:
    block = os.urandom(BLOCK_BYTES)
    with path.open("wb", buffering=0) as file:
        while True:
            file.write(block)
            rounds[-1] += 1
            if rounds[-1] % SYNC_BLOCKS == 0:
                os.fsync(file.fileno())
            if rounds[-1] % FILE_BLOCKS == 0:
                file.seek(0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--folder", type=Path, default=None)
    options = parser.parse_args()
    clock = SystemClock()
    begun_ns = clock.now_ns()
    with suppress(KeyboardInterrupt), loaded_machine(options.folder) as load:
        while (clock.now_ns() - begun_ns) / 1e9 < options.seconds:
            clock.sleep_until(clock.now_ns() + nanoseconds(1.0))
        print(f"{len(load.busy_rounds)} busy processes, {load.written_mib} MiB written")


if __name__ == "__main__":
    main()
