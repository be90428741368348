"""Meaning of the signals on a CAN bus for the wheels: a TOML file and, in the same folder, a DBC file.

The keys of [every_wheel] apply to each [[wheel]] that does not set them itself. In every text of them, and in
the messages of [[start]], [[stop]] and [[protection]], "{node}" is replaced by each wheel's `node`.
"""

import math
from abc import abstractmethod
from collections.abc import Iterator
from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from drivers.settings import Settings

Positive = Annotated[float, Field(gt=0)]
DbcName = Annotated[str, Field(pattern=r"^[^/\\]+$")]
_METRES_PER_S = {"m/s": 1.0, "mm/s": 1e-3, "km/h": 1.0 / 3.6}


class NamesSignals(Settings):
    """A part of the mapping that names messages and signals of the DBC file."""

    @abstractmethod
    def names(self) -> Iterator[tuple[str, str | None, float | None]]:
        """Yield each message, signal in it if any, and value that the signal must be able to hold, if any."""


class SignalName(NamesSignals):
    """One signal of one message.

    Attributes:
        message: Name of the message in the DBC file.
        signal: Name of the signal in it.
    """

    message: str
    signal: str

    def names(self) -> Iterator[tuple[str, str | None, float | None]]:
        """Yield the one signal."""
        yield self.message, self.signal, None


class MeasuredSignal(SignalName):
    """A signal that carries a physical quantity.

    Attributes:
        unit: Of the signal, after the DBC file's own scaling.
    """

    @property
    @abstractmethod
    def si_per_unit(self) -> float:
        """Size of the unit in SI units."""


class PositionSource(MeasuredSignal):
    """The signal with the position of a wheel.

    Attributes:
        unit: Unit at the encoder, before the gear.
        ticks_per_revolution: Size of the unit "ticks".
        wrap: The position wraps after this much, in its unit. Default: the whole range of an integer
            signal, never for a float. Turns are lost where it moves more than half of that between messages.
        turns: Signal of the same message that counts how often the position has wrapped, where there is one.
    """

    unit: Literal["rad", "rev", "deg", "ticks"]
    ticks_per_revolution: Positive | None = None
    wrap: Positive | None = None
    turns: str | None = None

    def names(self) -> Iterator[tuple[str, str | None, float | None]]:
        """Yield the position and the count of its turns."""
        yield from super().names()
        if self.turns is not None:
            yield self.message, self.turns, None

    @property
    def si_per_unit(self) -> float:
        """Size of the unit in rad."""
        if self.unit == "ticks":
            return 2.0 * math.pi / (self.ticks_per_revolution or math.nan)
        return {"rad": 1.0, "rev": 2.0 * math.pi, "deg": math.pi / 180.0}[self.unit]

    @property
    def units_per_revolution(self) -> float:
        """One revolution of the encoder, in its unit."""
        return 2.0 * math.pi / self.si_per_unit

    @model_validator(mode="after")
    def _check_ticks(self) -> Self:
        if (self.unit == "ticks") != (self.ticks_per_revolution is not None):
            raise ValueError('give ticks_per_revolution if, and only if, the unit is "ticks"')
        return self


class SpeedSource(MeasuredSignal):
    """The signal with the speed of a wheel, as the drive itself measures it.

    Attributes:
        unit: Those of a length are at the rim of the wheel, the others at the encoder, before the gear.
        radius_m: Radius of the wheel; for the units of a length.
    """

    unit: Literal["rad/s", "deg/s", "rev/s", "rpm", "m/s", "mm/s", "km/h"]
    radius_m: Positive | None = None

    @property
    def is_at_rim(self) -> bool:
        """Whether the unit is one of a length."""
        return self.unit in _METRES_PER_S

    @property
    def si_per_unit(self) -> float:
        """Size of the unit in rad/s."""
        if self.is_at_rim:
            return _METRES_PER_S[self.unit] / (self.radius_m or math.nan)
        return {
            "rad/s": 1.0,
            "deg/s": math.pi / 180.0,
            "rev/s": 2.0 * math.pi,
            "rpm": math.pi / 30.0,
        }[self.unit]

    @model_validator(mode="after")
    def _check_radius(self) -> Self:
        if self.is_at_rim != (self.radius_m is not None):
            raise ValueError("give radius_m if, and only if, the unit is m/s, mm/s or km/h")
        return self


