import math
import struct
from collections.abc import Sequence

import numpy as np
import pytest

from drivers.clock import VirtualClock, nanoseconds
from drivers.errors import ConfigError
from drivers.link import Received
from drivers.robotino_board.codec import REPLY_SIZE, BoardReply, RobotinoBoardCodec, parse_reply
from drivers.robotino_board.parameters import Board
from drivers.robotino_board.settings import RobotinoBoardSettings
from drivers.samples import BumperSample, PowerSample, WheelCommand, WheelSample
from sim_backends.devices.robotino_board import RobotinoBoardEmulatorSettings, make_emulator
from sim_backends.world.line import NEVER_NS
from sim_backends.world.loopback import LoopbackLink
from sim_backends.world.plant import Truth
from sim_backends.world.world import EmulatedDevice, World

START_NS = 1_000_000_000
BIT_NS = 1e9 / 115_200
REQUEST_NS = round(470 * BIT_NS)
REPLY_NS = round(1010 * BIT_NS)
STEP_RAD_S = 27 * math.tau / 60 / 16
TICK_RAD = math.tau / 2000 / 16


class IdealPlant:
    """Wheels that turn as commanded at once, or as they are dragged; the rest is set by the test."""

    wheel_count = 3

    def __init__(self) -> None:
        self.speeds = (0.0, 0.0, 0.0)
        self.dragged_rad_s: tuple[float, float, float] | None = None
        self.positions = (0.0, 0.0, 0.0)
        self.currents = (0.0, 0.0, 0.0)
        self.battery_v = 24.0
        self.bumper_pressed = False
        self.now_ns = START_NS
        self.told: list[tuple[int, tuple[float, ...]]] = []

    def set_wheel_speeds(self, speed_rad_s: Sequence[float]) -> None:
        s0, s1, s2 = speed_rad_s
        self.speeds = self.dragged_rad_s or (s0, s1, s2)
        self.told.append((self.now_ns, self.speeds))

    def advance(self, t_ns: int) -> None:
        step_s = max(0, t_ns - self.now_ns) / 1e9
        p0, p1, p2 = (
            place + step_s * speed for place, speed in zip(self.positions, self.speeds, strict=True)
        )
        self.positions = (p0, p1, p2)
        self.now_ns = max(t_ns, self.now_ns)

    def truth(self) -> Truth:
        return Truth(
            t_ns=self.now_ns,
            x_m=0.0,
            y_m=0.0,
            yaw_rad=0.0,
            roll_rad=0.0,
            pitch_rad=0.0,
            velocity_x_m_s=0.0,
            velocity_y_m_s=0.0,
            yaw_rate_rad_s=0.0,
            wheel_position_rad=self.positions,
            wheel_speed_rad_s=self.speeds,
            motor_current_a=self.currents,
            slip=(0.0, 0.0, 0.0),
            battery_v=self.battery_v,
            bumper_pressed=self.bumper_pressed,
        )


class Bench:
    """A board on a line in a world, and the host's codec."""

    def __init__(self, board: Board = "EA05", ripple_a: float = 0.0, seed: int = 1) -> None:
        self.settings = RobotinoBoardSettings(type="robotino_board", port="p", board=board)
        emulator = RobotinoBoardEmulatorSettings(type="robotino_board", current_ripple_a=ripple_a)
        self.plant = IdealPlant()
        self.device: EmulatedDevice[bytes] = make_emulator(
            "board", self.settings, emulator, self.plant, np.random.default_rng(seed), START_NS
        )
        self.world = World(self.plant, {"board": self.device})
        self.codec = RobotinoBoardCodec("board", self.settings)

    def send(self, speeds: Sequence[float], t_ns: int) -> None:
        for payload in self.codec.encode_speeds(speeds)[0]:
            self.device.to_device.put(t_ns, payload)

    def receive(self, until_ns: int) -> list[Received[bytes]]:
        self.world.advance(until_ns)
        return self.device.to_host.take(until_ns)

    def poll(self, speeds: Sequence[float], cycles: int, period_ns: int = 20_000_000) -> list[BoardReply]:
        replies: list[BoardReply] = []
        begin_ns = self.plant.now_ns
        for cycle in range(cycles):
            self.send(speeds, begin_ns + cycle * period_ns)
            received = self.receive(begin_ns + (cycle + 1) * period_ns)
            replies += [parse_reply(item.payload) for item in received]
        return replies


def test_one_request_gives_one_reply_as_late_as_board_and_line_make_it() -> None:
    delays_ns: list[int] = []
    bench = Bench()
    for cycle in range(200):
        asked_ns = START_NS + cycle * 30_000_000
        bench.send((1.0, 0.0, -1.0), asked_ns)
        (reply,) = bench.receive(asked_ns + 30_000_000)
        assert len(reply.payload) == REPLY_SIZE
        delays_ns.append(reply.t_ns - asked_ns - REQUEST_NS - REPLY_NS)
    assert 4_000_000 <= min(delays_ns) < 4_200_000
    assert 5_800_000 < max(delays_ns) <= 6_000_001


