from drivers.link import Received
from sim_backends.world.line import NEVER_NS, Line, serial_bits

MS = 1_000_000


def line() -> Line[bytes]:
    return Line(serial_bits, 10_000)  # one byte per millisecond


def test_a_payload_arrives_when_its_last_bit_has() -> None:
    wire = line()
    assert wire.next_arrival_ns == NEVER_NS
    wire.put(5 * MS, b"abc")
    assert wire.next_arrival_ns == 8 * MS
    assert wire.take(8 * MS - 1) == []
    assert wire.take(8 * MS) == [Received(8 * MS, b"abc")]
    assert wire.take(9 * MS) == []


def test_a_busy_wire_makes_the_next_payload_wait() -> None:
    wire = line()
    wire.put(0, b"abc")
    wire.put(1 * MS, b"d")
    wire.put(9 * MS, b"e")
    assert wire.take(99 * MS) == [Received(3 * MS, b"abc"), Received(4 * MS, b"d"), Received(10 * MS, b"e")]


def test_what_is_under_way_when_the_plug_is_pulled_is_lost_and_the_wire_is_free() -> None:
    wire = line()
    wire.put(0, bytes(100))
    wire.clear()
    wire.put(1 * MS, b"a")
    assert wire.take(99 * MS) == [Received(2 * MS, b"a")]


def test_a_disturbance_may_lose_double_and_delay() -> None:
    wire = line()

    def disturb(arrival: Received[bytes]) -> list[Received[bytes]]:
        match arrival.payload:
            case b"lose":
                return []
            case b"twice":
                return [arrival, arrival]
            case _:
                return [Received(arrival.t_ns + 50 * MS, arrival.payload)]

    wire.disturb = disturb
    for payload in (b"late", b"lose", b"twice"):
        wire.put(0, payload)
    assert wire.take(99 * MS) == [
        Received(13 * MS, b"twice"),
        Received(13 * MS, b"twice"),
        Received(54 * MS, b"late"),
    ]
