"""CANopen drives with the profile CiA 402 on their bus. The bytes are written and read apart from the driver.

Modelled: network states with boot-up and heartbeat, expedited SDOs on the objects that the driver needs, PDOs
as they are mapped, the state machine of CiA 402, fault reset at a rising edge, emergencies, the fault at a
missing heartbeat of the host (8130h), rounding of all values.

Not modelled: other objects (an SDO on them is aborted), segmented SDOs, SYNC, node guarding, ramps, profile
velocity's own limits, and what `sim_backends/devices/can_nodes.py` lists for the bus.

Source: CiA 301 and CiA 402, see `drivers/canopen_wheels/frames.py`.
"""

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from drivers.can.frame import CanFrame, can_frame_bits, pack_can_frame, unpack_can_frame
from drivers.canopen_wheels.settings import CanopenWheelsSettings
from drivers.clock import nanoseconds
from drivers.settings import Settings
from sim_backends.world.fit import check_bit_rate, check_wheel_count
from sim_backends.world.line import NEVER_NS, Line
from sim_backends.world.plant import Plant
from sim_backends.world.sensor_errors import standard_normals
from sim_backends.world.world import EmulatedDevice

HEARTBEAT_ERROR = 0x8130
_SWITCH_ON_DISABLED, _READY, _SWITCHED_ON, _ENABLED, _FAULT = 0x240, 0x221, 0x233, 0x237, 0x208
_STEPS = {
    (_SWITCH_ON_DISABLED, 0x06): _READY,
    (_READY, 0x07): _SWITCHED_ON,
    (_READY, 0x0F): _ENABLED,
    (_SWITCHED_ON, 0x0F): _ENABLED,
    (_SWITCHED_ON, 0x06): _READY,
    (_ENABLED, 0x06): _READY,
    (_ENABLED, 0x07): _SWITCHED_ON,
}
"""State, controlword and the state that follows; 0 in the lower bits leads to switch-on disabled."""


class CanopenFaultSettings(Settings):
    """A fault of one drive: it sends an emergency and switches off until it is reset.

    Attributes:
        wheel: Index of the wheel.
        code: Emergency code, e.g. 8976 (2310h) for an over current.
        start_s: Time from the start of the simulation.
    """

    wheel: Annotated[int, Field(ge=0)]
    code: Annotated[int, Field(ge=0x100, le=0xFFFF)]
    start_s: Annotated[float, Field(ge=0)]


class CanopenWheelsEmulatorSettings(Settings):
    """Errors and faults of the drives.

    Attributes:
        speed_noise_rad_s: Standard deviation of each reported speed, at the wheel.
        current_noise_a: Standard deviation of each motor current.
        drive_faults: Faults of the drives.
    """

    type: Literal["canopen_wheels"] = "canopen_wheels"
    speed_noise_rad_s: Annotated[float, Field(ge=0, le=10)] = 0.02
    current_noise_a: Annotated[float, Field(ge=0, le=10)] = 0.02
    drive_faults: tuple[CanopenFaultSettings, ...] = ()


