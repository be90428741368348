"""What several workers ask for is computed by one of them."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from threading import Barrier, BrokenBarrierError

import pytest

from tests import once

WORKERS = 4


@pytest.fixture(autouse=True)
def _folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(once, "_folders", [tmp_path])


def test_one_of_many_workers_writes_and_all_read_the_whole() -> None:
    ready, second = Barrier(WORKERS), Barrier(2)
    written = []

    def write(part: Path) -> None:
        written.append(part)
        part.write_text("half")
        with suppress(BrokenBarrierError):
            second.wait(0.3)  # for one that does not wait for the first
        part.write_text("whole")

    def work(number: int) -> str:
        ready.wait()
        return once.made_once("run.txt", write).read_text()

    with ThreadPoolExecutor(WORKERS) as pool:
        assert [*pool.map(work, range(WORKERS))] == ["whole"] * WORKERS
    assert len(written) == 1


def test_what_failed_is_made_by_the_next() -> None:
    def fail(part: Path) -> None:
        part.write_text("half")
        msg = "no space"
        raise OSError(msg)

    with pytest.raises(OSError, match="no space"):
        once.made_once("run.txt", fail)
    assert once.made_once("run.txt", lambda part: part.write_text("whole")).read_text() == "whole"


def test_a_function_is_computed_once_for_each_set_of_arguments() -> None:
    asked = []

    def double(number: int, *, is_negative: bool = False) -> int:
        asked.append((number, is_negative))
        return -2 * number if is_negative else 2 * number

    for _ in range(2):  # as two workers, which know nothing of each other
        shared = once.computed_once(double)
        assert [shared(3), shared(3), shared(4), shared(3, is_negative=True)] == [6, 6, 8, -6]
    assert asked == [(3, False), (4, False), (3, True)]
