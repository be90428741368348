"""Healthy runs from the page in a real browser, on a loaded machine: how often the rover stops for nothing.

    python -m benchmarks.program.page_runs [--times N] [--unloaded] [--width PX] [--hidden SECONDS]

With --hidden each run lasts so long, and another tab hides that of the page meanwhile. Needs the extra
`bench`, selenium, chromium and chromedriver. The rover is simulated, in real time; the load is that of
`benchmarks.program.machine_load`.
"""

import argparse
import json
import os
import tempfile
from contextlib import ExitStack
from pathlib import Path

from benchmarks.program.machine_load import loaded_machine
from benchmarks.program.page_stop import wait_for_end, wait_s
from drivers.clock import SystemClock, nanoseconds
from rover_hil.bench.session import LOG_NAME
from tests.rover_hil.bench.browser import Page, served, write_config

END_S = 600.0
STATE = "return live.state.state"
NOTE_HIDDEN = "document.addEventListener('visibilitychange', () => { window.wasHidden ||= document.hidden; })"
MISSION_OVER = {False: "mission finished", True: "time over in mode 'running'"}


def until(page: Page, state: str) -> None:
    """Wait until the page shows a state."""
    clock = SystemClock()
    deadline_ns = clock.now_ns() + nanoseconds(END_S)
    while page.driver.execute_script(STATE) != state:
        assert clock.now_ns() < deadline_ns, f"the page does not become {state}: {page.text('bench-words')}"
        clock.sleep_until(clock.now_ns() + nanoseconds(0.2))


def drive(page: Page, folder: Path, hidden_s: float) -> tuple[str, list[str], float]:
    """Drive the mission once; return its end, the reasons of its stops, how late a heartbeat was in ms."""
    before = set(folder.glob("runs/*"))
    page.click("Start mission")
    until(page, "running")
    if hidden_s:
        own = page.driver.current_window_handle
        page.driver.execute_script(NOTE_HIDDEN)
        page.driver.switch_to.new_window("tab")
        wait_s(hidden_s)
        wait_for_end(next(iter(set(folder.glob("runs/*")) - before)) / LOG_NAME)
        page.driver.close()
        page.driver.switch_to.window(own)
        assert page.driver.execute_script("return window.wasHidden"), "the tab was not hidden"
    else:
        until(page, "writing report")
    late_ms = float(page.driver.execute_script("return live.state.server_late_ms"))
    until(page, "idle")
    (run,) = set(folder.glob("runs/*")) - before
    summary = json.loads((run / "summary.json").read_text())
    return page.text("bench-words"), [", ".join(stop["reasons"]) for stop in summary["stops"]], late_ms


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=20)
    parser.add_argument("--unloaded", action="store_true")
    parser.add_argument("--width", type=int, default=1400, help="of the window, in px")
    parser.add_argument("--hidden", type=float, default=0.0, help="s that each run lasts in a hidden tab")
    options = parser.parse_args()
    stopped = 0
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        is_hidden = options.hidden > 0.0
        replaced = {"time_limit_s": str(options.hidden), "length_m": "90.0"} if is_hidden else {}
        write_config(folder, **replaced)
        load = None if options.unloaded else stack.enter_context(loaded_machine(folder))
        url, _ = stack.enter_context(served(folder))
        page = stack.enter_context(Page(url))
        page.driver.set_window_size(options.width, 1400)
        for number in range(1, options.times + 1):
            end, stops, late_ms = drive(page, folder, options.hidden)
            stopped += bool(stops) or end != MISSION_OVER[is_hidden]
            reasons = "; ".join(stops) or "none"
            print(f"run {number}: {end}; stops: {reasons}; heartbeat late by {late_ms:.0f} ms", flush=True)
        if load is not None:
            print(f"load: {len(load.busy_rounds)} busy processes, {load.written_mib} MiB written")
    one_minute, five, fifteen = os.getloadavg()
    print(f"load of the computer: {one_minute:.1f}, {five:.1f}, {fifteen:.1f} on {os.cpu_count()} processors")
    print(f"{stopped} of {options.times} healthy runs stopped, bar 0")
    assert not stopped


if __name__ == "__main__":
    main()
