"""Which of the commands that arrive over the network moves the rover, and what stops it.

Everything here is about who may move the rover and when. It runs in the process of the loop: a process of
ROS 2 that dies, hangs or is fed with nonsense cannot release a stop.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import NamedTuple

from controllers.motion.body_motion import BodyMotion
from drivers.clock import NANOSECONDS_PER_SECOND, nanoseconds
from drivers.safety_event import Outcome, SafetyEvent

REST: BodyMotion = (0.0, 0.0, 0.0)
FASTEST_MEMORY_NS = 60 * NANOSECONDS_PER_SECOND
"""How late a stamp is counts against the fastest command of this time: clocks of computers differ."""
STEPPED_NS = 5 * NANOSECONDS_PER_SECOND
"""How long the stamps of a clock that was set must fit each other before they count. It exceeds the longest
`command_timeout_s`: the rover is stationary, and what a network delivers in disorder has arrived."""
MOST_WRITERS = 64
"""Writers of stops that are remembered; a stop of one more still stops the rover."""
MOST_STAMPS = 64
STOPPED = "emergency stop on the topic emergency_stop, by {}"
NEEDS_ZERO = "released: waiting for a zero command, then a new one"
NO_COMMANDS = "no command"

EVENTS = (
    SafetyEvent(
        Outcome.STOPS,
        "An emergency stop arrives over ROS 2.",
        "`emergency stop on the topic emergency_stop, by …`",
        (
            "tests/rover_hil/connect/test_commands.py::"
            "test_a_press_stops_and_only_release_zero_and_a_new_command_move_again",
            "tests/rover_hil/connect/test_ros2_run.py::test_an_emergency_stop_latches_also_before_the_run",
        ),
        within="one cycle after its arrival",
        clears="after its release by the same sender, a zero command, and a new command",
    ),
    SafetyEvent(
        Outcome.STOPS,
        "The clock of the sender of stamped commands is set back.",
        "state of the commands: `steps of the clock of …`",
        (
            "tests/rover_hil/connect/test_commands.py::"
            "test_after_a_step_back_of_the_senders_clock_its_commands_count_again_in_5_s",
        ),
        within="`command_timeout_s`",
        settings=("ros2.command_timeout_s",),
        clears="commands count again 5 s after the step",
    ),
)
"""Rows of the reference page of safety."""


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


class _Order(Enum):
    """What the stamp of a command says about it."""

    TIMELY = auto()
    LATE = auto()
    STEPPED = auto()


@dataclass(slots=True)
class _NewTime:
    """Stamps of one writer that do not fit its time until then, but each other."""

    since_ns: int
    arrival_ns: int
    delay_ns: int
    stamp_ns: int

    def continues(self, arrival_ns: int, stamp_ns: int, limit_ns: int) -> bool:
        """Take a stamp; return whether it is the next one of the same clock."""
        is_next = (
            arrival_ns - self.arrival_ns <= limit_ns
            and abs(arrival_ns - stamp_ns - self.delay_ns) <= limit_ns
            and stamp_ns >= self.stamp_ns
        )
        self.arrival_ns, self.stamp_ns = arrival_ns, stamp_ns
        return is_next


@dataclass(slots=True)
class _Stamps:
    """Stamps of one writer's commands, by the delay of the fastest command of a minute.

    A clock that is set back makes all commands late. Its new time counts once its stamps have gone back and
    then increased with the arrivals for `STEPPED_NS`, without one of the time before. The stamps of a slow
    network do not go back: its commands stay late until the fast ones are forgotten.
    """

    fastest: deque[tuple[int, int]] = field(default_factory=deque)
    newest_ns: int = 0
    former_ns: int = 0
    """The newest stamp before the clock was set: up to here a stamp of the future is an old one."""
    new_time: _NewTime | None = None

    def judge(self, arrival_ns: int, stamp_ns: int, limit_ns: int) -> _Order:
        """Take a stamp; return whether its command counts.

        Args:
            arrival_ns: Monotonic time of the arrival.
            stamp_ns: Time of the sender's clock.
            limit_ns: Greatest delay, compared with the fastest command.

        Returns:
            LATE for a command that is too late or older than the newest one; STEPPED for the last one that
            does not count before those of a clock that was set do.
        """
        delay_ns = arrival_ns - stamp_ns
        before_ns = self.fastest[0][1] if self.fastest else delay_ns
        while self.fastest and self.fastest[0][0] < arrival_ns - FASTEST_MEMORY_NS:
            self.fastest.popleft()
        is_former = stamp_ns <= self.former_ns and before_ns - delay_ns > limit_ns
        if not is_former:
            while self.fastest and self.fastest[-1][1] >= delay_ns:
                self.fastest.pop()
            self.fastest.append((arrival_ns, delay_ns))
            if self.fastest[0][1] - before_ns > limit_ns:
                return self._step(arrival_ns, stamp_ns)
        if is_former or delay_ns - self.fastest[0][1] > limit_ns:
            return self._judge_untimely(arrival_ns, stamp_ns, limit_ns, is_former=is_former)
        self.new_time = None
        is_overtaken = stamp_ns < self.newest_ns and self.newest_ns - stamp_ns <= limit_ns
        self.newest_ns = self.newest_ns if is_overtaken else stamp_ns
        return _Order.LATE if is_overtaken else _Order.TIMELY

    def _judge_untimely(self, arrival_ns: int, stamp_ns: int, limit_ns: int, *, is_former: bool) -> _Order:
        if self.new_time is not None and self.new_time.continues(arrival_ns, stamp_ns, limit_ns):
            if arrival_ns - self.new_time.since_ns < STEPPED_NS:
                return _Order.LATE
            return self._step(arrival_ns, stamp_ns)
        delay_ns = arrival_ns - stamp_ns
        has_gone_back = is_former or self.newest_ns - stamp_ns > limit_ns
        self.new_time = _NewTime(arrival_ns, arrival_ns, delay_ns, stamp_ns) if has_gone_back else None
        return _Order.LATE

    def _step(self, arrival_ns: int, stamp_ns: int) -> _Order:
        self.former_ns = max(self.former_ns, self.newest_ns)
        self.fastest = deque([(arrival_ns, arrival_ns - stamp_ns)])
        self.newest_ns, self.new_time = stamp_ns, None
        return _Order.STEPPED


class CommandGate:
    """Follows the newest command of one writer while the rover may move.

    - A command holds for a time after its earliest possible arrival, whatever its stamp says.
    - The first writer is followed until its commands have expired; others are reported.
    - A command with a number that is not finite is rest.
    - A command that is late by its stamp is ignored. A sender's clock that was set back is reported, and its
      later commands count after `STEPPED_NS`.
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
        order = self._stamps[command.writer].judge(command.arrival_ns, command.stamp_ns, self._timeout_ns)
        if order is _Order.LATE:
            self.report("commands that came late or out of order")
        if order is _Order.STEPPED:
            self.report(f"steps of the clock of {command.writer}: its later commands count by its new time")
            self._command = None
            self._valid_from_ns = max(self._valid_from_ns, command.arrival_ns)
        return order is not _Order.TIMELY

    def report(self, words: str) -> None:
        """Count something that was wrong with what arrived."""
        self.report_count += 1
        if words in self._reports or len(self._reports) < MOST_WRITERS:
            self._reports[words] = self._reports.get(words, 0) + 1
