"""The connection of the emergency stop: presses, pings, limits, foreign words."""

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

pytest.importorskip("nicegui", reason="the extra `bench` is not installed")

import uvicorn
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from drivers.clock import SystemClock, nanoseconds
from rover_hil.bench import connection_limits
from rover_hil.bench import session as session_module
from rover_hil.bench.server import LIFE_PERIOD_S, bind, give_life, server_config
from rover_hil.bench.session import Kind, Session
from rover_hil.bench.views import EndOrder
from rover_hil.config import load_config
from tests.rover_hil.bench.application import new_application
from tests.rover_hil.bench.test_session import FakeProcess

PATIENCE_S = 60.0


@pytest.fixture
def session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Session]:
    monkeypatch.setattr(session_module, "LoopProcess", FakeProcess)
    session = Session(load_config("robotino"), tmp_path, "robotino", None, None)  # type: ignore[arg-type]
    session.answered("a")
    yield session
    session.close()


@asynccontextmanager
async def served(session: Session) -> AsyncIterator[int]:
    """Serve a session in this event loop; give the port."""
    config = server_config(new_application(session))
    config.lifespan = "off"  # it belongs to NiceGUI and may begin only once in a process
    server = uvicorn.Server(config)
    with bind(0) as listener:
        task = asyncio.create_task(server.serve([listener]))
        while not server.started:
            await asyncio.sleep(0.01)
        try:
            yield listener.getsockname()[1]
        finally:
            server.should_exit = True
            await task


@asynccontextmanager
async def line_of(port: int, hello: object) -> AsyncIterator[ClientConnection]:
    async with connect(f"ws://127.0.0.1:{port}/line", ping_interval=None) as line:
        await line.send(hello if isinstance(hello, str | bytes) else json.dumps(hello))
        yield line


def run(work: Callable[[], Awaitable[None]]) -> None:
    asyncio.run(asyncio.wait_for(work(), PATIENCE_S))


async def press(line: ClientConnection, number: int, run: str) -> dict[str, object]:
    await line.send(json.dumps({"press": number, "run": run}))
    answer: dict[str, object] = json.loads(await line.recv())
    return answer


async def until(condition: Callable[[], bool]) -> None:
    while not condition():
        await asyncio.sleep(0.01)


def test_a_press_is_ordered_once_and_answered_each_time(session: Session) -> None:
    async def work() -> None:
        async with served(session) as port, line_of(port, {"browser": "watching"}) as line:
            session.start("a", Kind.MISSION, is_real=False)
            name = session.snapshot().run
            for number in (1, 2):
                answer = await press(line, number, name)
                assert answer == {"press": number, "answer": "sent", "run": name}
            session._take({"kind": "ended", "reason": "emergency stop"})
            assert (await press(line, 3, name))["answer"] == "ended"
        assert [type(order) for order in FakeProcess.orders[1:]] == [EndOrder]

    run(work)


def test_a_browser_answers_pings_without_a_word_of_its_script(session: Session) -> None:
    async def work() -> None:
        life = session._process.browser_life
        first = life.count
        async with served(session) as port:
            async with line_of(port, {"browser": "another"}):
                await asyncio.sleep(0.5)
                assert life.count == first  # it is not in control
            async with line_of(port, {"browser": "a"}):
                await until(lambda: life.count >= first + 3)
            await until(lambda: session.snapshot().controller is None)
            count = life.count
            await asyncio.sleep(0.5)
            assert life.count == count  # it is gone
            async with line_of(port, {"browser": "another"}):
                await until(lambda: life.count > count)
            await until(lambda: session.snapshot().controller is None)

    run(work)


def test_a_silent_connection_is_not_taken_for_a_browser(session: Session) -> None:
    """Pings begin after the page has said who it is: a press that waits is sent before."""

    async def work() -> None:
        life = session._process.browser_life
        first = life.count
        async with served(session) as port, connect(f"ws://127.0.0.1:{port}/line", ping_interval=None):
            await asyncio.sleep(0.5)
        assert life.count == first

    run(work)


def test_a_line_that_is_renewed_gives_control_to_nobody_else(session: Session) -> None:
    async def work() -> None:
        async with served(session) as port, line_of(port, {"browser": "watching"}):
            async with line_of(port, {"browser": "a"}) as old, line_of(port, {"browser": "a"}) as new:
                await press(new, 1, "")  # both have said hello
                await press(old, 1, "")
                session.arm("a")
                await old.close()
                await asyncio.sleep(0.5)
                assert session.snapshot().controller == "a"
                assert session.snapshot().is_armed
            await until(lambda: session.snapshot().controller == "watching")

    run(work)


