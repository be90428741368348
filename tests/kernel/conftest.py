"""Everything here runs inside the virtual machine of `make test-kernel`, and nowhere else."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.kernel.can_wire import Wire
from tests.kernel.system import run

INSIDE = "ROVER_HIL_KERNEL"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if INSIDE in os.environ:
        return
    skip = pytest.mark.skip(reason="makes and unplugs devices of the kernel: run it with `make test-kernel`")
    for item in items:
        if item.path.is_relative_to(Path(__file__).parent):
            item.add_marker(skip)


@pytest.fixture(params=["vcan", "card"])
def wire(request: pytest.FixtureRequest) -> Iterator[Wire]:
    """Yield a CAN bus of each kind, up; it has no queueing discipline of an earlier test."""
    if request.param == "vcan":
        run("modprobe vcan")
        run("ip link add vcan0 type vcan")
        wire = Wire("vcan0", "vcan0")
        wire.up()
        yield wire
        run("ip link delete vcan0")
        return
    run("modprobe kvaser_pci")
    wire = Wire("can0", "can1")
    wire.up()
    yield wire
    run("modprobe -r kvaser_pci")
