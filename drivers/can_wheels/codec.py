"""CAN frames to wheel samples and back, by a mapping and its DBC file."""

from collections.abc import Sequence

from drivers.can.faults import BusMonitor, FaultBoard
from drivers.can.frame import EXTENDED_FLAG, unpack_can_frame
from drivers.can_wheels.layout import choices_of
from drivers.can_wheels.mapping import FixedFrame, WheelMapping
from drivers.can_wheels.mapping_file import BusDescription
from drivers.can_wheels.messages import MessageReader, MessageWriter, bus_id, raw_values
from drivers.can_wheels.parts import (
    FaultPart,
    Part,
    PowerPart,
    StatePart,
    WheelMotion,
    WheelPart,
    YawRatePart,
)
from drivers.can_wheels.signals import Scale
from drivers.driver import Rejection
from drivers.link import Received
from drivers.operation_check import OperationCheck
from drivers.samples import Sample

NOT_A_FRAME = (Rejection("not_a_frame"),)
OTHER_TRAFFIC = (Rejection("other_traffic"),)


class _Outbox:
    """One setpoint message and the wheels that it commands: speeds, and steering angles."""

    def __init__(self, writer: MessageWriter) -> None:
        self.writer = writer
        self.fixed: dict[str, float] = {}
        self.wheels: list[tuple[int, Scale]] = []
        self.steered: list[tuple[int, Scale]] = []


