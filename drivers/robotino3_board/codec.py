"""Messages of the Robotino 3/4 board: tag, length and value, several to a frame, little endian.

The board answers each request with what it asks for, and adds the power source and the power button. It has
no time and no counter: a reply that is lost or old does not show. It stops the motors when no byte has
arrived for 0.3 s. The speed field counts encoder ticks of one millisecond, in steps of 30 rpm at the motor;
positions are finer.

Source: openrobotino `common/lib/rec/robotino3/iocom/tag/*.h`,
`firmware/Robotino3/trunk/firmware/src/{producer,parser,motor,adc,fpga,main}.c`; fawkes
`direct_com_{message,thread}.cpp`.
"""

import math
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence

from drivers.driver import Rejection
from drivers.link import Received
from drivers.position_counter import PositionCounter, restart_sample
from drivers.robotino3_board.frames import FrameScanner, build_frame
from drivers.robotino3_board.parameters import Robotino3BoardParameters
from drivers.samples import BumperSample, PowerSample, Sample, WheelSample

SET_MOTOR_SPEED, SET_EMERGENCY_BUMPER = 9, 57
GET_BUMPER, GET_ALL_MOTOR_READINGS = 36, 52
BUMPER, ALL_MOTOR_READINGS, POWER_SOURCE = 37, 53, 65
WARNING, ERROR = 251, 252
LARGEST_CURRENT_A = 20.0
LARGEST_VOLTAGE_V = 60.0

_SPEED = struct.Struct("<Bh")
_READINGS = struct.Struct("<4h4i4f")
_POWER = struct.Struct("<2f4BI")
_SIZES = {ALL_MOTOR_READINGS: _READINGS.size, BUMPER: 1, POWER_SOURCE: _POWER.size}
_PLAUSIBLE_OVERSPEED = 1.5

_LAYOUT = Rejection("layout")
_RANGE = Rejection("range")
_IMPLAUSIBLE_JUMP = Rejection("implausible_jump")


def build_message(tag: int, value: bytes = b"") -> bytes:
    """Return tag, length and value."""
    return bytes((tag, len(value))) + value


