"""The stops of the page in a real browser while the rover drives: pressed, also with a fault, and by a loss.

    python -m benchmarks.program.page_stop [--times N] [--case NAME]

The rover is a simulated Robotino behind its ports (`rover-hil simulate`); the run is a real one. Time is from
the press until setpoints of zero were sent for good, by the log: the last setpoint that is not zero, and
the next message on the bus. Page, network or server are also lost and come back; seconds later the user
clicks that the rover may move. There time is from the loss until the last setpoint that is not zero and
until the last wheel that turns, before that click. Needs the extra `bench`, selenium, chromium and
chromedriver.
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
from urllib.request import Request, urlopen

from drivers.clock import SystemClock, nanoseconds, seconds
from rover_hil.bench.session import LOG_NAME
from rover_hil.recording.reader import LogReader
from tests.rover_hil.bench.browser import CONFIG, ENVIRONMENT, PROGRAM, WAIT_S, Page, served, write_config
from tests.rover_hil.bench.network import Network, port_of, through

BAR_S = 1.0
PRESS_BAR_S = 0.3
"""Where nothing is broken."""
READERS = 300
OUTAGE_S = 5.0
AGAIN_S = 3.0
"""After so long the user clicks again where the page still asks."""
BACK_S = 3.0
"""So long nothing may move after what was lost is back."""
TURNING_RAD_S = 0.2
"""A wheel that is faster turns: 8 mm/s."""
PORTS = ("board", "imu")
MOVES = (
    "return live.last !== null && live.state.state === 'running' && live.last.set_rad_s.some((s) => s !== 0)"
)
HANG = (
    "const end = performance.now() + 1000 * arguments[0]; "
    "setTimeout(() => { while (performance.now() < end); })"
)
CLICK = "document.getElementById('bench-stop').click()"
ESCAPE = "document.body.dispatchEvent(new KeyboardEvent('keydown', { code: 'Escape', bubbles: true }))"
ALARM = "const bar = document.getElementById('bench-alarm'); return bar.hidden ? '' : bar.textContent"
CLOCK = SystemClock()


@dataclass
class Bench:
    """What a case may break."""

    page: Page
    server: "subprocess.Popen[str]"
    port: int
    network: Network
    readers: list[socket.socket]


@dataclass(frozen=True)
class Loss:
    """How a rover stopped after a loss, until the user clicked that it may move again.

    Attributes:
        to_zero_s: From the loss to the last setpoint that is not zero.
        to_rest_s: From the loss until the last wheel turned.
        reason: Why the rover waited, by the page.
        clicks: Number of confirmations until the rover moved: more than one where the page was lost again.
    """

    to_zero_s: float
    to_rest_s: float
    reason: str
    clicks: int


@dataclass(frozen=True)
class Stop:
    """How a rover stopped.

    Attributes:
        to_zero_s: From the press to the last setpoints being zero.
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
    for _ in range(READERS):
        reader = socket.create_connection(("127.0.0.1", bench.network.port))
        reader.sendall(b"GET /stream HTTP/1.1\r\nHost: localhost\r\n\r\n")
        bench.readers.append(reader)
    wait_s(1.0)


def thaw_network(bench: Bench) -> None:
    """The network comes back."""
    bench.network.thaw()


def continue_server(bench: Bench) -> None:
    """The program goes on."""
    bench.server.send_signal(signal.SIGCONT)


def hang_script(bench: Bench) -> None:
    """The script of the page hangs."""
    bench.page.driver.execute_script(HANG, OUTAGE_S)


def load_again(bench: Bench) -> None:
    """The page is loaded again."""
    bench.page.driver.refresh()


def keep_browser(page: Page) -> None:
    """Open an empty tab behind that of the page: without any tab the browser would end."""
    own = page.driver.current_window_handle
    page.driver.switch_to.new_window("tab")
    page.driver.switch_to.window(own)


def close_page(bench: Bench) -> None:
    """The tab of the page is closed; the browser stays."""
    driver = bench.page.driver
    driver.close()
    driver.switch_to.window(driver.window_handles[0])


def open_page(bench: Bench) -> None:
    """The page is opened again."""
    bench.page.driver.switch_to.new_window("tab")
    bench.page.driver.get(bench.page.url)


