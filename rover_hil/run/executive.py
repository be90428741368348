"""The cyclic executive: poll, step, command, record, at absolute deadlines."""

import math
import signal
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple, Protocol

from controllers.control_loop import StepOutput
from controllers.operator import OperatorInput
from controllers.safety import Mode
from drivers.clock import NANOSECONDS_PER_SECOND, nanoseconds, seconds, stopwatch_ns
from drivers.driver import DeviceState, Health
from drivers.safety_event import RESTART, Outcome, SafetyEvent
from drivers.samples import Sample, SentCommand
from rover_hil.recording.schema import COMMAND, CYCLE, OPERATOR, operator_record, set_point_record
from rover_hil.recording.writer import LogWriter
from rover_hil.run.composition import Rig
from rover_hil.run.end_signals import EndRequest
from sim_backends.world.plant import Truth

HEALTH_PERIOD_NS = NANOSECONDS_PER_SECOND
STATUS_PERIOD_NS = 100_000_000

EVENTS = (
    SafetyEvent(
        Outcome.ENDS,
        "The mission is done.",
        "`mission finished`, exit code 0",
        ("tests/rover_hil/test_virtual_run.py::test_the_rectangle_is_finished_and_the_wheels_stand",),
        within="one cycle",
    ),
    SafetyEvent(
        Outcome.ENDS,
        "The time limit or `--duration` is reached.",
        "`time over`, exit code 1 (0 for `--duration` while running)",
        ("tests/rover_hil/test_virtual_run.py::test_time_limit_ends_the_run",),
        within="one cycle",
    ),
    SafetyEvent(
        Outcome.ENDS,
        "A required device is given up (`reconnect_limit_s`).",
        "`device failed`, exit code 1; zero setpoints since the link broke",
        ("tests/rover_hil/test_executive.py::test_a_device_in_a_role_that_is_given_up_ends_the_run",),
        within="1 s",
        settings=("devices.NAME.reconnect_limit_s",),
        clears=RESTART,
    ),
    SafetyEvent(
        Outcome.ENDS,
        "ctrl-C.",
        "`stopped by user`, exit code 0",
        ("tests/rover_hil/test_executive.py::test_a_signal_ends_the_run_after_the_cycle",),
        within="one cycle",
    ),
    SafetyEvent(
        Outcome.ENDS,
        "SIGTERM, or the terminal is lost.",
        "`terminated`, exit code 1",
        ("tests/rover_hil/test_executive.py::test_a_signal_ends_the_run_after_the_cycle",),
        within="one cycle",
    ),
    SafetyEvent(
        Outcome.ENDS,
        "ctrl-C twice.",
        "no end in the log, exit code 130: the cycle is interrupted",
        (
            "tests/rover_hil/test_executive.py::"
            "test_a_second_signal_does_not_wait_for_the_cycle_but_the_drive_is_stopped",
        ),
        within="at once",
    ),
    SafetyEvent(
        Outcome.ENDS,
        "ctrl-C while the drive is being stopped.",
        "the end does not change; the stop is completed",
        ("tests/rover_hil/test_executive.py::test_no_signal_interrupts_the_stopping_of_the_drive",),
    ),
    SafetyEvent(
        Outcome.ENDS,
        "The disk is full, or the log cannot be written.",
        "no end in the log, exit code 2",
        ("tests/rover_hil/test_executive.py::test_when_the_log_cannot_be_written_all_wheels_are_stopped",),
        within="the same cycle",
        clears=RESTART,
    ),
    SafetyEvent(
        Outcome.ENDS,
        "The log is deleted while the rover drives.",
        "no end in the log, exit code 2",
        (
            "tests/rover_hil/test_executive.py::"
            "test_a_log_that_is_deleted_while_the_rover_drives_stops_all_wheels",
        ),
        within="1 s",
        clears=RESTART,
    ),
    SafetyEvent(
        Outcome.ENDS,
        "An error occurs inside the loop.",
        "no end in the log, traceback",
        ("tests/rover_hil/test_executive.py::test_an_error_inside_the_loop_stops_all_wheels",),
        within="the same cycle",
        clears=RESTART,
    ),
    SafetyEvent(
        Outcome.CONTINUES,
        "The disk of the log hangs.",
        "For two seconds records wait in memory. Then the loop waits, and the watchdog stops the "
        "drive, until the log is written again or the run is ended (ctrl-C, a signal, the "
        "page). The last line of the run reports how long.",
        ("tests/rover_hil/test_log.py::test_a_log_that_hangs_for_seconds_makes_the_loop_wait_and_says_so",),
    ),
)
"""Rows of the reference page of safety."""


class End(StrEnum):
    """Why a run ended."""

    FINISHED = "mission finished"
    TIME_OVER = "time over"
    STOPPED_BY_USER = "stopped by user"
    TERMINATED = "terminated"
    EMERGENCY_STOP = "emergency stop"
    DEVICE_FAILED = "device failed"