class CanWheelsCodec:
    """Frames of one CAN bus, as a mapping describes them.

    Every sample holds the values of one frame: where a multiplexer chooses what a frame holds, only those. A
    wheel's speed is given only where the drive itself reports one; positions are finer. Positions count from
    the drive's own zero; after a break of the link, turns may be missing. A float32 position in revolutions,
    as of ODrives, is resolved to 0.4 mrad of the motor up to 1024 revolutions and to 12 mrad up to 32768:
    restart such a drive from time to time.

    Rejections: "not_a_frame"; "other_traffic", identifiers that the mapping does not use, normal on a shared
    bus; "too_short"; "checksum"; "counter_repeat" and "counter_backwards", old data; "frames_lost", which
    accompanies the samples of the message that showed the gap; "not_finite"; "out_of_range";
    "implausible_jump", see `PositionCounter`; "negative_as_unsigned", see `SignCheck`, whose value is missing
    in the sample; "speed_contradicts_position", see `SpeedCheck`, and "position_ambiguous", a step of more
    than a quarter of the position's range or one that contradicts a count of turns beside it, which accompany
    samples; "bus_lost_arbitration" and "bus_warning",
    reports of the CAN controller that are not faults.

    Args:
        device: Name of the device in the configuration.
        bus: Mapping and DBC file.
    """

    def __init__(self, device: str, bus: BusDescription) -> None:
        self.wheel_count = len(bus.mapping.wheel)
        self._bus = bus
        self._board = FaultBoard(device)
        self._bus_monitor = BusMonitor(self._board)
        self._operations = [OperationCheck() for _ in bus.mapping.wheel]
        self._inboxes: dict[int, tuple[MessageReader, tuple[Part, ...]]] = {}
        for name, parts in self._parts_by_message(device).items():
            message = bus.message(name)
            signals = {signal for part in parts for signal in part.signals}
            watched = {signal for part in parts if isinstance(part, WheelPart) for signal in part.watched}
            reader = MessageReader(message, sorted(signals), bus.protection(name), watched - signals)
            self._inboxes[bus_id(message)] = (reader, tuple(parts))
        self._writers: dict[str, MessageWriter] = {}
        self._outboxes = self._make_outboxes()
        self._steering_rad = [0.0] * self.wheel_count
        self.wheel_wraps_rad = tuple(map(bus.position_wrap_rad, bus.mapping.wheel))
        self.steering_limits_rad = {
            index: bus.steering_scale(wheel, wheel.steering_setpoint).limits_si
            for index, wheel in enumerate(bus.mapping.wheel)
            if wheel.steering_setpoint is not None
        }

    def reset(self) -> None:
        """Forget counters and turns; faults that are still active are reported again."""
        self._board.reset()
        for reader, parts in self._inboxes.values():
            reader.reset()
            for part in parts:
                part.reset()

    def decode(self, item: Received[bytes]) -> Sequence[Sample | Rejection]:
        """Return the samples and rejections of one frame."""
        frame = unpack_can_frame(item.payload)
        if frame is None:
            return NOT_A_FRAME
        if frame.is_error:
            return self._bus_monitor.note_error(item.t_ns, frame)
        recovered = self._bus_monitor.note_frame(item.t_ns)
        inbox = self._inboxes.get(frame.can_id | EXTENDED_FLAG if frame.is_extended else frame.can_id)
        if inbox is None or frame.is_remote:
            return (*recovered, *OTHER_TRAFFIC)
        reader, parts = inbox
        values, rejection = reader.read(frame.data)
        results: list[Sample | Rejection] = [*recovered]
        if rejection is not None:
            results.append(rejection)
        if values is not None:
            for part in parts:
                if part.signals[0] in values:
                    results += part.read(item.t_ns, values)
        return results

    def encode_start(self) -> Sequence[bytes]:
        """Return the [[start]] messages of the mapping."""
        return self._encode_fixed(self._bus.mapping.start)

    def encode_stop(self) -> Sequence[bytes]:
        """Return the [[stop]] messages of the mapping; drives may be in any state from now on."""
        for operation in self._operations:
            operation.note_stop()
        return self._encode_fixed(self._bus.mapping.stop)

    def encode_emergency_stop(self) -> Sequence[bytes]:
        """Return zero speeds, encoded three times for drives that check a counter, and the [[stop]] messages.

        Messages that only steer are left out. A drive that takes speed and steering angle in one message is
        steered to 0.
        """
        fresh = CanWheelsCodec("", self._bus)
        standstill = [
            outbox.writer.write(
                dict(outbox.fixed)
                | {scale.signal: scale.to_raw(0.0) for _, scale in (*outbox.wheels, *outbox.steered)}
            )
            for _ in range(3)
            for outbox in fresh._outboxes
            if outbox.wheels
        ]
        return [*standstill, *fresh.encode_stop()]

    def encode_speeds(self, speed_rad_s: Sequence[float]) -> tuple[Sequence[bytes], tuple[float, ...]]:
        """Return the setpoint messages, and the speeds they mean after clipping and rounding.

        A wheel without a setpoint in the mapping gets none; its speed is given as 0. Steering angles stay at
        their last setpoints, 0 at first.
        """
        payloads, meant, _ = self.encode_set_points(speed_rad_s, self._steering_rad)
        return payloads, meant

    def encode_set_points(
        self, speed_rad_s: Sequence[float], steering_rad: Sequence[float]
    ) -> tuple[Sequence[bytes], tuple[float, ...], tuple[float, ...]]:
        """Return the setpoint messages, and the speeds and steering angles they mean.

        A steering angle without a signal in the mapping is given as 0.
        """
        for operation in self._operations:
            operation.note_set_point()
        self._steering_rad = list(steering_rad)
        angles = [0.0] * self.wheel_count
        meant = [0.0] * self.wheel_count
        payloads = []
        for outbox in self._outboxes:
            raw_by_signal = dict(outbox.fixed)
            for wheel, scale in outbox.wheels:
                raw = scale.to_raw(speed_rad_s[wheel])
                raw_by_signal[scale.signal] = raw
                meant[wheel] = scale.to_si(raw)
            for wheel, scale in outbox.steered:
                raw = scale.to_raw(steering_rad[wheel])
                raw_by_signal[scale.signal] = raw
                angles[wheel] = scale.to_si(raw)
            payloads.append(outbox.writer.write(raw_by_signal))
        return payloads, tuple(meant), tuple(angles)

    def _parts_by_message(self, device: str) -> dict[str, list[Part]]:
        bus, mapping = self._bus, self._bus.mapping
        parts: dict[str, list[Part]] = {}
        for index, wheel in enumerate(mapping.wheel):
            motion = WheelMotion(bus, index)
            for scales in _scales_by_frame(bus, wheel):
                message = next(iter(scales.values())).message
                parts.setdefault(message, []).append(WheelPart(device, bus, index, scales, motion))
            for name in wheel.fault:
                parts.setdefault(name.message, []).append(FaultPart(self._board, bus, index, name))
            if wheel.state is not None:
                part = StatePart(self._board, bus, index, wheel.state, self._operations[index])
                parts.setdefault(wheel.state.message, []).append(part)
        for name in mapping.fault:
            parts.setdefault(name.message, []).append(FaultPart(self._board, bus, None, name))
        if mapping.yaw_rate is not None:
            rate = bus.yaw_rate_scale(mapping.yaw_rate)
            parts.setdefault(rate.message, []).append(YawRatePart(device, rate))
        if mapping.power is not None:
            voltage, current = bus.power_scales(mapping.power)
            parts.setdefault(voltage.message, []).append(PowerPart(device, voltage, current))
        return parts

    def _make_outboxes(self) -> list[_Outbox]:
        outboxes: dict[str, _Outbox] = {}
        for index, wheel in enumerate(self._bus.mapping.wheel):
            if wheel.setpoint is not None:
                outbox = self._outbox(outboxes, wheel.setpoint.message)
                message = self._bus.message(wheel.setpoint.message)
                outbox.fixed.update(raw_values(message, wheel.setpoint.fixed))
                outbox.wheels.append((index, self._bus.setpoint_scale(wheel, wheel.setpoint)))
            if wheel.steering_setpoint is not None:
                outbox = self._outbox(outboxes, wheel.steering_setpoint.message)
                outbox.steered.append((index, self._bus.steering_scale(wheel, wheel.steering_setpoint)))
        return list(outboxes.values())

    def _outbox(self, outboxes: dict[str, _Outbox], message: str) -> _Outbox:
        if message not in outboxes:
            outboxes[message] = _Outbox(self._writer(message))
        return outboxes[message]

    def _writer(self, message: str) -> MessageWriter:
        writer = self._writers.get(message)
        if writer is None:
            writer = MessageWriter(self._bus.message(message), self._bus.protection(message))
            self._writers[message] = writer
        return writer

    def _encode_fixed(self, frames: Sequence[FixedFrame]) -> Sequence[bytes]:
        return [
            self._writer(frame.message).write(raw_values(self._bus.message(frame.message), frame.signals))
            for frame in frames
        ]


def _scales_by_frame(bus: BusDescription, wheel: WheelMapping) -> list[dict[str, Scale]]:
    """Return the conversions of a wheel's signals by quantity, those together that come in one frame."""
    scales: dict[object, dict[str, Scale]] = {}
    for quantity, scale in bus.wheel_scales(wheel).items():
        choices = choices_of(bus.message(scale.message), scale.signal)
        scales.setdefault((scale.message, choices), {})[quantity] = scale
    return list(scales.values())
