"""CAN frames of VESC motor controllers: 29-bit identifiers `command << 8 | VESC ID`, big-endian numbers.

The controllers send status messages by themselves. Status 1 gives the speed in electrical turns per minute
(motor turns times pole pairs), status 5 the tachometer, which counts six steps per electrical turn in a
signed 32-bit register and starts from 0 when the controller does. They never send their fault code, nor
whether their timeout or kill switch keeps the motor off: both are asked for with `COMM_GET_VALUES_SELECTIVE`
in short-buffer commands, which do not feed the controller's timeout.

The motor current on the wire is negative when the motor brakes. In samples it is positive when it drives
forwards, so it takes the sign of the duty cycle of the same message.

There is no checksum beyond the bus' own, no counter and no time. Not detectable: a controller that repeats
old values, wrong pole pairs or gear, a restart soon after the last one (see `PositionCounter`), a timeout
that is switched off, an unplugged motor (its wheel does not turn, which stops the rover).

Source: bldc `documentation/comm_can.md`; `comm/comm_can.c` (`comm_can_send_status1` to `status5`,
`decode_msg`, `comm_can_send_buffer`) and `comm/commands.c` (mask bits 15 and 21), firmware 5.02 to 6; where
it is too old for the second, the answer is short and counts as other traffic.
"""

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum

from drivers.can.faults import BusMonitor, FaultBoard
from drivers.can.frame import CanFrame, pack_can_frame, unpack_can_frame
from drivers.driver import Rejection
from drivers.link import Received
from drivers.operation_check import OperationCheck
from drivers.position_counter import PositionCounter, restart_sample
from drivers.samples import FaultSample, PowerSample, Sample, WheelSample
from drivers.speed_check import SPEED_CONTRADICTS_POSITION, SpeedCheck
from drivers.vesc.faults import fault_name
from drivers.vesc.parameters import VescParameters

NOT_A_FRAME = (Rejection("not_a_frame"),)
OTHER_TRAFFIC = (Rejection("other_traffic"),)
OTHER_NODE = (Rejection("other_node"),)
TOO_SHORT = (Rejection("too_short"),)
IMPLAUSIBLE_JUMP = (Rejection("implausible_jump"),)
NO_FAULT_REPORT = Rejection("no_fault_report")

STEPS_PER_ELECTRICAL_TURN = 6
MOST_UNANSWERED = 20
"""Questions for the fault of one wheel after which a missing answer is reported."""

_SHORT_BUFFER = 8
_GET_VALUES_SELECTIVE = 50
_FAULT_MASK = 1 << 15
_STATUS_MASK = 1 << 21
_KEPT_OFF = (
    "",
    "timeout expired",
    "kill switch active",
    "timeout expired, kill switch active",
)
"""What keeps a motor off, by the two bits of the status."""
_QUESTION = struct.Struct(">BBBI")
_ANSWER = struct.Struct(">BBBIB")
_PROCESS_AND_REPLY, _REPLY = 0, 1

_STATUS_1, _STATUS_5 = 9, 27
_SPEED_CURRENT_DUTY = struct.Struct(">ihh")
_TACHOMETER_VOLTAGE = struct.Struct(">ih")
_STATUS_SIZES = {_STATUS_1: 8, 14: 8, 15: 8, 16: 8, _STATUS_5: 6, 58: 8}
"""Status messages and their sizes; 2, 3, 4 and 6 contain nothing that becomes a sample."""
_VALUE = struct.Struct(">i")


class Command(IntEnum):
    """Commands with one 32-bit number."""

    DUTY = 0
    CURRENT = 1
    RPM = 3


_STEPS_PER_UNIT = {Command.DUTY: 100_000, Command.CURRENT: 1000, Command.RPM: 1}
"""Steps of the number per 1 of duty cycle, per A and per electrical turn per minute."""


def encode_command(command: Command, node: int, value: float) -> bytes:
    """Return the frame that commands a duty cycle, a current in A or a speed in electrical rpm."""
    return _frame(command, node, _VALUE.pack(round(value * _STEPS_PER_UNIT[command])))


def encode_fault_question(node: int, host_id: int) -> bytes:
    """Return the frame that asks a controller for its fault code."""
    return _question(node, host_id, _FAULT_MASK)


def encode_status_question(node: int, host_id: int) -> bytes:
    """Return the frame that asks a controller whether its timeout or kill switch keeps the motor off."""
    return _question(node, host_id, _STATUS_MASK)


