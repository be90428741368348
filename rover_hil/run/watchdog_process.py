"""The loop's side of the watchdog: starts its process, gives it heartbeats, and looks after it."""

import json
import mmap
import os
import select
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Self

from drivers.clock import nanoseconds
from drivers.emergency_stop import EmergencyStop
from drivers.errors import RoverHilError
from drivers.safety_event import RESTART, Outcome, SafetyEvent
from rover_hil.run import watchdog_program as program
from rover_hil.run.heartbeat import LifeWatch

START_S = 10.0
"""Longest wait for an answer, on a loaded machine."""
SILENT_S = 0.5
"""The rover stops without a heartbeat of the watchdog for longer."""
PAUSE_S = 0.5
"""Between two attempts to start it again."""
RESTARTS = 3
"""How often a watchdog that has died is started again in a run."""

EVENTS = (
    SafetyEvent(
        Outcome.ENDS,
        "The program is killed or has crashed.",
        "no end in the log; the cause is in `run.watchdog.txt`, in the report and on the page. "
        "The watchdog stops the drive.",
        (
            "tests/rover_hil/test_watchdog_program.py::"
            "test_when_the_loop_is_killed_the_drive_is_stopped_at_once_and_the_cause_told",
        ),
        within="0.02 s",
        clears=RESTART,
    ),
    SafetyEvent(
        Outcome.ENDS,
        "The loop hangs in code that holds the interpreter's lock.",
        "no end in the log; the cause is in `run.watchdog.txt`, in the report and on the page. "
        "The watchdog stops the drive, and ends the program a second later.",
        (
            "tests/rover_hil/test_watchdog_process.py::"
            "test_a_loop_that_is_stuck_in_c_is_ended_and_the_cause_told",
        ),
        within="`expiry_s` + 0.02 s",
        settings=("expiry_s",),
        clears=RESTART,
    ),
    SafetyEvent(
        Outcome.ENDS,
        "The computer fails.",
        "no end in the log. Only the time-out of the drive stops the wheels: Robotino EA05 1.04 "
        "s, EA09 0.2 s, both simulated. Check the time-out of your drive.",
        ("tests/sim_backends/test_robotino_board.py::test_motors_stop_when_the_host_falls_silent",),
        clears=RESTART,
    ),
    SafetyEvent(
        Outcome.ENDS,
        "The watchdog cannot be started, gets no shared memory, or cannot open the port of the drive.",
        "no run, exit code 2; nothing was commanded",
        ("tests/rover_hil/test_watchdog_process.py::test_without_shared_memory_nothing_moves",),
        within="before the first motion",
        clears=RESTART,
    ),
    SafetyEvent(
        Outcome.CONTINUES,
        "The loop hangs for less than a second, or its process was stopped from outside.",
        "The watchdog stops the drive `expiry_s` + 0.02 s after the last cycle. Driving resumes "
        "with the loop.",
        (
            "tests/rover_hil/test_watchdog_program.py::"
            "test_a_silent_loop_s_drive_is_stopped_and_counted_and_watched_on",
        ),
        settings=("expiry_s",),
    ),
    SafetyEvent(
        Outcome.CONTINUES,
        "The watchdog dies or hangs.",
        "The rover is stationary until it is back. A watchdog that has died is started again, at "
        "most three times.",
        (
            "tests/rover_hil/test_watchdog.py::"
            "test_without_a_watchdog_the_rover_rests_and_goes_on_with_a_new_one",
        ),
    ),
)
"""Rows of the reference page of safety."""


class WatchdogError(RoverHilError, OSError):
    """The watchdog cannot be started, or could not stop the drive: the rover must not move."""


