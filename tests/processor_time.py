"""A test that needs more than some seconds of processor time fails unless it is marked `slow` or `nightly`.

Time on the clock depends on what else the machine does; that of the processor less. What is left of it is
allowed for: a loop is timed on the same processor at the same time, and a test may take three times as long.
"""

import sys
import time
from collections.abc import Generator

import pytest
from numba.core.event import install_recorder

MARKERS = ("slow", "nightly", "rover")
LIMIT_S = 3.0
SCATTER = 3.0
"""Of the processor time of one test beside other programs, which share memory, caches and cores with it."""

STEPS = 1_000_000
STEPS_S = 0.028
"""Processor time of `STEPS` on the computer whose seconds are meant."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--processor-limit", type=float, default=LIMIT_S, metavar="SECONDS",
        help="a test without a marker that needs more processor time fails; 0 for no limit",
    )  # fmt: skip


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    """Measure what a test itself needs, without its fixtures, which others share."""
    # What numba compiles takes seconds, once on each machine.
    with install_recorder("numba:compile") as compiled:
        start_s = time.process_time()
        result = yield
        used_s = time.process_time() - start_s
    limit_s = item.config.getoption("--processor-limit")
    is_marked = any(item.get_closest_marker(name) is not None for name in MARKERS)
    is_traced = sys.gettrace() is not None  # as under coverage, which takes several times as long
    is_free = not limit_s or is_marked or is_traced or bool(compiled.buffer)
    if not is_free and used_s > SCATTER * limit_s and used_s > SCATTER * limit_s * _slowness():
        pytest.fail(
            f"{used_s:.1f} s of processor time, more than {limit_s:g} s: make it faster, share what it "
            "computes in a fixture, or mark it `slow`",
            pytrace=False,
        )
    return result


def _slowness() -> float:
    """Return how many times longer than on the computer that is meant a loop takes here and now."""
    start_s = time.process_time()
    total = 0.0
    for step in range(STEPS):
        total += 0.5 * step
    return (time.process_time() - start_s) / STEPS_S
