"""The driver contract, on a link and a codec small enough to see through."""

import math
import threading
from collections.abc import Sequence

import pytest

from drivers.clock import VirtualClock, nanoseconds
from drivers.driver import MOST_BYTES_PER_POLL, DeviceState, Driver, Rejection, WheelDrive
from drivers.errors import LinkTimeoutError, NotConnectedError, StaleSampleError
from drivers.link import LinkChange, LinkItem, NoTap, Received
from drivers.samples import BumperSample, FaultSample, LinkSample, PowerSample, Sample, WheelCommand


class ScriptedLink:
    """Delivers what the test put in; keeps what was sent."""

    dropped = 0

    def __init__(self) -> None:
        self.items: list[LinkItem[bytes]] = []
        self.sent: list[bytes] = []
        self.accepts = True
        self.opened = 0
        self.closed = 0
        self.refuses_to_open = False

    def open(self, timeout_s: float) -> None:
        if self.refuses_to_open:
            raise NotConnectedError("cannot open scripted port: no such device")
        self.opened += 1

    def close(self) -> None:
        self.closed += 1

    def receive(self) -> list[LinkItem[bytes]]:
        items, self.items = self.items, []
        return items

    def send(self, payload: bytes) -> bool:
        if self.accepts:
            self.sent.append(payload)
        return self.accepts


class LetterCodec:
    """`p` is a power sample, anything else is rejected; two wheels whose speeds are rounded to integers."""

    wheel_count = 2

    def __init__(self) -> None:
        self.resets = 0

    def decode(self, item: Received[bytes]) -> list[Sample | Rejection]:
        return [
            PowerSample(device="toy", t_ns=item.t_ns, voltage_v=24.0)
            if letter == ord("p")
            else Rejection("letter")
            for letter in item.payload
        ]

    def reset(self) -> None:
        self.resets += 1

    def encode_start(self) -> list[bytes]:
        return [b"start"]

    def encode_speeds(self, speed_rad_s: Sequence[float]) -> tuple[list[bytes], tuple[float, ...]]:
        rounded = tuple(float(round(speed)) for speed in speed_rad_s)
        return [repr(rounded).encode()], rounded

    def encode_stop(self) -> list[bytes]:
        return [b"off"]

    def encode_emergency_stop(self) -> list[bytes]:
        return [b"stop"]


class RecordingTap(NoTap):
    def __init__(self) -> None:
        self.seen: list[tuple[str, object]] = []

    def received(self, device: str, item: object) -> None:
        self.seen.append((device, item))

    def sent(self, device: str, t_ns: int, payload: bytes, delivered: bool) -> None:
        self.seen.append((device, (t_ns, payload, delivered)))


class Toy:
    """A wheel drive with everything around it in reach."""

    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.link = ScriptedLink()
        self.codec = LetterCodec()
        self.tap = RecordingTap()
        self.drive = WheelDrive("toy", self.link, self.codec, self.clock, max_age_s=0.1, tap=self.tap)

    def arrive(self, payload: bytes) -> None:
        self.link.items.append(Received(self.clock.now_ns(), payload))

    def forward(self, duration_s: float) -> None:
        self.clock.sleep_until(self.clock.now_ns() + nanoseconds(duration_s))

    def command(self, *speeds: float, valid_s: float = 0.15) -> WheelCommand:
        now_ns = self.clock.now_ns()
        return WheelCommand(t_ns=now_ns, expires_ns=now_ns + nanoseconds(valid_s), speed_rad_s=speeds)


@pytest.fixture
def toy() -> Toy:
    return Toy()


def test_constructor_touches_nothing(toy: Toy) -> None:
    assert toy.link.opened == 0
    assert toy.drive.health().state is DeviceState.CLOSED


def test_connect_and_close_may_be_repeated(toy: Toy) -> None:
    toy.drive.connect()
    toy.drive.connect()
    toy.drive.close()
    toy.drive.close()
    assert (toy.link.opened, toy.link.closed) == (1, 1)


def test_failed_connect_leaves_the_driver_closed(toy: Toy) -> None:
    toy.link.refuses_to_open = True
    with pytest.raises(NotConnectedError, match="scripted port"):
        toy.drive.connect()
    assert toy.drive.health().state is DeviceState.CLOSED


@pytest.mark.parametrize("method", ["poll", "stop"])
def test_use_before_connect_names_device_and_method(toy: Toy, method: str) -> None:
    with pytest.raises(NotConnectedError, match=rf"'toy' is closed: call connect\(\) before {method}"):
        getattr(toy.drive, method)()


