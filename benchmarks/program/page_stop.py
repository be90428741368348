"""The emergency stop of the page, pressed in a real browser while the rover drives and something is broken.

    python -m benchmarks.program.page_stop [--times N] [--case NAME]

The rover is a simulated Robotino behind its ports (`rover-hil simulate`); the run is a real one. Time is from
the press until set-points of zero were sent for good, by the log: the last set-point that is not zero, and
the next message on the bus. Needs the extra `bench`, selenium, chromium and chromedriver.
"""

import argparse
import json
import signal
import socket
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from drivers.clock import SystemClock, nanoseconds, seconds
from rover_hil.recording.reader import LogReader
from tests.rover_hil.bench.browser import CONFIG, ENVIRONMENT, PROGRAM, WAIT_S, Page, served, write_config
from tests.rover_hil.bench.network import Network, port_of, through

BAR_S = 1.0
READERS = 300
OUTAGE_S = 5.0
PORTS = ("board", "imu")
MOVES = (
    "return live.last !== null && live.state.state === 'running' && live.last.set_rad_s.some((s) => s !== 0)"
)
ALARM = "const bar = document.getElementById('bench-alarm'); return bar.hidden ? '' : bar.textContent"
CLOCK = SystemClock()


@dataclass
class Bench:
    """What a case may break."""

    page: Page
    server: "subprocess.Popen[str]"
    network: Network
    readers: list[socket.socket]


@dataclass(frozen=True)
class Stop:
    """How a rover stopped.

    Attributes:
        to_zero_s: From the press to the last set-points being zero.
        reasons: Why the operator was lost before, in order.
        end: How the run ended.
        alarm: What the red bar said; "" where there was none.
    """

    to_zero_s: float
    reasons: tuple[str, ...]
    end: str
    alarm: str


def wait_s(duration_s: float) -> None:
    """Wait."""
    CLOCK.sleep_until(CLOCK.now_ns() + nanoseconds(duration_s))


def nothing(bench: Bench) -> None:
    """Nothing is broken."""


def stop_server(bench: Bench) -> None:
    """The program of the page hangs."""
    bench.server.send_signal(signal.SIGSTOP)


def kill_server(bench: Bench) -> None:
    """The program of the page is gone."""
    bench.server.kill()


def freeze_network(bench: Bench) -> None:
    """The network is gone."""
    bench.network.freeze()


def close_network(bench: Bench) -> None:
    """The tunnel is closed."""
    bench.network.close()


def reopen_network(bench: Bench) -> None:
    """The tunnel is made again."""
    bench.network.reopen()


def add_readers(bench: Bench) -> None:
    """Many ask for the stream and do not read it."""
    port = port_of(bench.page.url)
    for _ in range(READERS):
        reader = socket.create_connection(("127.0.0.1", port))
        reader.sendall(f"GET /stream HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n".encode())
        bench.readers.append(reader)
    wait_s(1.0)


def thaw_network(bench: Bench) -> None:
    """The network comes back."""
    bench.network.thaw()


def continue_server(bench: Bench) -> None:
    """The program goes on."""
    bench.server.send_signal(signal.SIGCONT)


CASES: dict[str, tuple[Callable[[Bench], None], float, Callable[[Bench], None]]] = {
    "nothing broken": (nothing, 0.0, nothing),
    "server stopped": (stop_server, OUTAGE_S, continue_server),
    "server killed": (kill_server, OUTAGE_S, nothing),
    "network gone": (freeze_network, OUTAGE_S, nothing),
    "network back": (freeze_network, OUTAGE_S, thaw_network),
    "tunnel closed": (close_network, OUTAGE_S, reopen_network),
    "300 readers": (add_readers, 0.0, nothing),
}
"""What breaks before the press, how long that lasts after it, and what is mended then."""


