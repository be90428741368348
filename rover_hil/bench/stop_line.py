"""The separate connection on which a page sends its emergency stops and answers that its script runs.

It waits behind nothing else that the page loads. The server asks, the script of the page answers: the same
script handles the stop button and the keys, so that a page that answers can stop the rover. A hidden tab
answers too, because only its timers are slowed down. A page that comes back sends its stops before it answers
again, also when it was loaded again.
"""

import asyncio
from contextlib import suppress

from fastapi import WebSocket, WebSocketDisconnect
from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from drivers.clock import SystemClock, nanoseconds
from drivers.errors import ConfigError
from rover_hil.bench.session import Session

ASK_PERIOD_S = 0.1
"""At half of what is required, an answer that is late for lack of processor time is followed sooner."""
HELLO_S = 5.0
"""A connection whose page does not say which browser it is in for longer is closed."""
NOT_UNDERSTOOD = 1008


class Words(BaseModel):
    """A message of a page."""

    model_config = ConfigDict(strict=True, extra="forbid")


class Hello(Words):
    """The first message: in which browser the page is."""

    browser: str


class Answer(Words):
    """The script of the page runs.

    Attributes:
        answer: Number of the question.
    """

    answer: int


class Press(Words):
    """An emergency stop.

    Attributes:
        press: Number that the answer repeats.
        run: The run that the page showed; "" for none.
    """

    press: int
    run: str


class Confirm(Words):
    """The user has clicked that the stopped rover may move.

    Attributes:
        confirm: Number of stops that the page showed.
    """

    confirm: int


HELLO, WORDS = TypeAdapter(Hello), TypeAdapter[Answer | Press | Confirm](Answer | Press | Confirm)


class Questions:
    """The questions to one page that are not too old.

    An answer to an old one shows only that the script ran once: it may have waited in a network.

    Args:
        limit_s: Longest time between a question and an answer that counts.
    """

    def __init__(self, limit_s: float) -> None:
        self._limit_ns = nanoseconds(limit_s)
        self._asked_ns: dict[int, int] = {}
        self._number = 0

    def ask(self, now_ns: int) -> int:
        """Return the number of a new question."""
        self._number += 1
        self._asked_ns = {
            number: t_ns for number, t_ns in self._asked_ns.items() if self._is_new(t_ns, now_ns)
        }
        self._asked_ns[self._number] = now_ns
        return self._number

    def counts(self, number: int, now_ns: int) -> bool:
        """Return whether an answer to a question counts."""
        asked_ns = self._asked_ns.get(number)
        return asked_ns is not None and self._is_new(asked_ns, now_ns)

    def _is_new(self, asked_ns: int, now_ns: int) -> bool:
        return now_ns - asked_ns <= self._limit_ns


async def serve_line(socket: WebSocket, session: Session) -> None:
    """Serve one page's connection until it ends."""
    await socket.accept()
    try:
        hello = HELLO.validate_json(await asyncio.wait_for(socket.receive_text(), HELLO_S))
        session.enter(hello.browser)
        questions = Questions(session.config.bench.page_timeout_s)
        asking = asyncio.create_task(_ask(socket, questions))
        try:
            await _serve_words(socket, session, hello.browser, questions)
        finally:
            asking.cancel()
            session.leave(hello.browser)
    except (WebSocketDisconnect, TimeoutError):
        pass
    except (ValidationError, KeyError):  # the latter for bytes
        session.refuse()
        with suppress(WebSocketDisconnect, RuntimeError):
            await socket.close(NOT_UNDERSTOOD)


async def _serve_words(socket: WebSocket, session: Session, browser: str, questions: Questions) -> None:
    clock = SystemClock()
    while True:
        words = WORDS.validate_json(await socket.receive_text())
        if isinstance(words, Answer):
            if questions.counts(words.answer, clock.now_ns()):
                session.answered(browser)
        elif isinstance(words, Press):
            answer, run = session.emergency_stop(words.run)
            await socket.send_json({"press": words.press, "answer": answer, "run": run})
        else:
            with suppress(
                ConfigError
            ):  # not in control, or the loop hangs: the page goes on showing the stop
                session.confirm(browser, words.confirm)


async def _ask(socket: WebSocket, questions: Questions) -> None:
    clock = SystemClock()
    with suppress(WebSocketDisconnect, RuntimeError):  # it is closed
        while True:
            await socket.send_json({"ask": questions.ask(clock.now_ns())})
            await asyncio.sleep(ASK_PERIOD_S)