def test_states_follow_the_data(toy: Toy) -> None:
    toy.drive.connect()
    assert toy.drive.health().state is DeviceState.CONNECTED
    toy.arrive(b"p")
    toy.drive.poll()
    assert toy.drive.health().state is DeviceState.STREAMING
    toy.forward(0.11)
    assert toy.drive.health().state is DeviceState.DEGRADED


def test_break_and_recovery_are_samples_and_reset_the_codec(toy: Toy) -> None:
    toy.drive.connect()
    toy.arrive(b"p")
    toy.link.items.append(LinkChange(toy.clock.now_ns(), up=False, reason="unplugged"))
    kinds = [type(sample) for sample in toy.drive.poll()]
    assert kinds == [PowerSample, LinkSample]
    assert toy.drive.health().state is DeviceState.DEGRADED
    assert toy.drive.health().breaks == 1
    toy.link.items.append(LinkChange(toy.clock.now_ns(), up=True, reason="reopened"))
    toy.drive.poll()
    assert toy.codec.resets == 3  # at connect, at the break, at the recovery


def test_what_was_heard_before_a_break_does_not_pass_for_fresh_after_it(toy: Toy) -> None:
    toy.drive.connect()
    toy.arrive(b"p")
    toy.link.items.append(LinkChange(toy.clock.now_ns(), up=False, reason="unplugged"))
    toy.link.items.append(LinkChange(toy.clock.now_ns(), up=True, reason="reopened"))
    toy.drive.poll()
    assert toy.drive.health().state is DeviceState.CONNECTED
    with pytest.raises(StaleSampleError, match="no PowerSample yet"):
        toy.drive.latest(PowerSample, max_age_s=1.0)
    toy.arrive(b"p")
    toy.drive.poll()
    assert toy.drive.health().state is DeviceState.STREAMING


def test_what_was_heard_before_close_does_not_pass_for_fresh_after_connect(toy: Toy) -> None:
    toy.drive.connect()
    toy.arrive(b"p")
    toy.drive.poll()
    toy.drive.close()
    toy.drive.connect()
    assert toy.drive.health().state is DeviceState.CONNECTED
    assert toy.drive.health().age_s is None
    with pytest.raises(StaleSampleError, match="no PowerSample yet"):
        toy.drive.latest(PowerSample, max_age_s=1.0)


def test_giving_up_is_a_state_of_its_own_and_no_second_break(toy: Toy) -> None:
    toy.drive.connect()
    toy.link.items.append(LinkChange(toy.clock.now_ns(), up=False, reason="unplugged"))
    toy.link.items.append(LinkChange(toy.clock.now_ns(), up=False, reason="gave up", gave_up=True))
    toy.drive.poll()
    assert toy.drive.health().state is DeviceState.FAILED
    assert toy.drive.health().breaks == 1


def test_rejections_are_counted_by_reason_and_are_no_samples(toy: Toy) -> None:
    toy.drive.connect()
    toy.arrive(b"xpx")
    assert len(toy.drive.poll()) == 1
    health = toy.drive.health()
    assert health.rejected == {"letter": 2}
    assert health.accepted == 1


def test_latest_refuses_a_stale_or_missing_sample(toy: Toy) -> None:
    toy.drive.connect()
    with pytest.raises(StaleSampleError, match="no PowerSample yet"):
        toy.drive.latest(PowerSample, max_age_s=1.0)
    toy.arrive(b"p")
    toy.drive.poll()
    assert toy.drive.latest(PowerSample, max_age_s=0.1).voltage_v == 24.0
    toy.forward(0.2)
    with pytest.raises(StaleSampleError, match=r"0\.200 s old, limit 0\.100 s"):
        toy.drive.latest(PowerSample, max_age_s=0.1)


def test_wait_next_ignores_what_was_there_before(toy: Toy) -> None:
    toy.drive.connect()
    toy.arrive(b"p")
    before_ns = toy.clock.now_ns()
    with pytest.raises(LinkTimeoutError, match=r"no PowerSample within 0\.050 s"):
        toy.drive.wait_next(PowerSample, timeout_s=0.05)
    assert toy.clock.now_ns() - before_ns >= nanoseconds(0.05)


def test_wait_next_of_another_kind_times_out(toy: Toy) -> None:
    toy.drive.connect()
    with pytest.raises(LinkTimeoutError):
        toy.drive.wait_next(BumperSample, timeout_s=0.01)


def test_rate_counts_the_fastest_kind(toy: Toy) -> None:
    toy.drive.connect()
    for _ in range(100):
        toy.forward(0.02)
        toy.arrive(b"p")
        toy.drive.poll()
    assert toy.drive.health().rate_hz == pytest.approx(50, abs=1)


