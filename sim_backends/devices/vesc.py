"""VESC motor controllers on their CAN bus. The bytes are written and read here, apart from the driver.

Modelled: setpoints in whole electrical turns per minute, release at a current of 0 (the wheel rolls on), the
stop by the timeout's brake when no setpoint arrives for `timeout_s`, status messages 1 to 5, current in
steps of 0.1 A and negative when braking, six tachometer steps per electrical turn, answers to questions
for fault and timeout, faults that stop the motor.

Not modelled: setpoints of duty cycle and of currents other than 0, minimum ERPM, the speed ramp, the duty
cycle (sent from speed and sign of the current only), the kill switch, temperatures, energies, the size of the
timeout's brake current, a wheel that rolls on after a fault, and what `sim_backends/devices/can_nodes.py`
lists for the bus.

Source: as for `drivers/vesc/codec.py`.
"""

import math
from collections.abc import Callable
from heapq import heapify, heapreplace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from drivers.can.frame import CanFrame, can_frame_bits, pack_can_frame, unpack_can_frame
from drivers.clock import nanoseconds
from drivers.settings import Settings
from drivers.vesc.settings import VescSettings
from sim_backends.world.fit import check_bit_rate, check_wheel_count
from sim_backends.world.line import NEVER_NS, Line
from sim_backends.world.plant import Plant, Truth
from sim_backends.world.sensor_errors import standard_normals
from sim_backends.world.world import EmulatedDevice


class VescFaultSettings(Settings):
    """A fault of one controller: its motor stops, and setpoints are ignored.

    Attributes:
        wheel: Index of the wheel.
        code: Fault code of the firmware, e.g. 4 for an absolute over current.
        start_s: Time from the start of the simulation.
        duration_s: The controller obeys again after this time.
    """

    wheel: Annotated[int, Field(ge=0)]
    code: Annotated[int, Field(ge=1, le=255)]
    start_s: Annotated[float, Field(ge=0)]
    duration_s: Annotated[float, Field(gt=0)] = 0.5


class VescEmulatorSettings(Settings):
    """Rates, errors and timeout of the controllers.

    Attributes:
        wheel_rate_hz: Status messages 1 and 5 of each controller per second.
        status_rate_hz: Status messages 2, 3 and 4 of each controller per second.
        speed_noise_rad_s: Standard deviation of each reported speed, at the wheel.
        current_noise_a: Standard deviation of each motor current.
        timeout_s: A wheel is braked when it gets no setpoint for this long.
        drive_faults: Faults of the controllers.
    """

    type: Literal["vesc"] = "vesc"
    wheel_rate_hz: Annotated[float, Field(gt=0, le=500)] = 50.0
    status_rate_hz: Annotated[float, Field(gt=0, le=100)] = 5.0
    speed_noise_rad_s: Annotated[float, Field(ge=0, le=10)] = 0.02
    current_noise_a: Annotated[float, Field(ge=0, le=10)] = 0.05
    timeout_s: Annotated[float, Field(gt=0, le=60)] = 0.5
    drive_faults: tuple[VescFaultSettings, ...] = ()


