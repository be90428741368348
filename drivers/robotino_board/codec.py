"""Serial protocol of the Robotino 1/2/XT boards EA05 and EA09, both directions.

The host sends requests of 47 bytes, the board answers each with 101; both begin with "REC" and end with
"rec". There is no checksum. A reply is checked by three things: both markers are in their places, the board
itself marks motors it could not read, and no wheel has turned further than a motor can since the reply before
(`RobotinoBoardCodec`). Every bit pattern of currents, voltages and speeds is in their range: a flipped bit in
these, or the loss of exactly 101 bytes across two replies, is not detectable.

An EA05 answers with the measurements of the request before; the time count is theirs.

Source: openrobotino `common/lib/rec/iocontrol/remotestate/{SetState,SensorState}.h`, `qdsa_protocol.h`,
`firmware/EA05/trunk/qDSA`, `firmware/EA09/trunk/src/{robotinoserial,main}.c`, `daemons/apps/controld2`.
"""

import struct
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.driver import Rejection
from drivers.link import Received
from drivers.position_counter import restart_sample
from drivers.robotino_board.parameters import Board, RobotinoBoardParameters
from drivers.robotino_board.scales import MAX_SPEED_STEPS, STEP_TICKS_PER_S, scales
from drivers.samples import BumperSample, PowerSample, Sample, WheelSample

Counts: TypeAlias = tuple[int, int, int]
"""One whole number per wheel."""

HEAD = b"REC"
TAIL = b"rec"
REQUEST_SIZE = 47
REPLY_SIZE = 101

_REQUEST = struct.Struct("<3sB" + 4 * "BBBiBBB" + "3s")
_MASTER = struct.Struct("<3sBxB5xB2x")
_MOTOR = struct.Struct("<B7xBxBBiBI")
_NO_AUXILIARY = bytes(_MOTOR.size)

_GAINS_ARE_MEANT = 0x08
_BRAKE_OFF = 0x01
_SET_FORWARD = 0x02
_AUXILIARY_OUTPUT = (_BRAKE_OFF, _SET_FORWARD, 0, 0, 0, 0, 0)

_TURNS_FORWARD = 0x01
_MOTOR_FAULT = 0x0C
_VERSION_OF_EA05 = 0x80
_VERSION_OF_EA09 = 0x40
_NEWER_THAN_EA05 = 0x70
_BUMPER = 0x10

_FRAMING = Rejection("framing")
_MOTOR_FAULT_SEEN = Rejection("motor_fault")
_IMPLAUSIBLE_JUMP = Rejection("implausible_jump")

_NANOSECONDS_PER_COUNT = 1_000_000
_LONGEST_BUNCHING_NS = 100_000_000
_WORD = 0xFFFF_FFFF
_HALF_WORD = 0x8000_0000


class BoardRequest(NamedTuple):
    """A request of the host.

    Attributes:
        speed_steps: Setpoint of each motor, -255 to 255 speed steps, forward positive.
        brakes_off: Whether each motor may turn; with the brake on its setpoint counts as 0.
        gains: kp, ki, kd, 0 to 255, the same for the three motors.
    """

    speed_steps: Counts
    brakes_off: tuple[bool, bool, bool]
    gains: Counts


class BoardReply(NamedTuple):
    """A reply of the board, in counts.

    Attributes:
        ticks: Encoder position of each motor, 32 bits signed, forward positive.
        speed_steps: Speed of each motor, -255 to 255 speed steps, forward positive.
        current_raw: Magnitude of each motor's current, 0 to 1023.
        battery_raw: Battery voltage, 0 to 1020 in steps of 4: the boards disagree about the low bits.
        system_current_raw: Current of the whole rover, 0 to 1023.
        bumper_pressed: State of the bumper.
        time_ms: The board's running time, 32 bits unsigned.
        board: Which board answers.
        motor_fault: The board could not read a motor; that motor's numbers are meaningless.
    """

    ticks: Counts
    speed_steps: Counts
    current_raw: Counts
    battery_raw: int
    system_current_raw: int
    bumper_pressed: bool
    time_ms: int
    board: Board
    motor_fault: bool = False


