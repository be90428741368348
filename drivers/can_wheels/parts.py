"""What the signals of one message mean: a wheel, the supply, an error word, the state of a drive."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TypeAlias

from drivers.can.faults import FaultBoard, fault_text
from drivers.can_wheels.mapping import SignalName, StateSource, WheelMapping
from drivers.can_wheels.mapping_file import BusDescription
from drivers.can_wheels.signals import Scale
from drivers.driver import Rejection
from drivers.operation_check import OperationCheck
from drivers.position_counter import PositionCounter, restart_sample
from drivers.samples import PowerSample, RateSample, Sample, WheelSample
from drivers.speed_check import SPEED_CONTRADICTS_POSITION, SpeedCheck

IMPLAUSIBLE_JUMP = Rejection("implausible_jump")
POSITION_AMBIGUOUS = Rejection("position_ambiguous")
NEGATIVE_AS_UNSIGNED = Rejection("negative_as_unsigned")

LARGEST_SPEED_RAD_S = 1000.0
"""No wheel turns faster: 180 km/h with a radius of 5 cm. A position that does has jumped."""

Results: TypeAlias = Iterator[Sample | Rejection]


class SignCheck:
    """Notices negative values in a signal that the DBC file calls unsigned.

    They fill the upper half of its range from the top down. A value there is believed only where the signal
    came to it in steps of less than half the range.

    Args:
        span: Number of values of the signal.
    """

    def __init__(self, span: int) -> None:
        self._half = span // 2
        self.reset()

    def reset(self) -> None:
        """Forget the last value."""
        self._believed: float | None = None

    def is_negative(self, raw: float) -> bool:
        """Take a raw value and return whether it is a negative one."""
        is_upper = raw >= self._half
        if is_upper and (self._believed is None or raw - self._believed >= self._half):
            self._believed = None
            return True
        self._believed = raw
        return False


def _sign_check(scale: Scale) -> SignCheck | None:
    return None if scale.unsigned_span is None else SignCheck(scale.unsigned_span)


class TurnCheck:
    """Compares the turns of a position that wraps with a signal beside it that by its name counts turns.

    The two may differ by one turn near the end of the range: a drive need not read both at one instant. A
    signal that never changes counts nothing.

    Args:
        signal: The signal.
        bits: Its size.
        span: Raw steps after which the position wraps.
    """

    def __init__(self, signal: str, bits: int, span: float) -> None:
        self.signal = signal
        self._values = 2**bits
        self._span = span
        self.reset()

    def reset(self) -> None:
        """Forget the turns."""
        self._before: tuple[float, float] | None = None
        self._apart = 0
        self._is_counting = False

    def has_lost_turns(self, counted: float, counts: float) -> bool:
        """Take the counted turns and the position; return whether turns of the position are missing."""
        before, self._before = self._before, (counted, counts)
        if before is None:
            return False
        moved = round((counted - before[0] + self._values // 2) % self._values) - self._values // 2
        turned = math.floor(counts / self._span) - math.floor(before[1] / self._span)
        self._apart = moved - turned + (self._apart if moved or self._is_counting else 0)
        self._is_counting |= moved != 0
        if not self._is_counting:
            return False
        is_inside = 0.25 < counts / self._span % 1.0 < 0.75
        is_certain = moved != 0 and (is_inside or counts == before[1])
        return abs(self._apart) > 1 or (self._apart != 0 and is_certain)


class WheelMotion:
    """What is remembered of a wheel from message to message, whatever message brings it.

    Args:
        bus: Mapping and DBC file.
        wheel: Index of the wheel.
    """

    def __init__(self, bus: BusDescription, wheel: int) -> None:
        mapping = bus.mapping.wheel[wheel]
        scales = bus.wheel_scales(mapping)
        position, speed = scales.get("position"), scales.get("speed")
        self.counter: PositionCounter | None = None
        self.check: SpeedCheck | None = None
        if position is not None:
            rate_per_s = LARGEST_SPEED_RAD_S / abs(position.si_per_raw)
            self.counter = PositionCounter(
                bus.counter_span(mapping), rate_per_s, bus.unmarked_revolution(mapping)
            )
            if speed is not None:
                self.check = SpeedCheck(_step(position), _step(speed))

    def reset(self) -> None:
        """Forget all."""
        if self.counter is not None:
            self.counter.reset()
        self.forget_turns()

    def forget_turns(self) -> None:
        """Begin the comparison with the speed anew, after a jump of the position."""
        if self.check is not None:
            self.check.reset()


def _step(scale: Scale) -> float:
    return abs(scale.si_per_raw) if scale.float_format is None else 0.0


class WheelPart:
    """The signals of one wheel that come together in one message."""

    def __init__(
        self, device: str, bus: BusDescription, wheel: int, scales: Mapping[str, Scale], motion: WheelMotion
    ) -> None:
        mapping = bus.mapping.wheel[wheel]
        self._device = device
        self._wheel = wheel
        self._current_is_signed = mapping.current_is_signed
        self._position = scales.get("position")
        self._turns = None if self._position is None else bus.turn_scale(mapping)
        self._turn_check = None if self._position is None else _turn_check(bus, mapping)
        self.watched = () if self._turn_check is None else (self._turn_check.signal,)
        self._measured = [
            (key, scale, _sign_check(scale) if key in ("speed", "current") else None)
            for key, scale in scales.items()
            if key != "position"
        ]
        self._motion = motion
        turns = () if self._turns is None else (self._turns.signal,)
        self.signals = (*(scale.signal for scale in scales.values()), *turns)

    def reset(self) -> None:
        """Forget turns and signs."""
        self._motion.reset()
        if self._turn_check is not None:
            self._turn_check.reset()
        for _, _, sign in self._measured:
            if sign is not None:
                sign.reset()

    def read(self, t_ns: int, values: Mapping[str, float]) -> Results:
        """Yield the sample of the wheel, and what is wrong with it.

        A quantity that cannot be true is left out; without its position, the whole sample is.
        """
        readings: dict[str, float] = {}
        for key, scale, sign in self._measured:
            raw = values[scale.signal]
            if sign is not None and sign.is_negative(raw):
                yield NEGATIVE_AS_UNSIGNED
            else:
                readings[key] = scale.to_si(raw)
        check = self._motion.check
        if check is not None and "speed" in readings:
            check.note_speed(readings["speed"])
        position_rad = None
        if self._position is not None:
            counts = self._count(t_ns, values, self._position)
            if counts is None:
                yield IMPLAUSIBLE_JUMP
                return
            if self._motion.counter is not None and self._motion.counter.has_restarted:
                yield restart_sample(self._device, t_ns, f"wheel {self._wheel}")
            if self._may_lack_turns(values, counts):
                yield POSITION_AMBIGUOUS
            position_rad = self._position.to_si(counts)
            if check is not None and check.contradicts(t_ns, position_rad):
                yield SPEED_CONTRADICTS_POSITION
        elif not readings:
            return
        yield WheelSample(
            device=self._device,
            t_ns=t_ns,
            wheel=self._wheel,
            position_rad=position_rad,
            speed_rad_s=readings.get("speed"),
            current_a=readings.get("current"),
            current_is_signed=self._current_is_signed,
            voltage_v=readings.get("voltage"),
            steering_rad=readings.get("steering"),
        )

    def _count(self, t_ns: int, values: Mapping[str, float], scale: Scale) -> float | None:
        """Return the position in raw steps without wraps; None for a jump."""
        counter = self._motion.counter
        raw = values[scale.signal]
        if self._turns is not None:
            raw += self._turns.to_si(values[self._turns.signal])
        counts = raw if counter is None else counter.count(t_ns, raw)
        if counts is None:
            self._motion.forget_turns()
            if self._turn_check is not None:
                self._turn_check.reset()
        return counts

    def _may_lack_turns(self, values: Mapping[str, float], counts: float) -> bool:
        counter, check = self._motion.counter, self._turn_check
        has_lost = check is not None and check.has_lost_turns(values[check.signal], counts)
        return has_lost or (counter is not None and counter.is_ambiguous)


def _turn_check(bus: BusDescription, wheel: WheelMapping) -> TurnCheck | None:
    name, source, span = bus.unnamed_turns(wheel), wheel.position, bus.position_span(wheel)
    if name is None or source is None or span is None:
        return None
    return TurnCheck(name, bus.message(source.message).get_signal_by_name(name).length, span)


class YawRatePart:
    """The yaw rate of the rover in one message."""

    def __init__(self, device: str, scale: Scale) -> None:
        self._device = device
        self._scale = scale
        self.signals: Sequence[str] = (scale.signal,)

    def reset(self) -> None:
        """Forget nothing."""

    def read(self, t_ns: int, values: Mapping[str, float]) -> Results:
        """Yield the sample."""
        rate_rad_s = self._scale.to_si(values[self._scale.signal])
        yield RateSample(device=self._device, t_ns=t_ns, rate_z_rad_s=rate_rad_s)


class PowerPart:
    """The signals of the supply in one message."""

    def __init__(self, device: str, voltage: Scale, current: Scale | None) -> None:
        self._device = device
        self._voltage = voltage
        self._current = current
        self._sign = None if current is None else _sign_check(current)
        self.signals = tuple(scale.signal for scale in (voltage, current) if scale is not None)

    def reset(self) -> None:
        """Forget the sign of the current."""
        if self._sign is not None:
            self._sign.reset()

    def read(self, t_ns: int, values: Mapping[str, float]) -> Results:
        """Yield the sample of the supply."""
        voltage, current = self._voltage, self._current
        current_a = None if current is None else current.to_si(values[current.signal])
        if current is not None and self._sign is not None and self._sign.is_negative(values[current.signal]):
            current_a = None
            yield NEGATIVE_AS_UNSIGNED
        yield PowerSample(
            device=self._device,
            t_ns=t_ns,
            voltage_v=voltage.to_si(values[voltage.signal]),
            current_a=current_a,
        )


class FaultPart:
    """One error word or flag in a message."""

    def __init__(self, board: FaultBoard, bus: BusDescription, wheel: int | None, name: SignalName) -> None:
        self._board = board
        self._wheel = wheel
        self._source = f"{name.message}.{name.signal}"
        self._names = bus.value_names(name)
        self.signals: Sequence[str] = (name.signal,)

    def reset(self) -> None:
        """The fault board is reset as a whole."""

    def read(self, t_ns: int, values: Mapping[str, float]) -> Results:
        """Yield the fault when it changes."""
        code = int(values[self.signals[0]])
        fault = self._board.report(t_ns, self._wheel, self._source, code, fault_text(code, self._names))
        if fault is not None:
            yield fault


class StatePart:
    """The state of one wheel's drive in a message."""

    def __init__(
        self, board: FaultBoard, bus: BusDescription, wheel: int, name: StateSource, operation: OperationCheck
    ) -> None:
        self._board = board
        self._wheel = wheel
        self._source = f"{name.message}.{name.signal}"
        self._names = bus.value_names(name)
        self._operating = frozenset(name.operating)
        self._operation = operation
        self.signals: Sequence[str] = (name.signal,)

    def reset(self) -> None:
        """Take the drive for one that gets no setpoints, until the next."""
        self._operation.note_stop()

    def read(self, t_ns: int, values: Mapping[str, float]) -> Results:
        """Yield the fault when it begins, changes or ends."""
        state = int(values[self.signals[0]])
        code, text = 0, ""
        if self._operation.is_at_fault(t_ns, is_operating=state in self._operating):
            code = state or 1  # 0 would mean no fault
            text = f"the drive does not obey setpoints, its state is {self._names.get(state, state)}"
        fault = self._board.report(t_ns, self._wheel, self._source, code, text)
        if fault is not None:
            yield fault


Part: TypeAlias = WheelPart | YawRatePart | PowerPart | FaultPart | StatePart
