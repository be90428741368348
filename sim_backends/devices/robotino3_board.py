"""The Robotino 3/4 board on its USB port. The bytes are written and read here, apart from the driver.

Modelled: setpoints in whole rpm, a reply of all motor readings, bumper, power source and power button to
each request, the speed field as encoder ticks of one millisecond (steps of 30 rpm), signed currents in steps
of the converter (6.60 mA) with ripple, the stop when no byte arrives for 0.4 s, the emergency bumper.

Not modelled: gains, acceleration limits, odometry, gyro, analogue and digital inputs, chargers, the bridged
CAN bus, the cut of the motors' supply at standstill, texts of the board, latency of the USB host.

Source: as for `drivers/robotino3_board/codec.py`; the delay of the reply is assumed.
"""

import math
import struct
from collections import deque
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from drivers.clock import nanoseconds
from drivers.link import Received
from drivers.robotino3_board.settings import Robotino3BoardSettings
from drivers.settings import Settings
from sim_backends.world.fit import check_wheel_count
from sim_backends.world.line import NEVER_NS, Line, serial_bits
from sim_backends.world.plant import Plant
from sim_backends.world.sensor_errors import standard_normals, standard_uniforms
from sim_backends.world.world import EmulatedDevice

SILENCE_S = 0.4
"""The firmware looks every 0.1 s whether 0.3 s have passed without a byte; this is the longest time."""
USB_BITS_PER_S = 5_000_000.0
CURRENT_STEP_A = 5.0 / 4096.0 * 5.4054


class Robotino3BoardEmulatorSettings(Settings):
    """Measurement errors of the simulated board.

    Attributes:
        current_ripple_a: Standard deviation of a motor current reading at 1 A; it grows with the root of the
            current.
        fastest_reply_s: Shortest time from a request to its reply.
        slowest_reply_s: Longest time from a request to its reply.
    """

    type: Literal["robotino3_board"] = "robotino3_board"
    current_ripple_a: Annotated[float, Field(ge=0, le=10)] = 0.1
    fastest_reply_s: Annotated[float, Field(ge=0, le=0.1)] = 0.001
    slowest_reply_s: Annotated[float, Field(ge=0, le=0.1)] = 0.003


