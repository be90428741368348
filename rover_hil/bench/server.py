"""Serves the page on this computer only."""

import asyncio
import socket
from collections.abc import AsyncIterator
from dataclasses import asdict
from pathlib import Path

import uvicorn
from fastapi import FastAPI
from fastapi.responses import FileResponse, JSONResponse, Response, StreamingResponse
from nicegui import ui

from drivers.errors import ConfigError
from rover_hil.bench.finished_runs import find_report
from rover_hil.bench.guard import Guard
from rover_hil.bench.page import build_page
from rover_hil.bench.session import Session
from rover_hil.pages.render import PLOT_SCRIPT
from rover_hil.recording.text import strict_json

HOST = "127.0.0.1"
STREAM_PERIOD_S = 0.04
VIEWS_AT_ONCE = 2400
"""A browser that was away for long gets the newest ones."""
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
    except OSError as error:
        listener.close()
        raise ConfigError(
            f"port {port} cannot be used: {error.strerror}; end the program that uses it, or choose another "
            "--port"
        ) from error
    return listener


def serve(session: Session, title: str, listener: socket.socket) -> None:
    """Serve the page until ctrl-C."""
    app = make_app(session, title)
    config = uvicorn.Config(
        app, log_level="error", timeout_graceful_shutdown=END_S, access_log=False, ws_max_size=1_000_000
    )
    uvicorn.Server(config).run(sockets=[listener])


def make_app(session: Session, title: str) -> Guard:
    """Return the application of a session."""
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)

    @app.post("/stop")
    async def stop() -> JSONResponse:
        session.emergency_stop()
        return JSONResponse({"stopped": True})

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
    ui.run_with(app, tailwind=False, show_welcome_message=False, message_history_length=0)
    return Guard(app)


async def _events(session: Session) -> AsyncIterator[str]:
    """Yield the state again and again; a browser that reads slowly gets fewer and newer views."""
    number = 0
    while True:
        now = session.snapshot(number, VIEWS_AT_ONCE)
        number = now.number
        yield f"data: {strict_json(asdict(now)).decode()}\n\n"
        await asyncio.sleep(STREAM_PERIOD_S)