def build_request(request: BoardRequest) -> bytes:
    """Return the 47 bytes of a request."""
    gains = request.gains
    motors: list[int] = []
    for steps, brake_off in zip(request.speed_steps, request.brakes_off, strict=True):
        direction = _SET_FORWARD if steps >= 0 else 0
        motors += (_BRAKE_OFF if brake_off else 0, direction, abs(steps), 0, *gains)
    return _REQUEST.pack(HEAD, _GAINS_ARE_MEANT, *motors, *_AUXILIARY_OUTPUT, TAIL)


def parse_request(frame: bytes) -> BoardRequest:
    """Return the request in 47 bytes; the gains are those of the first motor. The markers are not checked."""
    fields = _REQUEST.unpack(frame)
    flag0, direction0, magnitude0 = fields[2:5]
    flag1, direction1, magnitude1 = fields[9:12]
    flag2, direction2, magnitude2 = fields[16:19]
    return BoardRequest(
        (
            magnitude0 if direction0 & _SET_FORWARD else -magnitude0,
            magnitude1 if direction1 & _SET_FORWARD else -magnitude1,
            magnitude2 if direction2 & _SET_FORWARD else -magnitude2,
        ),
        (bool(flag0 & _BRAKE_OFF), bool(flag1 & _BRAKE_OFF), bool(flag2 & _BRAKE_OFF)),
        fields[6:9],
    )


def build_reply(reply: BoardReply) -> bytes:
    """Return the 101 bytes of a reply whose counts are in their ranges; the ticks may wrap."""
    states = [
        (_TURNS_FORWARD if steps >= 0 else 0) | (_MOTOR_FAULT if reply.motor_fault else 0)
        for steps in reply.speed_steps
    ]
    states[0] |= _VERSION_OF_EA05 if reply.board == "EA05" else _VERSION_OF_EA09
    inputs = (_BUMPER if reply.bumper_pressed else 0, 0, 0)
    times_ms = (reply.time_ms & _WORD, 0, 0)
    system = reply.system_current_raw
    parts = [_MASTER.pack(HEAD, system >> 2, reply.battery_raw >> 2, system & 3)]
    for wheel, current in enumerate(reply.current_raw):
        speed, position = abs(reply.speed_steps[wheel]), _wrapped(-reply.ticks[wheel])
        parts.append(
            _MOTOR.pack(
                current >> 2, current & 3, states[wheel], speed, position, inputs[wheel], times_ms[wheel]
            )
        )
    return b"".join((*parts, _NO_AUXILIARY, TAIL))


def parse_reply(frame: bytes) -> BoardReply:
    """Return the reply in 101 bytes. The markers are not checked."""
    _, system, battery, system_low = _MASTER.unpack_from(frame)
    high0, low0, state0, speed0, position0, inputs, time_ms = _MOTOR.unpack_from(frame, 14)
    high1, low1, state1, speed1, position1, _, _ = _MOTOR.unpack_from(frame, 35)
    high2, low2, state2, speed2, position2, _, _ = _MOTOR.unpack_from(frame, 56)
    return BoardReply(
        ticks=(_wrapped(-position0), _wrapped(-position1), _wrapped(-position2)),
        speed_steps=(
            speed0 if state0 & _TURNS_FORWARD else -speed0,
            speed1 if state1 & _TURNS_FORWARD else -speed1,
            speed2 if state2 & _TURNS_FORWARD else -speed2,
        ),
        current_raw=(high0 << 2 | low0 & 3, high1 << 2 | low1 & 3, high2 << 2 | low2 & 3),
        battery_raw=battery << 2,
        system_current_raw=system << 2 | system_low & 3,
        bumper_pressed=bool(inputs & _BUMPER),
        time_ms=time_ms,
        board="EA09" if state0 & _NEWER_THAN_EA05 else "EA05",
        motor_fault=bool((state0 | state1 | state2) & _MOTOR_FAULT),
    )


