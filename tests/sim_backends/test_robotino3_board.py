"""The simulated Robotino 3 board: bytes, quantisation, silence, bumper, and the real driver on it."""

import math
import struct
from collections.abc import Sequence

import numpy as np
import pytest

from drivers.clock import seconds
from drivers.errors import ConfigError
from drivers.robotino3_board.settings import Robotino3BoardSettings
from drivers.samples import BumperSample, PowerSample
from sim_backends.devices.robotino3_board import (
    CURRENT_STEP_A,
    Robotino3BoardEmulatorSettings,
    make_emulator,
)
from sim_backends.world.plant import Plant, Truth
from sim_backends.world.world import EmulatedDevice
from tests.sim_backends.obedient_plant import START_NS, DriveBench, ObedientPlant, of_wheel

DEVICE = Robotino3BoardSettings(port="simulated")
EXACT = Robotino3BoardEmulatorSettings(current_ripple_a=0.0)
SPEEDS = (2.0, -1.0, 0.25)
RPM = math.tau / 60 / 32
GET_READINGS = bytes.fromhex("aa 02 00 34 00 ca ff")
SET_SPEEDS = bytes.fromhex("aa 0f 00 09 03 00 b5 fe 09 03 01 00 00 09 03 02 4b 01 cb fd")


def three_wheels(position_rad: Sequence[float] = (0.0, 0.0, 0.0)) -> ObedientPlant:
    return ObedientPlant(position_rad)


def make(
    plant: Plant, settings: Robotino3BoardEmulatorSettings = EXACT, seed: int = 1
) -> EmulatedDevice[bytes]:
    return make_emulator("board", DEVICE, settings, plant, np.random.default_rng(seed), 0)


def bench(settings: Robotino3BoardEmulatorSettings = EXACT) -> DriveBench:
    return DriveBench(DEVICE, lambda plant: make(plant, settings), three_wheels())


def answer(board: EmulatedDevice[bytes], request: bytes, t_ns: int = START_NS) -> bytes:
    board.emulator.receive(t_ns, request)
    board.emulator.act(t_ns + 3_000_000)
    return b"".join(item.payload for item in board.to_host.take(t_ns + 10_000_000))


def test_bytes_of_a_standing_rover() -> None:
    """Written down from the table of tags: readings, power source and power button, then the checksum."""
    body = bytes.fromhex("35 28") + bytes(40)
    body += bytes.fromhex("41 10 cd cc c0 41 00 00 80 3f 00 00 01 00 00 00 00 00") + bytes.fromhex("27 01 00")
    checksum = (-sum(bytes((len(body), 0)) + body)) & 0xFFFF
    assert answer(make(three_wheels()), GET_READINGS) == (
        b"\xaa" + bytes((len(body), 0)) + body + checksum.to_bytes(2, "little")
    )


def test_published_set_points_turn_the_wheels() -> None:
    plant = three_wheels()
    answer(make(plant), SET_SPEEDS)
    assert plant.speed_rad_s == pytest.approx([-331 * RPM, 0.0, 331 * RPM])


@pytest.mark.parametrize("cut", range(1, len(SET_SPEEDS)))
def test_requests_in_two_parts_are_executed_once(cut: int) -> None:
    plant = three_wheels()
    board = make(plant)
    assert answer(board, SET_SPEEDS[:cut]) == b""
    assert answer(board, SET_SPEEDS[cut:], START_NS + 1).count(b"\xaa") == 1
    assert plant.speed_rad_s == pytest.approx([-331 * RPM, 0.0, 331 * RPM])


def test_damaged_requests_are_ignored() -> None:
    plant = three_wheels()
    assert answer(make(plant), SET_SPEEDS[:-1] + b"\xfc") == b""
    assert plant.speed_rad_s == [0.0] * 3