LOSSES: dict[str, tuple[Callable[[Bench], None], Callable[[Bench], None]]] = {
    "script hung": (hang_script, nothing),
    "server stopped": (stop_server, continue_server),
    "network gone": (freeze_network, thaw_network),
    "tunnel closed": (close_network, reopen_network),
    "page loaded again": (load_again, nothing),
    "page closed": (close_page, open_page),
}
"""What is lost, and how it comes back."""


def press_button(bench: Bench) -> None:
    """Click the button."""
    bench.page.driver.execute_script(CLICK)


def press_escape(bench: Bench) -> None:
    """Press the Escape key."""
    bench.page.driver.execute_script(ESCAPE)


def post(bench: Bench) -> None:
    """Let another program stop the rover; it does not know the token."""
    urlopen(Request(f"http://127.0.0.1:{bench.port}/stop", method="POST"), timeout=WAIT_S).close()


PRESSES = {"button": press_button, "Escape": press_escape, "plain POST": post}
CASES: dict[str, tuple[Callable[[Bench], None], float, Callable[[Bench], None]]] = {
    "nothing broken": (nothing, 0.0, nothing),
    "server stopped": (stop_server, OUTAGE_S, continue_server),
    "server killed": (kill_server, OUTAGE_S, nothing),
    "network gone": (freeze_network, OUTAGE_S, nothing),
    "network back": (freeze_network, OUTAGE_S, thaw_network),
    "tunnel closed": (close_network, OUTAGE_S, reopen_network),
    "300 readers": (add_readers, 0.0, nothing),
}
"""What breaks before the press, how long that lasts after it, and what is restored then."""


@contextmanager
def bench_of(folder: Path, stderr: TextIO | None = None) -> Iterator[Bench]:
    """Give a browser on the page of a rover behind its ports, through a network that can fail."""
    write_config(folder, length_m="9.0", width_m="4.0", time_limit_s="600")
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
        yield Bench(page, server, port_of(url), network, readers)
        for reader in readers:
            reader.close()


def start_real_run(page: Page) -> None:
    """Start a real run and wait until the rover moves."""
    page.click("real rover")
    page.click("Arm")
    page.click("Start mission")
    page.wait(lambda: bool(page.driver.execute_script(MOVES)), "the rover does not move")


def stop_by(press: str, folder: Path) -> Stop:
    """Stop a rover that drives while nothing is broken; return how it stopped."""
    with bench_of(folder) as bench:
        start_real_run(bench.page)
        press_ns = CLOCK.now_ns()
        PRESSES[press](bench)
        (path,) = folder.glob("runs/*/run.mcap")
        wait_for_end(path)
        return Stop(seconds(zero_ns(path) - press_ns), *ended(path), "")


def losses_in(case: str, folder: Path, times: int) -> Iterator[Loss]:
    """Lose something in each of so many runs, let it come back and confirm; give how the rover stopped."""
    lose, mend = LOSSES[case]
    with bench_of(folder) as bench:
        page = bench.page
        keep_browser(page)
        for _ in range(times):
            before = set(folder.glob("runs/*"))
            start_real_run(page)
            lost_ns = CLOCK.now_ns()
            lose(bench)
            wait_s(OUTAGE_S)
            mend(bench)
            reason = wait_until_asked(page)
            wait_s(BACK_S)
            click_ns = CLOCK.now_ns()
            clicks = confirm_until_it_moves(page)
            page.click("Stop")
            page.wait(lambda: page.mode == "idle", "the run does not end")
            (run,) = set(folder.glob("runs/*")) - before
            yield Loss(*motion_s(run / LOG_NAME, lost_ns, click_ns), reason, clicks)


def confirm_until_it_moves(page: Page) -> int:
    """Confirm until the rover moves, again where the page asks again; return the number of clicks."""
    clicks, next_ns = 0, 0

    def moves() -> bool:
        nonlocal clicks, next_ns
        if page.driver.execute_script(MOVES):
            return True
        if CLOCK.now_ns() >= next_ns and page.driver.find_element("id", "bench-confirm").is_displayed():
            page.confirm()
            clicks, next_ns = clicks + 1, CLOCK.now_ns() + nanoseconds(AGAIN_S)
        return False

    page.wait(moves, "the rover does not move again")
    return clicks