class WatchdogProcess:
    """A process that stops the drive when this one is silent, and ends it when it hangs.

    A context manager; it must be entered before a port is opened.

    Args:
        stop: How the drive is stopped.
        expiry_s: The drive is stopped this long after the last heartbeat.
        note: File that gets the cause when this process is ended; None for none.
    """

    def __init__(self, stop: EmergencyStop, expiry_s: float, note: Path | None = None) -> None:
        self._stop = stop
        self._silent_periods = max(1, round(expiry_s * 1000.0 / program.PERIOD_MS))
        self._note = note
        self._file = -1
        self._counts = memoryview(bytearray(program.PAGE_SIZE)).cast("Q")
        self._process: subprocess.Popen[bytes] | None = None
        self._life = LifeWatch(self, SILENT_S, f"watchdog: no heartbeat for {SILENT_S:g} s")
        self._lost: list[str] = []
        self._signs = self._waits = self._seen_stops = self._seen_beats = 0
        self._restarts_left = RESTARTS
        self._next_start_ns = 0

    def __enter__(self) -> Self:
        """Start the process.

        Raises:
            WatchdogError: There is no shared memory, or the process does not start.
        """
        try:
            self._file = os.memfd_create("rover_hil watchdog")
            os.truncate(self._file, program.PAGE_SIZE)
            self._counts = memoryview(mmap.mmap(self._file, program.PAGE_SIZE)).cast("Q")
        except (OSError, ValueError) as error:
            self.close()
            raise WatchdogError(
                f"the watchdog gets no shared memory ({error}): end other programs, or give this one more"
            ) from error
        try:
            self._spawn()
            answer = self._answer()
        except OSError as error:
            self.close()
            raise WatchdogError(
                f"the watchdog cannot be started ({error}): the rover must not move"
            ) from error
        if answer != program.READY:
            self.close()
            raise WatchdogError(f"the watchdog cannot be started ({answer}): the rover must not move")
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process; may be called again."""
        if self._process is not None:
            self._counts[program.STATE] = program.OVER
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(1.0)
            self._discard(self._process)
        if self._file >= 0:
            os.close(self._file)
            self._file = -1
            self._counts = memoryview(bytearray(self._counts)).cast("Q")  # lets go of the shared page

    @property
    def count(self) -> int:
        """Number of heartbeats of the process so far."""
        return self._counts[program.BEATS]

    def check_port(self) -> None:
        """Check that the process can open the port of the drive.

        Raises:
            WatchdogError: It cannot.
        """
        self._counts[program.STATE] = program.CHECKING
        answer = self._answer()
        if answer != program.READY:
            raise WatchdogError(f"the watchdog is not ready: {answer}; the rover must not move")

    def arm(self) -> None:
        """Watch from now on; the cause of an earlier end is forgotten."""
        if self._note is not None:
            self._note.unlink(missing_ok=True)
        self.feed()
        self._counts[program.STATE] = program.ARMED

    def rest(self) -> None:
        """Watch no longer: the drive has been stopped."""
        self._counts[program.STATE] = program.RESTING

    def feed(self) -> None:
        """Report that the loop has commanded the drive."""
        self._signs += 1
        self._counts[program.SIGNS] = self._signs

    def note_waiting(self) -> None:
        """Report that the loop waits on purpose: the drive is stopped, the loop is not ended."""
        self._waits += 1
        self._counts[program.WAITS] = self._waits

    def has_stopped_drive(self) -> bool:
        """Return whether the process has stopped the drive since the last call, also where it did again."""
        stops = self._counts[program.STOPS]
        has_stopped = stops != self._seen_stops
        self._seen_stops = stops
        return has_stopped

    def stop_reason(self, now_ns: int) -> str:
        """Return why the rover must rest at `now_ns` of the host's clock; "" where the watchdog lives.

        One that has died is started again, at most three times in a run.
        """
        reason = self._life.check(now_ns)
        count = self.count
        if count != self._seen_beats:
            self._seen_beats = count
            self._lost.clear()
        elif self._process is None:
            self._restart(now_ns)
        elif self._process.poll() is not None:
            self._lost.append(f"watchdog: its process has ended with code {self._process.returncode}")
            self._discard(self._process)
            self._restart(now_ns)
        return next(iter(self._lost), reason)

    def _restart(self, now_ns: int) -> None:
        """Start the process again, unless it was tried just now; the rover rests until it lives."""
        if self._restarts_left == 0 or now_ns < self._next_start_ns:
            return
        self._restarts_left -= 1
        self._next_start_ns = now_ns + nanoseconds(PAUSE_S)
        with suppress(OSError):
            self._spawn()

    def _spawn(self) -> None:
        loop = os.pidfd_open(os.getpid())
        try:
            order: program.Order = {
                "page": self._file,
                "loop": loop,
                "loop_id": os.getpid(),
                "silent_periods": self._silent_periods,
                "port": self._stop.port.kind.value,
                "path": self._stop.port.path,
                "baud_rate": self._stop.port.baud_rate,
                "payloads": [payload.hex() for payload in self._stop.payloads],
                "note": "" if self._note is None else str(self._note.absolute()),
            }
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-S", program.__file__, json.dumps(order)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=program.SCREEN,  # named, so that it passes also where it closes for other programs
                pass_fds=(self._file, loop),
                start_new_session=True,  # no key of a terminal stops or ends it
            )
        finally:
            os.close(loop)

    def _answer(self) -> str:
        """Return the next line of the process; what is wrong where there is none."""
        process = self._process
        if process is None or process.stdout is None:
            return "it has ended"
        ready, _, _ = select.select([process.stdout], [], [], START_S)
        if not ready:
            return f"no answer within {START_S:g} s"
        line = os.read(process.stdout.fileno(), 4096).decode(errors="replace").strip()
        return line or f"it has ended with code {process.wait()}"

    def _discard(self, process: "subprocess.Popen[bytes]") -> None:
        """Let go of the process, whatever it does."""
        self._process = None
        with process:
            process.kill()