def test_command_returns_what_was_really_sent(toy: Toy) -> None:
    toy.drive.connect()
    sent = toy.drive.command(toy.command(1.4, -2.6))
    assert sent.speed_rad_s == (1.0, -3.0)
    assert sent.delivered
    assert toy.link.sent == [b"start", b"(1.0, -3.0)"]


def test_start_is_sent_once_and_again_after_a_break(toy: Toy) -> None:
    toy.drive.connect()
    toy.drive.command(toy.command(1, 1))
    toy.drive.command(toy.command(1, 1))
    toy.link.items.append(LinkChange(toy.clock.now_ns(), up=False, reason="unplugged"))
    toy.drive.poll()
    toy.drive.command(toy.command(1, 1))
    assert toy.link.sent.count(b"start") == 2


def test_start_is_sent_again_after_close_and_connect(toy: Toy) -> None:
    toy.drive.connect()
    toy.drive.command(toy.command(1, 1))
    toy.drive.close()
    toy.drive.connect()
    toy.drive.command(toy.command(1, 1))
    assert toy.link.sent[-2:] == [b"start", b"(1.0, 1.0)"]


def test_close_stops_a_drive_that_was_commanded_and_no_other(toy: Toy) -> None:
    toy.drive.connect()
    toy.drive.close()
    assert toy.link.sent == []
    toy.drive.connect()
    toy.drive.command(toy.command(1, 1))
    toy.drive.close()
    assert toy.link.sent[2:] == [b"(0.0, 0.0)"] * 3 + [b"off"]
    assert toy.link.closed == 2


def test_undelivered_start_is_tried_again(toy: Toy) -> None:
    toy.drive.connect()
    toy.link.accepts = False
    assert not toy.drive.command(toy.command(1, 1)).delivered
    toy.link.accepts = True
    toy.drive.command(toy.command(1, 1))
    assert toy.link.sent[0] == b"start"
    assert toy.drive.health().send_failures == 2


def test_expired_command_sends_zero(toy: Toy) -> None:
    toy.drive.connect()
    command = toy.command(1, 1, valid_s=0.15)
    toy.forward(0.15)
    assert toy.drive.command(command).speed_rad_s == (0.0, 0.0)


@pytest.mark.parametrize("speeds", [(1.0,), (1.0, 2.0, 3.0), (math.nan, 1.0), (math.inf, 1.0), ()])
def test_malformed_command_sends_zero(toy: Toy, speeds: tuple[float, ...]) -> None:
    toy.drive.connect()
    assert toy.drive.command(toy.command(*speeds)).speed_rad_s == (0.0, 0.0)


def test_stop_sends_zero_three_times_then_off(toy: Toy) -> None:
    toy.drive.connect()
    toy.drive.stop()
    assert toy.link.sent == [b"(0.0, 0.0)"] * 3 + [b"off"]


def test_each_zero_of_a_stop_is_encoded_anew(toy: Toy) -> None:
    """A drive refuses a message whose counter stands still."""
    counts = iter(range(10))

    def encode(speed_rad_s: Sequence[float]) -> tuple[list[bytes], tuple[float, ...]]:
        return [b"%d" % next(counts)], tuple(speed_rad_s)

    toy.codec.encode_speeds = encode  # type: ignore[method-assign]
    toy.drive.connect()
    toy.drive.stop()
    assert toy.link.sent == [b"0", b"1", b"2", b"off"]


def test_stop_does_not_wait_for_the_tap(toy: Toy) -> None:
    sent_before_tap: list[int] = []
    toy.tap.sent = lambda *_: sent_before_tap.append(len(toy.link.sent))  # type: ignore[method-assign]
    toy.drive.connect()
    toy.drive.stop()
    assert sent_before_tap == [4] * 4


def test_stop_from_another_thread_waits_for_the_command_and_has_the_last_word(toy: Toy) -> None:
    is_sending, may_send = threading.Event(), threading.Event()
    send_now = toy.link.send

    def send_slowly(payload: bytes) -> bool:
        is_sending.set()
        may_send.wait(5.0)
        return send_now(payload)

    toy.drive.connect()
    toy.link.send = send_slowly  # type: ignore[method-assign]
    commanding = threading.Thread(target=toy.drive.command, args=(toy.command(1, 1),))
    commanding.start()
    assert is_sending.wait(5.0)
    toy.link.send = send_now  # type: ignore[method-assign]
    stopping = threading.Thread(target=toy.drive.stop)
    stopping.start()
    stopping.join(0.1)
    may_send.set()
    commanding.join(5.0)
    stopping.join(5.0)
    assert toy.link.sent == [b"start", b"(1.0, 1.0)", *[b"(0.0, 0.0)"] * 3, b"off"]
    toy.drive.command(toy.command(1, 1))
    assert toy.link.sent[-2] == b"start"


