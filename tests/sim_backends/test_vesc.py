"""Simulated VESC controllers: bytes on the bus, timeout, faults, and the real driver on them."""

import numpy as np
import pytest

from drivers.can.frame import CanFrame, pack_can_frame, unpack_can_frame
from drivers.clock import seconds
from drivers.errors import ConfigError
from drivers.samples import FaultSample, PowerSample
from drivers.vesc.settings import VescSettings
from sim_backends.devices.vesc import VescEmulatorSettings, make_emulator
from sim_backends.world.plant import Plant
from sim_backends.world.world import EmulatedDevice
from tests.sim_backends.obedient_plant import START_NS, DriveBench, ObedientPlant, faults, of_wheel

DEVICE = VescSettings.model_validate(
    {
        "interface": "virtual",
        "channel": "x",
        "wheel": [{"node": 1}, {"node": 2, "sign": -1}, {"node": 3}, {"node": 4, "sign": -1}],
        "pole_pairs": 7,
        "gear_ratio": 20.0,
    }
)
EXACT = VescEmulatorSettings(speed_noise_rad_s=0, current_noise_a=0)
SPEEDS = (1.0, -2.0, 3.0, 0.5)


def bench(settings: VescEmulatorSettings = EXACT, plant: ObedientPlant | None = None) -> DriveBench:
    def make(wheels: Plant) -> EmulatedDevice[bytes]:
        return make_emulator("wheels", DEVICE, settings, wheels, np.random.default_rng(1), START_NS)

    return DriveBench(DEVICE, make, plant)


def bus(emulated: EmulatedDevice[bytes], until_ns: int) -> list[tuple[str, str]]:
    """Return identifier and bytes of all frames that have reached the host."""
    frames = [unpack_can_frame(item.payload) for item in emulated.to_host.take(until_ns)]
    return [(f"{frame.can_id:X}", frame.data.hex(" ")) for frame in frames if frame is not None]


def test_bytes_on_the_bus() -> None:
    """Written down by hand: 3 rad/s, 0.5 A per rad/s, 20:1, 7 pole pairs: 4010 electrical turns a minute."""
    plant = ObedientPlant()
    emulated = make_emulator("wheels", DEVICE, EXACT, plant, np.random.default_rng(1), START_NS)
    plant.set_wheel_speeds((3.0, 3.0, 0.0, 0.0))
    for t_ns in range(START_NS, START_NS + 21_000_000, 500_000):
        plant.advance(t_ns)
        emulated.run_event(t_ns)
    frames = dict(bus(emulated, START_NS + 30_000_000))
    assert set(frames) >= {f"{command:X}{node:02X}" for command in (9, 27) for node in (1, 2, 3, 4)}
    assert frames["901"] == "00 00 0f aa 00 0f 00 5f"
    assert frames["902"] == "ff ff f0 56 00 0f ff a1"
    assert frames["1B03"] == "00 00 00 00 00 f1 00 00"


def test_commanded_wheels_turn_and_tell_it() -> None:
    drive = bench()
    samples = drive.run(1.0, SPEEDS)
    assert drive.plant.speed_rad_s == pytest.approx(SPEEDS, abs=1e-3)
    for wheel, speed in enumerate(SPEEDS):
        told = of_wheel(samples, wheel)
        speeds = [sample for sample in told if sample.speed_rad_s is not None]
        turned = [sample for sample in told if sample.position_rad is not None]
        assert len(speeds) == pytest.approx(50, abs=1)
        assert len(turned) == pytest.approx(50, abs=1)
        assert speeds[-1].speed_rad_s == pytest.approx(speed, abs=2e-3)
        assert speeds[-1].current_a == pytest.approx(0.5 * speed, abs=0.1)
        late_s = seconds(drive.clock.now_ns() - turned[-1].t_ns)
        assert turned[-1].position_rad == pytest.approx(
            drive.plant.position_rad[wheel] - speed * late_s, abs=0.02
        )
    supply = [sample.voltage_v for sample in samples if isinstance(sample, PowerSample)]
    assert supply == [24.1] * len(supply)
    assert not drive.drive.health().rejected
    assert faults(samples) == []


def test_wheels_stop_when_set_points_stop() -> None:
    drive = bench()
    drive.run(0.2, SPEEDS)
    drive.run(0.44)
    assert drive.plant.speed_rad_s == pytest.approx(SPEEDS, abs=1e-3)
    drive.run(0.1)
    assert drive.plant.speed_rad_s == [0.0] * 4


