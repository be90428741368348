"""Healthy runs from the page in a real browser, on a loaded machine: how often the rover stops for nothing.

    python -m benchmarks.program.page_runs [--times N] [--unloaded]

Needs the extra `bench`, selenium, chromium and chromedriver. The rover is simulated, in real time; the load
is that of `benchmarks.program.machine_load`.
"""

import argparse
import json
import os
import tempfile
from contextlib import ExitStack
from pathlib import Path

from benchmarks.program.machine_load import loaded_machine
from drivers.clock import SystemClock, nanoseconds
from tests.rover_hil.bench.browser import Page, served, write_config

END_S = 600.0
STATE = "return live.state.state"


def until(page: Page, state: str) -> None:
    """Wait until the page shows a state."""
    clock = SystemClock()
    deadline_ns = clock.now_ns() + nanoseconds(END_S)
    while page.driver.execute_script(STATE) != state:
        assert clock.now_ns() < deadline_ns, f"the page does not become {state}: {page.text('bench-words')}"
        clock.sleep_until(clock.now_ns() + nanoseconds(0.2))


def drive(page: Page, folder: Path) -> tuple[str, list[str], float]:
    """Drive the mission once; return its end, the reasons of its stops, how late a sign of life was in ms."""
    before = set(folder.glob("runs/*"))
    page.click("Start mission")
    until(page, "running")
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
    options = parser.parse_args()
    stopped = 0
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        write_config(folder)
        load = None if options.unloaded else stack.enter_context(loaded_machine(folder))
        url, _ = stack.enter_context(served(folder))
        page = stack.enter_context(Page(url))
        for number in range(1, options.times + 1):
            end, stops, late_ms = drive(page, folder)
            stopped += bool(stops) or end != "mission finished"
            reasons = "; ".join(stops) or "none"
            print(f"run {number}: {end}; stops: {reasons}; sign of life late by {late_ms:.0f} ms", flush=True)
        if load is not None:
            print(f"load: {len(load.busy_rounds)} busy processes, {load.written_mib} MiB written")
    one_minute, five, fifteen = os.getloadavg()
    print(f"load of the computer: {one_minute:.1f}, {five:.1f}, {fifteen:.1f} on {os.cpu_count()} processors")
    print(f"{stopped} of {options.times} healthy runs stopped, bar 0")
    assert not stopped


if __name__ == "__main__":
    main()