def test_tap_sees_raw_data_before_parsing_and_everything_sent(toy: Toy) -> None:
    toy.drive.connect()
    toy.arrive(b"?")
    toy.drive.poll()
    toy.drive.command(toy.command(1, 1))
    first_device, first_item = toy.tap.seen[0]
    assert first_device == "toy"
    assert isinstance(first_item, Received)
    assert first_item.payload == b"?"
    assert toy.tap.seen[-1][1] == (toy.clock.now_ns(), b"(1.0, 1.0)", True)


def test_plain_driver_is_a_context_manager() -> None:
    link = ScriptedLink()
    with Driver("toy", link, LetterCodec(), VirtualClock(), max_age_s=1.0) as driver:
        assert driver.health().state is DeviceState.CONNECTED
    assert link.closed == 1


def test_a_flood_costs_one_poll_and_the_rest_is_counted_as_lost(toy: Toy) -> None:
    toy.drive.connect()
    for _ in range(100):
        toy.arrive(b"p" * 4096)
    toy.link.items.append(LinkChange(toy.clock.now_ns(), up=True, reason="reopened"))
    toy.link.dropped = 7
    samples = toy.drive.poll()
    health = toy.drive.health()
    assert health.accepted == len(samples) - 1 == MOST_BYTES_PER_POLL
    assert health.lost == 100 - MOST_BYTES_PER_POLL // 4096 + 7
    assert isinstance(samples[-1], LinkSample)
    assert toy.drive.poll() == []


def test_what_a_poll_takes_is_the_newest(toy: Toy) -> None:
    toy.drive.connect()
    for _ in range(2):
        toy.arrive(b"p" * MOST_BYTES_PER_POLL)
        toy.forward(0.01)
    now_ns = toy.clock.now_ns()
    assert {now_ns - sample.t_ns for sample in toy.drive.poll()} == {nanoseconds(0.01)}


def faulty(toy: Toy, *, wheel: int | None = 1, code: int = 4) -> None:
    """Let the device report a fault, or that it has cleared."""
    fault = FaultSample(device="toy", t_ns=toy.clock.now_ns(), wheel=wheel, code=code, text="expired")
    toy.codec.decode = lambda item: [fault]  # type: ignore[method-assign]
    toy.arrive(b"f")
    toy.drive.poll()


def starts_after(toy: Toy, duration_s: float, speed: float = 0.0) -> int:
    """Return how often the drive is started while it is commanded at 50 Hz."""
    before = toy.link.sent.count(b"start")
    for _ in range(round(50.0 * duration_s)):
        toy.forward(0.02)
        toy.drive.command(toy.command(speed, speed))
    return toy.link.sent.count(b"start") - before


def test_a_drive_with_a_fault_is_started_again_after_a_second_and_at_most_three_times(toy: Toy) -> None:
    toy.drive.connect()
    toy.drive.command(toy.command(0, 0))
    faulty(toy)
    assert starts_after(toy, 0.9) == 0
    assert starts_after(toy, 0.2) == 1
    assert starts_after(toy, 30.0) == 2


def test_only_starts_that_went_out_are_counted(toy: Toy) -> None:
    toy.drive.connect()
    toy.drive.command(toy.command(0, 0))
    faulty(toy)
    send_now = toy.link.send
    toy.link.send = lambda payload: False  # type: ignore[method-assign]
    assert starts_after(toy, 10.0) == 0
    toy.link.send = send_now  # type: ignore[method-assign]
    assert starts_after(toy, 30.0) == 3


def test_a_fault_that_has_cleared_starts_nothing(toy: Toy) -> None:
    toy.drive.connect()
    toy.drive.command(toy.command(0, 0))
    faulty(toy)
    faulty(toy, code=0)
    assert starts_after(toy, 5.0) == 0


def test_nothing_is_started_again_while_the_rover_is_driven(toy: Toy) -> None:
    toy.drive.connect()
    toy.drive.command(toy.command(1, 1))
    faulty(toy)
    assert starts_after(toy, 5.0, speed=1.0) == 0


def test_a_fault_of_the_bus_starts_nothing(toy: Toy) -> None:
    toy.drive.connect()
    toy.drive.command(toy.command(0, 0))
    faulty(toy, wheel=None)
    assert starts_after(toy, 5.0) == 0
