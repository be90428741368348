"""Limits on connections, so that none takes the time or the files that the emergency stop needs."""

import asyncio
import itertools
from collections import Counter
from typing import Any, cast

from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

MOST_CONNECTIONS = 400
"""Of all kinds; the usual limit of open files of a program is 1024."""
MOST_OF_A_KIND = {"/stream": 16, "/line": 64, "/_nicegui_ws/socket.io/": 16}
REFUSED = "refused: this computer already serves as many pages as it may; close another one\n"
TRY_LATER = 1013


class BoundedHttp(HttpToolsProtocol):
    """Connections of uvicorn, up to a number.

    One too many takes the place of the oldest that has asked for nothing; where there is none, it is cut off.
    """

    _counter = itertools.count()

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a connection."""
        self.number = next(self._counter)
        is_one_too_many = len(self.connections) >= MOST_CONNECTIONS
        others = [connection for connection in self.connections if isinstance(connection, BoundedHttp)]
        silent = [connection for connection in others if cast("object | None", connection.cycle) is None]
        super().connection_made(transport)
        if is_one_too_many:
            min(silent, key=lambda connection: connection.number, default=self).transport.abort()


class ConnectionLimits:
    """Refuses what stays open, beyond a number of each kind.

    Args:
        app: The application behind.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._open: Counter[str] = Counter()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request or WebSocket."""
        path: Any = scope.get("path")
        most = MOST_OF_A_KIND.get(path)
        if most is None:
            await self._app(scope, receive, send)
        elif self._open[path] < most:
            self._open[path] += 1
            try:
                await self._app(scope, receive, send)
            finally:
                self._open[path] -= 1
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": TRY_LATER})
        else:
            await PlainTextResponse(REFUSED, 503, {"Connection": "close"})(scope, receive, send)