def end_by(number: signal.Signals) -> tuple[End, str]:
    """Return how and why a run ends at a signal: ctrl-C is the user's request, others come from outside."""
    if number == signal.SIGINT:
        return End.STOPPED_BY_USER, "stopped by the user"
    what = "the terminal or connection was lost" if number == signal.SIGHUP else "ended from outside"
    return End.TERMINATED, f"{what} ({number.name})"


@dataclass(slots=True)
class RunResult:
    """Outcome of a run.

    Attributes:
        end: Why it ended; None while it runs.
        reason: The same in words, with details.
        mode: Mode of the controller at the end.
        skipped: Cycles skipped because an earlier one took too long; they are not run later.
        log_pause_s: Longest time in which the log could not be written and made the loop wait.
    """

    end: End | None = None
    reason: str = ""
    mode: Mode | None = None
    cycles: int = 0
    skipped: int = 0
    duration_s: float = 0.0
    watchdog_interventions: int = 0
    log_pause_s: float = 0.0

    @property
    def has_lost_device(self) -> bool:
        """Whether a device was lost for good, or the rover was still stopped when its time was over."""
        was_stopped = self.end is End.TIME_OVER and self.mode is not Mode.RUNNING
        return was_stopped or self.end is End.DEVICE_FAILED


class CycleView(NamedTuple):
    """What an operator sees of a cycle.

    Attributes:
        healths: Facts of all devices, renewed once per second.
        late_ns: How late the cycle began.
        work_ns: Real time that it took until then.
        truth: True state of a simulated rover, or None.
        wanted: What was wanted from this cycle on by all who operate the run; None for no change.
    """

    samples: Sequence[Sample]
    output: StepOutput
    sent: SentCommand
    healths: Sequence[Health]
    late_ns: int
    work_ns: int
    truth: Truth | None = None
    wanted: OperatorInput | None = None


class Operator(Protocol):
    """Someone who watches and operates a run; neither method waits for anything."""

    def wanted(self) -> OperatorInput | None:
        """Return what is wanted from this cycle on; None for no change."""
        ...

    def end(self) -> tuple[End, str] | None:
        """Return how and why the run is to end; None to go on."""
        ...

    def show(self, view: CycleView) -> None:
        """Show a cycle that has just been run."""
        ...


class Watchdog(Protocol):
    """What stops the drive when the loop is silent."""

    def feed(self) -> None:
        """Report that the loop has commanded the drive."""
        ...

    def note_waiting(self) -> None:
        """Report that the loop waits for its log."""
        ...

    def has_stopped_drive(self) -> bool:
        """Return whether the drive was stopped since the last call."""
        ...

    def stop_reason(self, now_ns: int) -> str:
        """Return why the rover must rest for lack of a watchdog; "" for none."""
        ...