def test_a_controller_that_has_timed_out_says_so() -> None:
    drive = bench()
    question = CanFrame(0x801, bytes((254, 0, 50, 0, 32, 0, 0)), is_extended=True)
    answers = []
    for speeds in (None, SPEEDS, None):
        drive.run(0.6, speeds)
        drive.device.to_device.put(drive.clock.now_ns(), pack_can_frame(question))
        answers += faults(drive.run(0.04))
    assert [(fault.wheel, fault.code, fault.text) for fault in answers] == [
        (0, 1, "VESC 1 status: timeout expired")
    ]


def test_questions_do_not_feed_the_timeout() -> None:
    drive = bench()
    drive.run(0.2, SPEEDS)
    question = CanFrame(0x801, bytes((254, 0, 50, 0, 0, 128, 0)), is_extended=True)
    for _ in range(30):
        drive.device.to_device.put(drive.clock.now_ns(), pack_can_frame(question))
        drive.run(0.02)
    assert drive.plant.speed_rad_s == [0.0] * 4


def test_a_pulled_plug_stops_the_wheels() -> None:
    drive = bench()
    drive.run(0.2, SPEEDS)
    drive.device.unplugged = True
    drive.run(0.6, SPEEDS)
    assert drive.plant.speed_rad_s == [0.0] * 4


def test_an_expired_command_and_a_stop_give_zero_speeds() -> None:
    drive = bench()
    drive.run(0.2, SPEEDS)
    drive.drive.stop()
    drive.run(0.04)
    assert drive.plant.speed_rad_s == [0.0] * 4
    drive.run(0.2, SPEEDS)
    drive.drive.close()
    drive.plant.advance(drive.clock.now_ns())
    drive.device.run_event(drive.clock.now_ns() + 5_000_000)
    assert drive.plant.speed_rad_s == [0.0] * 4


def test_a_current_of_zero_lets_the_wheel_roll_on_until_the_next_set_point() -> None:
    drive = bench()
    drive.run(0.2, SPEEDS)
    release = CanFrame(0x101, bytes(4), is_extended=True)
    drive.device.to_device.put(drive.clock.now_ns(), pack_can_frame(release))
    drive.run(0.1)
    drive.plant.speed_rad_s[0] *= 0.5  # friction
    drive.run(1.0)
    assert drive.plant.speed_rad_s == pytest.approx((0.5, 0.0, 0.0, 0.0), abs=1e-3)
    drive.run(0.1, SPEEDS)
    assert drive.plant.speed_rad_s == pytest.approx(SPEEDS, abs=1e-3)


def test_a_fault_is_named_releases_its_wheel_and_clears() -> None:
    fault = {"wheel": 2, "code": 4, "start_s": 0.5, "duration_s": 0.5}
    settings = VescEmulatorSettings.model_validate({**EXACT.model_dump(), "drive_faults": [fault]})
    drive = bench(settings)
    samples = drive.run(0.6, SPEEDS)
    assert drive.plant.speed_rad_s == pytest.approx((1.0, -2.0, 0.0, 0.5), abs=1e-3)
    (reported,) = faults(samples)
    assert isinstance(reported, FaultSample)
    assert (reported.wheel, reported.code) == (2, 4)
    assert reported.text == "VESC 3: absolute over current"
    assert seconds(reported.t_ns - START_NS) == pytest.approx(0.5, abs=0.1)
    (cleared,) = faults(drive.run(0.6, SPEEDS))
    assert (cleared.wheel, cleared.code) == (2, 0)
    assert drive.plant.speed_rad_s == pytest.approx(SPEEDS, abs=1e-3)


def test_same_seed_same_bytes() -> None:
    plants = [ObedientPlant() for _ in range(3)]
    heard = []
    for plant, seed in zip(plants, (5, 5, 6), strict=True):
        rng = np.random.default_rng(seed)
        emulated = make_emulator("wheels", DEVICE, VescEmulatorSettings(), plant, rng, START_NS)
        for t_ns in range(START_NS, START_NS + 200_000_000, 1_000_000):
            plant.advance(t_ns)
            emulated.run_event(t_ns)
        heard.append(bus(emulated, START_NS + 300_000_000))
    assert heard[0] == heard[1] != heard[2]


def test_it_must_fit_the_rover_and_the_bus() -> None:
    rng = np.random.default_rng(1)
    with pytest.raises(ConfigError, match="turns 4 wheels but the simulated rover has 3"):
        make_emulator("wheels", DEVICE, EXACT, ObedientPlant((0.0,) * 3), rng, START_NS)
    slow = DEVICE.model_copy(update={"bit_rate": 50_000})
    with pytest.raises(ConfigError, match="raise bit_rate or lower wheel_rate_hz"):
        make_emulator("wheels", slow, EXACT, ObedientPlant(), rng, START_NS)
