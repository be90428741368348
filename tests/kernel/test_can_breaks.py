"""Interfaces that go down, vanish, fill up, or are in a mode in which nothing is sent."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from drivers.can.link import CanLink
from drivers.errors import NotConnectedError
from drivers.link import LinkChange, Received
from sim_backends.serving.can_bus_port import CanBusPort
from tests.kernel.can_wire import Wire, collect, directions, frame, number_of, numbers
from tests.kernel.system import pause, run, wait_until

FORCED_BREAKS = 10


def test_an_interface_that_is_down_is_not_opened(wire: Wire) -> None:
    wire.down()
    with pytest.raises(NotConnectedError, match="Network is down; bring it up with"):
        wire.link().open(0.0)


def test_going_down_is_one_break_and_coming_up_one_recovery(wire: Wire) -> None:
    link = wire.link()
    link.open(1.0)
    wire.down()
    (down,) = collect(link, 1, LinkChange)
    assert isinstance(down, LinkChange)
    assert "Network is down" in down.reason
    assert not link.send(frame(1))
    wire.up()
    assert directions([down, *collect(link, 1, LinkChange)]) == [False, True]
    _passes_both_ways(wire, link)
    link.close()


def test_removed_and_made_again(wire: Wire) -> None:
    link = wire.link()
    link.open(1.0)
    wire.remove()
    assert directions(collect(link, 1, LinkChange)) == [False]
    pause(0.3)
    wire.make()
    wire.up()
    assert directions(collect(link, 1, LinkChange)) == [True]
    _passes_both_ways(wire, link)
    link.close()


def test_every_break_is_reported_however_often_something_is_sent(wire: Wire) -> None:
    """The kernel gives the error of a break to one caller, and here that is mostly `send`."""
    link = wire.link()
    link.open(1.0)
    with _sending(link):
        for _ in range(FORCED_BREAKS):
            wire.down()
            assert directions(collect(link, 1, LinkChange)) == [False]
            wire.up()
            assert directions(collect(link, 1, LinkChange)) == [True]
    link.close()


def test_a_full_queue_loses_set_points_but_not_the_link(wire: Wire) -> None:
    link = wire.link()
    link.open(1.0)
    run(f"tc qdisc replace dev {wire.near} root tbf rate 1kbit burst 32 limit 64")
    assert False in [link.send(frame(number)) for number in range(20)]
    run(f"tc qdisc delete dev {wire.near} root")
    wait_until(lambda: link.send(frame(99)))
    assert directions(link.receive()) == []
    _passes_both_ways(wire, link)
    link.close()


@pytest.mark.parametrize("mode", ["listen-only", "loopback"])
def test_a_controller_that_sends_nothing_is_not_taken_for_connected(card: Wire, mode: str) -> None:
    card.down()
    card.up(f" {mode} on")
    with pytest.raises(NotConnectedError, match=f"can0 is in {mode} mode, in which nothing is sent"):
        card.link().open(0.0)
    run(f"ip link set {card.near} down")
    run(f"ip link set {card.near} up type can {mode} off")
    link = card.link()
    link.open(0.0)
    _passes_both_ways(card, link)
    link.close()


def test_a_simulated_node_joins_an_interface_that_was_made_again(wire: Wire) -> None:
    port = CanBusPort("socketcan", wire.near)
    port.open()
    wire.remove()
    wait_until(lambda: port.read() == [] and not port.has_listener())
    wire.make()
    wire.up()
    wait_until(lambda: port.read() == [] and port.has_listener())
    with wire.node() as node:
        node.settimeout(2.0)
        assert port.write(frame(1))
        assert number_of(node.recv(16)) == 1
        node.send(frame(2))
        pause(0.1)
        assert [number_of(payload) for payload in port.read()] == [2]
    port.close()


@contextmanager
def _sending(link: CanLink) -> Iterator[None]:
    """Send about a thousand setpoints per second."""
    stop = threading.Event()

    def send() -> None:
        while not stop.wait(0.001):
            link.send(frame(7))

    thread = threading.Thread(target=send)
    thread.start()
    yield
    stop.set()
    thread.join()


def _passes_both_ways(wire: Wire, link: CanLink) -> None:
    with wire.node() as node:
        node.settimeout(2.0)
        node.send(frame(1))
        assert numbers(collect(link, 1, Received)) == [1]
        assert link.send(frame(2))
        assert number_of(node.recv(16)) == 2
