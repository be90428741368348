"""The program of the page when its terminal is lost, or what it reports leads nowhere."""

import signal
import socket
from contextlib import ExitStack
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from benchmarks.program.page_stop import bench_of, ended, start_real_run, wait_for_end
from rover_hil.console.exit_codes import EXIT_TERMINATED
from tests.rover_hil.bench.browser import WAIT_S, Page, served, write_config
from tests.rover_hil.bench.network import port_of

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]
FULL = Path("/dev/full")
READERS = 8
POLLING = "/_nicegui_ws/socket.io/?EIO=4&transport=polling"
ENDS = {
    signal.SIGHUP: (EXIT_TERMINATED, "rover-hil: the terminal or connection was lost (SIGHUP)\n"),
    signal.SIGTERM: (EXIT_TERMINATED, "rover-hil: ended by SIGTERM\n"),
    signal.SIGINT: (0, ""),
}


@pytest.mark.parametrize(
    "number",
    [pytest.param(n, marks=pytest.mark.nightly) if n == signal.SIGTERM else n for n in ENDS],
)
def test_the_program_ends_without_a_traceback_whoever_is_connected(
    number: signal.Signals, tmp_path: Path
) -> None:
    write_config(tmp_path)
    messages = tmp_path / "messages"
    with (
        messages.open("w") as stderr,
        served(tmp_path, stderr=stderr) as (url, process),
        Page(url),
        ExitStack() as stack,
    ):
        port, query = port_of(url), urlsplit(url).query
        paths = ("/static/stop.js", *["/stream"] * READERS, f"{POLLING}&{query}")
        for path in paths:  # none of them reads more than the begin of the answer
            reader = stack.enter_context(socket.create_connection(("127.0.0.1", port)))
            reader.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n".encode())
            assert b"HTTP/1.1" in reader.recv(4096)
        process.send_signal(number)
        assert (process.wait(WAIT_S), messages.read_text()) == ENDS[number]


def test_a_run_ends_with_the_terminal(tmp_path: Path) -> None:
    with bench_of(tmp_path) as bench:
        start_real_run(bench.page)
        bench.server.send_signal(signal.SIGHUP)
        assert bench.server.wait(WAIT_S) == EXIT_TERMINATED
    (path,) = tmp_path.glob("runs/*/run.mcap")
    assert ended(path)[1] == "the program of the page has ended"


@pytest.mark.skipif(not FULL.is_char_device(), reason="needs /dev/full")
def test_a_real_run_begins_where_nothing_can_be_reported(tmp_path: Path) -> None:
    with FULL.open("w") as stderr, bench_of(tmp_path, stderr) as bench:
        start_real_run(bench.page)
        bench.page.click("Stop")
        (path,) = tmp_path.glob("runs/*/run.mcap")
        wait_for_end(path)
    assert ended(path)[1] == "stopped by the user"
