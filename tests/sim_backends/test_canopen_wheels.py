"""Simulated CANopen drives: bytes, states, heartbeat, faults, and the real driver on them."""

import numpy as np
import pytest

from drivers.can.frame import CanFrame, pack_can_frame, unpack_can_frame
from drivers.canopen_wheels.settings import CanopenWheelsSettings
from drivers.clock import seconds
from drivers.errors import ConfigError
from sim_backends.devices.canopen_wheels import CanopenWheelsEmulatorSettings, make_emulator
from sim_backends.world.plant import Plant
from sim_backends.world.world import EmulatedDevice
from tests.sim_backends.obedient_plant import START_NS, DriveBench, ObedientPlant, faults, of_wheel

DEVICE = CanopenWheelsSettings.model_validate(
    {
        "interface": "virtual",
        "channel": "x",
        "wheel": [{"node": 1}, {"node": 2, "sign": -1}, {"node": 3}, {"node": 4, "sign": -1}],
        "counts_per_motor_turn": 4096,
        "gear_ratio": 50.0,
        "rated_current_a": 3.0,
    }
)
EXACT = CanopenWheelsEmulatorSettings(speed_noise_rad_s=0, current_noise_a=0)
SPEEDS = (1.0, -2.0, 3.0, 0.5)
STARTING_S = 1.5


def bench(settings: CanopenWheelsEmulatorSettings = EXACT) -> DriveBench:
    def make(plant: Plant) -> EmulatedDevice[bytes]:
        return make_emulator("wheels", DEVICE, settings, plant, np.random.default_rng(1), START_NS)

    return DriveBench(DEVICE, make)


def talk(request: CanFrame) -> list[str]:
    """Return what reaches the host within a millisecond after the boot-up messages."""
    device = make_emulator("wheels", DEVICE, EXACT, ObedientPlant(), np.random.default_rng(1), START_NS)
    device.run_event(START_NS)
    device.to_host.take(START_NS + 5_000_000)
    device.emulator.receive(START_NS + 5_000_000, pack_can_frame(request))
    frames = [unpack_can_frame(item.payload) for item in device.to_host.take(START_NS + 6_000_000)]
    return [f"{frame.can_id:03X} {frame.data.hex(' ').upper()}" for frame in frames if frame is not None]


@pytest.mark.parametrize(
    ("request_data", "reply"),
    [
        ("2F 60 60 00 03 00 00 00", "581 60 60 60 00 00 00 00 00"),
        ("23 00 99 00 00 00 00 00", "581 80 00 99 00 00 00 02 06"),
        ("40 60 60 00 00 00 00 00", "581 80 60 60 00 01 00 04 05"),
    ],
)
def test_sdo_answers(request_data: str, reply: str) -> None:
    assert talk(CanFrame(0x601, bytes.fromhex(request_data))) == [reply]


def test_boot_up_and_heartbeat() -> None:
    device = make_emulator("wheels", DEVICE, EXACT, ObedientPlant(), np.random.default_rng(1), START_NS)
    device.run_event(START_NS)
    frames = [unpack_can_frame(item.payload) for item in device.to_host.take(START_NS + 5_000_000)]
    told = [(frame.can_id, frame.data.hex()) for frame in frames if frame is not None]
    assert told == [(0x700 + node, "00") for node in (1, 2, 3, 4)] + [
        (0x700 + node, "7f") for node in (1, 2, 3, 4)
    ]


def test_drives_are_configured_enabled_turn_and_tell_it() -> None:
    drive = bench()
    drive.run(STARTING_S, (0.0,) * 4)
    samples = drive.run(1.0, SPEEDS)
    assert drive.plant.speed_rad_s == pytest.approx(SPEEDS, abs=0.002)
    for wheel, speed in enumerate(SPEEDS):
        told = of_wheel(samples, wheel)
        speeds = [sample for sample in told if sample.speed_rad_s is not None]
        turned = [sample for sample in told if sample.position_rad is not None]
        assert len(speeds) == pytest.approx(100, abs=2)
        assert len(turned) == pytest.approx(100, abs=2)
        assert speeds[-1].speed_rad_s == pytest.approx(speed, abs=0.002)
        assert turned[-1].current_a == pytest.approx(0.5 * speed, abs=0.002)
        late_s = seconds(drive.clock.now_ns() - turned[-1].t_ns)
        expected_rad = drive.plant.position_rad[wheel] - speed * late_s
        assert turned[-1].position_rad == pytest.approx(expected_rad, abs=0.01)
    assert not drive.drive.health().rejected
    assert faults(samples) == []


