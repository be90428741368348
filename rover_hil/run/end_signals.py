"""The signals that end the program: a flag, and the places where the program obeys it.

An exception that a handler throws into library code may be swallowed there: pydantic does so while it builds
its models. Such a signal would be lost, and the rover would drive. While modules load and while a rover is
driven the handler therefore only sets a flag. The program looks at it before the drive opens and in each
cycle. Elsewhere the handler also ends the program by an exception, as Python does at ctrl-C; the flag stays,
and no drive begins after it.
"""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from drivers.safety_event import Outcome, SafetyEvent

EVENTS = (
    SafetyEvent(
        Outcome.ENDS,
        "SIGINT, SIGTERM or SIGHUP while the program starts, before a drive is opened.",
        "no end in the log, exit code 130 (ctrl-C) or 143; nothing was commanded, no log is left",
        ("tests/rover_hil/test_end_signals.py::test_a_signal_before_the_drive_opens_keeps_it_closed",),
        within="when the modules are loaded",
    ),
    SafetyEvent(
        Outcome.ENDS,
        "SIGINT, SIGTERM or SIGHUP after the last cycle, while the log is closed or the report is written.",
        "the end does not change; exit code 130 or 143",
        ("tests/rover_hil/test_end_signals.py::test_a_signal_after_the_last_cycle_is_not_lost",),
        within="at once",
    ),
)
"""Rows of the reference page of safety."""


class Terminated(BaseException):
    """SIGTERM, or the loss of the terminal or connection, ends the program; its text says which."""


def end_signals() -> tuple[signal.Signals, ...]:
    """Return what ends a run: ctrl-C, a request to end, and a lost terminal or network connection.

    Under nohup the last of them is ignored and stays so.
    """
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        return (signal.SIGINT, signal.SIGTERM)
    return (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class EndRequest:
    """The wish to end, by a signal.

    Attributes:
        number: The first signal that is not answered yet, or None.
    """

    def __init__(self) -> None:
        self.number: signal.Signals | None = None
        self._is_shielded = False

    def note(self, number: int, frame: FrameType | None = None) -> None:
        """Set the flag; a handler.

        Raises:
            KeyboardInterrupt: At the second signal, so that a cycle that hangs ends too; never while the
                drive is being stopped.
        """
        if self.number is not None and not self._is_shielded:
            raise KeyboardInterrupt
        self.number = self.number or signal.Signals(number)

    def obey_now(self, number: int, frame: FrameType | None = None) -> None:
        """Set the flag and end the program by an exception; a handler."""
        self.number = signal.Signals(number)
        self.obey()

    def obey(self) -> None:
        """Go on only where no signal came.

        Raises:
            KeyboardInterrupt: Ctrl-C came.
            Terminated: Another signal came.
        """
        if self.number == signal.SIGINT:
            raise KeyboardInterrupt
        if self.number == signal.SIGHUP:
            raise Terminated("the terminal or connection was lost (SIGHUP)")
        if self.number is not None:
            raise Terminated(f"ended by {self.number.name}")

    def shield(self) -> None:
        """From now on raise at no signal: the drive is being stopped."""
        self._is_shielded = True

    def answer(self) -> None:
        """Note that the signal has had its effect."""
        self.number = None
        self._is_shielded = False


END_REQUEST = EndRequest()
"""That of this process, as signals are."""


def take_signals() -> None:
    """Let the signals that end the program end it with a sentence, from the start of the program on."""
    for number in end_signals():
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, END_REQUEST.obey_now)


@contextmanager
def held_signals() -> Iterator[EndRequest]:
    """Only set the flag at a signal, and give it.

    A signal that is not answered within the block acts at its end; so does one that came before, and whose
    exception was swallowed.
    """
    previous = {number: signal.signal(number, END_REQUEST.note) for number in end_signals()}
    is_ended_well = False
    try:
        yield END_REQUEST
        is_ended_well = True
    finally:
        for each, handler in previous.items():
            signal.signal(each, handler)
        # After the handlers, so that a signal in between is not forgotten.
        number = END_REQUEST.number
        END_REQUEST.answer()
        if is_ended_well and number is not None:
            signal.raise_signal(number)
