"""Messages between two processes through shared memory."""

import multiprocessing
import random

import pytest

from rover_hil.connect.shared_ring import RingReader, RingWriter, SharedRing

PLACES, PLACE_BYTES = 4, 64
SEED = 1
MESSAGES = 3000


def test_messages_come_out_as_they_went_in_and_what_does_not_fit_is_refused() -> None:
    ring = SharedRing(PLACES, PLACE_BYTES)
    writer, reader = RingWriter(ring), RingReader(ring)
    assert reader.take() is None
    for first in range(0, 100, PLACES):
        sent = [bytes([first + each]) * each for each in range(PLACES)]
        assert all(map(writer.put, sent))
        assert not writer.put(b"no room")
        assert [reader.take() for _ in range(PLACES)] == sent
        assert reader.take() is None
    assert not writer.put(bytes(PLACE_BYTES + 1))
    assert writer.put(bytes(PLACE_BYTES))
    assert reader.take() == bytes(PLACE_BYTES)


def test_a_look_reports_messages_and_counts_the_heartbeats() -> None:
    ring = SharedRing(PLACES, PLACE_BYTES)
    writer, reader = RingWriter(ring), RingReader(ring)
    assert not reader.look()
    for number in range(3 * PLACES):
        writer.give_sign()
        assert not reader.look()
        assert reader.count == 2 * number + 1
        assert writer.put(b"a")
        assert reader.look()
        writer.give_sign()
        assert reader.look()
        assert reader.count == 2 * number + 2
        assert reader.take() == b"a"
        assert not reader.look()


def test_a_message_whose_bytes_have_not_all_arrived_waits() -> None:
    ring = SharedRing(PLACES, PLACE_BYTES)
    writer, reader, memory = RingWriter(ring), RingReader(ring), ring.view()
    assert writer.put(b"abcdef")
    last = ring.begin_of(1) + 16 + 5
    memory[last] = 0
    assert reader.take() is None
    memory[last] = ord("f")
    assert reader.take() == b"abcdef"


@pytest.mark.parametrize("written", range(16))
def test_a_header_that_is_written_in_part_is_no_message(written: int) -> None:
    ring, model = SharedRing(PLACES, PLACE_BYTES), SharedRing(PLACES, PLACE_BYTES)
    assert RingWriter(model).put(b"")
    begin = ring.begin_of(1)
    ring.view()[begin : begin + written] = model.view()[begin : begin + written]
    is_whole = bytes(ring.view()[begin : begin + 16]) == bytes(model.view()[begin : begin + 16])
    assert RingReader(ring).take() == (b"" if is_whole else None)


def test_nonsense_in_the_memory_is_no_message() -> None:
    ring = SharedRing(PLACES, PLACE_BYTES)
    writer, reader = RingWriter(ring), RingReader(ring)
    drawn = random.Random(SEED)
    for _ in range(1000):
        ring.view()[:] = drawn.randbytes(len(ring.view()))
        reader.look()
        assert reader.take() is None
        writer.put(b"a")  # raises nothing, whatever the other side claims to have taken


def _write(ring: SharedRing) -> None:
    writer = RingWriter(ring)
    for number in range(MESSAGES):
        while not writer.put(b"%d" % number * (1 + number % 7)):
            pass


@pytest.mark.slow
def test_another_process_loses_and_changes_none() -> None:
    ring = SharedRing(PLACES, PLACE_BYTES)
    process = multiprocessing.get_context("spawn").Process(target=_write, args=(ring,), daemon=True)
    process.start()
    reader = RingReader(ring)
    got: list[bytes] = []
    while len(got) < MESSAGES and (process.is_alive() or len(got) < MESSAGES):
        data = reader.take()
        if data is not None:
            got.append(data)
        else:
            assert process.is_alive() or process.exitcode == 0
    process.join()
    assert got == [b"%d" % number * (1 + number % 7) for number in range(MESSAGES)]
