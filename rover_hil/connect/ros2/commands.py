"""Which of the commands that arrive over the network moves the rover, and what stops it.

Everything here is about who may move the rover and when. It runs in the process of the loop: a process of
ROS 2 that dies, hangs or is fed with nonsense cannot release a stop.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

from controllers.motion.body_motion import BodyMotion
from drivers.clock import NANOSECONDS_PER_SECOND, nanoseconds

REST: BodyMotion = (0.0, 0.0, 0.0)
FASTEST_MEMORY_NS = 60 * NANOSECONDS_PER_SECOND
"""How late a stamp is counts against the fastest command of this time: clocks of computers differ."""
MOST_WRITERS = 64
"""Writers of stops that are remembered; a stop of one more still stops the rover."""
MOST_STAMPS = 64
STOPPED = "emergency stop on the topic emergency_stop, by {}"
NEEDS_ZERO = "released: waiting for a zero command, then a new one"
NO_COMMANDS = "no command"


class Command(NamedTuple):
    """A velocity that has arrived.

    Attributes:
        writer: Who sent it.
        arrival_ns: Real monotonic time at which it was found to have arrived on this computer.
        earliest_ns: The look before, which did not find it: it may have arrived since then, where the process
            of ROS 2 had to wait for the processor.
        motion: Forward and to the left in m/s, counter-clockwise in rad/s.
        stamp_ns: The sender's time; None for one without.
    """

    writer: str
    arrival_ns: int
    earliest_ns: int
    motion: BodyMotion
    stamp_ns: int | None = None


class Stop(NamedTuple):
    """A message on the topic of emergency stops.

    Attributes:
        writer: Who sent it.
        stamp_ns: When it was sent, by the sender's clock.
        is_pressed: True stops, false releases.
    """

    writer: str
    stamp_ns: int
    is_pressed: bool


@dataclass(slots=True)
class _Stamps:
    """Stamps of one writer's commands: how late the fastest of a minute was, and the newest one."""

    fastest: deque[tuple[int, int]] = field(default_factory=deque)
    newest_ns: int = 0

    def is_late(self, arrival_ns: int, stamp_ns: int, limit_ns: int) -> bool:
        """Take a stamp; return whether its command is too late, or older than the newest one."""
        delay_ns = arrival_ns - stamp_ns
        while self.fastest and self.fastest[0][0] < arrival_ns - FASTEST_MEMORY_NS:
            self.fastest.popleft()
        while self.fastest and self.fastest[-1][1] >= delay_ns:
            self.fastest.pop()
        self.fastest.append((arrival_ns, delay_ns))
        if delay_ns - self.fastest[0][1] > limit_ns:
            return True
        is_overtaken = stamp_ns < self.newest_ns and self.newest_ns - stamp_ns <= limit_ns
        self.newest_ns = self.newest_ns if is_overtaken else stamp_ns
        return is_overtaken