def _wrapped(count: int) -> int:
    return (count + _HALF_WORD & _WORD) - _HALF_WORD


class FrameScanner:
    """Cuts frames of one size out of a byte stream by their markers; keeps less than one frame.

    Args:
        frame_size: `REQUEST_SIZE` or `REPLY_SIZE`.
    """

    def __init__(self, frame_size: int) -> None:
        self._frame_size = frame_size
        self._rest = b""

    def feed(self, data: bytes) -> list[bytes | Rejection]:
        """Return the frames that `data` completes, and one "framing" for each run of discarded bytes."""
        buffer = self._rest + data
        frames: list[bytes | Rejection] = []
        used = 0
        head = _find_head(buffer, 0)
        while (end := head + self._frame_size) <= len(buffer):
            if buffer.startswith(TAIL, end - len(TAIL)):
                if head > used:
                    frames.append(_FRAMING)
                frames.append(buffer[head:end])
                used = end
                head = _find_head(buffer, end)
            else:
                head = _find_head(buffer, head + 1)
        if head > used:
            frames.append(_FRAMING)
        self._rest = buffer[head:]
        return frames

    def reset(self) -> None:
        """Forget a half-received frame."""
        self._rest = b""


def _find_head(buffer: bytes, start: int) -> int:
    head = buffer.find(HEAD, start)
    if head >= 0 or start == len(buffer):
        return max(head, start)
    begun = next((size for size in (2, 1) if buffer.endswith(HEAD[:size], start)), 0)
    return len(buffer) - begun


class _Counters(NamedTuple):
    """Counters that continue from reply to reply."""

    t_ns: int
    time_ms: int
    ticks: Counts


def _can_follow(before: _Counters, after: _Counters) -> bool:
    # The time may jump forwards: an EA05's first reply is as old as the last request of any program.
    if (after.time_ms - before.time_ms) & _WORD >= _HALF_WORD:
        return False
    elapsed_ns = max(after.t_ns - before.t_ns, _LONGEST_BUNCHING_NS)
    limit = MAX_SPEED_STEPS * STEP_TICKS_PER_S * elapsed_ns / NANOSECONDS_PER_SECOND
    new0, new1, new2 = after.ticks
    old0, old1, old2 = before.ticks
    turned = max(abs(_wrapped(new0 - old0)), abs(_wrapped(new1 - old1)), abs(_wrapped(new2 - old2)))
    return turned <= limit


