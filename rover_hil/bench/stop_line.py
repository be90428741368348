"""The connection of its own on which a page sends its emergency stops and shows that its browser is there.

It waits behind nothing else that the page loads. The browser itself answers the pings, also of a hidden tab
and while the page's script hangs. A browser that comes back sends its stops before it answers again, also
when its page was loaded again. Whoever answers may be in control, as long as one of its connections lasts.
"""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from fastapi import WebSocket, WebSocketDisconnect
from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame
from websockets.http11 import Request

from rover_hil.bench.session import Session

PING_PERIOD_S = 0.2
HELLO_S = 5.0
"""A connection whose page does not say which browser it is in for longer is closed."""
NOT_UNDERSTOOD = 1008
PINGS = "rover-hil pings"


class PingedWebSocket(WebSocketsSansIOProtocol):
    """A WebSocket whose application may send pings, and is told of what answers them."""

    def handle_connect(self, event: Request) -> None:
        """Offer pings to the application."""
        self.on_pong: Callable[[], None] = _nothing
        super().handle_connect(event)
        if self.handshake_initiated and not self.handshake_complete:
            self.scope["extensions"][PINGS] = {"socket": self}

    def handle_pong(self, event: Frame) -> None:
        """Tell the application."""
        super().handle_pong(event)
        self.on_pong()

    def ping(self) -> None:
        """Send a ping."""
        if not self.transport.is_closing():
            self.conn.send_ping(b"")
            self.transport.write(b"".join(self.conn.data_to_send()))


class Hello(BaseModel):
    """The first message: in which browser the page is."""

    model_config = ConfigDict(strict=True, extra="forbid")

    browser: str


class Press(BaseModel):
    """An emergency stop.

    Attributes:
        press: Number that the answer repeats.
        run: The run that the page showed; "" for none.
    """

    model_config = ConfigDict(strict=True, extra="forbid")

    press: int
    run: str


HELLO, PRESS = TypeAdapter(Hello), TypeAdapter(Press)


async def serve_line(socket: WebSocket, session: Session) -> None:
    """Serve one page's connection until it ends."""
    await socket.accept()
    try:
        hello = HELLO.validate_json(await asyncio.wait_for(socket.receive_text(), HELLO_S))
        session.enter(hello.browser)
        try:
            with _pinging(socket, lambda: session.answered(hello.browser)):
                await _serve_presses(socket, session)
        finally:
            session.leave(hello.browser)
    except (WebSocketDisconnect, TimeoutError):
        pass
    except (ValidationError, KeyError):  # the latter for bytes
        session.refuse()
        with suppress(WebSocketDisconnect, RuntimeError):
            await socket.close(NOT_UNDERSTOOD)


async def _serve_presses(socket: WebSocket, session: Session) -> None:
    while True:
        press = PRESS.validate_json(await socket.receive_text())
        answer, run = session.emergency_stop(press.run)
        await socket.send_json({"press": press.press, "answer": answer, "run": run})


@contextmanager
def _pinging(socket: WebSocket, on_pong: Callable[[], None]) -> Iterator[None]:
    pinged: PingedWebSocket = socket.scope["extensions"][PINGS]["socket"]
    pinged.on_pong = on_pong

    async def ping() -> None:
        while True:
            pinged.ping()
            await asyncio.sleep(PING_PERIOD_S)

    task = asyncio.create_task(ping())
    try:
        yield
    finally:
        pinged.on_pong = _nothing
        task.cancel()


def _nothing() -> None:
    pass
