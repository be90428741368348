"""What the signals of one message mean: a wheel, the supply, an error word, the state of a drive."""

from collections.abc import Iterator, Mapping, Sequence
from typing import TypeAlias

from drivers.can_faults import FaultBoard, fault_text
from drivers.can_wheels.mapping import SignalName, StateSource
from drivers.can_wheels.mapping_file import BusDescription
from drivers.can_wheels.signals import Scale
from drivers.driver import Rejection
from drivers.operation_check import OperationCheck
from drivers.position_counter import PositionCounter
from drivers.samples import PowerSample, Sample, WheelSample
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
        for part in (self.counter, self.check):
            if part is not None:
                part.reset()


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
        for _, _, sign in self._measured:
            if sign is not None:
                sign.reset()

    def read(self, t_ns: int, values: Mapping[str, float]) -> Results:
        """Yield the sample of the wheel, and what is wrong with it.

        A quantity that cannot be true is left out; without its position, the whole sample is.
        """
        found: dict[str, float] = {}
        for key, scale, sign in self._measured:
            raw = values[scale.signal]
            if sign is not None and sign.is_negative(raw):
                yield NEGATIVE_AS_UNSIGNED
            else:
                found[key] = scale.to_si(raw)
        check = self._motion.check
        if check is not None and "speed" in found:
            check.note_speed(found["speed"])
        position_rad = None
        if self._position is not None:
            position_rad = self._read_position(t_ns, values, self._position)
            if position_rad is None:
                yield IMPLAUSIBLE_JUMP
                return
            if self._motion.counter is not None and self._motion.counter.is_ambiguous:
                yield POSITION_AMBIGUOUS
            if check is not None and check.contradicts(t_ns, position_rad):
                yield SPEED_CONTRADICTS_POSITION
        elif not found:
            return
        yield WheelSample(
            device=self._device,
            t_ns=t_ns,
            wheel=self._wheel,
            position_rad=position_rad,
            speed_rad_s=found.get("speed"),
            current_a=found.get("current"),
            current_is_signed=self._current_is_signed,
            voltage_v=found.get("voltage"),
            steering_rad=found.get("steering"),
        )

    def _read_position(self, t_ns: int, values: Mapping[str, float], scale: Scale) -> float | None:
        counter = self._motion.counter
        raw = values[scale.signal]
        if self._turns is not None:
            raw += self._turns.to_si(values[self._turns.signal])
        counts = raw if counter is None else counter.count(t_ns, raw)
        if counts is not None:
            return scale.to_si(counts)
        if self._motion.check is not None:
            self._motion.check.reset()
        return None


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
        """Take the drive for one that gets no set-points, until the next."""
        self._operation.note_stop()

    def read(self, t_ns: int, values: Mapping[str, float]) -> Results:
        """Yield the fault when it begins, changes or ends."""
        state = int(values[self.signals[0]])
        code, text = 0, ""
        if self._operation.is_at_fault(t_ns, is_operating=state in self._operating):
            code = state or 1  # 0 would mean no fault
            text = f"the drive does not obey set-points, its state is {self._names.get(state, state)}"
        fault = self._board.report(t_ns, self._wheel, self._source, code, text)
        if fault is not None:
            yield fault


Part: TypeAlias = WheelPart | PowerPart | FaultPart | StatePart