@contextmanager
def bench_of(folder: Path, stderr: TextIO | None = None) -> Iterator[Bench]:
    """Give a browser on the page of a rover behind its ports, through a network that can fail."""
    write_config(folder, length_m="9.0", width_m="4.0")
    with ExitStack() as stack:
        simulator = stack.enter_context(
            subprocess.Popen(
                [*PROGRAM, "simulate", CONFIG], cwd=folder, env=ENVIRONMENT, stdout=subprocess.DEVNULL
            )
        )
        stack.callback(simulator.send_signal, signal.SIGINT)
        deadline_ns = CLOCK.now_ns() + nanoseconds(WAIT_S)
        while not all((folder / "ports" / name).exists() for name in PORTS):
            assert CLOCK.now_ns() < deadline_ns, "the simulated rover has no ports"
            wait_s(0.05)
        url, server = stack.enter_context(served(folder, stderr=stderr))
        network = stack.enter_context(Network(port_of(url)))
        page = stack.enter_context(Page(through(network, url)))
        readers: list[socket.socket] = []
        yield Bench(page, server, network, readers)
        for reader in readers:
            reader.close()


def start_real_run(page: Page) -> None:
    """Start a real run and wait until the rover moves."""
    page.click("real rover")
    page.click("Arm")
    page.click("Start mission")
    page.wait(lambda: bool(page.driver.execute_script(MOVES)), "the rover does not move")


def stop_in(case: str, folder: Path) -> Stop:
    """Press the emergency stop of a rover that drives, in a case; return how it stopped."""
    destroy, lasting_s, mend = CASES[case]
    with bench_of(folder) as bench:
        page = bench.page
        start_real_run(page)
        destroy(bench)
        press_ns = CLOCK.now_ns()
        page.driver.execute_script("document.getElementById('bench-stop').click()")
        wait_s(lasting_s)
        alarm = str(page.driver.execute_script(ALARM))
        mend(bench)
        (path,) = folder.glob("runs/*/run.mcap")
        if case == "network gone":
            wait_s(1.0)  # nobody can end it
        else:
            wait_for_end(path)
        return Stop(seconds(zero_ns(path) - press_ns), *ended(path), alarm)


def wait_for_end(path: Path) -> None:
    """Wait until a log tells of the end of its run."""
    deadline_ns = CLOCK.now_ns() + nanoseconds(WAIT_S)
    while not any(message.topic == "/end" for message in LogReader(path).messages()):
        assert CLOCK.now_ns() < deadline_ns, "the run does not end"
        wait_s(0.5)


def ended(path: Path) -> tuple[tuple[str, ...], str]:
    """Return the reasons for which the operator was lost, in order, and how a run ended, by its log."""
    reasons, end = list[str](), "goes on"
    for message in LogReader(path).messages():
        if message.topic == "/operator" and (reason := json.loads(message.data)["stop_reason"]):
            reasons.append(reason)
        elif message.topic == "/end":
            end = json.loads(message.data)["reason"]
    return tuple(reasons), end


def zero_ns(path: Path) -> int:
    """Return when the set-points on the bus became zero for good, by the log of a real run."""
    moving_ns, sent_ns = 0, list[int]()
    for message in LogReader(path).messages():
        if message.topic == "/command" and any(json.loads(message.data)["speed_rad_s"]):
            moving_ns = message.t_ns
        elif message.topic.startswith("/sent/"):
            sent_ns.append(message.t_ns)
    return min(t_ns for t_ns in sent_ns if t_ns > moving_ns)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=1)
    parser.add_argument("--case", choices=CASES)
    options = parser.parse_args()
    failed = []
    for case in [options.case] if options.case else CASES:
        for _ in range(options.times):
            with tempfile.TemporaryDirectory() as name:
                stop = stop_in(case, Path(name))
            print(f"{case}: zero after {stop.to_zero_s:.3f} s, bar {BAR_S:g} s; {stop.end}")
            print(f"    stops before: {'; '.join(stop.reasons) or 'none'}")
            print(f"    red bar: {stop.alarm or 'none'}")
            if stop.to_zero_s > BAR_S:
                failed.append(case)
    assert not failed, failed


if __name__ == "__main__":
    main()