def test_nothing_turns_before_all_drives_are_enabled() -> None:
    drive = bench()
    for _ in range(75):
        drive.run(0.02, SPEEDS)
        turning = [speed != 0.0 for speed in drive.plant.speed_rad_s]
        assert all(turning) or not any(turning)
    assert all(turning)


@pytest.mark.parametrize("is_unplugged", [True, False])
def test_a_missing_heartbeat_stops_the_wheels_and_is_named(is_unplugged: bool) -> None:
    drive = bench()
    drive.run(STARTING_S, SPEEDS)
    drive.device.unplugged = is_unplugged
    drive.run(0.12, SPEEDS if is_unplugged else None)
    assert drive.plant.speed_rad_s == pytest.approx(SPEEDS, abs=0.002)
    samples = drive.run(0.06, SPEEDS if is_unplugged else None)
    assert drive.plant.speed_rad_s == [0.0] * 4
    if not is_unplugged:
        assert "emergency 0x8130, monitoring" in faults(samples)[-1].text


def test_stop_and_close_give_standstill() -> None:
    drive = bench()
    drive.run(STARTING_S, SPEEDS)
    drive.drive.stop()
    drive.run(0.04)
    assert drive.plant.speed_rad_s == [0.0] * 4
    drive.run(0.2, SPEEDS)
    assert drive.plant.speed_rad_s == pytest.approx(SPEEDS, abs=0.002)
    drive.drive.close()
    drive.plant.advance(drive.clock.now_ns())
    drive.device.run_event(drive.clock.now_ns() + 5_000_000)
    assert drive.plant.speed_rad_s == [0.0] * 4


def test_a_fault_of_one_drive_stops_all_is_named_and_reset() -> None:
    fault = {"wheel": 2, "code": 0x2310, "start_s": 2.0}
    drive = bench(
        CanopenWheelsEmulatorSettings.model_validate({**EXACT.model_dump(), "drive_faults": [fault]})
    )
    drive.run(1.98, SPEEDS)
    assert drive.plant.speed_rad_s == pytest.approx(SPEEDS, abs=0.002)
    samples = drive.run(0.08, SPEEDS)
    assert drive.plant.speed_rad_s == [0.0] * 4
    assert {sample.wheel for sample in faults(samples)} == {2}
    texts = [sample.text for sample in faults(samples)]
    assert texts[0] == "node 3 emergency: emergency 0x2310, current"
    assert "node 3 emergency: emergency 0x2310, current; node 3 state: fault" in texts
    samples += drive.run(2.0, SPEEDS)
    assert drive.plant.speed_rad_s == [0.0] * 4
    assert faults(samples)[-1].code != 0
    samples += drive.run(0.3, (0.0,) * 4)
    assert faults(samples)[-1].code == 0
    drive.run(0.1, SPEEDS)
    assert drive.plant.speed_rad_s == pytest.approx(SPEEDS, abs=0.002)


def test_it_must_fit_the_rover_and_the_bus() -> None:
    rng = np.random.default_rng(1)
    with pytest.raises(ConfigError, match="turns 4 wheels but the simulated rover has 3"):
        make_emulator("wheels", DEVICE, EXACT, ObedientPlant((0.0,) * 3), rng, START_NS)
    slow = DEVICE.model_copy(update={"bit_rate": 50_000})
    with pytest.raises(ConfigError, match="raise bit_rate or pdo_period_ms"):
        make_emulator("wheels", slow, EXACT, ObedientPlant(), rng, START_NS)