class Robotino3BoardCodec:
    """Turns replies into wheel, power and bumper samples, and wheel speeds into requests.

    Rejections: "framing" and "checksum"; "layout", a message that does not fit into its frame or has another
    size than its tag; "range", a current or voltage that the board cannot measure; "implausible_jump", see
    `PositionCounter`; "board_warning" and "board_error", texts of the board.

    Args:
        name: Name of the device in the configuration.
        settings: Gear, encoder and limits.
    """

    wheel_count = 3

    def __init__(self, name: str, settings: Robotino3BoardParameters) -> None:
        self._name = name
        self._rpm_limit = settings.rpm_limit
        self._rpm_per_rad_s = settings.gear_ratio * 60.0 / math.tau
        self._rad_per_tick = math.tau / (settings.gear_ratio * settings.ticks_per_motor_turn)
        ticks_per_s = _PLAUSIBLE_OVERSPEED * settings.rpm_limit / 60.0 * settings.ticks_per_motor_turn
        self._counters = [PositionCounter(2**32, ticks_per_s) for _ in range(self.wheel_count)]
        self._emergency_bumper = settings.emergency_bumper
        self._scanner = FrameScanner()
        self._readers: Mapping[int, Callable[[int, bytes], Sequence[Sample | Rejection]]] = {
            ALL_MOTOR_READINGS: self._read_motors,
            BUMPER: self._read_bumper,
            POWER_SOURCE: self._read_power,
            WARNING: _read_warning,
            ERROR: _read_error,
        }

    def decode(self, item: Received[bytes]) -> Sequence[Sample | Rejection]:
        """Return the samples and rejections of the frames that `item` completes."""
        results: list[Sample | Rejection] = []
        for scanned in self._scanner.feed(item.payload):
            if isinstance(scanned, Rejection):
                results.append(scanned)
                continue
            for message in _split(scanned):
                if isinstance(message, Rejection):
                    results.append(message)
                    continue
                tag, value = message
                reader = self._readers.get(tag)
                results += () if reader is None else reader(item.t_ns, value)
        return results

    def reset(self) -> None:
        """Forget a half-received frame and the positions; they start from the board's own counts again."""
        self._scanner.reset()
        for counter in self._counters:
            counter.reset()

    def encode_start(self) -> Sequence[bytes]:
        """Return the choice whether the board itself stops at the bumper."""
        return [build_frame(build_message(SET_EMERGENCY_BUMPER, bytes((self._emergency_bumper,))))]

    def encode_speeds(self, speed_rad_s: Sequence[float]) -> tuple[Sequence[bytes], tuple[float, ...]]:
        """Return one request with the setpoints and a question for all readings, and the speeds it means."""
        body = b""
        meant = []
        for motor, speed in enumerate(speed_rad_s):
            rpm = round(min(max(speed * self._rpm_per_rad_s, -self._rpm_limit), self._rpm_limit))
            body += build_message(SET_MOTOR_SPEED, _SPEED.pack(motor, rpm))
            meant.append(rpm / self._rpm_per_rad_s)
        body += build_message(GET_ALL_MOTOR_READINGS) + build_message(GET_BUMPER)
        return [build_frame(body)], tuple(meant)

    def encode_stop(self) -> Sequence[bytes]:
        """Return a request for standstill; the board cuts the motors' supply after a second of it."""
        return self.encode_speeds((0.0,) * self.wheel_count)[0]

    def encode_emergency_stop(self) -> Sequence[bytes]:
        """Return the request for standstill, three times: the first may end a half-sent one."""
        return 3 * [*self.encode_stop()]

    def _read_motors(self, t_ns: int, value: bytes) -> Sequence[Sample | Rejection]:
        fields = _READINGS.unpack(value)
        speeds, ticks, currents_a = fields[:3], fields[4:7], fields[8:11]
        if not all(abs(current_a) <= LARGEST_CURRENT_A for current_a in currents_a):  # rejects NaN too
            return (_RANGE,)
        results: list[Sample | Rejection] = []
        for wheel, counter in enumerate(self._counters):
            position = counter.count(t_ns, ticks[wheel])
            if position is None:
                results.append(_IMPLAUSIBLE_JUMP)
                continue
            if counter.has_restarted:
                results.append(restart_sample(self._name, t_ns, f"wheel {wheel}"))
            results.append(
                WheelSample(
                    device=self._name,
                    t_ns=t_ns,
                    wheel=wheel,
                    position_rad=position * self._rad_per_tick,
                    speed_rad_s=speeds[wheel] / self._rpm_per_rad_s,
                    current_a=currents_a[wheel],
                )
            )
        return results

    def _read_bumper(self, t_ns: int, value: bytes) -> Sequence[Sample | Rejection]:
        return (BumperSample(device=self._name, t_ns=t_ns, pressed=value[0] != 0),)

    def _read_power(self, t_ns: int, value: bytes) -> Sequence[Sample | Rejection]:
        voltage_v, current_a, *_ = _POWER.unpack(value)
        if not (0.0 <= voltage_v <= LARGEST_VOLTAGE_V and abs(current_a) <= 2 * LARGEST_CURRENT_A):
            return (_RANGE,)
        return (PowerSample(device=self._name, t_ns=t_ns, voltage_v=voltage_v, current_a=current_a),)


def _read_warning(t_ns: int, value: bytes) -> Sequence[Sample | Rejection]:
    return (Rejection("board_warning"),)


def _read_error(t_ns: int, value: bytes) -> Sequence[Sample | Rejection]:
    return (Rejection("board_error"),)


def _split(body: bytes) -> Iterator[tuple[int, bytes] | Rejection]:
    """Yield tag and value of each message; the rest of a body with a wrong length is refused."""
    position = 0
    while position < len(body):
        tag = body[position]
        start = position + 2
        end = start + body[position + 1] if start <= len(body) else start
        if end > len(body) or end - start != _SIZES.get(tag, end - start):
            yield _LAYOUT
            return
        yield tag, body[start:end]
        position = end
