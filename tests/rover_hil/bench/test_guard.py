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

    scope = {"type": "websocket", "headers": [(b"host", b"localhost:8484"), (b"origin", origin)]}
    asyncio.run(Guard(page)(scope, receive, send))
    assert seen == (["websocket"] if allowed else [])
    assert sent == ([] if allowed else [{"type": "websocket.close", "code": 1008}])