def wait_until_asked(page: Page) -> str:
    """Wait until the page asks whether the rover may move, after taking control where it must; return why."""
    page.wait(lambda: bool(page.driver.execute_script("return live.last?.waits_for_operator")), "no question")
    if not page.driver.find_element("id", "bench-confirm").is_displayed():
        page.click("Take control")
        page.wait(page.driver.find_element("id", "bench-confirm").is_displayed, "no button")
    return page.text("bench-why")


def motion_s(path: Path, begin_ns: int, end_ns: int) -> tuple[float, float]:
    """Return when in a span the last setpoint was not zero and the last wheel turned, from its begin."""
    set_ns = turned_ns = begin_ns
    for message in LogReader(path).messages():
        if not begin_ns < message.t_ns < end_ns:
            continue
        if message.topic == "/command" and any(json.loads(message.data)["speed_rad_s"]):
            set_ns = message.t_ns
        elif message.topic == "/samples":
            for wheel in json.loads(message.data).get("WheelSample", ()):
                if abs(wheel["speed_rad_s"]) > TURNING_RAD_S:
                    turned_ns = max(turned_ns, min(wheel["t_ns"], end_ns))
    return seconds(set_ns - begin_ns), seconds(turned_ns - begin_ns)


def stop_in(case: str, folder: Path) -> Stop:
    """Press the emergency stop of a rover that drives, in a case; return how it stopped."""
    destroy, lasting_s, mend = CASES[case]
    with bench_of(folder) as bench:
        page = bench.page
        start_real_run(page)
        destroy(bench)
        press_ns = CLOCK.now_ns()
        press_button(bench)
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
    """Wait until a log states the end of its run."""
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
    """Return when the setpoints on the bus became zero for good, by the log of a real run."""
    moving_ns, sent_ns = 0, list[int]()
    for message in LogReader(path).messages():
        if message.topic == "/command" and any(json.loads(message.data)["speed_rad_s"]):
            moving_ns = message.t_ns
        elif message.topic.startswith("/sent/"):
            sent_ns.append(message.t_ns)
    return min(t_ns for t_ns in sent_ns if t_ns > moving_ns)


def report_stop(case: str, stop: Stop, bar_s: float) -> bool:
    """Print how a rover stopped; return whether that is within the bar."""
    print(f"{case}: zero after {stop.to_zero_s:.3f} s, bar {bar_s:g} s; {stop.end}")
    print(f"    stops before: {'; '.join(stop.reasons) or 'none'}")
    print(f"    red bar: {stop.alarm or 'none'}", flush=True)
    return stop.to_zero_s <= bar_s


def report_loss(case: str, loss: Loss) -> bool:
    """Print how a rover stopped after a loss; return whether that is within the bar."""
    print(
        f"{case}, and back: zero after {loss.to_zero_s:.3f} s, at rest after {loss.to_rest_s:.3f} s, "
        f"bar {BAR_S:g} s; {loss.clicks} click\n    {loss.reason}",
        flush=True,
    )
    return loss.to_rest_s <= BAR_S


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=1)
    parser.add_argument("--case", choices=(*PRESSES, *(f"{case}, and back" for case in LOSSES), *CASES))
    options = parser.parse_args()

    def chosen(name: str) -> bool:
        return options.case in (None, name)

    are_good = list[bool]()
    for ways, stop, bar_s in ((PRESSES, stop_by, PRESS_BAR_S), (CASES, stop_in, BAR_S)):
        for case in filter(chosen, ways):
            for _ in range(options.times):
                with tempfile.TemporaryDirectory() as name:
                    are_good.append(report_stop(case, stop(case, Path(name)), bar_s))
    for case in LOSSES:
        if chosen(f"{case}, and back"):
            with tempfile.TemporaryDirectory() as name:
                are_good += (report_loss(case, loss) for loss in losses_in(case, Path(name), options.times))
    print(f"{are_good.count(False)} of {len(are_good)} outside their bar")
    assert all(are_good)


if __name__ == "__main__":
    main()