class RobotinoBoardCodec:
    """Turns replies into wheel, power and bumper samples, and wheel speeds into requests.

    Rejections: "framing" (markers not in their places), "board_is_EA05" or "board_is_EA09" (not the board
    in the settings: its currents would be wrong by a factor of 6.7), "motor_fault" (the board could not
    read a motor) and "implausible_jump": the board's time runs backwards, or a wheel turned further than
    6885 rpm at the motor allow. Replies may come in bunches, so at least 0.1 s is assumed between them. When
    the next reply continues from the suspect one, the board has restarted its counters: positions continue
    from their last value, and a `LinkSample` reports that turns in between may be missing.

    Args:
        name: Name of the device in the configuration.
        settings: Board, gear, encoder and gains.
    """

    wheel_count = 3

    def __init__(self, name: str, settings: RobotinoBoardParameters) -> None:
        self._name = name
        self._board: Board = settings.board
        self._scales = scales(settings)
        self._gains: Counts = (settings.kp, settings.ki, settings.kd)
        self._scanner = FrameScanner(REPLY_SIZE)
        self._accepted: _Counters | None = None
        self._suspect: _Counters | None = None
        self._ticks: Counts = (0, 0, 0)
        self._has_restarted = False

    def decode(self, item: Received[bytes]) -> list[Sample | Rejection]:
        """Return three `WheelSample`, a `PowerSample` and a `BumperSample` for each reply in the stream.

        There is no `PowerSample` when the battery reads 0 counts: the board itself runs from it.
        """
        decoded: list[Sample | Rejection] = []
        for scanned in self._scanner.feed(item.payload):
            if isinstance(scanned, Rejection):
                decoded.append(scanned)
            else:
                decoded += self._read(item.t_ns, parse_reply(scanned))
        return decoded

    def reset(self) -> None:
        """Forget the half-received reply and the positions; they start from the board's own counts again."""
        self._scanner.reset()
        self._accepted = None
        self._suspect = None

    def encode_start(self) -> list[bytes]:
        """Return nothing: every request releases the brakes, and positions are not reset."""
        return []

    def encode_speeds(self, speed_rad_s: Sequence[float]) -> tuple[list[bytes], tuple[float, ...]]:
        """Return one request, and the speeds it means: whole steps of 27 rpm towards zero, 255 at most."""
        step_rad_s = self._scales.speed_rad_s
        s0, s1, s2 = [_steps(speed / step_rad_s) for speed in speed_rad_s]
        request = build_request(BoardRequest((s0, s1, s2), (True, True, True), self._gains))
        return [request], (s0 * step_rad_s, s1 * step_rad_s, s2 * step_rad_s)

    def encode_stop(self) -> list[bytes]:
        """Return one request with the brakes on."""
        return [build_request(BoardRequest((0, 0, 0), (False, False, False), self._gains))]

    def encode_emergency_stop(self) -> list[bytes]:
        """Return the request with the brakes on, three times: the first may end a half-sent one."""
        return 3 * self.encode_stop()

    def _read(self, t_ns: int, reply: BoardReply) -> list[Sample | Rejection]:
        if reply.board != self._board:
            return [Rejection(f"board_is_{reply.board}")]
        if reply.motor_fault:
            return [_MOTOR_FAULT_SEEN]
        if not self._accept(_Counters(t_ns, reply.time_ms, reply.ticks)):
            return [_IMPLAUSIBLE_JUMP]
        samples = self._samples(t_ns, reply)
        return [restart_sample(self._name, t_ns, "board"), *samples] if self._has_restarted else samples

    def _accept(self, counters: _Counters) -> bool:
        base = self._accepted
        self._has_restarted = base is not None and not _can_follow(base, counters)
        if self._has_restarted:
            base, self._suspect = self._suspect, counters
            if base is None or not _can_follow(base, counters):
                return False
        if base is None:
            self._ticks = counters.ticks
        else:
            (t0, t1, t2), (new0, new1, new2), (old0, old1, old2) = self._ticks, counters.ticks, base.ticks
            self._ticks = (t0 + _wrapped(new0 - old0), t1 + _wrapped(new1 - old1), t2 + _wrapped(new2 - old2))
        self._accepted, self._suspect = counters, None
        return True

    def _samples(self, t_ns: int, reply: BoardReply) -> list[Sample | Rejection]:
        name, scale = self._name, self._scales
        t_device_ns = reply.time_ms * _NANOSECONDS_PER_COUNT
        samples: list[Sample | Rejection] = [
            WheelSample(
                device=name,
                t_ns=t_ns,
                t_device_ns=t_device_ns,
                wheel=wheel,
                position_rad=self._ticks[wheel] * scale.position_rad,
                speed_rad_s=reply.speed_steps[wheel] * scale.speed_rad_s,
                current_a=reply.current_raw[wheel] * scale.current_a,
                current_is_signed=False,
            )
            for wheel in range(3)
        ]
        if reply.battery_raw:
            power = PowerSample(
                device=name,
                t_ns=t_ns,
                t_device_ns=t_device_ns,
                voltage_v=reply.battery_raw * scale.battery_v,
                current_a=reply.system_current_raw * scale.system_current_a,
            )
            samples.append(power)
        samples.append(
            BumperSample(device=name, t_ns=t_ns, t_device_ns=t_device_ns, pressed=reply.bumper_pressed)
        )
        return samples


def _steps(steps: float) -> int:
    # The margin keeps a speed that is a whole number of steps whole after its conversion to rad/s.
    size = int(min(abs(steps) + 1e-9, MAX_SPEED_STEPS))
    return size if steps >= 0 else -size
