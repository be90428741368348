"""The loop's side of ROS 2: starts its process, feeds it without waiting, and takes commands from it."""

import json
import math
import multiprocessing
import socket
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Any, Self

from controllers.operator import OperatorInput
from controllers.safety import Mode
from drivers.clock import Clock, SystemClock
from drivers.errors import ConfigError
from drivers.samples import PoseFixSample
from rover_hil.config import Config
from rover_hil.config.ros2_joints import joint_names
from rover_hil.connect.cycle_record import CycleRecorder
from rover_hil.connect.ros2.commands import Command, CommandGate, Stop
from rover_hil.connect.ros2.device_frames import static_transforms
from rover_hil.connect.ros2.fixes import Fix
from rover_hil.connect.ros2.process import MOST_BYTES, Face, serve
from rover_hil.connect.wall_clock import WallOffset
from rover_hil.recording.text import strict_json
from rover_hil.run.executive import CycleView, End
from rover_hil.run.sign_of_life import LifeWatch, SignOfLife

START_S = 30.0
"""Longest wait for the process, on a loaded machine."""
SILENT_S = 0.4
"""With the cycle that notices it the rover stops within half a second."""
SILENT = f"ROS 2: its process gave no sign of life for {SILENT_S:g} s"
ENDED = "the process of ROS 2 has ended"
END_S = 2.0
MOST_PER_CYCLE = 64
"""Messages of the process that are taken in a cycle; the rest waits for the next one."""
REST_M_S = 0.01
REST_RAD_S = 0.05
"""A rover that is slower, with set-points of zero, is at rest."""


class Ros2Connection:
    """Connects a run with programs of ROS 2, as an operator; a context manager.

    Nothing here waits: a record is dropped where the process does not take it.

    Args:
        config: A rover with the section [ros2].
        simulated_offset_ns: Returns real minus simulated time; 0 for a real rover.

    Raises:
        ConfigError: On entering: the library is missing, or interface or domain cannot be used.
    """

    def __init__(self, config: Config, simulated_offset_ns: Callable[[], int] = lambda: 0) -> None:
        settings = config.ros2
        if settings is None:
            raise ConfigError("ros2: this section is missing")
        self._face = Face(
            settings, config.filter, joint_names(config.rover, settings), static_transforms(config)
        )
        self._recorder = CycleRecorder(config, WallOffset(), simulated_offset_ns)
        self._simulated_offset_ns = simulated_offset_ns
        self._life = SignOfLife()
        self._clock: Clock = SystemClock()
        self._gate = CommandGate(settings.command_timeout_s, is_listening=settings.commands)
        self._watch = LifeWatch(self._life, SILENT_S, SILENT)
        self._line, self._their_line = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._process = multiprocessing.get_context("spawn").Process(
            target=serve, args=(self._face, self._their_line, self._life), name="ros2", daemon=True
        )
        self._stop_reason = ""
        self._ended = ""
        self._dropped = 0

    def __enter__(self) -> Self:
        """Start the process and wait until it is ready."""
        self._process.start()
        self._their_line.close()  # else its end would not be noticed
        self._line.settimeout(START_S)
        try:
            answer = json.loads(self._line.recv(MOST_BYTES) or b'{"failed":""}')
        except TimeoutError:
            answer = {"failed": f"its process did not answer within {START_S:g} s"}
        if "ready" not in answer:
            self.close()
            raise ConfigError(answer.get("failed") or "ros2: its process ended while it started")
        self._line.setblocking(False)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def pid(self) -> int | None:
        """Number of the process."""
        return self._process.pid

    def close(self) -> None:
        """End the process; may be called again."""
        self._line.close()
        if self._process.pid is not None:
            self._process.join(END_S)
            if self._process.is_alive():
                self._process.kill()
                self._process.join()

    def wanted(self) -> OperatorInput | None:
        """Return the command that holds now, and a change of the reason to stop; None for neither."""
        now_ns = self._clock.now_ns()
        fixes: list[PoseFixSample] = []
        for item in self._arrived():
            if isinstance(item, Stop):
                self._gate.take_stop(item)
            elif isinstance(item, Command):
                self._gate.take(item)
            elif isinstance(item, Fix):
                fixes.append(item.sample(self._simulated_offset_ns()))
            else:
                self._gate.report(item)
        reason = self._ended or self._watch.check(now_ns) or self._gate.stop_reason
        motion = self._gate.motion(now_ns)
        if reason == self._stop_reason:
            if motion is None and not fixes:
                return None
            return OperatorInput(motion=motion, fixes=tuple(fixes))
        self._stop_reason = reason
        return OperatorInput(motion=motion, stop_reason=reason, fixes=tuple(fixes))

    def end(self) -> tuple[End, str] | None:
        """Return that the run ends where the process has ended; None to go on."""
        return (End.TERMINATED, self._ended) if self._ended else None

    def show(self, view: CycleView) -> None:
        """Take a cycle, and send its record."""
        now_ns = self._clock.now_ns()
        output = view.output
        estimate = output.estimate
        is_slow = math.hypot(estimate.velocity_x_m_s, estimate.velocity_y_m_s) < REST_M_S
        is_at_rest = is_slow and abs(estimate.yaw_rate_rad_s) < REST_RAD_S
        self._gate.follow(
            now_ns,
            is_running=output.mode is Mode.RUNNING,
            is_at_rest=is_at_rest and not any(view.sent.speed_rad_s),
        )
        facts = {**self._gate.reports, "records dropped": self._dropped}
        record = self._recorder.record(view, now_ns, {"commands": self._gate.state, **facts})
        try:
            self._line.send(strict_json(record))
        except OSError:  # it hangs, and its queue is full, or it has ended
            self._dropped += 1

    def _arrived(self) -> Iterator[Command | Stop | Fix | str]:
        for _ in range(MOST_PER_CYCLE):
            try:
                data = self._line.recv(MOST_BYTES)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                self._ended = self._ended or ENDED
                return
            try:
                item = json.loads(data)
                if "failed" in item:
                    self._ended = f"{ENDED}: {item['failed']}"
                    return
                yield _parse(item)
            except (ValueError, TypeError, KeyError):  # it parses strangers' bytes in C, and may go mad
                self._ended = f"{ENDED}: it sent what it never should"
                return


def _parse(item: dict[str, Any]) -> Command | Stop | Fix | str:
    if "fix" in item:
        arrival_ns, age_ns, *numbers = item["fix"]
        return Fix(int(arrival_ns), int(age_ns), *map(float, numbers))
    if "wrong" in item:
        return str(item["wrong"])
    if "is_pressed" in item:
        return Stop(str(item["writer"]), int(item["stamp_ns"]), bool(item["is_pressed"]))
    forward_m_s, left_m_s, yaw_rate_rad_s = map(float, item["motion"])
    stamp_ns = None if item["stamp_ns"] is None else int(item["stamp_ns"])
    motion = forward_m_s, left_m_s, yaw_rate_rad_s
    return Command(str(item["writer"]), int(item["arrival_ns"]), motion, stamp_ns)