class Setpoint(SpeedSource):
    """The signal of the speed setpoint of a wheel.

    Attributes:
        fixed: Values of further signals of that message, e.g. `{ Enable = 1 }`. All others take the
            DBC file's start value, or 0.
    """

    fixed: Annotated[dict[str, float], Field(default_factory=dict)]

    def names(self) -> Iterator[tuple[str, str | None, float | None]]:
        """Yield the setpoint and the fixed signals."""
        yield from super().names()
        for signal, value in self.fixed.items():
            yield self.message, signal, value


class SteeringSource(MeasuredSignal):
    """The signal with the steering angle of a wheel, or of the steering wheel that turns it.

    Attributes:
        unit: Of the signal, after the DBC file's own scaling.
        zero: Its value straight ahead, in its unit.
        ratio: By how much it turns per turn of the wheel, e.g. 15 for the steering wheel of a car.
    """

    unit: Literal["rad", "deg"]
    zero: float = 0.0
    ratio: Positive = 1.0

    @property
    def si_per_unit(self) -> float:
        """Size of the unit in rad of the wheel."""
        return {"rad": 1.0, "deg": math.pi / 180.0}[self.unit] / self.ratio


class YawRateSource(MeasuredSignal):
    """The signal with the yaw rate of the rover.

    Attributes:
        sign: -1 where it counts clockwise.
        zero: Its value at standstill, in its unit.
    """

    unit: Literal["rad/s", "deg/s"]
    sign: Literal[1, -1] = 1
    zero: float = 0.0

    @property
    def si_per_unit(self) -> float:
        """Size of the unit in rad/s."""
        return {"rad/s": 1.0, "deg/s": math.pi / 180.0}[self.unit]


class CurrentSource(MeasuredSignal):
    """The signal with a current."""

    unit: Literal["A", "mA"]

    @property
    def si_per_unit(self) -> float:
        """Size of the unit in A."""
        return {"A": 1.0, "mA": 1e-3}[self.unit]


class VoltageSource(MeasuredSignal):
    """The signal with a voltage."""

    unit: Literal["V", "mV"]

    @property
    def si_per_unit(self) -> float:
        """Size of the unit in V."""
        return {"V": 1.0, "mV": 1e-3}[self.unit]


class StateSource(SignalName):
    """The signal with the state of a wheel's drive.

    Attributes:
        operating: Values with which the drive obeys setpoints. Any other one is a fault from a second after
            the first setpoint until the drive is stopped.
    """

    operating: Annotated[tuple[int, ...], Field(min_length=1)]

    def names(self) -> Iterator[tuple[str, str | None, float | None]]:
        """Yield the signal with each of the values."""
        for value in self.operating:
            yield self.message, self.signal, value


class WheelMapping(Settings):
    """One wheel; it has a position, a speed, or both, unless it is not measured.

    Attributes:
        node: Number or name that replaces "{node}".
        sign: -1 where the drive counts backwards when the rover drives forwards.
        gear_ratio: Turns of the encoder and of the commanded motor per turn of the wheel.
        measured: False where it has no encoder: position and speed of [every_wheel] are then not its own.
        position: How far its encoder has turned.
        speed: As the drive itself measures it; positions are finer.
        current: Of its motor.
        current_is_signed: False where the drive reports only the magnitude of the motor current.
        voltage: Voltage at the motor's terminals, never the supply.
        setpoint: Setpoint signal; without it the wheel is only measured.
        steering: Signal with the measured steering angle, counter-clockwise. Without it the controller
            assumes that the wheel follows its setpoints.
        steering_setpoint: Signal of the steering setpoint; it may be in the message of the speed.
        steering_sign: -1 where steering angles count clockwise.
        fault: Error words and flags of the wheel's drive; 0 means no fault.
        state: State of the wheel's drive, for drives that may leave operation without an error word.
    """

    node: int | str
    sign: Literal[1, -1] = 1
    gear_ratio: Annotated[float, Field(gt=0, le=1000)] = 1.0
    measured: bool = True
    position: PositionSource | None = None
    speed: SpeedSource | None = None
    current: CurrentSource | None = None
    current_is_signed: bool = True
    voltage: VoltageSource | None = None
    setpoint: Setpoint | None = None
    steering: SteeringSource | None = None
    steering_setpoint: SteeringSource | None = None
    steering_sign: Literal[1, -1] = 1
    fault: tuple[SignalName, ...] = ()
    state: StateSource | None = None

    @model_validator(mode="after")
    def _check_sources(self) -> Self:
        has_motion = self.position is not None or self.speed is not None
        if self.measured and not has_motion:
            raise ValueError("the wheel has neither position nor speed: add one, here or in [every_wheel]")
        if has_motion and not self.measured:
            raise ValueError("the wheel has a position or a speed: remove measured = false")
        return self


