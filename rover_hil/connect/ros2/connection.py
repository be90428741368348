"""The loop's side of ROS 2: starts its process, feeds it without waiting, and takes commands from it."""

import json
import math
import multiprocessing
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Any, Self

from controllers.operator import OperatorInput
from controllers.safety import Mode
from drivers.clock import Clock, SystemClock, nanoseconds
from drivers.errors import ConfigError
from drivers.safety_event import RESTART, Outcome, SafetyEvent
from drivers.samples import PoseFixSample
from rover_hil.config import Config
from rover_hil.connect.cycle_bytes import CyclePacker
from rover_hil.connect.ros2.commands import Command, CommandGate, Stop
from rover_hil.connect.ros2.fixes import Fix
from rover_hil.connect.ros2.process import serve
from rover_hil.connect.shared_ring import RingReader, RingWriter, SharedRing
from rover_hil.run.executive import CycleView, End
from rover_hil.run.heartbeat import LifeWatch

START_S = 30.0
"""Longest wait for the process, on a loaded machine."""
LOOK_S = 0.005
SILENT_S = 0.4
"""With the cycle that notices it the rover stops within half a second."""
SILENT = f"ROS 2: no heartbeat of its process for {SILENT_S:g} s"
LOOKED_FOR_NS = nanoseconds(0.1)
"""A process that is silent for longer may have ended."""
ENDED = "the process of ROS 2 has ended"
END_S = 2.0
MOST_PER_CYCLE = 64
"""Messages of the process that are taken in a cycle; the rest waits for the next one."""
CYCLES, CYCLE_BYTES = 64, 1 << 14
"""Cycles that wait for the process, more than a second at 50 Hz; the longest one."""
ARRIVALS, ARRIVAL_BYTES = 256, 1 << 10
REST_M_S = 0.01
REST_RAD_S = 0.05
"""A rover that is slower, with setpoints of zero, is at rest."""

EVENTS = (
    SafetyEvent(
        Outcome.STOPS,
        "The process of ROS 2 hangs.",
        f"`{SILENT}`",
        ("tests/rover_hil/connect/test_ros2_run.py::test_a_process_that_hangs_or_dies_stops_the_run",),
        within="0.4 s and one cycle",
        clears="when it works again, and with a later command",
    ),
    SafetyEvent(
        Outcome.ENDS,
        "The process of ROS 2 is gone.",
        "`terminated`",
        ("tests/rover_hil/connect/test_ros2_run.py::test_a_process_that_hangs_or_dies_stops_the_run",),
        within="one cycle",
        clears=RESTART,
    ),
)
"""Rows of the reference page of safety."""


