"""Each fault on a device that says a running number every 10 ms and notes what it hears."""

from collections.abc import Sequence

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from drivers.clock import VirtualClock, nanoseconds
from drivers.link import CameraImage, LinkChange, Received
from sim_backends.world.faults import FaultSettings, flip_bit, grey_lower_half, schedule_faults
from sim_backends.world.line import Line
from sim_backends.world.loopback import LoopbackLink
from sim_backends.world.plant import Plant
from sim_backends.world.world import EmulatedDevice, World
from tests.sim_backends.turning_plant import TurningPlant

START_NS = 1_000_000_000
PERIOD_NS = 10_000_000
BIT_NS = 1000


class Counter:
    def __init__(self, to_host: Line[bytes]) -> None:
        self.next_event_ns = START_NS
        self.heard: list[bytes] = []
        self._to_host = to_host

    def act(self, t_ns: int) -> None:
        number = (t_ns - START_NS) // PERIOD_NS
        self._to_host.put(t_ns, number.to_bytes(2, "big"))
        self.next_event_ns += PERIOD_NS

    def receive(self, t_ns: int, payload: bytes) -> None:
        self.heard.append(payload)


class Bench:
    """The device in a world, polled by a host at a steady pace."""

    def __init__(self, faults: Sequence[dict[str, object]], seed: int = 1) -> None:
        adapter: TypeAdapter[FaultSettings] = TypeAdapter(FaultSettings)
        settings = [adapter.validate_python({"device": "counter", **fault}) for fault in faults]
        to_host: Line[bytes] = Line(lambda payload: 1.0, 1e9 / BIT_NS)
        to_device: Line[bytes] = Line(lambda payload: 1.0, 1e9 / BIT_NS)
        self.emulator = Counter(to_host)
        device = EmulatedDevice("counter", self.emulator, to_host, to_device)
        schedule_faults(device, settings, flip_bit, np.random.default_rng(seed), START_NS)
        plant: Plant = TurningPlant()
        self.clock = VirtualClock(START_NS)
        self.link = LoopbackLink(World(plant, {"counter": device}), device, self.clock)
        self.link.open(1.0)
        self.received: list[Received[bytes]] = []
        self.changes: list[LinkChange] = []

    def run(self, duration_s: float) -> None:
        end_ns = self.clock.now_ns() + nanoseconds(duration_s)
        while self.clock.now_ns() < end_ns:
            self.clock.sleep_until(self.clock.now_ns() + PERIOD_NS // 2)
            for item in self.link.receive():
                if isinstance(item, LinkChange):
                    self.changes.append(item)
                else:
                    self.received.append(item)

    def numbers(self) -> list[int]:
        return [int.from_bytes(item.payload, "big") for item in self.received]


def window(kind: str, **others: float) -> dict[str, object]:
    return {"type": kind, "start_s": 0.1, "duration_s": 0.2, **others}


INSIDE = set(range(10, 30))
OUTSIDE = set(range(50)) - INSIDE


def test_without_faults_everything_arrives_once_in_order() -> None:
    bench = Bench([])
    bench.run(0.495)
    assert bench.numbers() == list(range(50))


def test_a_frozen_device_is_silent_but_hears() -> None:
    bench = Bench([window("freeze")])
    bench.run(0.2)
    assert bench.link.send(b"go")
    bench.run(0.295)
    assert set(bench.numbers()) == OUTSIDE
    assert bench.emulator.heard == [b"go"]
    assert bench.changes == []


def test_an_unplugged_device_neither_speaks_nor_hears_and_the_link_says_so_once() -> None:
    bench = Bench([window("unplug")])
    bench.run(0.2)
    assert not bench.link.send(b"go")
    bench.run(0.295)
    assert set(bench.numbers()) == OUTSIDE
    assert bench.emulator.heard == []
    assert [(change.up, change.t_ns) for change in bench.changes] == [
        (False, START_NS + nanoseconds(0.1)),
        (True, START_NS + nanoseconds(0.3)),
    ]


def test_a_restored_plug_is_told_before_what_comes_after_it() -> None:
    bench = Bench([window("unplug")])
    bench.run(0.2)
    bench.link.receive()
    bench.clock.sleep_until(START_NS + nanoseconds(0.325))
    change, *received = bench.link.receive()
    assert isinstance(change, LinkChange)
    assert change.up
    assert len(received) == 3
    assert START_NS + nanoseconds(0.3) <= change.t_ns <= received[0].t_ns


def test_what_is_on_the_wire_when_the_plug_is_pulled_is_lost() -> None:
    bench = Bench([{"type": "delay", "start_s": 0, "duration_s": 9, "delay_s": 0.025}, window("unplug")])
    bench.run(0.495)
    assert set(bench.numbers()) == set(range(47)) - set(range(7, 30))


def test_plugs_pulled_twice_at_once_stay_pulled_until_the_last_is_restored() -> None:
    bench = Bench([window("unplug"), {"type": "unplug", "start_s": 0.15, "duration_s": 0.05}])
    bench.run(0.495)
    assert set(bench.numbers()) == OUTSIDE


@pytest.mark.parametrize("probability", [0.3, 1.0])
def test_drop_loses_its_share_in_both_directions(probability: float) -> None:
    bench = Bench([{"type": "drop", "start_s": 0, "duration_s": 99, "probability": probability}])
    for _ in range(200):
        bench.link.send(b"go")
        bench.run(0.01)
    assert len(bench.received) == pytest.approx(200 * (1 - probability), abs=20)
    assert len(bench.emulator.heard) == pytest.approx(200 * (1 - probability), abs=20)
    assert bench.numbers() == sorted(set(bench.numbers()))


def test_delay_makes_everything_late_and_keeps_the_order() -> None:
    bench = Bench([window("delay", delay_s=0.035)])
    bench.run(0.495)
    for item in bench.received:
        number = int.from_bytes(item.payload, "big")
        late_ns = nanoseconds(0.035) if number in INSIDE else 0
        assert item.t_ns == START_NS + number * PERIOD_NS + BIT_NS + late_ns
    assert set(bench.numbers()) == set(range(50))


def test_duplicate_delivers_twice() -> None:
    bench = Bench([window("duplicate", probability=1.0)])
    bench.run(0.495)
    assert bench.numbers() == sorted([*range(50), *INSIDE])


def test_reorder_lets_the_next_one_pass() -> None:
    bench = Bench([window("reorder", probability=0.5)])
    bench.run(0.495)
    numbers = bench.numbers()
    assert sorted(numbers) == list(range(50))
    assert numbers != sorted(numbers)
    assert all(abs(place - number) <= 2 for place, number in enumerate(numbers))
    assert [item.t_ns for item in bench.received] == sorted(item.t_ns for item in bench.received)


def test_corrupt_flips_one_bit() -> None:
    bench = Bench([window("corrupt", probability=1.0)])
    bench.run(0.495)
    for number, said in enumerate(bench.numbers()):
        assert (number ^ said).bit_count() == (number in INSIDE)


def test_faults_add_up() -> None:
    bench = Bench([window("duplicate", probability=1.0), window("delay", delay_s=0.02)])
    bench.run(0.495)
    assert sorted(bench.numbers()) == sorted([*range(50), *INSIDE])
    first_inside = next(item for item in bench.received if int.from_bytes(item.payload, "big") == 10)
    assert first_inside.t_ns == START_NS + nanoseconds(0.12) + BIT_NS


def test_chance_is_seeded() -> None:
    runs = []
    for seed in (1, 1, 2):
        bench = Bench([window("drop", probability=0.5)], seed)
        bench.run(0.495)
        runs.append(bench.numbers())
    assert runs[0] == runs[1] != runs[2]


def test_a_corrupt_image_is_grey_below_and_the_camera_keeps_its_own() -> None:
    frame = CameraImage(np.zeros((40, 30, 3), np.uint8), 7)
    damaged = grey_lower_half(frame, np.random.default_rng(1))
    assert damaged.t_capture_ns == 7
    assert not damaged.image[:20].any()
    assert (damaged.image[-1] == 128).all()
    assert not frame.image.any()


@pytest.mark.parametrize(
    "fault",
    [
        {"type": "delay", "start_s": 0, "duration_s": 1},
        {"type": "drop", "start_s": 0, "duration_s": 1, "probability": 0},
        {"type": "unplug", "start_s": 0, "duration_s": 1, "probability": 0.5},
        {"type": "unplug", "start_s": 0, "duration_s": 0},
        {"type": "explode", "start_s": 0, "duration_s": 1},
    ],
)
def test_faults_that_make_no_sense_are_refused(fault: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(FaultSettings).validate_python({"device": "counter", **fault})
