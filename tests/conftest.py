"""Shared fixtures: measured data outside the repository, and the switch for tests on a real rover."""

import gc
import os
import signal
from pathlib import Path

# Set before numpy is first imported: the workers of pytest-xdist share the cores, and idle threads of numpy's
# linear algebra spin on them. Programs that the tests start inherit it.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import pytest
from hypothesis import settings

from tests.once import share_in

pytest_plugins = ["tests.processor_time"]

# The same examples each time: what a run covers and kills must not depend on luck.
settings.register_profile("any_machine", deadline=None, derandomize=True)
settings.load_profile("any_machine")

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--rover", metavar="CONFIG", help="run the tests on the rover of this configuration")


def pytest_configure() -> None:
    # A job started in the background inherits signals that are ignored, and ctrl-C is tested here.
    for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, handler)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--rover"):
        return
    skip = pytest.mark.skip(reason="needs a real rover: run with --rover CONFIG")
    for item in items:
        if item.get_closest_marker("rover") is not None:
            item.add_marker(skip)


def pytest_collection_finish() -> None:
    # Or all modules and thousands of tests are searched for garbage each time: a twentieth of the time.
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _shared_folder(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Let the workers of a session share what one of them has computed (`tests.once`)."""
    folder = tmp_path_factory.getbasetemp()
    share_in(folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder)


@pytest.fixture
def unrendered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw the pictures of reports, but do not make SVG of them: that takes most of a short run's time."""
    monkeypatch.setattr("rover_hil.pages.picture.svg", lambda figure: b"")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of measured data, or skip: the data is not part of the repository."""
    if not SHARED_DATA.is_dir():
        pytest.skip("measured data not found in ../shared/data; README says where to fetch it")
    return SHARED_DATA
