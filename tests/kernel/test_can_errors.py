"""Errors of a CAN bus: what the controller reports, and what the wheel drive makes of it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from drivers.can_wheels.settings import CanWheelsSettings
from drivers.driver import SampleT, WheelDrive
from drivers.samples import FaultSample, LinkSample, Sample
from tests.kernel.can_wire import Wire
from tests.kernel.slcan_adapter import Adapter, slcan_adapter
from tests.kernel.system import CLOCK, pause, wait_until

MAPPING = str(Path(__file__).parents[2] / "docs" / "examples" / "can" / "differential.toml")
WHEEL_STATES = (0x210, 0x211)
RECOVERY_S = 1.0
CARRIER_S = 1.3
"""The kernel looks after changes of the carrier once in a second (net/core/link_watch.c). Until then it goes
on sending; a real controller that is off the bus puts nothing on the wire."""
SET_POINT_LINE = "t200"
BUS_OFF = 0x40

REPORTS = {
    "bit errors": ("e3bBb", "protocol violation, bus error"),
    "stuff and form errors": ("e3sfs", "protocol violation, bus error"),
    "nobody acknowledges": ("e3aaa", "no acknowledge"),
    "receive overflow": ("e3ooo", "receive overflow: frames were lost"),
    "error-passive": ("sp000128", "error-passive after transmit errors"),
    "bus-off": ("sb000255", "bus off: the controller has left the bus"),
}


@pytest.fixture
def adapter() -> Iterator[Adapter]:
    with slcan_adapter() as found:
        yield found


@pytest.mark.parametrize("report", REPORTS)
def test_what_the_controller_reports_is_a_fault_of_the_bus(adapter: Adapter, report: str) -> None:
    line, text = REPORTS[report]
    with _drive(adapter.wire) as wheels:
        adapter.report(line)
        fault = _next_fault(wheels)
    assert fault.wheel is None
    assert fault.code != 0
    assert fault.text.startswith("CAN bus: ")
    assert text in fault.text


def test_a_warning_level_is_counted_and_no_fault(adapter: Adapter) -> None:
    with _drive(adapter.wire) as wheels:
        adapter.report("sw000100")
        found: list[Sample] = []

        def is_counted() -> bool:
            found.extend(wheels.poll())
            return wheels.health().rejected.get("bus_warning", 0) == 1

        wait_until(is_counted)
    assert not [sample for sample in found if isinstance(sample, FaultSample)]


def test_bit_errors_are_over_when_frames_have_come_without_them(adapter: Adapter) -> None:
    with _drive(adapter.wire) as wheels:
        adapter.report("e3bBb")
        assert _next_fault(wheels).code != 0
        pause(RECOVERY_S)
        for can_id in WHEEL_STATES:
            adapter.report_frame(can_id, bytes(8))
        cleared = _next_fault(wheels)
    assert (cleared.code, cleared.text) == (0, "CAN bus: cleared")


def test_after_bus_off_nothing_is_sent_until_the_interface_is_restarted(adapter: Adapter) -> None:
    with _drive(adapter.wire) as wheels:
        assert _set_points_reach(adapter, wheels)
        adapter.report("sb000255")
        assert _next_fault(wheels).code & BUS_OFF
        pause(CARRIER_S)
        assert not _set_points_reach(adapter, wheels)
        adapter.wire.down()
        assert not _next(wheels, LinkSample).up
        adapter.wire.up()
        assert _next(wheels, LinkSample).up
        assert _set_points_reach(adapter, wheels)
        pause(RECOVERY_S)
        adapter.report_frame(WHEEL_STATES[0], bytes(8))
        assert _next_fault(wheels).code == 0


@contextmanager
def _drive(wire: Wire) -> Iterator[WheelDrive]:
    settings = CanWheelsSettings(interface="socketcan", channel=wire.near, mapping=MAPPING)
    with settings.make_driver("wheels", settings.make_link(CLOCK), CLOCK) as wheels:
        yield wheels


def _set_points_reach(adapter: Adapter, wheels: WheelDrive) -> bool:
    adapter.take()
    wheels.stop()
    pause(0.1)
    return any(line.startswith(SET_POINT_LINE) for line in adapter.take())


def _next_fault(wheels: WheelDrive) -> FaultSample:
    return _next(wheels, FaultSample)


def _next(wheels: WheelDrive, kind: type[SampleT]) -> SampleT:
    """Return the next sample of a kind."""
    found: list[SampleT] = []

    def is_done() -> bool:
        found.extend(sample for sample in wheels.poll() if isinstance(sample, kind))
        return bool(found)

    wait_until(is_done)
    return found[0]
