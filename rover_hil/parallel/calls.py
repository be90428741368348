"""Independent calls of a command that are too short for processes of this machine, but not for a cluster."""

import tempfile
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from typing import TypeVar, cast

from drivers.errors import LogError
from drivers.files import LOG_COPY_BYTES, read_bytes, resolved
from rover_hil.parallel.executor import open_executor

WAITING_BYTES = 2**30
"""Files of calls that have not ended; more wait on the disk."""

S = TypeVar("S")
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Calls:
    """Makes calls one after the other here, or side by side on a cluster; the results are the same.

    Attributes:
        executor: Of the cluster; None to call here.
    """

    executor: Executor | None = None

    def map(self, function: Callable[[S], T], *items: Iterable[S]) -> Iterator[T]:
        """Yield the result for each item, in their order."""
        if self.executor is None:
            yield from map(function, *items)
            return
        yield from _in_order([self.executor.submit(function, *item) for item in zip(*items, strict=True)])

    def map_files(
        self,
        function: Callable[[Path], T],
        paths: Sequence[Path],
        beside: Callable[[Path], Iterable[Path]] = lambda _: (),
    ) -> Iterator[T]:
        """Yield the result for each file, in their order; the files travel with the calls.

        Args:
            function: Takes the path of a file.
            paths: The files.
            beside: Returns the files that it also reads, where they exist.

        Raises:
            LogError: A file cannot be read.
        """
        if self.executor is None:
            yield from map(function, paths)
            return
        waiting: deque[tuple[Future[T], int]] = deque()
        waiting_bytes = 0
        try:
            for path in paths:
                absolute = resolved(path)
                # What is beside a link travels to beside the file that it leads to.
                places = zip((path, *beside(path)), (absolute, *beside(absolute)), strict=True)
                contents = _contents(dict(places))
                size = sum(map(len, contents.values()))
                while waiting and waiting_bytes + size > WAITING_BYTES:
                    waiting_bytes -= waiting[0][1]
                    yield waiting.popleft()[0].result()
                call = self.executor.submit(_call_with_files, function, path, absolute, contents)
                waiting.append((call, size))
                waiting_bytes += size
            while waiting:
                yield waiting.popleft()[0].result()
        finally:
            for call, _ in waiting:
                call.cancel()


HERE = Calls()


@contextmanager
def open_calls(cluster: str | None) -> Iterator[Calls]:
    """Give what makes the calls: here, or on a cluster.

    Raises:
        ConfigError: The cluster cannot be used, see `open_executor`.
    """
    if cluster is None:
        yield HERE
        return
    with open_executor(cluster) as executor:
        yield Calls(executor)


def _in_order(futures: Sequence[Future[T]]) -> Iterator[T]:
    """Yield the results; cancel what has not begun when the caller has seen enough."""
    try:
        for future in futures:
            yield future.result()
    finally:
        for future in futures:
            future.cancel()


def _contents(places: Mapping[Path, Path]) -> dict[str, bytes]:
    """Return the content of the files that exist, by the absolute path that they get."""
    try:
        return {
            str(place): read_bytes(path, LOG_COPY_BYTES) for path, place in places.items() if path.is_file()
        }
    except OSError as error:
        raise LogError(f"cannot read {error.filename}: {error.strerror}") from error


def _call_with_files(
    function: Callable[[Path], T], path: Path, absolute: Path, contents: Mapping[str, bytes]
) -> T:
    """Call a function where the files are laid out under a folder; results and errors name the original.

    Args:
        function: Takes the path of a file.
        path: The file, as it was named.
        absolute: The same on the computer that sent it.
        contents: Files by their absolute path there.
    """
    with tempfile.TemporaryDirectory(prefix="rover_hil_") as folder:
        for name, content in contents.items():
            here = Path(f"{folder}{name}")
            here.parent.mkdir(parents=True, exist_ok=True)
            here.write_bytes(content)
        here = Path(f"{folder}{absolute}")
        try:
            return cast("T", _renamed(function(here), str(here), str(path)))
        except LogError as error:
            raise LogError(str(error).replace(str(here), str(path)).replace(folder, "")) from None


def _renamed(value: object, here: str, there: str) -> object:
    """Return a value in which the path of a file is another, also within lists and dataclasses."""
    if isinstance(value, Path):
        return Path(there) if str(value) == here else value
    if isinstance(value, str):
        return value.replace(here, there)
    if isinstance(value, list):
        return [_renamed(item, here, there) for item in value]
    if is_dataclass(value) and not isinstance(value, type):
        changed = {
            item.name: new
            for item in fields(value)
            if (new := _renamed(old := getattr(value, item.name), here, there)) is not old and new != old
        }
        return replace(value, **changed) if changed else value
    return value