def test_speeds_come_in_steps_of_30_rpm_and_currents_in_steps_of_the_converter() -> None:
    drive = bench()
    samples = drive.run(2.0, SPEEDS)
    for wheel, speed in enumerate(SPEEDS):
        told = of_wheel(samples, wheel)[5:]
        steps = [(sample.speed_rad_s or 0.0) / (30 * RPM) for sample in told]
        assert steps == pytest.approx([round(step) for step in steps])
        assert np.mean(steps) * 30 * RPM == pytest.approx(speed, abs=0.05)
        counts = [(sample.current_a or 0.0) / CURRENT_STEP_A for sample in told]
        assert counts == pytest.approx([round(count) for count in counts], abs=1e-4)
        assert counts[-1] * CURRENT_STEP_A == pytest.approx(0.5 * speed, abs=CURRENT_STEP_A)


def test_commanded_wheels_turn_and_tell_it() -> None:
    drive = bench()
    samples = drive.run(1.0, SPEEDS)
    assert drive.plant.speed_rad_s == pytest.approx(SPEEDS, abs=RPM)
    for wheel, speed in enumerate(SPEEDS):
        told = of_wheel(samples, wheel)
        assert len(told) == 50
        late_s = seconds(drive.clock.now_ns() - told[-1].t_ns) + 0.002
        expected_rad = drive.plant.position_rad[wheel] - speed * late_s
        assert told[-1].position_rad == pytest.approx(expected_rad, abs=0.01)
    assert [sample.pressed for sample in samples if isinstance(sample, BumperSample)] == [False] * 50
    assert {round(sample.voltage_v, 3) for sample in samples if isinstance(sample, PowerSample)} == {24.1}
    assert not drive.drive.health().rejected


def test_silence_stops_the_motors() -> None:
    drive = bench()
    drive.run(0.2, SPEEDS)
    drive.run(0.34)
    assert drive.plant.speed_rad_s == pytest.approx(SPEEDS, abs=RPM)
    drive.run(0.1)
    assert drive.plant.speed_rad_s == [0.0] * 3


def test_a_pulled_plug_stops_the_motors() -> None:
    drive = bench()
    drive.run(0.2, SPEEDS)
    drive.device.unplugged = True
    drive.run(0.5, SPEEDS)
    assert drive.plant.speed_rad_s == [0.0] * 3


def test_stop_and_close_give_standstill() -> None:
    drive = bench()
    drive.run(0.2, SPEEDS)
    drive.drive.stop()
    drive.run(0.02)
    assert drive.plant.speed_rad_s == [0.0] * 3
    drive.run(0.2, SPEEDS)
    drive.drive.close()
    drive.plant.advance(drive.clock.now_ns())
    drive.device.run_event(drive.clock.now_ns() + 1_000_000)
    assert drive.plant.speed_rad_s == [0.0] * 3


class AtAWall(ObedientPlant):
    """Its bumper is pressed."""

    def truth(self) -> Truth:
        truth = super().truth()
        return Truth(**{**{name: getattr(truth, name) for name in truth.__slots__}, "bumper_pressed": True})


@pytest.mark.parametrize("is_on", [True, False])
def test_emergency_bumper(is_on: bool) -> None:
    device = DEVICE.model_copy(update={"emergency_bumper": is_on})
    drive = DriveBench(device, make, AtAWall((0.0, 0.0, 0.0)))
    samples = drive.run(0.2, SPEEDS)
    expected = (0.0, 0.0, 0.0) if is_on else SPEEDS
    assert drive.plant.speed_rad_s == pytest.approx(expected, abs=RPM)
    assert {sample.pressed for sample in samples if isinstance(sample, BumperSample)} == {True}


def test_same_seed_same_bytes() -> None:
    runs = []
    for seed in (5, 5, 6):
        plant = three_wheels()
        plant.set_wheel_speeds((2.0, 1.0, 0.5))
        board = make(plant, Robotino3BoardEmulatorSettings(), seed)
        runs.append([answer(board, GET_READINGS, START_NS + step * 20_000_000) for step in range(20)])
    assert runs[0] == runs[1] != runs[2]


def test_power_source_is_that_of_the_plant() -> None:
    plant = three_wheels()
    plant.battery_v = 21.5
    reply = answer(make(plant), GET_READINGS)
    assert struct.pack("<f", 21.5) in reply


def test_it_needs_three_wheels() -> None:
    with pytest.raises(ConfigError, match="turns 3 wheels but the simulated rover has 4"):
        make(ObedientPlant())
