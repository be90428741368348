"""Serves the page on this computer only."""

import asyncio
import gc
import signal
import socket
from collections.abc import AsyncIterator
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from types import FrameType

import uvicorn
from fastapi import FastAPI, WebSocket
from fastapi.responses import FileResponse, JSONResponse, Response, StreamingResponse
from nicegui import app as nicegui_app
from nicegui import ui
from starlette.types import ASGIApp

from drivers.clock import SystemClock, nanoseconds
from drivers.errors import ConfigError
from rover_hil.bench.connection_limits import BoundedHttp, ConnectionLimits
from rover_hil.bench.finished_runs import find_report
from rover_hil.bench.guard import QUERY_KEY, Guard
from rover_hil.bench.page import build_page
from rover_hil.bench.session import Session
from rover_hil.bench.stop_line import serve_line
from rover_hil.pages.render import PLOT_SCRIPT
from rover_hil.recording.text import strict_json
from rover_hil.run.end_signals import END_REQUEST, end_signals

HOST = "127.0.0.1"
STREAM_PERIOD_S = 0.04
VIEWS_AT_ONCE = 200
"""A browser that begins or was away gets those that are kept in pieces: none holds up the emergency stop."""
LIFE_PERIOD_S = 0.02
FILES_PERIOD_S = 0.5
END_S = 1
STATIC = Path(__file__).parent / "static"
FILES = {path.name: path for path in (*STATIC.iterdir(), PLOT_SCRIPT)}


def bind(port: int) -> socket.socket:
    """Return a socket that listens on this computer only.

    Raises:
        ConfigError: The port cannot be used.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((HOST, port))
        listener.listen()  # a browser that is faster than the server waits
    except OSError as error:
        listener.close()
        raise ConfigError(
            f"port {port} cannot be used: {error.strerror}; "
            "end the program that uses it, or choose another --port"
        ) from error
    return listener


class Server(uvicorn.Server):
    """A server that ends although pages are open."""

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Cut off who is still connected: a stream has no end for which uvicorn could wait."""
        for connection in list(self.server_state.connections):
            connection.transport.abort()
        await asyncio.sleep(0.0)  # each stream and socket now learns that its browser is gone
        await super().shutdown(sockets)


def serve(session: Session, title: str, listener: socket.socket, token: str) -> None:
    """Serve the page, with a token in its address, until a signal ends the program.

    Raises:
        KeyboardInterrupt: Ctrl-C came.
        Terminated: Another signal came.
    """
    config = server_config(make_app(session, title, token))
    server = Server(config)

    def note(number: int, frame: FrameType | None) -> None:
        if END_REQUEST.number is None:
            END_REQUEST.note(number)
        server.should_exit = True

    async def serve_and_give_life() -> None:
        tasks = [asyncio.create_task(give_life(session)), asyncio.create_task(_look_at_files(session))]
        try:
            await server.serve([listener])
        finally:
            for task in tasks:
                task.cancel()

    # An exception of a handler would be lost in the event loop.
    previous = {number: signal.signal(number, note) for number in end_signals()}
    try:
        END_REQUEST.obey()
        gc.collect()
        # Else each full collection would look at all of the page's libraries again, for tens of ms.
        gc.freeze()
        with asyncio.Runner(loop_factory=config.get_loop_factory()) as runner:
            runner.run(serve_and_give_life())
    finally:
        for each, handler in previous.items():
            signal.signal(each, handler)
    END_REQUEST.obey()


def server_config(app: ASGIApp) -> uvicorn.Config:
    """Return how the page is served: with a limited number of connections."""
    return uvicorn.Config(
        app,
        http=BoundedHttp,
        ws="websockets-sansio",
        log_level="error",
        timeout_graceful_shutdown=END_S,
        access_log=False,
        ws_max_size=1_000_000,
    )


async def give_life(session: Session) -> None:
    """Give heartbeats for ever, from the event loop that calls this: a loop that hangs gives none."""
    clock = SystemClock()
    while True:
        due_ns = clock.now_ns() + nanoseconds(LIFE_PERIOD_S)
        await asyncio.sleep(LIFE_PERIOD_S)
        session.give_life(clock.now_ns() - due_ns)


async def _look_at_files(session: Session) -> None:
    """Look at the disk again and again, on a thread: it may hang."""
    while True:
        with suppress(OSError):
            await asyncio.to_thread(session.look_at_files)
        await asyncio.sleep(FILES_PERIOD_S)


def make_app(session: Session, title: str, token: str) -> ASGIApp:
    """Return the application of a session, with a token in the address of its page."""
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)

    @app.post("/stop")
    async def stop(run: str | None = None) -> JSONResponse:
        """For a page whose line is not open, and for other programs."""
        answer, present = session.emergency_stop(run)
        return JSONResponse({"answer": answer, "run": present})

    @app.websocket("/line")
    async def line(socket: WebSocket) -> None:
        await serve_line(socket, session)

    @app.get("/stream")
    async def stream() -> StreamingResponse:
        return StreamingResponse(_events(session), media_type="text/event-stream")

    @app.get("/camera/{name}")
    async def camera(name: str) -> Response:
        jpeg = session.picture(name)
        if jpeg is None:
            return Response("there is no picture of this camera yet", 404)
        return Response(jpeg, media_type="image/jpeg", headers={"Cache-Control": "no-store"})

    @app.get("/static/{name}")
    async def static(name: str) -> Response:
        return FileResponse(FILES[name]) if name in FILES else Response(status_code=404)

    @app.get("/report/{name}")
    async def report(name: str) -> Response:
        path = find_report(session.folder, name)
        return Response("there is no report of this run", 404) if path is None else FileResponse(path)

    build_page(session, title)
    nicegui_app.config.socket_io_js_query_params[QUERY_KEY] = token
    ui.run_with(app, tailwind=False, show_welcome_message=False, message_history_length=0)
    return Guard(ConnectionLimits(app), token)


async def _events(session: Session) -> AsyncIterator[bytes]:
    """Yield the state again and again; a browser that reads slowly gets it less often."""
    number = 0
    while True:
        number, views = session.views(number, VIEWS_AT_ONCE)
        state = strict_json(asdict(session.snapshot()))
        yield b'data: {"views":[%b],%b\n\n' % (b",".join(views), state[1:])
        await asyncio.sleep(STREAM_PERIOD_S)
