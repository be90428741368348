"""The server of the page: other origins, foreign names, pictures, ports."""

import asyncio
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("nicegui", reason="the extra `bench` is not installed")

import httpx

from drivers.errors import ConfigError
from rover_hil.bench import session as session_module
from rover_hil.bench.server import bind
from rover_hil.bench.session import Kind, Session
from rover_hil.bench.views import EndOrder
from rover_hil.config import load_config
from tests.rover_hil.bench.application import TOKEN, new_application
from tests.rover_hil.bench.test_session import FakeProcess

HOME = "http://localhost:8484"


class Client:
    """Asks the application without a network."""

    def __init__(self, session: Session) -> None:
        # Without its lifespan, which belongs to NiceGUI and may begin only once in a process.
        self._transport = httpx.ASGITransport(new_application(session))

    def request(self, method: str, path: str, **headers: str) -> httpx.Response:
        async def ask() -> httpx.Response:
            async with httpx.AsyncClient(transport=self._transport, base_url=HOME) as client:
                return await client.request(method, path, headers=headers)

        return asyncio.run(ask())

    def get(self, path: str) -> httpx.Response:
        return self.request("GET", path)


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Client, Session]]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(session_module, "LoopProcess", FakeProcess)
        session = Session(load_config("robotino"), tmp_path_factory.mktemp("runs"), "robotino", None, None)  # type: ignore[arg-type]
        yield Client(session), session


@pytest.mark.parametrize(
    "headers",
    [{"origin": "http://evil.example"}, {"origin": "http://localhost:9000"}, {"host": "evil.example:8484"}],
)
def test_another_origin_or_name_gets_nothing_and_orders_nothing(
    served: tuple[Client, Session], headers: dict[str, str]
) -> None:
    client, session = served
    session.answered("a")
    if session.snapshot().kind is None:
        session.start("a", Kind.MISSION, is_real=False)
    sent = len(FakeProcess.orders)
    for method, path in (("POST", "/stop"), ("GET", "/"), ("GET", "/stream"), ("GET", "/static/bench.js")):
        answer = client.request(method, path, **headers)
        assert answer.status_code == 403
        assert answer.text.startswith("refused: this page answers only to itself")
    assert len(FakeProcess.orders) == sent


def test_the_page_itself_stops_the_rover_and_may_load_from_nowhere_else(
    served: tuple[Client, Session],
) -> None:
    client, session = served
    session.answered("a")
    if session.snapshot().kind is None:
        session.start("a", Kind.MISSION, is_real=False)
    answer = client.request("POST", "/stop", origin=HOME)
    assert answer.json() == {"answer": "sent", "run": session.snapshot().run}
    assert isinstance(FakeProcess.orders[-1], EndOrder)
    assert "default-src 'self'" in answer.headers["content-security-policy"]
    assert "http" not in answer.headers["content-security-policy"]
    assert answer.headers["x-frame-options"] == "DENY"


def test_without_the_token_the_page_is_one_sentence(served: tuple[Client, Session]) -> None:
    client, _ = served
    for query in ("", "?token=another"):
        answer = client.get(f"/{query}")
        assert answer.status_code == 403
        assert answer.text.startswith("refused: this address lacks the token of the running bench")
        assert TOKEN not in answer.text


def test_what_needs_no_token_does_not_contain_it(served: tuple[Client, Session]) -> None:
    client, _ = served
    for path in ("/static/stop.js", "/static/bench.js", "/camera/none", "/report/none"):
        assert TOKEN not in client.get(path).text


def test_the_newest_picture_of_a_camera(served: tuple[Client, Session]) -> None:
    client, session = served
    assert client.get("/camera/rear").status_code == 404
    for jpeg in (b"first", b"second"):
        session._take({"kind": "picture", "camera": "rear", "words": "no trace", "jpeg": jpeg})
    assert client.get("/camera/rear").content == b"second"
    assert session.snapshot().pictures == {"rear": (2, "no trace")}


def test_only_the_files_of_the_page_are_served(served: tuple[Client, Session]) -> None:
    client, _ = served
    assert client.get("/static/bench.css").status_code == 200
    for path in ("/static/..%2fpage.py", "/static/page.py", "/report/..%2f..", "/report/unknown"):
        assert client.get(path).status_code == 404, path


def test_a_port_that_is_taken_is_one_sentence() -> None:
    with bind(0) as taken:
        taken.listen()
        port = taken.getsockname()[1]
        assert taken.getsockname()[0] == "127.0.0.1"
        with pytest.raises(ConfigError, match=f"port {port} cannot be used: .*choose another --port"):
            bind(port)


def test_the_page_is_on_this_computer_only() -> None:
    with bind(0) as listener:
        assert listener.family is socket.AF_INET
        assert listener.getsockname()[0] == "127.0.0.1"


def test_a_camera_is_shown_where_there_is_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session_module, "LoopProcess", FakeProcess)
    has_camera = {
        name: Session(load_config(name), tmp_path, name, None, None).has_camera()  # type: ignore[arg-type]
        for name in ("robotino", "el-dorado")
    }
    assert has_camera == {"robotino": False, "el-dorado": True}