class CommandGate:
    """Follows the newest command of one writer while the rover may move.

    - A command holds for a time after its earliest possible arrival, whatever its stamp says.
    - The first writer is followed until its commands have expired; others are reported.
    - A command with a number that is not finite is rest.
    - After any stop, pause or timeout only a command that arrives later moves the rover.
    - A true on the topic of emergency stops latches. A false of the same writer releases it, at rest only.
      Then a zero command is needed, then a new one. A writer that disappears releases nothing.
    - Who operates the run on its page releases all of them by resuming it, at rest only.

    Args:
        timeout_s: How long a command holds.
        is_listening: Whether commands drive the rover; stops count in any case.

    Attributes:
        state: What is followed, or why nothing is; it changes once per event, not per cycle.
        report_count: How many reports there were.
    """

    def __init__(self, timeout_s: float, *, is_listening: bool = True) -> None:
        self._timeout_ns = nanoseconds(timeout_s)
        self._is_listening = is_listening
        self._command: Command | None = None
        self._holder: Command | None = None
        self._valid_from_ns = 0
        self._is_running = self._is_at_rest = False
        self._needs_zero = self._is_driving = False
        self._stamps: dict[str, _Stamps] = {}
        self._latched: dict[str, None] = {}
        self._heard: dict[str, deque[Stop]] = {}
        self._reports: dict[str, int] = {}
        self.report_count = 0
        self.state = NO_COMMANDS if is_listening else ""

    @property
    def stop_reason(self) -> str:
        """Why the rover must rest; empty where nobody has pressed."""
        return STOPPED.format(next(iter(self._latched))) if self._latched else ""

    @property
    def reports(self) -> dict[str, int]:
        """How often something was wrong with what arrived, by its description."""
        return dict(self._reports)

    def follow(self, now_ns: int, *, is_running: bool, is_at_rest: bool) -> None:
        """Take the state of the rover after a cycle.

        Args:
            now_ns: Real monotonic time.
            is_running: Whether the rover may move.
            is_at_rest: Whether it rests, as commanded.
        """
        self._is_running, self._is_at_rest = is_running, is_at_rest
        if not is_running:
            self._valid_from_ns = now_ns
            if self._command is not None:
                self._command = None
                self.state = "the rover was stopped: waiting for a later command"

    def take_stop(self, stop: Stop) -> None:
        """Take a message on the topic of emergency stops.

        Two readers may both get it: one that was taken before has no effect, so that a press that comes late
        by one of them cannot undo a release, nor the other way round.
        """
        heard = self._heard.get(stop.writer)
        if heard is None and len(self._heard) < MOST_WRITERS:
            heard = self._heard[stop.writer] = deque(maxlen=MOST_STAMPS)
        if heard is not None and stop in heard:
            return
        newest_ns = max((each.stamp_ns for each in heard), default=-1) if heard else -1
        if heard is not None:
            heard.append(stop)
        if stop.is_pressed:
            # Dictionaries keep their order: the first one is named.
            self._latched[stop.writer if heard is not None else "one of many"] = None
            self._needs_zero = True
            self._command = None
        elif stop.writer in self._latched:
            if stop.stamp_ns <= newest_ns:
                self.report("releases of a stop that are older than it")
            elif not self._is_at_rest:
                self.report("releases of a stop while the rover moved")
            else:
                del self._latched[stop.writer]
                if not self._latched:
                    self.state = NEEDS_ZERO

    def resume(self) -> None:
        """Release all stops, by someone who sees the rover and resumes the run; at rest only."""
        if not self._latched:
            return
        if not self._is_at_rest:
            self.report("releases of a stop while the rover moved")
            return
        self._latched.clear()
        self.state = NEEDS_ZERO

    def take(self, command: Command) -> None:
        """Take a command, in the order of arrival."""
        if not self._is_listening:
            return
        if not self._is_of_holder(command) or self._is_late(command):
            return
        if not all(map(math.isfinite, command.motion)):
            self.report("commands with numbers that are not finite, taken as rest")
            command = command._replace(motion=REST)
        self._holder = command
        if self._latched or not self._is_running or command.earliest_ns <= self._valid_from_ns:
            return
        if self._needs_zero:
            if any(command.motion):
                self.state = NEEDS_ZERO
                return
            self._needs_zero = False
        self._command = command
        self.state = f"following {command.writer}"

    def motion(self, now_ns: int) -> BodyMotion | None:
        """Return the velocity to be driven now: once rest after the last command, then None."""
        if self._command is not None and now_ns - self._command.earliest_ns >= self._timeout_ns:
            self._command = None
            self.state = f"no command for {self._timeout_ns / NANOSECONDS_PER_SECOND:g} s: at rest"
        was_driving, self._is_driving = self._is_driving, self._command is not None
        if self._command is not None:
            return self._command.motion
        return REST if was_driving else None

    def _is_of_holder(self, command: Command) -> bool:
        holder = self._holder
        if holder is None or holder.writer == command.writer:
            return True
        if command.arrival_ns - holder.arrival_ns >= self._timeout_ns:
            return True
        self.report(f"commands of {command.writer} while {holder.writer} was followed")
        return False

    def _is_late(self, command: Command) -> bool:
        if command.stamp_ns is None:
            return False
        if command.writer not in self._stamps:
            if len(self._stamps) >= MOST_WRITERS:
                self._stamps.clear()
            self._stamps[command.writer] = _Stamps()
        is_late = self._stamps[command.writer].is_late(command.arrival_ns, command.stamp_ns, self._timeout_ns)
        if is_late:
            self.report("commands that came late or out of order")
        return is_late

    def report(self, words: str) -> None:
        """Count something that was wrong with what arrived."""
        self.report_count += 1
        if words in self._reports or len(self._reports) < MOST_WRITERS:
            self._reports[words] = self._reports.get(words, 0) + 1