def _question(node: int, host_id: int, mask: int) -> bytes:
    return _frame(
        _SHORT_BUFFER, node, _QUESTION.pack(host_id, _PROCESS_AND_REPLY, _GET_VALUES_SELECTIVE, mask)
    )


def _frame(command: int, node: int, data: bytes) -> bytes:
    return pack_can_frame(CanFrame(command << 8 | node, data, is_extended=True))


class _Wheel:
    """One controller: its scales, its counter, and the questions that it has not answered."""

    def __init__(self, index: int, settings: VescParameters) -> None:
        wheel = settings.wheel[index]
        self.index = index
        self.node = wheel.node
        turns_per_wheel_turn = wheel.sign * settings.pole_pairs * settings.gear_ratio
        self.erpm_per_rad_s = turns_per_wheel_turn * 60.0 / math.tau
        self.rad_per_step = math.tau / (turns_per_wheel_turn * STEPS_PER_ELECTRICAL_TURN)
        self.sign = wheel.sign
        largest_rate_per_s = settings.erpm_limit / 60.0 * STEPS_PER_ELECTRICAL_TURN
        self.counter = PositionCounter(2**32, largest_rate_per_s)
        self.speed_check = SpeedCheck(self.rad_per_step, 1.0 / self.erpm_per_rad_s)
        self.operation = OperationCheck()
        self.unanswered = 0

    def reset(self) -> None:
        """Forget turns and questions after a break of the link."""
        self.counter.reset()
        self.speed_check.reset()
        self.operation.note_stop()
        self.unanswered = 0