class PowerMapping(Settings):
    """The signals of the rover's supply.

    Attributes:
        voltage: Of bus or battery.
        current: In the same message as the voltage.
    """

    voltage: VoltageSource
    current: CurrentSource | None = None

    @model_validator(mode="after")
    def _check_message(self) -> Self:
        if self.current is not None and self.current.message != self.voltage.message:
            raise ValueError("voltage and current must come in the same message: leave the current out")
        return self


class FixedFrame(NamesSignals):
    """A message with fixed content, sent to switch the drives on or off.

    Attributes:
        message: Name of the message in the DBC file.
        signals: Values of signals in it; all others take the DBC file's start value, or 0.
    """

    message: str
    signals: dict[str, float]

    def names(self) -> Iterator[tuple[str, str | None, float | None]]:
        """Yield the message, and every signal with its value."""
        yield self.message, None, None
        for signal, value in self.signals.items():
            yield self.message, signal, value


class Protection(NamesSignals):
    """Protection of messages, in both directions.

    Attributes:
        messages: Names of the messages.
        counter: Signal that counts up by one in each message.
        counter_modulus: It counts from 0 to one less; default: its whole range.
        checksum: Signal of one whole byte: the checksum of all other bytes of the message, in order.
        algorithm: How the checksum is computed.
    """

    messages: Annotated[tuple[str, ...], Field(min_length=1)]
    counter: str | None = None
    counter_modulus: Annotated[int, Field(ge=2)] | None = None
    checksum: str | None = None
    algorithm: Literal["xor8", "sum8", "crc8_j1850"] | None = None

    def names(self) -> Iterator[tuple[str, str | None, float | None]]:
        """Yield counter and checksum of every message."""
        for message in self.messages:
            if self.counter is not None:
                yield message, self.counter, self.counter_modulus and self.counter_modulus - 1
            if self.checksum is not None:
                yield message, self.checksum, None

    @model_validator(mode="after")
    def _check_algorithm(self) -> Self:
        if (self.checksum is None) != (self.algorithm is None):
            raise ValueError("checksum and algorithm belong together: give both or none")
        return self


class CanWheelsMapping(Settings):
    """The whole mapping file, after "{node}" and [every_wheel] have been filled in.

    Attributes:
        dbc: Name of the DBC file in the same folder, or a list of several. Of messages with one name, that
            of the first file is meant.
        wheel: In the rover's order: that of [[rover.wheels]], or front left, front right, rear left, rear
            right.
        yaw_rate: Yaw rate of a sensor on this bus; name the device in `roles.gyro`, too.
        power: The rover's supply.
        fault: Error words of the whole rover.
        protection: Counters and checksums.
        start: Sent in this order before the first setpoint.
        stop: Sent in this order after standstill.
    """

    dbc: Annotated[tuple[DbcName, ...], Field(min_length=1)]
    wheel: Annotated[tuple[WheelMapping, ...], Field(min_length=1)]
    power: PowerMapping | None = None
    yaw_rate: YawRateSource | None = None
    fault: tuple[SignalName, ...] = ()
    start: tuple[FixedFrame, ...] = ()
    stop: tuple[FixedFrame, ...] = ()
    protection: tuple[Protection, ...] = ()

    @field_validator("dbc", mode="before")
    @classmethod
    def _list_one_file(cls, dbc: object) -> object:
        return (dbc,) if isinstance(dbc, str) else dbc

    @model_validator(mode="after")
    def _check_nodes(self) -> Self:
        nodes = [wheel.node for wheel in self.wheel]
        repeated = next((node for node in nodes if nodes.count(node) > 1), None)
        if repeated is not None:
            raise ValueError(f"two wheels have the node {repeated!r}: give each its own")
        return self
