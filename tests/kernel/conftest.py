"""Everything here runs inside the virtual machine of `make test-kernel`, and nowhere else."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.kernel.can_wire import Wire, cards
from tests.kernel.serial_line import Line, modem
from tests.kernel.system import INSIDE, load, run, wait_until


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if INSIDE in os.environ:
        return
    skip = pytest.mark.skip(reason="makes and unplugs devices of the kernel: run it with `make test-kernel`")
    for item in items:
        if item.path.is_relative_to(Path(__file__).parent):
            item.add_marker(skip)


@pytest.fixture
def vcan() -> Iterator[Wire]:
    """Yield a virtual CAN bus, up."""
    load("can_raw", "vcan", "sch_tbf")
    run("ip link add vcan0 type vcan")
    wire = Wire("vcan0", "vcan0")
    wire.up()
    yield wire
    run("ip link delete vcan0")


@pytest.fixture
def card() -> Iterator[Wire]:
    """Yield the bus of two PCI cards, both up."""
    with cards() as wire:
        yield wire


@pytest.fixture(params=["vcan", "card"])
def wire(request: pytest.FixtureRequest) -> Wire:
    """Return a bus of each kind."""
    found = request.getfixturevalue(request.param)
    assert isinstance(found, Wire)
    return found


@pytest.fixture
def gadget() -> Iterator[Line]:
    """Yield a USB modem."""
    with modem() as line:
        yield line


@pytest.fixture
def ftdi() -> Iterator[Line]:
    """Yield an FTDI adapter whose other side is wired to a UART of this machine."""
    load("uhci_hcd", "ftdi_sio")
    line = Line(Path("/dev/ttyUSB0"), Path("/dev/ttyS1"))
    wait_until(line.near.exists)
    yield line
    run("rmmod ftdi_sio")
    run("rmmod uhci_hcd")


@pytest.fixture(params=["gadget", "ftdi"])
def line(request: pytest.FixtureRequest) -> Line:
    """Return a serial line of each kind."""
    found = request.getfixturevalue(request.param)
    assert isinstance(found, Line)
    return found
