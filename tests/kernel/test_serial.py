"""USB serial ports: content, unplugging, latency, and a wrong baud rate."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from drivers.driver import DeviceState, SampleT
from drivers.nmea import encode_sentence
from drivers.nmea_compass.settings import NmeaCompassSettings
from drivers.samples import HeadingSample, LinkSample, Sample
from tests.kernel.serial_line import (
    Line,
    collect_bytes,
    collect_changes,
    plug_in,
    read_all,
    seen_at_another_rate,
    unplug,
)
from tests.kernel.system import CLOCK, pause, wait_until, write

EVERY_BYTE = bytes(range(256))
SENTENCES = b"".join(encode_sentence(f"HCHDM,{heading_deg}.5,M") for heading_deg in range(90, 130))


def test_every_byte_passes_both_ways(line: Line) -> None:
    link = line.link()
    link.open(2.0)
    with line.other_end() as end:
        os.write(end, EVERY_BYTE)
        assert collect_bytes(link, len(EVERY_BYTE)) == EVERY_BYTE
        assert link.send(EVERY_BYTE)
        assert read_all(end, len(EVERY_BYTE)) == EVERY_BYTE
    link.close()


def test_replugged_it_comes_back_under_its_name(line: Line) -> None:
    link = line.link()
    link.open(2.0)
    adapter = line.adapter
    unplug(adapter)
    assert [change.up for change in collect_changes(link)] == [False]
    assert not line.near.exists()
    assert not link.send(b"into the void")
    plug_in(adapter)
    assert [change.up for change in collect_changes(link)] == [True]
    with line.other_end() as end:
        os.write(end, b"again")
        assert collect_bytes(link, 5) == b"again"
    link.close()


def test_an_adapter_that_holds_bytes_back_is_told_not_to(ftdi: Line) -> None:
    timer = Path("/sys/bus/usb-serial/devices", ftdi.near.name, "latency_timer")
    write(timer, "16")
    link = ftdi.link()
    link.open(2.0)
    assert timer.read_text().strip() == "1"
    link.close()


def test_a_compass_stops_and_resumes_with_its_adapter(line: Line) -> None:
    settings = NmeaCompassSettings(port=str(line.near))
    with settings.make_driver("compass", settings.make_link(CLOCK), CLOCK) as compass:
        with line.other_end() as end:
            os.write(end, SENTENCES[:200])
            _next(compass.poll, HeadingSample)
        adapter = line.adapter
        unplug(adapter)
        assert not _next(compass.poll, LinkSample).up
        plug_in(adapter)
        assert _next(compass.poll, LinkSample).up
        with line.other_end() as end:
            os.write(end, SENTENCES[:200])
            _next(compass.poll, HeadingSample)
        assert compass.health().breaks == 1


@pytest.mark.parametrize("read_at", [2400, 9600, 19_200, 115_200])
def test_at_a_wrong_baud_rate_nothing_is_invented(line: Line, read_at: int) -> None:
    settings = NmeaCompassSettings(port=str(line.near))
    found: list[Sample] = []
    with settings.make_driver("compass", settings.make_link(CLOCK), CLOCK) as compass:
        with line.other_end() as end:
            os.write(end, seen_at_another_rate(SENTENCES, 4800, read_at)[:2000])
            for _ in range(50):
                found.extend(compass.poll())
                pause(0.02)
        assert compass.health().state is DeviceState.CONNECTED
    assert found == []


def _next(poll: Callable[[], Sequence[Sample]], kind: type[SampleT]) -> SampleT:
    """Return the next sample of a kind."""
    found: list[SampleT] = []

    def is_done() -> bool:
        found.extend(sample for sample in poll() if isinstance(sample, kind))
        return bool(found)

    wait_until(is_done)
    return found[0]


def test_resampling_at_the_right_rate_changes_nothing() -> None:
    assert seen_at_another_rate(EVERY_BYTE, 4800, 4800) == EVERY_BYTE
