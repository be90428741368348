"""Simulated CAN wheel drives, heard and commanded by the real codec."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from drivers.can.frame import can_frame_bits, unpack_can_frame
from drivers.can_wheels.codec import CanWheelsCodec
from drivers.can_wheels.mapping_file import SHIPPED_FOLDER, load_mapping
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.clock import VirtualClock, nanoseconds, seconds
from drivers.driver import Rejection, WheelDrive
from drivers.errors import ConfigError
from drivers.link import Received
from drivers.samples import FaultSample, PowerSample, Sample, WheelCommand, WheelSample
from sim_backends.devices.can_node_settings import CanNodeSettings
from sim_backends.devices.can_nodes import make_can_node
from sim_backends.world.loopback import LoopbackLink
from sim_backends.world.world import EmulatedDevice, World
from tests.sim_backends.obedient_plant import START_NS, ObedientPlant

SHIPPED = ("generic_wheel", "odrive_0_5", "odrive_0_6")
EXACT = CanNodeSettings(speed_noise_rad_s=0, current_noise_a=0, current_step_a=0, voltage_noise_v=0)


class Bench:
    """A drive on a simulated bus."""

    def __init__(
        self,
        mapping: str,
        settings: CanNodeSettings = EXACT,
        plant: ObedientPlant | None = None,
        seed: int = 1,
    ) -> None:
        device = CanWheelsSettings(interface="virtual", channel="x", mapping=mapping)
        self.clock = VirtualClock(START_NS)
        self.plant = plant or ObedientPlant()
        rng = np.random.default_rng(seed)
        self.node: EmulatedDevice[bytes] = make_can_node(
            "wheels", device, settings, self.plant, rng, START_NS
        )
        self.world = World(self.plant, {"wheels": self.node})
        link = LoopbackLink(self.world, self.node, self.clock)
        drive = device.make_driver("wheels", link, self.clock)
        assert isinstance(drive, WheelDrive)
        self.drive = drive
        drive.connect()

    def run(self, duration_s: float, speeds: Sequence[float] | None = None) -> list[Sample]:
        """Poll, and command unless `speeds` is None, at 100 Hz."""
        samples: list[Sample] = []
        for _ in range(round(duration_s * 100)):
            self.clock.sleep_until(self.clock.now_ns() + 10_000_000)
            samples += self.drive.poll()
            if speeds is not None:
                now_ns = self.clock.now_ns()
                command = WheelCommand(
                    t_ns=now_ns, expires_ns=now_ns + 150_000_000, speed_rad_s=tuple(speeds)
                )
                assert self.drive.command(command).delivered
        return samples


def of_wheel(samples: Sequence[Sample], wheel: int) -> list[WheelSample]:
    return [sample for sample in samples if isinstance(sample, WheelSample) and sample.wheel == wheel]


def faults(samples: Sequence[Sample]) -> list[FaultSample]:
    return [sample for sample in samples if isinstance(sample, FaultSample)]


@pytest.mark.parametrize("mapping", SHIPPED)
def test_commanded_wheels_turn_and_tell_it(mapping: str) -> None:
    bench = Bench(mapping)
    speeds = (1.0, -2.0, 3.0, 0.5)
    samples = bench.run(1.0, speeds)
    assert bench.plant.speed_rad_s == pytest.approx(speeds, abs=1e-6)
    for wheel, speed in enumerate(speeds):
        told = of_wheel(samples, wheel)
        positions = [sample for sample in told if sample.position_rad is not None]
        currents = [sample for sample in told if sample.current_a is not None]
        assert len(positions) == pytest.approx(100, abs=2)
        assert len(currents) == pytest.approx(100, abs=2)
        assert positions[-1].speed_rad_s == pytest.approx(speed, abs=1e-6)
        assert currents[-1].current_a == pytest.approx(0.5 * speed, abs=1e-6)
        late_s = seconds(bench.clock.now_ns() - positions[-1].t_ns) + 0.002
        error_rad = bench.plant.position_rad[wheel] - (positions[-1].position_rad or 0.0)
        assert abs(error_rad) <= 2 * math.pi / 4096 + abs(speed) * late_s
    assert bench.drive.health().rejected == {}
    assert faults(samples) == []


@pytest.mark.parametrize("mapping", SHIPPED)
def test_supply_is_told_ten_times_a_second(mapping: str) -> None:
    supply = [sample for sample in Bench(mapping).run(2.0) if isinstance(sample, PowerSample)]
    assert len(supply) == pytest.approx(20, abs=1)
    assert supply[-1].voltage_v == pytest.approx(24.1, abs=0.001)


def test_wheel_messages_are_spread_over_the_period() -> None:
    bench = Bench("generic_wheel")
    last_ns = [of_wheel(bench.run(0.1), wheel)[-1].t_ns for wheel in range(4)]
    offsets_ms = sorted((t_ns - last_ns[0]) // 1_000_000 % 10 for t_ns in last_ns)
    assert offsets_ms == pytest.approx([0, 2, 5, 7], abs=1)


def test_frames_need_their_time_on_the_wire() -> None:
    bench = Bench("generic_wheel")
    (sample,) = of_wheel(bench.run(0.02), 0)[:1]
    bits = (47 + 64) * 1.1
    assert sample.t_ns - START_NS == pytest.approx(2_500_000 + bits / 500_000 * 1e9, abs=1)


def test_positions_are_whole_ticks_and_wrap_unseen() -> None:
    turns = 127.9
    start_rad = turns * 2 * math.pi
    bench = Bench("generic_wheel", plant=ObedientPlant((start_rad,) * 4))
    raw: list[int] = []
    message = load_mapping("generic_wheel").message("Wheel0_State")
    put = bench.node.to_host.put

    def watch(t_ns: int, payload: bytes) -> None:
        frame = unpack_can_frame(payload)
        if frame is not None and frame.can_id == message.frame_id:
            values = message.decode_simple(frame.data, scaling=False)
            raw.append(int(str(values["Position"])))
        put(t_ns, payload)

    bench.node.to_host.put = watch  # type: ignore[method-assign]
    told = [sample.position_rad for sample in of_wheel(bench.run(1.0, (10.0,) * 4), 0)]
    ticks = [position_rad / (2 * math.pi) * 4096 for position_rad in told if position_rad is not None]
    assert max(raw) > 500_000
    assert min(raw) < -500_000
    assert ticks == pytest.approx([round(tick) for tick in ticks], abs=1e-6)
    steps = np.diff(ticks)
    assert steps.min() >= 0
    assert steps.max() <= math.ceil(10.0 / (2 * math.pi) * 4096 * 0.01)
    assert ticks[-1] > 128 * 4096 + 5000


def test_float_positions_have_the_steps_of_the_encoder() -> None:
    bench = Bench("odrive_0_6", EXACT.model_copy(update={"encoder_ticks_per_revolution": 100.0}))
    told = [sample.position_rad for sample in of_wheel(bench.run(1.0, (-1.0,) * 4), 2)]
    ticks = [position_rad / (2 * math.pi) * 100 for position_rad in told if position_rad is not None]
    assert ticks == pytest.approx([round(tick) for tick in ticks], abs=1e-4)
    assert len({round(tick) for tick in ticks}) == pytest.approx(17, abs=1)


def test_noise_has_the_size_asked_for_and_repeats_with_its_seed() -> None:
    noisy = CanNodeSettings(
        speed_noise_rad_s=0.1, current_noise_a=0.2, current_step_a=0.05, voltage_noise_v=0.3
    )

    def run(seed: int) -> tuple[list[float], list[float], list[float]]:
        samples = Bench("generic_wheel", noisy, seed=seed).run(10.0)
        wheels = [sample for sample in samples if isinstance(sample, WheelSample)]
        return (
            [sample.speed_rad_s for sample in wheels if sample.speed_rad_s is not None],
            [sample.current_a for sample in wheels if sample.current_a is not None],
            [sample.voltage_v for sample in samples if isinstance(sample, PowerSample)],
        )

    speeds, currents, voltages = run(7)
    assert np.std(speeds) == pytest.approx(0.1, rel=0.1)
    assert np.std(currents) == pytest.approx(0.2, rel=0.1)
    assert np.std(voltages) == pytest.approx(0.3, rel=0.3)
    steps = np.array(currents) / 0.05
    assert np.abs(steps - np.round(steps)).max() < 1e-6
    assert run(7) == (speeds, currents, voltages)
    assert run(8)[0] != speeds


def test_wheels_stop_when_set_points_stay_away() -> None:
    bench = Bench("generic_wheel")
    bench.run(0.1, (2.0,) * 4)
    bench.run(0.19)
    assert bench.plant.speed_rad_s == [2.0] * 4
    samples = bench.run(0.2)
    assert bench.plant.speed_rad_s == [0.0] * 4
    (fault,) = faults(samples)
    assert (fault.wheel, fault.code) == (None, 8)
    assert fault.text == "Drive_Status.Faults: watchdog: setpoints missing"
    (cleared,) = faults(bench.run(0.2, (1.0,) * 4))
    assert cleared.code == 0
    assert bench.plant.speed_rad_s == [1.0] * 4


def test_each_wheel_has_its_own_watchdog() -> None:
    bench = Bench("generic_wheel")
    codec = CanWheelsCodec("wheels", load_mapping("generic_wheel"))
    told: list[FaultSample] = []
    for _ in range(50):
        payloads, _ = codec.encode_speeds((1.0, 2.0, 3.0, 4.0))
        for payload in payloads[:2] if bench.clock.now_ns() > START_NS + 100_000_000 else payloads:
            bench.node.to_device.put(bench.clock.now_ns(), payload)
        told += faults(bench.run(0.01))
    assert bench.plant.speed_rad_s == [1.0, 2.0, 0.0, 0.0]
    assert [fault.code for fault in told] == [8]


@pytest.mark.parametrize("watchdog_s", [0.05, 0.5])
def test_watchdog_time_is_kept_to_the_cycle(watchdog_s: float) -> None:
    bench = Bench("generic_wheel", EXACT.model_copy(update={"watchdog_s": watchdog_s}))
    bench.run(0.1, (1.0,) * 4)
    stood_ns = 0
    start_ns = bench.clock.now_ns()
    while any(bench.plant.speed_rad_s):
        bench.run(0.01)
        stood_ns = bench.clock.now_ns()
    assert stood_ns - start_ns == pytest.approx(nanoseconds(watchdog_s), abs=12_000_000)


@pytest.mark.parametrize("mapping", ["odrive_0_5", "odrive_0_6"])
def test_odrive_moves_only_between_start_and_stop(mapping: str) -> None:
    bench = Bench(mapping)
    codec = CanWheelsCodec("wheels", load_mapping(mapping))
    start = codec.encode_start()

    def send(payloads: Sequence[bytes]) -> None:
        for payload in payloads:
            bench.node.to_device.put(bench.clock.now_ns(), payload)
        bench.run(0.02)

    send(codec.encode_speeds((1.0,) * 4)[0])
    assert bench.plant.speed_rad_s == [0.0] * 4
    send(start[:-1])
    send(codec.encode_speeds((1.0,) * 4)[0])
    assert bench.plant.speed_rad_s == [0.0] * 4
    send(start[-1:])
    send(codec.encode_speeds((1.0,) * 4)[0])
    assert bench.plant.speed_rad_s == pytest.approx([1.0] * 4)
    send(codec.encode_stop())
    assert bench.plant.speed_rad_s == [0.0] * 4
    send(codec.encode_speeds((1.0,) * 4)[0])
    assert bench.plant.speed_rad_s == [0.0] * 4


@pytest.mark.parametrize(("mapping", "code"), [("odrive_0_5", 0x800), ("odrive_0_6", 0x1000000)])
def test_odrive_whose_watchdog_expired_needs_a_new_start(mapping: str, code: int) -> None:
    bench = Bench(mapping)
    bench.run(0.1, (1.0,) * 4)
    told = faults(bench.run(0.5))
    idle = 1  # all axes leave closed loop
    assert {fault.wheel: fault.code for fault in told} == {0: code, 1: idle, 2: idle, 3: idle}
    bench.run(0.1, (1.0,) * 4)
    assert bench.plant.speed_rad_s == [0.0] * 4
    bench.node.unplugged = True
    bench.run(0.05)
    bench.node.unplugged = False
    told = faults(bench.run(0.3, (1.0,) * 4))
    assert bench.plant.speed_rad_s == pytest.approx([1.0] * 4)
    assert {fault.wheel: fault.code for fault in told} == dict.fromkeys(range(4), 0)


def test_damaged_and_repeated_set_points_do_not_feed_the_watchdog() -> None:
    bench = Bench("generic_wheel")
    payloads, _ = CanWheelsCodec("wheels", load_mapping("generic_wheel")).encode_speeds((1.0,) * 4)
    for _ in range(30):
        bench.node.to_device.put(bench.clock.now_ns(), payloads[0])
        damaged = bytearray(payloads[1])
        damaged[8] ^= 1
        bench.node.to_device.put(bench.clock.now_ns(), bytes(damaged))
        bench.node.to_device.put(bench.clock.now_ns(), b"no frame")
        bench.run(0.01)
    assert bench.plant.speed_rad_s == [0.0] * 4


def test_unplugged_bus_is_silent_and_the_rover_stops() -> None:
    bench = Bench("generic_wheel")
    bench.run(0.1, (1.0,) * 4)
    bench.node.unplugged = True
    bench.run(0.02)
    assert not [sample for sample in bench.run(0.3) if isinstance(sample, WheelSample)]
    assert bench.plant.speed_rad_s == [0.0] * 4
    bench.node.unplugged = False
    assert len(of_wheel(bench.run(0.1, (1.0,) * 4), 0)) >= 9


def test_sign_gear_magnitude_and_wrap_of_a_mapping_of_ones_own(tmp_path: Path) -> None:
    text = (SHIPPED_FOLDER / "generic_wheel.toml").read_text("utf-8")
    text = text.replace(
        "[every_wheel]", "[every_wheel]\nsign = -1\ngear_ratio = 5\ncurrent_is_signed = false", 1
    )
    text = text.replace("ticks_per_revolution = 4096", "ticks_per_revolution = 1000, wrap = 700", 1)
    (tmp_path / "own.toml").write_text(text, "utf-8")
    (tmp_path / "generic_wheel.dbc").write_bytes((SHIPPED_FOLDER / "generic_wheel.dbc").read_bytes())
    bench = Bench(str(tmp_path / "own.toml"))
    told = of_wheel(bench.run(1.0, (-2.0,) * 4), 1)
    assert bench.plant.speed_rad_s == pytest.approx([-2.0] * 4)
    first, last = told[0], told[-1]
    assert last.speed_rad_s == pytest.approx(-2.0)
    assert last.current_a == pytest.approx(1.0)
    assert not last.current_is_signed
    turned_rad = (last.position_rad or 0.0) - (first.position_rad or 0.0)
    assert turned_rad == pytest.approx(bench.plant.position_rad[1], abs=0.05)


PAGED_DBC = """VERSION ""
BU_: A
BO_ 512 Wheels: 8 A
 SG_ Which M : 0|4@1+ (1,0) [0|0] "" A
 SG_ Error : 4|4@1+ (1,0) [0|0] "" A
 SG_ Angle0 m0 : 8|16@1+ (1,0) [0|0] "" A
 SG_ Angle1 m1 : 8|16@1+ (1,0) [0|0] "" A
 SG_ Angle2 m2 : 8|16@1+ (1,0) [0|0] "" A
 SG_ Angle3 m3 : 8|16@1+ (1,0) [0|0] "" A
 SG_ Turns0 m0 : 24|8@1- (1,0) [0|0] "" A
 SG_ Turns1 m1 : 24|8@1- (1,0) [0|0] "" A
 SG_ Turns2 m2 : 24|8@1- (1,0) [0|0] "" A
 SG_ Turns3 m3 : 24|8@1- (1,0) [0|0] "" A
 SG_ Other m1 : 32|8@1+ (1,0) [0|0] "" A
 SG_ Other m1 : 36|8@1+ (0,0) [0|0] "" A
