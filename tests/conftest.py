"""Shared fixtures: measured data outside the repository, and the switch for tests on a real rover."""

from pathlib import Path

import pytest

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--rover", metavar="CONFIG", help="run the tests on the rover of this configuration")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--rover"):
        return
    skip = pytest.mark.skip(reason="needs a real rover: run with --rover CONFIG")
    for item in items:
        if item.get_closest_marker("rover") is not None:
            item.add_marker(skip)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Return the folder of measured data, or skip: the data is not part of the repository."""
    if not SHARED_DATA.is_dir():
        pytest.skip("measured data not found in ../shared/data; README says where to fetch it")
    return SHARED_DATA
