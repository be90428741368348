"""Calls that read files: the same here and on a cluster, where the files travel with them."""

import os
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest

from drivers.clock import SystemClock, nanoseconds
from drivers.errors import LogError
from rover_hil.parallel.calls import HERE, Calls, open_calls
from tests.rover_hil.parallel.cluster import DELAY, running_scheduler, running_worker, wait_for_workers

pytestmark = pytest.mark.slow

FILES = 8


@dataclass(frozen=True)
class Found:
    path: Path
    words: str
    note: str
    host_pid: int


def read(path: Path, *, beside: str) -> list[Found]:
    clock = SystemClock()
    clock.sleep_until(clock.now_ns() + nanoseconds(float(os.environ.get(DELAY, "0"))))
    if not path.read_text():
        raise LogError(f"{path} is empty")
    other = path.with_suffix(".txt")
    note = other.read_text() if other.is_file() else ""
    return [Found(path, path.read_text() + beside, f"{path}: {path.parent.name} {note}", os.getpid())]


def beside(path: Path) -> tuple[Path, ...]:
    return (path.with_suffix(".txt"),)


def write_files(folder: Path) -> list[Path]:
    paths = [folder / f"floor_{number % 2}" / f"{number}.log" for number in range(FILES)]
    for number, path in enumerate(paths):
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"log {number}")
    paths[3].with_suffix(".txt").write_text("by hand")
    return paths


def contents(found: list[list[Found]]) -> list[tuple[Path, str, str]]:
    return [(one.path, one.words, one.note) for items in found for one in items]


def test_files_travel_and_a_killed_worker_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    paths = [path.relative_to(tmp_path) for path in write_files(tmp_path)]
    function = partial(read, beside="!")
    expected = contents(list(HERE.map_files(function, paths, beside)))
    assert expected[3] == (paths[3], "log 3!", f"{paths[3]}: floor_1 by hand")
    with (
        running_scheduler() as address,
        running_worker(address, delay_s=0.2),
        running_worker(address, delay_s=0.2) as victim,
    ):
        wait_for_workers(address, 2)
        with open_calls(address) as calls:
            found = calls.map_files(function, paths, beside)
            first = next(found)
            threading.Timer(0.3, victim.kill).start()
            everything = [first, *found]
            assert contents(everything) == expected
            assert os.getpid() not in {one.host_pid for items in everything for one in items}
            (tmp_path / paths[5]).write_text("")
            with pytest.raises(LogError, match=f"^{paths[5]} is empty$"):
                list(calls.map_files(function, paths, beside))


def test_what_is_beside_a_link_to_a_file_travels_too(tmp_path: Path) -> None:
    paths = write_files(tmp_path)
    link = tmp_path / "mine" / "drive.log"
    link.parent.mkdir()
    link.symlink_to(paths[0])
    link.with_suffix(".txt").write_text("by hand")
    with ThreadPoolExecutor(1) as executor:
        ((found,),) = Calls(executor).map_files(partial(read, beside=""), [link], beside)
    assert found.path == link
    assert found.note.endswith(" by hand")


def test_files_are_read_as_calls_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Or the logs of a fleet would all be in memory at once."""
    paths = write_files(tmp_path)
    monkeypatch.setattr("rover_hil.parallel.calls.WAITING_BYTES", 3 * len("log 0"))
    sent: list[Path] = []
    ended: list[Path] = []
    most = 0

    class Executor(ThreadPoolExecutor):
        def submit(self, function, /, *arguments, **more):  # type: ignore[no-untyped-def]
            nonlocal most
            sent.append(arguments[1])
            most = max(most, len(sent) - len(ended))
            return super().submit(function, *arguments, **more)

    with Executor(1) as executor:
        for found in Calls(executor).map_files(partial(read, beside=""), paths, beside):
            ended += [one.path for one in found]
    assert ended == sent == paths
    assert most == 3


def test_without_a_cluster_a_call_is_made_when_its_result_is_wanted() -> None:
    made: list[int] = []

    def note(number: int) -> int:
        made.append(number)
        return 2 * number

    results = Calls().map(note, range(3))
    assert next(results) == 0
    assert made == [0]
    assert list(results) == [2, 4]
