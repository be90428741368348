"""The page answers only to itself."""

import pytest

pytest.importorskip("starlette", reason="the extra `bench` is not installed")

from starlette.datastructures import Headers

from rover_hil.bench.guard import is_allowed


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
