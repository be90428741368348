"""The connection of the emergency stop: presses, questions to the page, limits, foreign words, the token."""

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import pytest

pytest.importorskip("nicegui", reason="the extra `bench` is not installed")

import httpx
import uvicorn
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from drivers.clock import SystemClock, nanoseconds
from rover_hil.bench import connection_limits
from rover_hil.bench import session as session_module
from rover_hil.bench.server import LIFE_PERIOD_S, bind, give_life, server_config
from rover_hil.bench.session import Kind, Session
from rover_hil.bench.views import Confirmation, EndOrder
from rover_hil.config import load_config
from tests.rover_hil.bench.application import TOKEN, new_application
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


def address(port: int, token: str = TOKEN) -> str:
    return f"ws://127.0.0.1:{port}/line?token={token}"


@asynccontextmanager
async def line_of(port: int, hello: object) -> AsyncIterator[ClientConnection]:
    async with connect(address(port), ping_interval=None) as line:
        await line.send(hello if isinstance(hello, str | bytes) else json.dumps(hello))
        yield line


def run(work: Callable[[], Awaitable[None]]) -> None:
    asyncio.run(asyncio.wait_for(work(), PATIENCE_S))


async def press(line: ClientConnection, number: int, run: str) -> dict[str, object]:
    await line.send(json.dumps({"press": number, "run": run}))
    while "ask" in (answer := await heard(line)):
        pass
    return answer


async def heard(line: ClientConnection) -> dict[str, object]:
    message: dict[str, object] = json.loads(await line.recv())
    return message


async def read_to_end(line: ClientConnection) -> None:
    while True:
        await line.recv()


async def answer_questions(line: ClientConnection) -> None:
    """Answer as the script of a page does, until the connection ends."""
    with suppress(ConnectionClosed):
        while True:
            message = await heard(line)
            if "ask" in message:
                await line.send(json.dumps({"answer": message["ask"]}))


@asynccontextmanager
async def answering(port: int, browser: str) -> AsyncIterator[ClientConnection]:
    async with line_of(port, {"browser": browser}) as line:
        task = asyncio.create_task(answer_questions(line))
        try:
            yield line
        finally:
            task.cancel()


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


def test_only_the_answers_of_the_page_in_control_are_its_heartbeat(session: Session) -> None:
    async def work() -> None:
        life = session._process.browser_life
        first = life.count
        async with served(session) as port:
            async with answering(port, "another"):
                await asyncio.sleep(0.5)
                assert life.count == first  # it is not in control
            async with answering(port, "a"):
                await until(lambda: life.count >= first + 3)
            await until(lambda: session.snapshot().controller is None)
            count = life.count
            await asyncio.sleep(0.5)
            assert life.count == count  # it is gone
            async with answering(port, "another"):
                await until(lambda: life.count > count)
            await until(lambda: session.snapshot().controller is None)

    run(work)


def test_a_page_whose_script_hangs_gives_no_heartbeat_though_its_browser_answers_pings(
    session: Session,
) -> None:
    async def work() -> None:
        life = session._process.browser_life
        first = life.count
        async with served(session) as port, line_of(port, {"browser": "a"}) as line, answering(port, "b"):
            await (await line.ping())  # as a browser answers them
            await asyncio.sleep(0.7)
            assert life.count == first

    run(work)


def test_an_answer_to_an_old_question_or_to_none_does_not_count(session: Session) -> None:
    """It may have waited in a network: a stop would be as late."""

    async def work() -> None:
        life = session._process.browser_life
        first = life.count
        async with served(session) as port, line_of(port, {"browser": "a"}) as line:
            old = (await heard(line))["ask"]
            assert old == 1
            await line.send(json.dumps({"answer": 99}))
            await asyncio.sleep(session.config.bench.page_timeout_s + 0.1)
            await line.send(json.dumps({"answer": old}))
            await press(line, 1, "")
            assert life.count == first
            asyncio.create_task(answer_questions(line))  # noqa: RUF006
            await until(lambda: life.count > first)

    run(work)


def test_a_confirmation_is_passed_on_from_the_page_in_control_only(session: Session) -> None:
    async def work() -> None:
        async with served(session) as port, answering(port, "a") as line, answering(port, "b") as watching:
            session.start("a", Kind.MISSION, is_real=False)
            await watching.send(json.dumps({"confirm": 2}))
            await line.send(json.dumps({"confirm": 3}))
            await until(lambda: FakeProcess.orders[1:] == [Confirmation(stops=3)])

    run(work)


def test_a_silent_connection_is_not_taken_for_a_page(session: Session) -> None:
    """Questions begin after the page has said who it is: a press that waits is sent before."""

    async def work() -> None:
        async with served(session) as port, connect(address(port), ping_interval=None) as line:
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(line.recv(), 0.5)

    run(work)


@pytest.mark.parametrize("token", ["", "another"])
def test_without_the_token_there_is_no_line_but_the_stop(session: Session, token: str) -> None:
    async def work() -> None:
        session.start("a", Kind.MISSION, is_real=False)
        async with served(session) as port:
            with pytest.raises(InvalidStatus):
                await connect(address(port, token))
            async with httpx.AsyncClient(base_url=f"http://localhost:{port}") as client:
                assert (await client.post("/stop")).json()["answer"] == "sent"
        assert isinstance(FakeProcess.orders[-1], EndOrder)

    run(work)


def test_a_line_that_is_renewed_gives_control_to_nobody_else(session: Session) -> None:
    async def work() -> None:
        async with served(session) as port, answering(port, "watching"):
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
        '{"answer": "1"}',
        '{"confirm": true}',
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
                await read_to_end(line)
            assert closed.value.rcvd is not None
            assert closed.value.rcvd.code == 1008
        assert session.snapshot().refused == 1
        assert len(FakeProcess.orders) == 1

    run(work)


def test_another_site_gets_no_connection(session: Session) -> None:
    async def work() -> None:
        async with served(session) as port:
            with pytest.raises(InvalidStatus):
                await connect(address(port), origin="http://evil.example")  # type: ignore[arg-type]

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


def test_an_event_loop_that_hangs_gives_no_heartbeat_and_tells_how_late_the_next_one_is(
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