class Robotino3BoardEmulator:
    """The far end of the USB port.

    Args:
        device: Gear and encoder.
        settings: Measurement errors.
        plant: The rover it drives, with three wheels.
        to_host: Line to the host.
        rng: Source of delays and noise.
    """

    def __init__(
        self,
        device: Robotino3BoardSettings,
        settings: Robotino3BoardEmulatorSettings,
        plant: Plant,
        to_host: Line[bytes],
        rng: np.random.Generator,
    ) -> None:
        self._settings = settings
        self._motor_turns = device.gear_ratio
        self._ticks_per_turn = device.ticks_per_motor_turn
        self._plant = plant
        self._to_host = to_host
        normal_rng, uniform_rng = rng.spawn(2)
        self._normals = standard_normals(normal_rng)
        self._uniforms = standard_uniforms(uniform_rng)
        self._inbox = b""
        self._rpm = [0.0, 0.0, 0.0]
        self._bumper_stops = False
        self._stop_ns = NEVER_NS
        self._replies: deque[Received[bytes]] = deque()

    @property
    def next_event_ns(self) -> int:
        """When the next reply is ready or the time without a byte ends."""
        return min(self._replies[0].t_ns, self._stop_ns) if self._replies else self._stop_ns

    def act(self, t_ns: int) -> None:
        """Send the replies that are ready; stop the motors when no byte has arrived in time."""
        while self._replies and self._replies[0].t_ns <= t_ns:
            reply = self._replies.popleft()
            self._to_host.put(reply.t_ns, reply.payload)
        if self._stop_ns <= t_ns:
            self._stop_ns = NEVER_NS
            self._rpm = [0.0, 0.0, 0.0]
            self._turn()

    def receive(self, t_ns: int, payload: bytes) -> None:
        """Execute each request that `payload` completes and prepare its reply."""
        self._stop_ns = t_ns + nanoseconds(SILENCE_S)
        pieces = (self._inbox + payload).split(b"\xaa")[1:]
        bodies = [_unframed(piece) for piece in pieces]
        for body in bodies:
            if body is not None:
                self._execute(t_ns, body)
        is_complete = not pieces or bodies[-1] is not None
        self._inbox = b"" if is_complete else b"\xaa" + pieces[-1][-600:]

    def _execute(self, t_ns: int, body: bytes) -> None:
        reply = b""
        while len(body) >= 2:
            tag, value, body = body[0], body[2 : 2 + body[1]], body[2 + body[1] :]
            if tag == 9 and len(value) == 3 and value[0] < 3:
                self._rpm[value[0]] = float(int.from_bytes(value[1:], "little", signed=True))
            elif tag == 57 and len(value) == 1:
                self._bumper_stops = value[0] == 1
            elif tag == 52:
                reply += b"\x35\x28" + self._readings()
            elif tag == 36:
                reply += bytes((37, 1, self._plant.truth().bumper_pressed))
        self._turn()
        battery_v = self._plant.truth().battery_v
        reply += b"\x41\x10" + struct.pack("<2f4BI", battery_v, 1.0, 0, 0, 1, battery_v < 22.0, 0)
        reply += b"\x27\x01\x00"
        delay_s = self._settings.fastest_reply_s + next(self._uniforms) * (
            self._settings.slowest_reply_s - self._settings.fastest_reply_s
        )
        start_ns = self._replies[-1].t_ns if self._replies else t_ns
        self._replies.append(Received(max(start_ns, t_ns + nanoseconds(delay_s)), _framed(reply)))

    def _turn(self) -> None:
        is_stopped = self._bumper_stops and self._plant.truth().bumper_pressed
        rad_s_per_rpm = math.tau / 60.0 / self._motor_turns
        self._plant.set_wheel_speeds([0.0 if is_stopped else rpm * rad_s_per_rpm for rpm in self._rpm])

    def _readings(self) -> bytes:
        truth = self._plant.truth()
        speeds, ticks, currents = [], [], []
        for wheel in range(3):
            ticks_per_ms = (
                truth.wheel_speed_rad_s[wheel] * self._motor_turns * self._ticks_per_turn / math.tau / 1000.0
            )
            counted = int(abs(ticks_per_ms) + next(self._uniforms))
            speeds.append(round(math.copysign(counted, ticks_per_ms) * 60_000.0 / self._ticks_per_turn))
            turns = truth.wheel_position_rad[wheel] / math.tau * self._motor_turns
            ticks.append((math.floor(turns * self._ticks_per_turn) + 2**31) % 2**32 - 2**31)
            current_a = truth.motor_current_a[wheel]
            current_a += self._settings.current_ripple_a * math.sqrt(abs(current_a)) * next(self._normals)
            currents.append(max(-2047, min(2047, round(current_a / CURRENT_STEP_A))) * CURRENT_STEP_A)
        return struct.pack("<4h4i4f", *speeds, 0, *ticks, 0, *currents, 0.0)


def _framed(body: bytes) -> bytes:
    data = struct.pack("<H", len(body)) + body
    data += struct.pack("<H", (0x10000 - sum(data)) % 0x10000)
    return b"\xaa" + data.replace(b"\x55", b"\x55\x75").replace(b"\xaa", b"\x55\x8a")


def _unframed(frame: bytes) -> bytes | None:
    """Return the body of what stood behind AA, or None where it is incomplete or damaged."""
    data = frame.replace(b"\x55\x8a", b"\xaa").replace(b"\x55\x75", b"\x55")
    if len(data) < 4:
        return None
    size = int.from_bytes(data[:2], "little")
    total = sum(data[: size + 2]) + int.from_bytes(data[size + 2 : size + 4], "little")
    return data[2 : size + 2] if len(data) == size + 4 and total % 0x10000 == 0 else None


def make_emulator(
    name: str,
    device: Robotino3BoardSettings,
    emulator: Robotino3BoardEmulatorSettings,
    plant: Plant,
    rng: np.random.Generator,
    start_ns: int,
) -> EmulatedDevice[bytes]:
    """Return the simulated board on its USB port.

    Raises:
        ConfigError: The rover does not have three wheels.
    """
    check_wheel_count(name, 3, plant)
    to_host: Line[bytes] = Line(serial_bits, USB_BITS_PER_S)
    to_device: Line[bytes] = Line(serial_bits, USB_BITS_PER_S)
    return EmulatedDevice(
        name, Robotino3BoardEmulator(device, emulator, plant, to_host, rng), to_host, to_device
    )