class _Drive:
    """One drive: its objects, its network state, its state of CiA 402."""

    def __init__(self, node: int, start_ns: int, faults: list[tuple[int, int]]) -> None:
        self.node = node
        self.faults = faults
        self.network = 0x7F
        self.statusword = _SWITCH_ON_DISABLED
        self.controlword = 0
        self.velocity = 0
        self.guard_ns = NEVER_NS
        self.heartbeat_ns = start_ns
        self.pdo_ns = {0x1800: NEVER_NS, 0x1801: NEVER_NS}
        self.objects: dict[tuple[int, int], int] = {
            (0x1016, 1): 0,
            (0x1017, 0): 1000,
            (0x6007, 0): 0,
            (0x6040, 0): 0,
            (0x6060, 0): 0,
            (0x60FF, 0): 0,
        }
        for index, can_id, period in ((0x1400, 0x200, None), (0x1800, 0x180, 0), (0x1801, 0x280, 0)):
            self.objects |= {(index, 1): can_id + node, (index, 2): 255, (index + 0x200, 0): 0}
            self.objects |= {(index + 0x200, place): 0 for place in range(1, 5)}
            if period is not None:
                self.objects[index, 5] = period

    @property
    def next_event_ns(self) -> int:
        begin_ns = self.faults[0][0] if self.faults else NEVER_NS
        return min(self.guard_ns, self.heartbeat_ns, begin_ns, *self.pdo_ns.values())

    def mapped(self, pdo: int) -> list[tuple[int, int]]:
        """Return index and size in bytes of what a PDO holds."""
        count = self.objects[pdo + 0x200, 0]
        entries = [self.objects[pdo + 0x200, place] for place in range(1, count + 1)]
        return [(entry >> 16, (entry & 0xFF) // 8) for entry in entries]

    def take_controlword(self, controlword: int) -> bool:
        """Move through the states of CiA 402; returns whether that reset a fault."""
        rises = controlword & 0x80 and not self.controlword & 0x80
        self.controlword = controlword
        if self.statusword == _FAULT:
            if rises:
                self.statusword = _SWITCH_ON_DISABLED
            return bool(rises)
        if controlword & 0x06 != 0x06:
            self.statusword = _SWITCH_ON_DISABLED
        else:
            self.statusword = _STEPS.get((self.statusword, controlword & 0x0F), self.statusword)
        return False


class CanopenWheelsEmulator:
    """All drives on one bus.

    Args:
        device: Drives, motors and gear.
        settings: Errors and faults.
        plant: The rover whose wheels they turn.
        to_host: Line to the host.
        rng: Source of the noise.
        start_ns: Time of power-on.
    """

    def __init__(
        self,
        device: CanopenWheelsSettings,
        settings: CanopenWheelsEmulatorSettings,
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
        self._drives = [
            _Drive(
                wheel.node,
                start_ns,
                sorted(
                    (start_ns + nanoseconds(fault.start_s), fault.code)
                    for fault in settings.drive_faults
                    if fault.wheel == index
                ),
            )
            for index, wheel in enumerate(device.wheel)
        ]
        for drive in self._drives:
            self._send(start_ns, 0x700 + drive.node, b"\x00")

    @property
    def next_event_ns(self) -> int:
        """When the next message is due, a heartbeat is missed or a fault begins."""
        return min(drive.next_event_ns for drive in self._drives)

    def act(self, t_ns: int) -> None:
        """Do what is due."""
        for wheel, drive in enumerate(self._drives):
            while drive.faults and drive.faults[0][0] <= t_ns:
                self._fail(t_ns, drive, drive.faults.pop(0)[1])
            if drive.guard_ns <= t_ns:
                drive.guard_ns = NEVER_NS
                self._fail(t_ns, drive, HEARTBEAT_ERROR)
            if drive.heartbeat_ns <= t_ns:
                drive.heartbeat_ns = t_ns + drive.objects[0x1017, 0] * 1_000_000
                self._send(t_ns, 0x700 + drive.node, bytes((drive.network,)))
            for pdo, due_ns in drive.pdo_ns.items():
                if due_ns <= t_ns:
                    drive.pdo_ns[pdo] = t_ns + drive.objects[pdo, 5] * 1_000_000
                    self._send_pdo(t_ns, wheel, drive, pdo)

    def receive(self, t_ns: int, payload: bytes) -> None:
        """Process network commands, heartbeats, SDOs and setpoints."""
        frame = unpack_can_frame(payload)
        if frame is None or frame.is_extended or frame.is_remote or frame.is_error:
            return
        for drive in self._drives:
            can_id, data, node = frame.can_id, frame.data, drive.node
            if can_id == 0 and len(data) == 2 and data[1] in (0, node):
                self._take_network_command(t_ns, drive, data[0])
            elif can_id == 0x700 + (drive.objects[0x1016, 1] >> 16 & 0x7F):
                drive.guard_ns = t_ns + (drive.objects[0x1016, 1] & 0xFFFF) * 1_000_000
            elif can_id == 0x600 + node and len(data) == 8:
                self._serve_sdo(t_ns, drive, data)
            elif can_id == drive.objects[0x1400, 1] and drive.network == 0x05:
                self._take_pdo(t_ns, drive, data)
        self._turn()

    def _take_network_command(self, t_ns: int, drive: _Drive, command: int) -> None:
        states = {0x01: 0x05, 0x02: 0x04, 0x80: 0x7F}
        drive.network = states.get(command, drive.network)
        for pdo in drive.pdo_ns:
            is_sent = drive.network == 0x05 and drive.objects[pdo, 5] and not drive.objects[pdo, 1] >> 31
            drive.pdo_ns[pdo] = t_ns + drive.objects[pdo, 5] * 1_000_000 if is_sent else NEVER_NS
        if drive.network != 0x05:
            drive.take_controlword(0)

    def _serve_sdo(self, t_ns: int, drive: _Drive, data: bytes) -> None:
        key = (int.from_bytes(data[1:3], "little"), data[3])
        if key not in drive.objects or data[0] & 0xE3 != 0x23:
            abort = 0x0602_0000 if key not in drive.objects else 0x0504_0001
            self._send(t_ns, 0x580 + drive.node, b"\x80" + data[1:4] + abort.to_bytes(4, "little"))
            return
        size = 4 - (data[0] >> 2 & 3)
        drive.objects[key] = int.from_bytes(data[4 : 4 + size], "little")
        self._send(t_ns, 0x580 + drive.node, b"\x60" + data[1:4] + bytes(4))

    def _take_pdo(self, t_ns: int, drive: _Drive, data: bytes) -> None:
        for index, size in drive.mapped(0x1400):
            value, data = data[:size], data[size:]
            if len(value) < size:
                return
            if index == 0x6040:
                if drive.take_controlword(int.from_bytes(value, "little")):
                    self._send(t_ns, 0x080 + drive.node, bytes(8))
            elif index == 0x60FF:
                drive.velocity = int.from_bytes(value, "little", signed=True)

    def _fail(self, t_ns: int, drive: _Drive, code: int) -> None:
        drive.statusword = _FAULT
        self._send(t_ns, 0x080 + drive.node, code.to_bytes(2, "little") + b"\x01" + bytes(5))
        self._turn()

    def _turn(self) -> None:
        speeds = []
        for drive, wheel in zip(self._drives, self._device.wheel, strict=True):
            rpm = drive.velocity / self._device.velocity_units_per_rpm / self._device.gear_ratio
            is_turning = drive.statusword == _ENABLED and drive.objects[0x6060, 0] in (3, 9)
            speeds.append(wheel.sign * rpm * math.tau / 60.0 if is_turning else 0.0)
        self._plant.set_wheel_speeds(speeds)

    def _send_pdo(self, t_ns: int, wheel: int, drive: _Drive, pdo: int) -> None:
        data = b""
        for index, size in drive.mapped(pdo):
            span = 1 << 8 * size
            data += (self._value(wheel, drive, index) % span).to_bytes(size, "little")
        self._send(t_ns, drive.objects[pdo, 1] & 0x7FF, data)

    def _value(self, wheel: int, drive: _Drive, index: int) -> int:
        truth, device = self._plant.truth(), self._device
        turns = device.gear_ratio / math.tau * device.wheel[wheel].sign
        if index == 0x6041:
            return drive.statusword
        if index == 0x606C:
            speed_rad_s = truth.wheel_speed_rad_s[wheel] + self._settings.speed_noise_rad_s * next(
                self._noise
            )
            return round(speed_rad_s * turns * 60.0 * device.velocity_units_per_rpm)
        if index == 0x6064:
            return math.floor(truth.wheel_position_rad[wheel] * turns * device.counts_per_motor_turn)
        current_a = truth.motor_current_a[wheel] + self._settings.current_noise_a * next(self._noise)
        per_mille = round(1000.0 * current_a * device.wheel[wheel].sign / (device.rated_current_a or 1.0))
        return max(-32768, min(32767, per_mille))

    def _send(self, t_ns: int, can_id: int, data: bytes) -> None:
        self._to_host.put(t_ns, pack_can_frame(CanFrame(can_id, data)))


def make_emulator(
    name: str,
    device: CanopenWheelsSettings,
    emulator: CanopenWheelsEmulatorSettings,
    plant: Plant,
    rng: np.random.Generator,
    start_ns: int,
) -> EmulatedDevice[bytes]:
    """Build the emulated drives and the two directions of their bus.

    Raises:
        ConfigError: They do not fit the plant, or need more than the bus can carry.
    """
    check_wheel_count(name, len(device.wheel), plant)
    bits = can_frame_bits(pack_can_frame(CanFrame(0, bytes(6))))
    required_bits_s = 2000.0 * bits * plant.wheel_count / device.pdo_period_ms
    check_bit_rate(name, required_bits_s, device.bit_rate, "raise bit_rate or pdo_period_ms")
    to_host = Line(can_frame_bits, device.bit_rate)
    to_device = Line(can_frame_bits, device.bit_rate)
    drives = CanopenWheelsEmulator(device, emulator, plant, to_host, rng, start_ns)
    return EmulatedDevice(name, drives, to_host, to_device)