class VescCodec:
    """Status messages to samples; wheel speeds to setpoints, and with them questions for fault and status.

    Status 1 gives speed and current, status 5 the position and, from the first wheel's controller, the supply
    voltage. Positions count from the controller's own zero. Beside the controller's own faults, a timeout or
    kill switch that keeps the motor off while setpoints are sent is one.

    Rejections: "not_a_frame"; "other_traffic"; "other_node", a status message of a controller that no wheel
    has; "too_short"; "implausible_jump", see `PositionCounter`; "no_fault_report", a controller that answers
    no question for its fault; "speed_contradicts_position", which accompanies a sample, see `SpeedCheck`;
    "bus_lost_arbitration" and "bus_warning".

    Args:
        name: Name of the device in the configuration.
        settings: Controllers, motors and gear.
    """

    def __init__(self, name: str, settings: VescParameters) -> None:
        self.wheel_count = len(settings.wheel)
        self._name = name
        self._host_id = settings.host_id
        self._erpm_limit = settings.erpm_limit
        self._wheels = [_Wheel(index, settings) for index in range(self.wheel_count)]
        self._wheel_of_node = {wheel.node: wheel for wheel in self._wheels}
        self._board = FaultBoard(name)
        self._bus_monitor = BusMonitor(self._board)
        self._next_question = 0
        self._readers: Mapping[int, Callable[[int, _Wheel, bytes], Sequence[Sample | Rejection]]] = {
            _STATUS_1: self._read_status_1,
            _STATUS_5: self._read_status_5,
        }

    def reset(self) -> None:
        """Forget turns and questions; faults that are still active are reported again."""
        self._board.reset()
        for wheel in self._wheels:
            wheel.reset()

    def decode(self, item: Received[bytes]) -> Sequence[Sample | Rejection]:
        """Return the samples and rejections of one frame."""
        frame = unpack_can_frame(item.payload)
        if frame is None:
            return NOT_A_FRAME
        if frame.is_error:
            return self._bus_monitor.note_error(item.t_ns, frame)
        recovered = self._bus_monitor.note_frame(item.t_ns)
        if not frame.is_extended or frame.is_remote:
            return (*recovered, *OTHER_TRAFFIC)
        return (*recovered, *self._read(item.t_ns, frame.can_id >> 8, frame.can_id & 0xFF, frame.data))

    def encode_start(self) -> Sequence[bytes]:
        """Return nothing: a controller obeys the first setpoint."""
        return ()

    def encode_speeds(self, speed_rad_s: Sequence[float]) -> tuple[Sequence[bytes], tuple[float, ...]]:
        """Return the setpoints, whole electrical turns per minute within the limit, and what they mean.

        Questions for fault and status of one wheel after the other are added to each call.
        """
        payloads, meant = [], []
        for wheel, speed in zip(self._wheels, speed_rad_s, strict=True):
            erpm = round(min(max(speed * wheel.erpm_per_rad_s, -self._erpm_limit), self._erpm_limit))
            payloads.append(encode_command(Command.RPM, wheel.node, erpm))
            meant.append(erpm / wheel.erpm_per_rad_s)
            wheel.operation.note_set_point()
        asked = self._wheels[self._next_question]
        self._next_question = (self._next_question + 1) % self.wheel_count
        asked.unanswered += 1
        payloads.append(encode_fault_question(asked.node, self._host_id))
        payloads.append(encode_status_question(asked.node, self._host_id))
        return payloads, tuple(meant)

    def encode_stop(self) -> Sequence[bytes]:
        """Return nothing: a controller holds speed 0 until its timeout, then applies its own brake current.

        A current of 0 would release the motor at once, and the wheel would roll on.
        """
        for wheel in self._wheels:
            wheel.operation.note_stop()
        return ()

    def encode_emergency_stop(self) -> Sequence[bytes]:
        """Return speed 0 for each controller; its timeout follows, with its own brake current."""
        return [encode_command(Command.RPM, wheel.node, 0) for wheel in self._wheels]

    def _read(self, t_ns: int, command: int, node: int, data: bytes) -> Sequence[Sample | Rejection]:
        if command == _SHORT_BUFFER and node == self._host_id:
            return self._read_answer(t_ns, data)
        size = _STATUS_SIZES.get(command)
        if size is None:
            return OTHER_TRAFFIC
        wheel = self._wheel_of_node.get(node)
        if wheel is None:
            return OTHER_NODE
        if len(data) < size:
            return TOO_SHORT
        reader = self._readers.get(command)
        return () if reader is None else reader(t_ns, wheel, data)

    def _read_status_1(self, t_ns: int, wheel: _Wheel, data: bytes) -> Sequence[Sample | Rejection]:
        erpm, current, duty = _SPEED_CURRENT_DUTY.unpack_from(data)
        drives_backwards = (duty or erpm) * wheel.sign < 0
        current_a = current / 10.0
        wheel.speed_check.note_speed(erpm / wheel.erpm_per_rad_s)
        sample = WheelSample(
            device=self._name,
            t_ns=t_ns,
            wheel=wheel.index,
            speed_rad_s=erpm / wheel.erpm_per_rad_s,
            current_a=-current_a if drives_backwards else current_a,
        )
        if wheel.unanswered <= MOST_UNANSWERED:
            return (sample,)
        wheel.unanswered = 0
        return sample, NO_FAULT_REPORT

    def _read_status_5(self, t_ns: int, wheel: _Wheel, data: bytes) -> Sequence[Sample | Rejection]:
        tachometer, voltage = _TACHOMETER_VOLTAGE.unpack_from(data)
        steps = wheel.counter.count(t_ns, tachometer)
        if steps is None:
            wheel.speed_check.reset()
            return IMPLAUSIBLE_JUMP
        position_rad = steps * wheel.rad_per_step
        samples: list[Sample | Rejection] = []
        if wheel.counter.has_restarted:
            samples.append(restart_sample(self._name, t_ns, f"wheel {wheel.index}"))
        samples.append(
            WheelSample(device=self._name, t_ns=t_ns, wheel=wheel.index, position_rad=position_rad)
        )
        if wheel.speed_check.contradicts(t_ns, position_rad):
            samples.append(SPEED_CONTRADICTS_POSITION)
        if wheel.index == 0:
            samples.append(PowerSample(device=self._name, t_ns=t_ns, voltage_v=voltage / 10.0))
        return samples

    def _read_answer(self, t_ns: int, data: bytes) -> Sequence[Sample | Rejection]:
        if len(data) < _ANSWER.size:
            return OTHER_TRAFFIC
        node, kind, command, mask, code = _ANSWER.unpack_from(data)
        if (kind, command) != (_REPLY, _GET_VALUES_SELECTIVE) or mask not in (_FAULT_MASK, _STATUS_MASK):
            return OTHER_TRAFFIC
        wheel = self._wheel_of_node.get(node)
        if wheel is None:
            return OTHER_NODE
        if mask == _FAULT_MASK:
            wheel.unanswered = 0
            return self._report(t_ns, wheel, "", code, fault_name(code))
        is_kept_off = wheel.operation.is_at_fault(t_ns, is_operating=not code & 3)
        return self._report(t_ns, wheel, " status", code & 3 if is_kept_off else 0, _KEPT_OFF[code & 3])

    def _report(self, t_ns: int, wheel: _Wheel, source: str, code: int, text: str) -> Sequence[FaultSample]:
        fault = self._board.report(
            t_ns, wheel.index, f"VESC {wheel.node}{source}", code, text if code else ""
        )
        return () if fault is None else (fault,)
