"""A test that needs more than some seconds of processor time fails unless it is marked `slow` or `nightly`.

Time on the clock depends on what else the machine does; that of the processor hardly.
"""

import sys
import time
from collections.abc import Generator

import pytest
from numba.core.event import install_recorder

MARKERS = ("slow", "nightly", "rover")
LIMIT_S = 3.0


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
    if limit_s and used_s > limit_s and not (is_marked or is_traced or compiled.buffer):
        pytest.fail(
            f"{used_s:.1f} s of processor time, more than {limit_s:g} s: make it faster, share what it "
            "computes in a fixture, or mark it `slow`",
            pytrace=False,
        )
    return result