class Ros2Connection:
    """Connects a run with programs of ROS 2, as an operator; a context manager.

    Nothing here waits or calls the system in a cycle: what both processes say to each other is in shared
    memory. A cycle is dropped where the process does not take it.

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
        self._simulated_offset_ns = simulated_offset_ns
        self._clock: Clock = SystemClock()
        self._gate = CommandGate(settings.command_timeout_s, is_listening=settings.commands)
        cycles, arrivals = SharedRing(CYCLES, CYCLE_BYTES), SharedRing(ARRIVALS, ARRIVAL_BYTES)
        self._cycles, self._arrivals = RingWriter(cycles), RingReader(arrivals)
        self._watch = LifeWatch(self._arrivals, SILENT_S, SILENT, forgives_pauses=True)
        context = multiprocessing.get_context("spawn")
        self._lifeline, self._their_lifeline = context.Pipe()
        self._process = context.Process(
            target=serve,
            args=(config, cycles, arrivals, self._their_lifeline),
            name="ros2",
            daemon=True,
        )
        self._packer = CyclePacker(config)
        self._told: tuple[str, int, int] | None = None
        self._extra: Mapping[str, object] = {}
        self._held = OperatorInput()
        self._stop_reason = ""
        self._ended = ""
        self._dropped = 0

    def __enter__(self) -> Self:
        """Start the process and wait until it is ready."""
        self._process.start()
        self._their_lifeline.close()  # else the end of this side would not be noticed
        answer = self._first_answer()
        if answer is None:
            self.close()
            raise ConfigError(f"ros2: its process ended, or did not answer within {START_S:g} s")
        failure = json.loads(answer).get("failed")
        if failure is not None:
            self.close()
            raise ConfigError(failure)
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
        self._lifeline.close()
        if self._process.pid is not None:
            self._process.join(END_S)
            if self._process.is_alive():
                self._process.kill()
                self._process.join()

    def wanted(self) -> OperatorInput | None:
        """Return the command that holds now, and a change of the reason to stop; None for neither."""
        now_ns = self._clock.now_ns()
        has_arrived = self._arrivals.look()
        silence = self._watch.check(now_ns)
        is_silent = self._watch.silent_ns > LOOKED_FOR_NS
        fixes = self._take_arrivals(is_silent=is_silent) if has_arrived or is_silent else ()
        reason = self._ended or silence or self._gate.stop_reason
        motion = self._gate.motion(now_ns)
        if reason == self._stop_reason:
            if motion is None and not fixes:
                return None
            if (motion, fixes) != (self._held.motion, self._held.fixes):
                self._held = OperatorInput(motion=motion, fixes=fixes)
            return self._held
        self._stop_reason = reason
        return OperatorInput(motion=motion, stop_reason=reason, fixes=fixes)

    def end(self) -> tuple[End, str] | None:
        """Return that the run ends where the process has ended; None to go on."""
        return (End.TERMINATED, self._ended) if self._ended else None

    def show(self, view: CycleView) -> None:
        """Take a cycle, and send its record."""
        now_ns = self._clock.now_ns()
        output, estimate = view.output, view.output.estimate
        is_at_rest = (
            not any(view.sent.speed_rad_s)
            and abs(estimate.yaw_rate_rad_s) < REST_RAD_S
            and math.hypot(estimate.velocity_x_m_s, estimate.velocity_y_m_s) < REST_M_S
        )
        self._gate.follow(now_ns, is_running=output.mode is Mode.RUNNING, is_at_rest=is_at_rest)
        if view.wanted is not None and view.wanted.is_paused is False:
            self._gate.resume()
        told = self._gate.state, self._gate.report_count, self._dropped
        if told != self._told:
            self._told = told
            self._extra = {"commands": told[0], **self._gate.reports, "records dropped": self._dropped}
        if not self._cycles.put(self._packer.pack(view, self._simulated_offset_ns(), self._extra)):
            self._packer.forget()
            self._dropped += 1

    def _first_answer(self) -> bytes | None:
        due_ns = self._clock.now_ns() + nanoseconds(START_S)
        is_awaited = True
        while is_awaited:
            now_ns = self._clock.now_ns()
            is_awaited = now_ns < due_ns and self._process.is_alive()
            answer = self._arrivals.take()  # after that: it may answer and end
            if answer is not None:
                return answer
            self._clock.sleep_until(now_ns + nanoseconds(LOOK_S))
        return None

    def _take_arrivals(self, *, is_silent: bool) -> tuple[PoseFixSample, ...]:
        """Take what has arrived; return the poses among it."""
        # A process that gives heartbeats need not be looked for, which calls the system.
        has_ended = is_silent and not self._process.is_alive()
        fixes: tuple[PoseFixSample, ...] = ()
        for _ in range(MOST_PER_CYCLE):
            data = self._arrivals.take()
            if data is None:
                if has_ended:
                    self._ended = self._ended or ENDED
                break
            try:
                content = json.loads(data)
                if "failed" in content:
                    self._ended = f"{ENDED}: {content['failed']}"
                    break
                item = _parse(content)
            except (ValueError, TypeError, KeyError):  # it parses untrusted bytes in C, and may be corrupted
                self._ended = f"{ENDED}: it sent what it never should"
                break
            if isinstance(item, Stop):
                self._gate.take_stop(item)
            elif isinstance(item, Command):
                self._gate.take(item)
            elif isinstance(item, Fix):
                fixes = (*fixes, item.sample(self._simulated_offset_ns()))
            else:
                self._gate.report(item)
        return fixes


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
    arrival_ns, earliest_ns = int(item["arrival_ns"]), int(item["earliest_ns"])
    return Command(str(item["writer"]), arrival_ns, earliest_ns, motion, stamp_ns)
