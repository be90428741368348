"""The page answers only to itself."""

import pytest

pytest.importorskip("starlette", reason="the extra `bench` is not installed")

import asyncio

from starlette.datastructures import Headers
from starlette.types import Message, Receive, Scope, Send

from rover_hil.bench.guard import Guard, is_allowed


@pytest.mark.parametrize(
    ("headers", "allowed"),
    [
        ({"host": "localhost:8484"}, True),
        ({"host": "127.0.0.1:8484", "origin": "http://127.0.0.1:8484"}, True),
        ({"host": "[::1]:8484", "origin": "http://[::1]:8484"}, True),
        ({"host": "localhost:9000", "origin": "http://localhost:9000"}, True),  # through an ssh tunnel
        ({"host": "localhost:8484", "origin": "http://localhost:9000"}, False),
        ({"host": "localhost:8484", "origin": "http://evil.example"}, False),
        ({"host": "localhost:8484", "origin": "null"}, False),
        ({"host": "rover.example:8484", "origin": "http://rover.example:8484"}, False),
        ({"host": "localhost.evil.example"}, False),
        ({"host": "[oh"}, False),
        ({}, False),
    ],
)
def test_requests_of_other_origins_and_names_are_refused(headers: dict[str, str], allowed: bool) -> None:
    assert is_allowed(Headers(headers)) is allowed


@pytest.mark.parametrize(
    ("origin", "allowed"), [(b"http://localhost:8484", True), (b"http://evil.example", False)]
)
def test_a_web_socket_of_another_origin_is_closed_before_the_page_sees_it(
    origin: bytes, allowed: bool
) -> None:
    seen: list[str] = []
    sent: list[Message] = []

    async def page(scope: Scope, receive: Receive, send: Send) -> None:
        seen.append(scope["type"])

    async def receive() -> Message:
        return {"type": "websocket.connect"}

    async def send(message: Message) -> None:
        sent.append(message)

    headers = [(b"host", b"localhost:8484"), (b"origin", origin)]
    scope = {"type": "websocket", "path": "/line", "query_string": b"token=right", "headers": headers}
    asyncio.run(Guard(page, "right")(scope, receive, send))
    assert seen == (["websocket"] if allowed else [])
    assert sent == ([] if allowed else [{"type": "websocket.close", "code": 1008}])


@pytest.mark.parametrize(
    ("kind", "method", "path", "query", "answer"),
    [
        ("http", "POST", "/stop", "", "page"),
        ("http", "POST", "/stop", "run=some", "page"),
        ("http", "GET", "/stop", "", "refused"),
        ("http", "GET", "/stream", "", "page"),
        ("http", "HEAD", "/static/bench.js", "", "page"),
        ("http", "GET", "/_nicegui/3/static/nicegui.js", "", "page"),
        ("http", "POST", "/_nicegui/client/upload", "", "refused"),
        ("http", "PUT", "/stop", "", "refused"),
        ("http", "GET", "/", "", "refused"),
        ("http", "GET", "/", "token=wrong", "refused"),
        ("http", "GET", "/", "token=righ", "refused"),
        ("http", "GET", "/", "token=", "refused"),
        ("http", "GET", "/", "token=wrong&token=right", "refused"),
        ("http", "GET", "/", "token=r%C3%AFght", "refused"),
        ("http", "GET", "/", "token=right", "page"),
        ("http", "GET", "/", "a=b&token=right", "page"),
        ("http", "POST", "/_nicegui_ws/socket.io/", "EIO=4&transport=polling", "refused"),
        ("http", "POST", "/_nicegui_ws/socket.io/", "EIO=4&transport=polling&token=right", "page"),
        ("websocket", "", "/line", "", "refused"),
        ("websocket", "", "/stream", "", "refused"),
        ("websocket", "", "/_nicegui_ws/socket.io/", "client_id=known", "refused"),
        ("websocket", "", "/_nicegui_ws/socket.io/", "token=right", "page"),
    ],
)
def test_what_can_drive_needs_the_token_and_the_stop_does_not(
    kind: str, method: str, path: str, query: str, answer: str
) -> None:
    seen: list[str] = []
    sent: list[Message] = []

    async def page(scope: Scope, receive: Receive, send: Send) -> None:
        seen.append(scope["path"])

    async def receive() -> Message:
        return {"type": "http.request"}

    async def send(message: Message) -> None:
        sent.append(message)

    scope = {
        "type": kind,
        "method": method,
        "path": path,
        "query_string": query.encode(),
        "headers": [(b"host", b"localhost:8484")],
    }
    asyncio.run(Guard(page, "right")(scope, receive, send))
    assert seen == ([path] if answer == "page" else [])
    if answer == "refused" and kind == "http":
        assert sent[0]["status"] == 403
        assert b"open the address that `rover-hil bench` printed" in sent[1]["body"]
    elif answer == "refused":
        assert sent == [{"type": "websocket.close", "code": 1008}]
