"""The wheel drives of a simulated rover on their CAN bus, in the messages of a mapping and its DBC file.

Not modelled: arbitration between the two directions (each is a wire of its own with the full bit rate), error
frames, retransmission and bus-off; jitter of the sampling; the delay of the drives' own filters. Signals that
the mapping does not name keep the DBC file's start value. The drives switch on together when all [[start]]
messages have arrived, and off at any [[stop]] message. Drives with [[start]] messages must be started again
after their watchdog has expired (an ODrive also requires that its errors are cleared).
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from heapq import heapify, heapreplace
from typing import TypeAlias

import numpy as np
from cantools.database.can import Message

from drivers.can.frame import EXTENDED_FLAG, CanFrame, can_frame_bits, pack_can_frame, unpack_can_frame
from drivers.can_wheels.layout import Choice, choices_of
from drivers.can_wheels.mapping import FixedFrame, SignalName, StateSource, WheelMapping
from drivers.can_wheels.mapping_file import BusDescription, load_mapping
from drivers.can_wheels.messages import MessageReader, MessageWriter, bus_id, raw_values
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.can_wheels.signals import Scale, raw_value
from drivers.clock import nanoseconds
from drivers.errors import ConfigError
from sim_backends.devices.can_node_settings import CanNodeSettings
from sim_backends.world.fit import check_bit_rate
from sim_backends.world.line import NEVER_NS, Line
from sim_backends.world.plant import Plant, SteeredPlant, Truth
from sim_backends.world.sensor_errors import standard_normals
from sim_backends.world.world import EmulatedDevice

RawSignal: TypeAlias = Callable[[Truth], float]
"""Returns the raw value of a signal for a given truth."""
_Page: TypeAlias = tuple[tuple[str, int], ...]
"""Multiplexers and their values."""


class _Outbox:
    """One message to the host with a choice of its multiplexers, and the sources of its signals."""

    def __init__(self, message: Message, writer: MessageWriter, page: _Page, rate_hz: float) -> None:
        self.writer = writer
        self.multiplexers = dict(page)
        self.signals: dict[str, RawSignal] = {}
        self.rate_hz = rate_hz
        empty = CanFrame(message.frame_id, bytes(message.length), message.is_extended_frame)
        self.bits = can_frame_bits(pack_can_frame(empty))


class CanNodes:
    """All wheel drives on one bus.

    Args:
        settings: Rates and errors.
        bus: Messages of the mapping.
        plant: The rover whose wheels they drive and measure.
        to_host: Line to the host.
        rng: Source of the noise.
        start_ns: Time of power-on.
    """

    def __init__(
        self,
        settings: CanNodeSettings,
        bus: BusDescription,
        plant: Plant,
        to_host: Line[bytes],
        rng: np.random.Generator,
        start_ns: int,
    ) -> None:
        self._settings = settings
        self._bus = bus
        self._plant = plant
        self._steered_plant = plant if isinstance(plant, SteeredPlant) else None
        self._to_host = to_host
        self._noise = standard_normals(rng)
        wheels = range(len(bus.mapping.wheel))
        self._speeds_rad_s = [0.0 for _ in wheels]
        self._deadlines_ns = [NEVER_NS for _ in wheels]
        self._has_expired = [False for _ in wheels]
        self._watchdog_ns = nanoseconds(settings.watchdog_s)
        self._readers: dict[int, MessageReader] = {}
        self._setpoints: dict[int, list[tuple[int, Scale]]] = {}
        self._steering: dict[int, list[tuple[int, Scale]]] = {}
        self._angles_rad = [0.0 for _ in wheels]
        self._start = self._listen_for_frames(bus.mapping.start)
        self._stop = self._listen_for_frames(bus.mapping.stop)
        self._missing = set(range(len(self._start)))
        self._listen_for_setpoints()
        self._outboxes = self._make_outboxes()
        self._due = self._schedule(start_ns)

    @property
    def next_event_ns(self) -> int:
        """When the next message is due or a watchdog expires."""
        return min(self._due[0][0], *self._deadlines_ns)

    @property
    def load_bits_per_s(self) -> float:
        """Bit rate of what the drives send."""
        return sum(outbox.bits * outbox.rate_hz for outbox in self._outboxes.values())

    def act(self, t_ns: int) -> None:
        """Stop wheels whose watchdog has expired, then send what is due."""
        for wheel, deadline_ns in enumerate(self._deadlines_ns):
            if deadline_ns <= t_ns:
                self._expire(wheel)
        truth = None
        while self._due[0][0] <= t_ns:
            due_ns, key = self._due[0]
            outbox = self._outboxes[key]
            heapreplace(self._due, (due_ns + nanoseconds(1.0 / outbox.rate_hz), key))
            truth = truth or self._plant.truth()
            values = {signal: raw_of(truth) for signal, raw_of in outbox.signals.items()}
            self._to_host.put(t_ns, outbox.writer.write({**outbox.multiplexers, **values}))

    def receive(self, t_ns: int, payload: bytes) -> None:
        """Process setpoints, [[start]] and [[stop]] messages."""
        frame = unpack_can_frame(payload)
        if frame is None or frame.is_remote or frame.is_error:
            return
        key = frame.can_id | (EXTENDED_FLAG if frame.is_extended else 0)
        reader = self._readers.get(key)
        values = None if reader is None else reader.read(frame.data)[0]
        if values is None:
            return
        for index, (start_key, raw) in enumerate(self._start):
            if start_key == key and raw.items() <= values.items():
                self._missing.discard(index)
        if any(stop_key == key and raw.items() <= values.items() for stop_key, raw in self._stop):
            self._switch_off()
        if key in self._setpoints and not self._missing:
            self._take_setpoints(t_ns, self._setpoints[key], values)
        if key in self._steering and not self._missing:
            self._steer(self._steering[key], values)

    def _take_setpoints(
        self, t_ns: int, scales: Iterable[tuple[int, Scale]], values: Mapping[str, float]
    ) -> None:
        for wheel, scale in scales:
            self._speeds_rad_s[wheel] = scale.to_si(values[scale.signal])
            self._deadlines_ns[wheel] = t_ns + self._watchdog_ns
            self._has_expired[wheel] = False
        self._plant.set_wheel_speeds(tuple(self._speeds_rad_s))

    def _steer(self, scales: Iterable[tuple[int, Scale]], values: Mapping[str, float]) -> None:
        """Pass the setpoints on; without a watchdog: a steering drive that gets none keeps its angle."""
        for wheel, scale in scales:
            self._angles_rad[wheel] = scale.to_si(values[scale.signal])
        if self._steered_plant is not None:
            self._steered_plant.set_steering(tuple(self._angles_rad))

    def _expire(self, wheel: int) -> None:
        self._has_expired[wheel] = True
        if self._start:
            self._switch_off()
            return
        self._speeds_rad_s[wheel] = 0.0
        self._deadlines_ns[wheel] = NEVER_NS
        self._plant.set_wheel_speeds(tuple(self._speeds_rad_s))

    def _switch_off(self) -> None:
        self._missing = set(range(len(self._start)))
        self._speeds_rad_s = [0.0 for _ in self._speeds_rad_s]
        self._deadlines_ns = [NEVER_NS for _ in self._deadlines_ns]
        self._plant.set_wheel_speeds(tuple(self._speeds_rad_s))

    def _listen_for_frames(self, frames: Iterable[FixedFrame]) -> list[tuple[int, dict[str, float]]]:
        return [
            (self._listen(frame.message), raw_values(self._bus.message(frame.message), frame.signals))
            for frame in frames
        ]

    def _listen_for_setpoints(self) -> None:
        for index, wheel in enumerate(self._bus.mapping.wheel):
            if wheel.setpoint is not None:
                key = self._listen(wheel.setpoint.message)
                scale = self._bus.setpoint_scale(wheel, wheel.setpoint)
                self._setpoints.setdefault(key, []).append((index, scale))
            if wheel.steering_setpoint is not None:
                key = self._listen(wheel.steering_setpoint.message)
                scale = self._bus.steering_scale(wheel, wheel.steering_setpoint)
                self._steering.setdefault(key, []).append((index, scale))

    def _listen(self, name: str) -> int:
        message = self._bus.message(name)
        key = bus_id(message)
        if key not in self._readers:
            signals = [signal.name for signal in message.signals]
            self._readers[key] = MessageReader(message, signals, self._bus.protection(name))
        return key

    def _make_outboxes(self) -> dict[tuple[str, _Page], _Outbox]:
        sources: dict[str, dict[str, RawSignal]] = {}
        rates_hz: dict[str, float] = {}
        for message_name, signal, rate_hz, raw_of in self._sources():
            sources.setdefault(message_name, {})[signal] = raw_of
            rates_hz.setdefault(message_name, rate_hz)
        outboxes: dict[tuple[str, _Page], _Outbox] = {}
        for message_name, signals in sources.items():
            message = self._bus.message(message_name)
            choices = {signal: choices_of(message, signal) for signal in signals}
            writer = MessageWriter(message, self._bus.protection(message_name), signals)
            for page in _pages(choices.values()):
                outbox = _Outbox(message, writer, page, rates_hz[message_name])
                outbox.signals = {
                    signal: raw_of
                    for signal, raw_of in signals.items()
                    if all(
                        outbox.multiplexers.get(choice.multiplexer) in choice.values
                        for choice in choices[signal]
                    )
                }
                outboxes[message_name, page] = outbox
        return outboxes

    def _sources(self) -> Iterator[tuple[str, str, float, RawSignal]]:
        """Yield message, signal, rate in Hz and source of all that the drives send."""
        mapping, settings = self._bus.mapping, self._settings
        for index, wheel in enumerate(mapping.wheel):
            for quantity, scale in self._bus.wheel_scales(wheel).items():
                raw_of = self._raw_signal(quantity, index, wheel, scale)
                yield scale.message, scale.signal, settings.wheel_rate_hz, raw_of
            turns = self._bus.turn_scale(wheel)
            if turns is not None:
                yield (
                    turns.message,
                    turns.signal,
                    settings.wheel_rate_hz,
                    self._raw_turns(index, wheel, turns),
                )
        if mapping.yaw_rate is not None:
            rate = self._bus.yaw_rate_scale(mapping.yaw_rate)
            yield rate.message, rate.signal, settings.wheel_rate_hz, self._raw_yaw_rate(rate)
        faults = [(index, name) for index, wheel in enumerate(mapping.wheel) for name in wheel.fault]
        for fault_wheel, name in [*faults, *((None, name) for name in mapping.fault)]:
            yield name.message, name.signal, settings.status_rate_hz, self._raw_fault(fault_wheel, name)
        for wheel in mapping.wheel:
            if wheel.state is not None:
                state = wheel.state
                yield state.message, state.signal, settings.status_rate_hz, self._raw_state(state)
        if mapping.power is not None:
            scale, _ = self._bus.power_scales(mapping.power)
            yield scale.message, scale.signal, settings.status_rate_hz, self._raw_supply(scale)

    def _schedule(self, start_ns: int) -> list[tuple[int, tuple[str, _Page]]]:
        """Return the first due times: the messages of each rate spread evenly over their period."""
        due = []
        for rate_hz in {outbox.rate_hz for outbox in self._outboxes.values()}:
            keys = [key for key, outbox in self._outboxes.items() if outbox.rate_hz == rate_hz]
            for index, key in enumerate(keys):
                due.append((start_ns + nanoseconds((index + 1) / len(keys) / rate_hz), key))
        heapify(due)
        return due

    def _raw_signal(self, quantity: str, index: int, wheel: WheelMapping, scale: Scale) -> RawSignal:
        if quantity == "position":
            return self._raw_position(index, wheel, scale)
        if quantity == "speed":
            return self._raw_speed(index, scale)
        if quantity == "steering":
            return lambda truth: scale.to_raw((truth.steering_rad or (0.0,) * (index + 1))[index])
        return self._raw_current(index, scale, is_signed=wheel.current_is_signed)

    def _encoder_position_rad(self, truth: Truth, index: int, wheel: WheelMapping) -> float:
        """Return the position of a wheel in whole ticks of its encoder."""
        per_turn = wheel.position and wheel.position.ticks_per_revolution
        ticks = per_turn or self._settings.encoder_ticks_per_revolution
        rad_per_tick = 2.0 * math.pi / ticks / wheel.gear_ratio
        return math.floor(truth.wheel_position_rad[index] / rad_per_tick) * rad_per_tick

    def _raw_position(self, index: int, wheel: WheelMapping, scale: Scale) -> RawSignal:
        span = self._bus.position_span(wheel)

        def raw_of(truth: Truth) -> float:
            position_rad = self._encoder_position_rad(truth, index, wheel)
            if span is None:
                return scale.to_raw(position_rad)
            raw = round((position_rad - scale.si_offset) / scale.si_per_raw) % span
            return raw if raw <= scale.high else raw - span

        return raw_of

    def _raw_turns(self, index: int, wheel: WheelMapping, turns: Scale) -> RawSignal:
        position = self._bus.wheel_scales(wheel)["position"]
        raw_position = self._raw_position(index, wheel, position)
        values = turns.high - turns.low + 1

        def raw_of(truth: Truth) -> float:
            position_rad = self._encoder_position_rad(truth, index, wheel)
            counts = round((position_rad - position.si_offset) / position.si_per_raw)
            wraps = round((counts - raw_position(truth) - turns.si_offset) / turns.si_per_raw)
            return (wraps - turns.low) % values + turns.low

        return raw_of

    def _raw_state(self, state: StateSource) -> RawSignal:
        signal = self._bus.message(state.message).get_signal_by_name(state.signal)
        operating = state.operating[0]
        off = next(
            value for value in range(len(state.operating) + 2) if value and value not in state.operating
        )
        raw_on, raw_off = raw_value(signal, operating), raw_value(signal, off)
        return lambda truth: raw_off if self._missing else raw_on

    def _raw_speed(self, index: int, scale: Scale) -> RawSignal:
        noise_rad_s = self._settings.speed_noise_rad_s
        return lambda truth: scale.to_raw(truth.wheel_speed_rad_s[index] + noise_rad_s * next(self._noise))

    def _raw_yaw_rate(self, scale: Scale) -> RawSignal:
        noise_rad_s = self._settings.yaw_rate_noise_rad_s
        return lambda truth: scale.to_raw(truth.yaw_rate_rad_s + noise_rad_s * next(self._noise))

    def _raw_current(self, index: int, scale: Scale, *, is_signed: bool) -> RawSignal:
        noise_a, step_a = self._settings.current_noise_a, self._settings.current_step_a

        def raw_of(truth: Truth) -> float:
            current_a = truth.motor_current_a[index] + noise_a * next(self._noise)
            if step_a:
                current_a = round(current_a / step_a) * step_a
            return scale.to_raw(current_a if is_signed else abs(current_a))

        return raw_of

    def _raw_supply(self, scale: Scale) -> RawSignal:
        noise_v = self._settings.voltage_noise_v
        return lambda truth: scale.to_raw(truth.battery_v + noise_v * next(self._noise))

    def _raw_fault(self, wheel: int | None, name: SignalName) -> RawSignal:
        choices = self._bus.message(name.message).get_signal_by_name(name.signal).choices
        codes = (value for value, text in (choices or {}).items() if "watchdog" in str(text).lower())
        code = next(codes, 0)

        def raw_of(truth: Truth) -> float:
            expired = any(self._has_expired) if wheel is None else self._has_expired[wheel]
            return code if expired else 0

        return raw_of


def make_can_node(
    name: str,
    device: CanWheelsSettings,
    emulator: CanNodeSettings,
    plant: Plant,
    rng: np.random.Generator,
    start_ns: int,
) -> EmulatedDevice[bytes]:
    """Build the emulated drives and the two directions of their bus.

    Raises:
        ConfigError: The mapping is wrong, does not fit the plant, or needs more than the bus can carry.
    """
    bus = load_mapping(device.mapping)
    mapping = bus.mapping
    if len(mapping.wheel) != plant.wheel_count:
        raise ConfigError(
            f"simulated bus '{name}' has {len(mapping.wheel)} wheels in {bus.mapping_file.name}, "
            f"the simulated rover {plant.wheel_count}: choose a mapping that fits"
        )
    has_supply_current = mapping.power is not None and mapping.power.current is not None
    if has_supply_current or any(wheel.voltage is not None for wheel in mapping.wheel):
        raise ConfigError(
            f"simulated bus '{name}': motor voltages and supply current are not simulated, "
            f"but {bus.mapping_file.name} names them: simulate with a mapping without them"
        )
    if any(wheel.steering_setpoint for wheel in mapping.wheel) and not isinstance(plant, SteeredPlant):
        raise ConfigError(
            f"simulated bus '{name}': {bus.mapping_file.name} steers wheels, but the simulated rover does "
            "not steer: choose a plant that does"
        )
    to_host = Line(can_frame_bits, device.bit_rate)
    to_device = Line(can_frame_bits, device.bit_rate)
    nodes = CanNodes(emulator, bus, plant, to_host, rng, start_ns)
    fix = "raise bit_rate or lower wheel_rate_hz"
    check_bit_rate(name, nodes.load_bits_per_s, device.bit_rate, fix)
    return EmulatedDevice(name, nodes, to_host, to_device)


def _pages(chosen: Iterable[tuple[Choice, ...]]) -> list[_Page]:
    """Return what multiplexers must be set to, in frames that together hold each signal at least once."""
    pages = {tuple((choice.multiplexer, min(choice.values)) for choice in choices) for choices in chosen}
    return sorted(page for page in pages if not any(set(page) < set(larger) for larger in pages))