class VescEmulator:
    """All controllers on one bus.

    Args:
        device: Controllers, motors and gear.
        settings: Rates, errors and timeout.
        plant: The rover whose wheels they turn.
        to_host: Line to the host.
        rng: Source of the noise.
        start_ns: Time of power-on.
    """

    def __init__(
        self,
        device: VescSettings,
        settings: VescEmulatorSettings,
        plant: Plant,
        to_host: Line[bytes],
        rng: np.random.Generator,
        start_ns: int,
    ) -> None:
        self._device = device
        self._settings = settings
        self._plant = plant
        self._to_host = to_host
        self._noise = standard_normals(rng)
        self._timeout_ns = nanoseconds(settings.timeout_s)
        self._wheel_of_node = {wheel.node: index for index, wheel in enumerate(device.wheel)}
        self._signs = [wheel.sign for wheel in device.wheel]
        self._electrical_turns = device.pole_pairs * device.gear_ratio
        self._speeds_rad_s = [0.0 for _ in device.wheel]
        self._deadlines_ns = [NEVER_NS for _ in device.wheel]
        self._has_expired = [True for _ in device.wheel]
        self._released: set[int] = set()
        self._faults = [
            (
                start_ns + nanoseconds(fault.start_s),
                start_ns + nanoseconds(fault.start_s + fault.duration_s),
                fault,
            )
            for fault in settings.drive_faults
        ]
        self._fault_moves_ns = sorted(
            {t_ns for begin_ns, end_ns, _ in self._faults for t_ns in (begin_ns, end_ns)}
        )
        self._messages: dict[int, Callable[[Truth, int], bytes]] = {
            9: self._status_1,
            14: _no_energy,
            15: _no_energy,
            16: self._status_4,
            27: self._status_5,
        }
        self._due = self._schedule(start_ns)

    @property
    def next_event_ns(self) -> int:
        """When the next message is due, a timeout expires, or a fault begins or ends."""
        move_ns = self._fault_moves_ns[0] if self._fault_moves_ns else NEVER_NS
        return min(self._due[0][0], move_ns, *self._deadlines_ns)

    @property
    def load_bits_per_s(self) -> float:
        """Bit rate of what the controllers send."""
        bits = can_frame_bits(pack_can_frame(CanFrame(0, bytes(8), is_extended=True)))
        rates_hz = 2 * self._settings.wheel_rate_hz + 3 * self._settings.status_rate_hz
        return len(self._speeds_rad_s) * bits * rates_hz

    def act(self, t_ns: int) -> None:
        """Stop wheels at a timeout or fault, then send what is due."""
        while self._fault_moves_ns and self._fault_moves_ns[0] <= t_ns:
            self._fault_moves_ns.pop(0)
            for wheel in range(len(self._speeds_rad_s)):
                if self._fault_code(t_ns, wheel):
                    self._command(wheel, 0.0, NEVER_NS)
        for wheel, deadline_ns in enumerate(self._deadlines_ns):
            if deadline_ns <= t_ns:
                self._command(wheel, 0.0, NEVER_NS)
                self._has_expired[wheel] = True
        truth = self._plant.truth()
        self._let_released_wheels_roll(truth)
        while self._due[0][0] <= t_ns:
            due_ns, period_ns, command, wheel = self._due[0]
            heapreplace(self._due, (due_ns + period_ns, period_ns, command, wheel))
            self._send(t_ns, command, self._device.wheel[wheel].node, self._messages[command](truth, wheel))

    def receive(self, t_ns: int, payload: bytes) -> None:
        """Obey a setpoint or answer a question."""
        frame = unpack_can_frame(payload)
        if frame is None or not frame.is_extended or frame.is_remote or frame.is_error:
            return
        wheel = self._wheel_of_node.get(frame.can_id & 0xFF)
        if wheel is None:
            return
        command, data = frame.can_id >> 8, frame.data
        if command == 8 and len(data) == 7 and data[1:3] == b"\x00\x32":
            self._answer(t_ns, wheel, data[0], data[3:7])
        elif command in (1, 3) and len(data) >= 4:
            self._has_expired[wheel] = False
            if self._fault_code(t_ns, wheel):
                return
            number = int.from_bytes(data[:4], "big", signed=True)
            if command == 3:
                motor_turns_per_s = number / 60.0 / self._device.pole_pairs
                speed_rad_s = motor_turns_per_s * math.tau / self._device.gear_ratio * self._signs[wheel]
                self._command(wheel, speed_rad_s, t_ns + self._timeout_ns)
            elif number == 0:
                self._command(wheel, self._plant.truth().wheel_speed_rad_s[wheel], NEVER_NS)
                self._released.add(wheel)

    def _command(self, wheel: int, speed_rad_s: float, deadline_ns: int) -> None:
        self._released.discard(wheel)
        self._speeds_rad_s[wheel] = speed_rad_s
        self._deadlines_ns[wheel] = deadline_ns
        self._plant.set_wheel_speeds(tuple(self._speeds_rad_s))

    def _let_released_wheels_roll(self, truth: Truth) -> None:
        """Set the setpoints of released wheels to their true speeds: the motor gives next to no force."""
        for wheel in self._released:
            self._speeds_rad_s[wheel] = truth.wheel_speed_rad_s[wheel]
        if self._released:
            self._plant.set_wheel_speeds(tuple(self._speeds_rad_s))

    def _answer(self, t_ns: int, wheel: int, asker: int, mask: bytes) -> None:
        values = {0x8000: self._fault_code(t_ns, wheel), 0x20_0000: int(self._has_expired[wheel])}
        value = values.get(int.from_bytes(mask, "big"))
        if value is None:
            return
        node = self._device.wheel[wheel].node
        data = bytes((node, 1, 0x32)) + mask + bytes((value,))
        self._send(t_ns, 8, asker, data)

    def _fault_code(self, t_ns: int, wheel: int) -> int:
        codes = (
            fault.code
            for begin_ns, end_ns, fault in self._faults
            if fault.wheel == wheel and begin_ns <= t_ns < end_ns
        )
        return next(codes, 0)

    def _send(self, t_ns: int, command: int, node: int, data: bytes) -> None:
        self._to_host.put(t_ns, pack_can_frame(CanFrame(command * 256 + node, data, is_extended=True)))

    def _schedule(self, start_ns: int) -> list[tuple[int, int, int, int]]:
        """Return the first due times: the messages of each rate spread evenly over their period."""
        due = []
        wheels = range(len(self._speeds_rad_s))
        settings = self._settings
        for commands, rate_hz in (((9, 27), settings.wheel_rate_hz), ((14, 15, 16), settings.status_rate_hz)):
            messages = [(command, wheel) for wheel in wheels for command in commands]
            for index, (command, wheel) in enumerate(messages):
                first_ns = start_ns + nanoseconds((index + 1) / len(messages) / rate_hz)
                due.append((first_ns, nanoseconds(1.0 / rate_hz), command, wheel))
        heapify(due)
        return due

    def _status_1(self, truth: Truth, wheel: int) -> bytes:
        sign = self._signs[wheel]
        speed_rad_s = truth.wheel_speed_rad_s[wheel] + self._settings.speed_noise_rad_s * next(self._noise)
        erpm = int(sign * speed_rad_s * self._electrical_turns * 60.0 / math.tau)
        current_a = sign * (truth.motor_current_a[wheel] + self._settings.current_noise_a * next(self._noise))
        duty = max(
            -950, min(950, int(30.0 * sign * truth.wheel_speed_rad_s[wheel] + math.copysign(5, current_a)))
        )
        tenths = int(10.0 * math.copysign(1.0, duty) * current_a)
        return _signed(erpm, 4) + _signed(max(-32768, min(32767, tenths)), 2) + _signed(duty, 2)

    def _status_4(self, truth: Truth, wheel: int) -> bytes:
        input_a = abs(truth.motor_current_a[wheel])
        return _signed(250, 2) + _signed(250, 2) + _signed(int(10.0 * input_a), 2) + _signed(0, 2)

    def _status_5(self, truth: Truth, wheel: int) -> bytes:
        turns = self._signs[wheel] * truth.wheel_position_rad[wheel] / math.tau * self._electrical_turns
        steps = (math.floor(6.0 * turns) + 2**31) % 2**32 - 2**31
        return _signed(steps, 4) + _signed(int(10.0 * truth.battery_v), 2) + bytes(2)


def _no_energy(truth: Truth, wheel: int) -> bytes:
    return bytes(8)


def _signed(value: int, size: int) -> bytes:
    return value.to_bytes(size, "big", signed=True)


def make_emulator(
    name: str,
    device: VescSettings,
    emulator: VescEmulatorSettings,
    plant: Plant,
    rng: np.random.Generator,
    start_ns: int,
) -> EmulatedDevice[bytes]:
    """Build the emulated controllers and the two directions of their bus.

    Raises:
        ConfigError: They do not fit the plant, or need more than the bus can carry.
    """
    check_wheel_count(name, len(device.wheel), plant)
    to_host = Line(can_frame_bits, device.bit_rate)
    to_device = Line(can_frame_bits, device.bit_rate)
    controllers = VescEmulator(device, emulator, plant, to_host, rng, start_ns)
    fix = "raise bit_rate or lower wheel_rate_hz"
    check_bit_rate(name, controllers.load_bits_per_s, device.bit_rate, fix)
    return EmulatedDevice(name, controllers, to_host, to_device)