BO_ 768 Command: 8 A
 SG_ Speed0 : 0|16@1- (0.01,0) [0|0] "" A
 SG_ Speed1 : 16|16@1- (0.01,0) [0|0] "" A
 SG_ Speed2 : 32|16@1- (0.01,0) [0|0] "" A
 SG_ Speed3 : 48|16@1- (0.01,0) [0|0] "" A
BO_ 769 Mode: 1 A
 SG_ Mode : 0|8@1+ (1,0) [0|0] "" A
BO_ 770 State: 1 A
 SG_ Mode : 0|8@1+ (1,0) [0|0] "" A
"""
PAGED_TOML = """dbc = "paged.dbc"
[every_wheel]
gear_ratio = 100
setpoint = { message = "Command", signal = "Speed{node}", unit = "rad/s" }
state = { message = "State", signal = "Mode", operating = [1] }
[every_wheel.position]
message = "Wheels"
signal = "Angle{node}"
unit = "ticks"
ticks_per_revolution = 65536
turns = "Turns{node}"
[[wheel]]
node = 0
[[wheel]]
node = 1
[[wheel]]
node = 2
[[wheel]]
node = 3
[[fault]]
message = "Wheels"
signal = "Error"
[[start]]
message = "Mode"
signals = { Mode = 1 }
"""


def test_multiplexed_wheels_with_turns_beside_their_angles_tell_how_far_they_turned(tmp_path: Path) -> None:
    (tmp_path / "paged.dbc").write_text(PAGED_DBC, "utf-8")
    (tmp_path / "paged.toml").write_text(PAGED_TOML, "utf-8")
    bench = Bench(str(tmp_path / "paged.toml"))
    speeds = (8.0, -8.0, 3.0, 0.5)
    samples = bench.run(2.0, speeds)
    for wheel, speed in enumerate(speeds):
        last = of_wheel(samples, wheel)[-1]
        late_s = seconds(bench.clock.now_ns() - last.t_ns) + 0.002
        error_rad = bench.plant.position_rad[wheel] - (last.position_rad or 0.0)
        assert abs(error_rad) <= 1e-4 + abs(speed) * late_s
    assert bench.drive.health().rejected == {}
    assert faults(samples) == []


def test_wheel_count_must_fit() -> None:
    with pytest.raises(ConfigError, match=r"has 4 wheels in generic_wheel\.toml, the simulated rover 3"):
        Bench("generic_wheel", plant=ObedientPlant((0.0,) * 3))


def test_bus_must_carry_the_load() -> None:
    device = CanWheelsSettings(interface="virtual", channel="x", mapping="odrive_0_5", bit_rate=50_000)
    with pytest.raises(ConfigError, match=r"needs 1.* bit/s, its line has 50000: raise bit_rate"):
        make_can_node("wheels", device, EXACT, ObedientPlant(), np.random.default_rng(1), START_NS)


def test_what_is_not_simulated_is_refused(tmp_path: Path) -> None:
    text = (SHIPPED_FOLDER / "odrive_0_5.toml").read_text("utf-8")
    current = 'current = { message = "Axis0_Get_Bus_Voltage_Current", signal = "Bus_Current", unit = "A" }'
    (tmp_path / "own.toml").write_text(text.replace("[power]", f"[power]\n{current}"), "utf-8")
    (tmp_path / "odrive_0_5.dbc").write_bytes((SHIPPED_FOLDER / "odrive_0_5.dbc").read_bytes())
    with pytest.raises(ConfigError, match=r"supply current are not simulated, but own\.toml"):
        Bench(str(tmp_path / "own.toml"))


def test_declared_load_is_the_load() -> None:
    bench = Bench("generic_wheel")
    bits = 0.0
    put = bench.node.to_host.put

    def watch(t_ns: int, payload: bytes) -> None:
        nonlocal bits
        bits += can_frame_bits(payload)
        put(t_ns, payload)

    bench.node.to_host.put = watch  # type: ignore[method-assign]
    bench.run(2.0)
    assert getattr(bench.node.emulator, "load_bits_per_s", None) == pytest.approx(bits / 2.0, rel=0.01)


def test_every_frame_is_one_the_codec_takes() -> None:
    bench = Bench("odrive_0_6", CanNodeSettings())
    codec = CanWheelsCodec("wheels", load_mapping("odrive_0_6"))
    bench.world.advance(START_NS + 1_000_000_000)
    arrived = bench.node.to_host.take(START_NS + 1_000_000_000)
    assert len(arrived) > 800
    for item in arrived:
        told = codec.decode(Received(item.t_ns, item.payload))
        assert not [part for part in told if isinstance(part, Rejection)]