def test_set_points_count_from_the_last_byte_and_in_whole_steps() -> None:
    bench = Bench()
    bench.send((2.0, -2.0, 100.0), START_NS)
    bench.world.advance(START_NS + REQUEST_NS - 1)
    assert bench.plant.told == []
    bench.world.advance(START_NS + REQUEST_NS)
    ((told_ns, speeds),) = bench.plant.told
    assert told_ns == START_NS + REQUEST_NS
    assert speeds == pytest.approx((11 * STEP_RAD_S, -11 * STEP_RAD_S, 255 * STEP_RAD_S))


def test_request_may_arrive_in_pieces_and_after_noise() -> None:
    bench = Bench()
    (request,), _ = bench.codec.encode_speeds((1.0, 1.0, 1.0))
    for index, piece in enumerate((b"\x00REC noise", request[:20], request[20:])):
        bench.device.to_device.put(START_NS + index, piece)
    assert len(bench.receive(START_NS + 50_000_000)) == 1


def test_brake_holds_the_wheels() -> None:
    bench = Bench()
    bench.poll((5.0, 5.0, 5.0), 2)
    (request,) = bench.codec.encode_stop()
    released = bytearray(request)
    released[4], released[6], released[16] = 1, 10, 10  # motor 0 released; 0 and 1 commanded to turn
    bench.device.to_device.put(bench.plant.now_ns, bytes(released))
    bench.receive(bench.plant.now_ns + 20_000_000)
    assert bench.plant.speeds == pytest.approx((10 * STEP_RAD_S, 0.0, 0.0))


@pytest.mark.parametrize(("board", "silence_s"), [("EA05", 1.04), ("EA09", 0.2)])
def test_motors_stop_when_the_host_falls_silent(board: Board, silence_s: float) -> None:
    bench = Bench(board)
    bench.send((3.0, 3.0, 3.0), START_NS)
    stop_ns = START_NS + REQUEST_NS + nanoseconds(silence_s)
    bench.world.advance(stop_ns - 1)
    assert bench.plant.speeds[0] > 2.8
    bench.world.advance(stop_ns)
    assert bench.plant.speeds == (0.0, 0.0, 0.0)
    assert bench.device.next_event_ns == NEVER_NS
    bench.send((3.0, 3.0, 3.0), stop_ns)
    bench.world.advance(stop_ns + REQUEST_NS)
    assert bench.plant.speeds[0] > 2.8


def test_motors_go_on_while_the_host_speaks() -> None:
    bench = Bench("EA09")
    bench.poll((3.0, 3.0, 3.0), 20, period_ns=190_000_000)
    assert all(speeds[0] > 2.8 for _, speeds in bench.plant.told)


@pytest.mark.parametrize(("board", "cycles_old"), [("EA05", 1), ("EA09", 0)])
def test_reply_tells_positions_and_their_time(board: Board, cycles_old: int) -> None:
    bench = Bench(board)
    replies = bench.poll((4 * STEP_RAD_S, 0.0, -4 * STEP_RAD_S), 50)
    moved_s = (49 - cycles_old) * 0.020  # from the first request to the measurement in the last reply
    ticks = 4 * 900 * moved_s
    assert replies[-1].ticks[0] == pytest.approx(ticks, abs=1)
    assert replies[-1].ticks[1] == 0
    assert replies[-1].ticks[2] == pytest.approx(-ticks, abs=1)
    assert replies[-1].time_ms == (REQUEST_NS + round(moved_s * 1e9)) // 1_000_000


def test_forward_turning_counts_down_on_the_wire() -> None:
    bench = Bench("EA09")
    bench.poll((5.0, 0.0, 0.0), 10)
    bench.send((5.0, 0.0, 0.0), bench.plant.now_ns)
    (reply,) = bench.receive(bench.plant.now_ns + 20_000_000)
    (raw,) = struct.unpack_from("<i", reply.payload, 26)
    assert raw < -1000
    assert reply.payload[24] & 1


def test_speed_field_is_coarse_but_right_on_average() -> None:
    bench = Bench("EA09")
    exact = 4.3 * STEP_RAD_S
    bench.plant.dragged_rad_s = (exact, 0.0, -exact)
    steps = [reply.speed_steps for reply in bench.poll((0.0, 0.0, 0.0), 2000)]
    forward, still, backward = np.array(steps).T
    assert set(forward) == {4, 5}
    assert set(still) == {0}
    assert set(backward) == {-4, -5}
    assert forward.mean() == pytest.approx(4.3, abs=0.05)
    assert backward.mean() == pytest.approx(-4.3, abs=0.05)


def wheel_currents(bench: Bench, cycles: int) -> list[float]:
    currents: list[float] = []
    for cycle in range(cycles):
        now_ns = bench.plant.now_ns
        bench.send((0.0, 0.0, 0.0), now_ns)
        for item in bench.receive(now_ns + 20_000_000):
            samples = bench.codec.decode(item)
            if cycle:  # an EA05's first reply is from before the currents were set
                currents += [
                    sample.current_a
                    for sample in samples
                    if isinstance(sample, WheelSample) and sample.current_a is not None
                ]
    return currents