@pytest.mark.parametrize(
    "words",
    [
        "",
        "[]",
        "nan",
        b"\x00",
        '{"press": "1", "run": ""}',
        '{"press": 1}',
        '{"browser": 1}',
        '{"press": 1, "run": NaN}',
    ],
)
@pytest.mark.parametrize("is_first", [True, False])
def test_foreign_words_are_refused_and_counted_and_stop_nothing(
    session: Session, words: str | bytes, is_first: bool
) -> None:
    async def work() -> None:
        session.start("a", Kind.MISSION, is_real=False)
        async with served(session) as port, line_of(port, words if is_first else {"browser": "a"}) as line:
            if not is_first:
                await line.send(words)
            with pytest.raises(ConnectionClosed) as closed:
                await line.recv()
            assert closed.value.rcvd is not None
            assert closed.value.rcvd.code == 1008
        assert session.snapshot().refused == 1
        assert len(FakeProcess.orders) == 1

    run(work)


def test_another_site_gets_no_connection(session: Session) -> None:
    async def work() -> None:
        async with served(session) as port:
            with pytest.raises(InvalidStatus):
                await connect(f"ws://127.0.0.1:{port}/line", origin="http://evil.example")  # type: ignore[arg-type]

    run(work)


def test_many_who_read_the_stream_or_not_leave_room_for_the_stop(session: Session) -> None:
    async def work() -> None:
        async with served(session) as port, line_of(port, {"browser": "a"}) as line:
            session.start("a", Kind.MISSION, is_real=False)
            readers, answers = [], []
            for _ in range(300):
                reader, writer = await asyncio.open_connection("127.0.0.1", port)
                writer.write(f"GET /stream HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n".encode())
                readers.append(writer)
                answers.append(int((await reader.readline()).split()[1]))
            assert answers.count(200) == connection_limits.MOST_OF_A_KIND["/stream"]
            assert set(answers) == {200, 503}
            assert (await press(line, 1, session.snapshot().run))["answer"] == "sent"
            async with line_of(port, {"browser": "b"}) as second:
                assert (await press(second, 1, session.snapshot().run))["answer"] == "sent"
            for writer in readers:
                writer.transport.abort()
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            await asyncio.sleep(0.3)
            writer.write(f"GET /stream HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n".encode())
            assert b"200" in await reader.readline()  # those that are gone do not count
            writer.transport.abort()

    run(work)


def test_connections_are_limited_and_those_in_use_are_kept(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection_limits, "MOST_CONNECTIONS", 5)

    async def work() -> None:
        async with served(session) as port, line_of(port, {"browser": "a"}) as line:
            session.start("a", Kind.MISSION, is_real=False)
            silent = [await asyncio.open_connection("127.0.0.1", port) for _ in range(8)]
            await until(lambda: [is_cut_off(reader) for reader, _ in silent] == [True] * 4 + [False] * 4)
            assert (await press(line, 1, session.snapshot().run))["answer"] == "sent"
            async with line_of(port, {"browser": "b"}) as second:
                assert (await press(second, 1, session.snapshot().run))["answer"] == "sent"
            for _, writer in silent:
                writer.transport.abort()

    run(work)


def test_one_connection_too_many_is_cut_off_where_all_are_in_use(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection_limits, "MOST_CONNECTIONS", 2)

    async def work() -> None:
        hello = {"browser": "a"}
        async with served(session) as port, line_of(port, hello), line_of(port, hello):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            await until(lambda: is_cut_off(reader))
            writer.transport.abort()

    run(work)


def is_cut_off(reader: asyncio.StreamReader) -> bool:
    return reader.at_eof() or reader.exception() is not None


def test_an_event_loop_that_hangs_gives_no_sign_of_life_and_tells_how_late_the_next_one_is(
    session: Session,
) -> None:
    async def work() -> None:
        life = session._process.server_life
        task = asyncio.create_task(give_life(session))
        await until(lambda: life.count >= 3)
        clock, count = SystemClock(), life.count
        clock.sleep_until(clock.now_ns() + nanoseconds(0.3))  # not asyncio's: nothing else runs
        assert life.count == count
        await until(lambda: life.count > count)
        assert session.snapshot().server_late_ms >= 1000 * (0.3 - LIFE_PERIOD_S) - 1
        task.cancel()

    run(work)
