"""The Robotino 1/2/XT board, EA05 or EA09, at its serial port.

Modelled: setpoints in whole speed steps, brakes, one reply per request after 4 to 6 ms at the pace of the
line, the speed field as a tick count over 1/900 s, currents as magnitudes with ripple in the converter's
counts (an EA05 sends only the upper 8 of 10 bits, an EA09 saturates at 0.98 A), and the stop when no
request arrives. An EA05 replies with its measurements at the previous request.

Not modelled: gains, position mode, position and time reset, digital and analogue inputs, the auxiliary
output, power-off, and the duty cycle in the supply current.

Source: as for `drivers/robotino_board/codec.py`; reply delay and ripple measured.
"""

import math
from collections import deque
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from drivers.clock import nanoseconds
from drivers.link import Received
from drivers.robotino_board.codec import (
    REQUEST_SIZE,
    BoardReply,
    FrameScanner,
    build_reply,
    parse_request,
)
from drivers.robotino_board.scales import MAX_RAW, MAX_SPEED_STEPS, scales
from drivers.robotino_board.settings import RobotinoBoardSettings
from drivers.settings import Settings
from sim_backends.world.fit import check_wheel_count
from sim_backends.world.line import NEVER_NS, Line, serial_bits
from sim_backends.world.plant import Plant
from sim_backends.world.sensor_errors import standard_normals, standard_uniforms
from sim_backends.world.world import EmulatedDevice

SILENCE_S = {"EA05": 1.04, "EA09": 0.2}
"""Time without a request after which each board stops the motors."""
FASTEST_REPLY_S = 0.004
SLOWEST_REPLY_S = 0.006


class RobotinoBoardEmulatorSettings(Settings):
    """Measurement errors of the simulated board.

    Attributes:
        current_ripple_a: Standard deviation of a motor current reading at 1 A; it grows with the root of
            the current. 0.16 A fits 306 recorded runs (BrOleg5/research-wheel-slippage).
    """

    type: Literal["robotino_board"]
    current_ripple_a: Annotated[float, Field(ge=0, le=10)] = 0.16


class RobotinoBoardEmulator:
    """The far end of the serial line.

    Args:
        device: Board, gear and encoder.
        settings: Measurement errors.
        plant: The rover it drives, with three wheels.
        to_host: Line to the host.
        rng: Source of delays and noise.
        start_ns: Time of power-on.
    """

    def __init__(
        self,
        device: RobotinoBoardSettings,
        settings: RobotinoBoardEmulatorSettings,
        plant: Plant,
        to_host: Line[bytes],
        rng: np.random.Generator,
        start_ns: int,
    ) -> None:
        self._board = device.board
        self._scales = scales(device)
        self._ripple_a = settings.current_ripple_a
        self._plant = plant
        self._to_host = to_host
        normal_rng, uniform_rng = rng.spawn(2)
        self._normals = standard_normals(normal_rng)
        self._uniforms = standard_uniforms(uniform_rng)
        self._start_ns = start_ns
        self._silence_ns = nanoseconds(SILENCE_S[device.board])
        self._stop_ns = NEVER_NS
        self._scanner = FrameScanner(REQUEST_SIZE)
        self._replies: deque[Received[bytes]] = deque()
        self._measured_before = self._measure(start_ns)

    @property
    def next_event_ns(self) -> int:
        """When the next reply is ready or the time without a request ends."""
        return min(self._replies[0].t_ns, self._stop_ns) if self._replies else self._stop_ns

    def act(self, t_ns: int) -> None:
        """Send the replies that are ready; stop the motors when no request has arrived in time."""
        while self._replies and self._replies[0].t_ns <= t_ns:
            reply = self._replies.popleft()
            self._to_host.put(reply.t_ns, reply.payload)
        if self._stop_ns <= t_ns:
            self._plant.set_wheel_speeds((0.0, 0.0, 0.0))
            self._stop_ns = NEVER_NS

    def receive(self, t_ns: int, payload: bytes) -> None:
        """Execute each request that `payload` completes and prepare its reply."""
        for frame in self._scanner.feed(payload):
            if isinstance(frame, bytes):
                self._execute(frame)
                self._prepare_reply(t_ns)
                self._stop_ns = t_ns + self._silence_ns

    def _execute(self, frame: bytes) -> None:
        request = parse_request(frame)
        self._plant.set_wheel_speeds(
            [
                steps * self._scales.speed_rad_s if brake_off else 0.0
                for steps, brake_off in zip(request.speed_steps, request.brakes_off, strict=True)
            ]
        )

    def _prepare_reply(self, t_ns: int) -> None:
        measured = self._measure(t_ns)
        answer = self._measured_before if self._board == "EA05" else measured
        self._measured_before = measured
        start_ns = self._replies[-1].t_ns if self._replies else t_ns
        delay_s = FASTEST_REPLY_S + (SLOWEST_REPLY_S - FASTEST_REPLY_S) * next(self._uniforms)
        delay_ns = nanoseconds(delay_s)
        self._replies.append(Received(start_ns + delay_ns, answer))

    def _measure(self, t_ns: int) -> bytes:
        truth = self._plant.truth()
        scale = self._scales
        phases = [next(self._uniforms) for _ in range(3)]
        ripples = [next(self._normals) for _ in range(3)]
        t0, t1, t2 = [math.floor(angle / scale.position_rad) for angle in truth.wheel_position_rad]
        s0, s1, s2 = [
            _ticks_in_window(speed / scale.speed_rad_s, phase)
            for speed, phase in zip(truth.wheel_speed_rad_s, phases, strict=True)
        ]
        c0, c1, c2 = [
            self._counts(abs(current + ripple * self._ripple_a * math.sqrt(abs(current))), scale.current_a)
            for current, ripple in zip(truth.motor_current_a, ripples, strict=True)
        ]
        supply_a = sum(map(abs, truth.motor_current_a))
        return build_reply(
            BoardReply(
                ticks=(t0, t1, t2),
                speed_steps=(s0, s1, s2),
                current_raw=(c0, c1, c2),
                battery_raw=self._counts(truth.battery_v, scale.battery_v),
                system_current_raw=self._counts(supply_a, scale.system_current_a),
                bumper_pressed=truth.bumper_pressed,
                time_ms=(t_ns - self._start_ns) // 1_000_000,
                board=self._board,
            )
        )

    def _counts(self, value: float, per_count: float) -> int:
        counts = min(int(value / per_count), MAX_RAW)
        return counts & ~3 if self._board == "EA05" else counts


def _ticks_in_window(ticks: float, phase: float) -> int:
    """Return the number of ticks counted in a window that begins at `phase`, 0 to 1, between two ticks."""
    size = min(int(abs(ticks) + phase), MAX_SPEED_STEPS)
    return size if ticks >= 0 else -size


def make_emulator(
    name: str,
    device: RobotinoBoardSettings,
    emulator: RobotinoBoardEmulatorSettings,
    plant: Plant,
    rng: np.random.Generator,
    start_ns: int,
) -> EmulatedDevice[bytes]:
    """Return the simulated board on a serial line of the configured speed.

    Raises:
        ConfigError: The rover does not have three wheels.
    """
    check_wheel_count(name, 3, plant)
    to_host: Line[bytes] = Line(serial_bits, device.baud_rate)
    to_device: Line[bytes] = Line(serial_bits, device.baud_rate)
    board = RobotinoBoardEmulator(device, emulator, plant, to_host, rng, start_ns)
    return EmulatedDevice(name, board, to_host, to_device)