def test_ea05_currents_are_magnitudes_in_steps_of_four_counts() -> None:
    bench = Bench("EA05", ripple_a=0.16)
    bench.plant.currents = (0.8, -0.8, 0.0)
    currents = np.array(wheel_currents(bench, 400)).reshape(-1, 3)
    counts = currents * 156
    assert np.abs(counts - np.round(counts)).max() < 1e-9
    assert set(np.round(counts.ravel()) % 4) == {0}
    assert currents.min() >= 0
    assert currents[:, 0].mean() == pytest.approx(0.8 - 2 / 156, abs=0.03)
    assert currents[:, 1].mean() == pytest.approx(0.8 - 2 / 156, abs=0.03)
    assert currents[:, 0].std() == pytest.approx(0.16 * math.sqrt(0.8), rel=0.15)
    assert currents[:, 2].max() == 0


def test_ea09_currents_are_fine_and_saturate() -> None:
    bench = Bench("EA09")
    bench.plant.currents = (0.5, -3.0, 0.001)
    last = wheel_currents(bench, 3)[-3:]
    assert last[0] == pytest.approx(0.5, abs=0.001)
    assert last[1] == pytest.approx(1023 * 0.15 / 156)
    assert last[2] == pytest.approx(0.15 / 156)


@pytest.mark.parametrize("board", ["EA05", "EA09"])
def test_battery_system_current_and_bumper_reach_the_host(board: Board) -> None:
    bench = Bench(board)
    bench.plant.battery_v, bench.plant.bumper_pressed = 21.4, True
    bench.plant.currents = (1.0, -1.0, 0.5)
    for _ in range(2):
        bench.send((0.0, 0.0, 0.0), bench.plant.now_ns)
        (item,) = bench.receive(bench.plant.now_ns + 20_000_000)
        decoded = bench.codec.decode(item)
    (power,) = (sample for sample in decoded if isinstance(sample, PowerSample))
    (bumper,) = (sample for sample in decoded if isinstance(sample, BumperSample))
    assert power.voltage_v == pytest.approx(21.4, abs=0.12)
    assert power.current_a == pytest.approx(2.5, abs=0.07)
    assert bumper.pressed


def test_burst_of_requests_is_answered_one_by_one() -> None:
    bench = Bench()
    for _ in range(4):
        bench.send((1.0, 1.0, 1.0), START_NS)
    replies = bench.receive(START_NS + 100_000_000)
    gaps_ns = np.diff([item.t_ns for item in replies])
    assert len(replies) == 4
    assert (gaps_ns >= REPLY_NS).all()


def test_board_works_on_one_request_at_a_time() -> None:
    bench = Bench()
    (request,), _ = bench.codec.encode_speeds((1.0, 1.0, 1.0))
    bench.device.to_device.put(START_NS, request + request)
    heard_ns = START_NS + 2 * REQUEST_NS
    bench.world.advance(heard_ns + 6_000_000)
    assert heard_ns + 8_000_000 <= bench.device.next_event_ns <= heard_ns + 12_000_000


def test_pulled_plug_loses_what_is_under_way() -> None:
    bench = Bench()
    bench.send((1.0, 1.0, 1.0), START_NS)
    bench.world.advance(START_NS + REQUEST_NS)
    bench.device.unplugged = True
    assert bench.receive(START_NS + 100_000_000) == []


def test_same_seed_gives_the_same_bytes() -> None:
    runs = []
    for seed in (4, 4, 5):
        bench = Bench(ripple_a=0.16, seed=seed)
        bench.plant.currents = (0.4, 0.5, 0.6)
        runs.append(bench.poll((1.0, 2.0, 3.0), 30))
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]


def test_driver_in_lockstep_hears_a_sample_per_cycle_without_rejections() -> None:
    clock = VirtualClock(START_NS)
    bench = Bench(ripple_a=0.16)
    link = LoopbackLink(bench.world, bench.device, clock)
    with bench.settings.make_driver("board", link, clock) as drive:
        for _ in range(100):
            expires_ns = clock.now_ns() + 100_000_000
            drive.command(WheelCommand(t_ns=clock.now_ns(), expires_ns=expires_ns, speed_rad_s=(2.0, 0, -2)))
            clock.sleep_until(clock.now_ns() + 20_000_000)
            assert sum(isinstance(sample, WheelSample) for sample in drive.poll()) == 3
        health = drive.health()
    assert health.rejected == {}
    assert health.accepted == 500
    assert health.rate_hz == pytest.approx(50, rel=0.02)


def test_rover_must_have_three_wheels() -> None:
    plant = IdealPlant()
    plant.wheel_count = 4
    settings = RobotinoBoardSettings(type="robotino_board", port="p")
    emulator = RobotinoBoardEmulatorSettings(type="robotino_board")
    with pytest.raises(ConfigError, match="turns 3 wheels but the simulated rover has 4"):
        make_emulator("board", settings, emulator, plant, np.random.default_rng(0), START_NS)