class Executive:
    """Runs the loop on any clock and any devices.

    Args:
        rig: Drivers and control loop, connected.
        log: Records every cycle.
        rate_hz: Cycles per second.
        on_cycle: Called at the end of each cycle, e.g. to record the truth of a simulated rover, which it
            returns for the operator.
        on_status: Called about ten times per second of real time, for a live display, also with the facts of
            all devices, renewed once per second.
        watchdog: Fed every cycle; None in simulated time, where the loop cannot hang unseen.
        operator: Operates the run; None where nobody does.
        end_request: Looked at in each cycle; None where no signal ends the run.
        longest_stop_s: The time is also over when a reason has kept the rover stopped for this long.
    """

    def __init__(
        self,
        rig: Rig,
        log: LogWriter,
        rate_hz: float,
        *,
        on_cycle: Callable[[int], Truth | None] | None = None,
        on_status: Callable[[StepOutput, Sequence[Health]], None] | None = None,
        watchdog: Watchdog | None = None,
        operator: Operator | None = None,
        end_request: EndRequest | None = None,
        longest_stop_s: float = math.inf,
    ) -> None:
        self._rig = rig
        self._longest_stop_s = longest_stop_s
        self._stopped_ns: int | None = None
        self._clock = rig.clock
        self._log = log
        self._period_ns = nanoseconds(1.0 / rate_hz)
        self._on_cycle = on_cycle
        self._on_status = on_status
        self._watchdog = watchdog
        self._operator = operator
        self._healths: Sequence[Health] = ()
        self._truth: Truth | None = None
        self._end_request = end_request or EndRequest()
        self._stop_request: tuple[End, str] | None = None
        self._interventions = 0
        self._operator_reason = self._watchdog_reason = ""
        if watchdog is not None:
            log.on_wait = watchdog.note_waiting

    def now_ns(self) -> int:
        """Return the time on the rig's clock."""
        return self._clock.now_ns()

    def run(self, duration_s: float) -> RunResult:
        """Run until the mission ends, a stop is final, or `duration_s` is over.

        The drive is commanded to stop however the run ends.
        """
        result = RunResult()
        start_ns = deadline_ns = self._clock.now_ns()
        end_ns = start_ns + nanoseconds(duration_s)
        next_health_ns = start_ns
        next_status_ns = 0
        try:
            while True:
                deadline_ns += self._period_ns
                self._clock.sleep_until(deadline_ns)
                woke_ns = stopwatch_ns()
                now_ns = self._clock.now_ns()
                late_ns = now_ns - deadline_ns
                if late_ns >= self._period_ns:
                    missed = late_ns // self._period_ns
                    result.skipped += missed
                    deadline_ns += missed * self._period_ns
                samples, output, sent, wanted = self._cycle(now_ns)
                if now_ns >= next_health_ns:
                    next_health_ns = now_ns + HEALTH_PERIOD_NS
                    self._check_health(now_ns)
                work_ns = stopwatch_ns() - woke_ns
                self._log.write_json(CYCLE, now_ns, {"late_ns": late_ns, "work_ns": work_ns})
                self._log.wait_while_disk_hangs(lambda: self._wanted_end() is not None)
                result.cycles += 1
                if self._operator is not None:
                    facts = self._healths, late_ns, work_ns, self._truth, wanted
                    self._operator.show(CycleView(samples, output, sent, *facts))
                is_due = woke_ns >= next_status_ns or output.checks is not None
                if self._on_status is not None and is_due:
                    next_status_ns = woke_ns + STATUS_PERIOD_NS
                    self._on_status(output, self._healths)
                if self._is_over(output, now_ns, end_ns, result):
                    break
        finally:
            self._end_request.shield()
            self._rig.drive.stop()
            self._log.health(self._clock.now_ns(), self._rig.healths())
        result.duration_s = seconds(now_ns - start_ns)
        result.log_pause_s = self._log.longest_pause_s
        result.watchdog_interventions = self._interventions
        return result

    def _cycle(self, now_ns: int) -> tuple[Sequence[Sample], StepOutput, SentCommand, OperatorInput | None]:
        if self._watchdog is not None and self._watchdog.has_stopped_drive():
            # The drive is started anew, as after a stop of its own: it is off, and the driver must know.
            self._interventions += 1
            self._log.watchdog(self._rig.drive.stop())
        wanted = self._wanted(now_ns)
        if wanted is not None:
            self._rig.loop.operate(now_ns, wanted)
            self._log.write_json(OPERATOR, now_ns, operator_record(wanted))
        samples, output, sent = self._rig.cycle(now_ns, () if wanted is None else wanted.fixes)
        if self._watchdog is not None:
            self._watchdog.feed()
        self._log.samples(now_ns, samples)
        self._log.estimate(output)
        self._log.write_json(COMMAND, sent.t_ns, set_point_record(sent))
        if self._on_cycle is not None:
            self._truth = self._on_cycle(now_ns)
        return samples, output, sent, wanted

    def _wanted(self, now_ns: int) -> OperatorInput | None:
        """Return what is wanted from this cycle on, by the operator and for lack of a watchdog."""
        wanted = None if self._operator is None else self._operator.wanted()
        reason = "" if self._watchdog is None else self._watchdog.stop_reason(now_ns)
        if wanted is not None and wanted.stop_reason is not None:
            self._operator_reason = wanted.stop_reason
        elif reason == self._watchdog_reason:
            return wanted
        self._watchdog_reason = reason
        return replace(wanted or OperatorInput(), stop_reason=reason or self._operator_reason)

    def _check_health(self, now_ns: int) -> None:
        self._log.require_file()
        healths = self._healths = self._rig.healths()
        self._log.health(now_ns, healths)
        for health in healths:
            if health.state is DeviceState.FAILED and health.device in self._rig.required:
                self._stop_request = (
                    End.DEVICE_FAILED,
                    f"device '{health.device}' has failed: {health.last_link_reason}",
                )

    def _wanted_end(self) -> tuple[End, str] | None:
        if self._operator is not None:
            self._stop_request = self._operator.end() or self._stop_request
        if self._end_request.number is not None:
            self._stop_request = end_by(self._end_request.number)
        return self._stop_request

    def _is_over(self, output: StepOutput, now_ns: int, end_ns: int, result: RunResult) -> bool:
        ended = end_by_controller(output) or self._wanted_end()
        if output.mode not in (Mode.SETTLING, Mode.SAFE_STOP) or not output.reason:
            self._stopped_ns = None
        elif self._stopped_ns is None:
            self._stopped_ns = now_ns
        is_stuck = self._stopped_ns is not None and seconds(now_ns - self._stopped_ns) >= self._longest_stop_s
        if ended is None and (now_ns >= end_ns or is_stuck):
            ended = end_by_time(output)
        if ended is not None:
            result.end, result.reason = ended
        result.mode = output.mode
        return result.end is not None


def end_by_controller(output: StepOutput) -> tuple[End, str] | None:
    """Return how and why a cycle ends the run; None where it goes on."""
    if output.mode is Mode.FINISHED:
        return End.FINISHED, "mission finished"
    return (End.EMERGENCY_STOP, output.reason) if output.mode is Mode.EMERGENCY_STOP else None


def end_by_time(output: StepOutput) -> tuple[End, str]:
    """Return how and why a run ends whose time is over in this cycle."""
    mode = output.mode.value.replace("_", " ")
    return End.TIME_OVER, f"time over in mode '{mode}'{': ' if output.reason else ''}{output.reason}"
