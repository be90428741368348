"""The page of `rover-hil bench` in a headless browser: first paint, slider, emergency stop, cost per cycle.

    python -m benchmarks.program.bench_page

Needs the extra `bench`, selenium, chromium and chromedriver. Times are of the browser's clock, from the
press to the first view of the loop that shows the effect.
"""

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import Pipe
from pathlib import Path
from statistics import median
from typing import Any

from controllers.motion.kinematics import make_kinematics
from drivers.clock import SystemClock, VirtualClock, nanoseconds, stopwatch_ns
from drivers.link import NoTap
from rover_hil.bench.camera_frames import FrameChoice
from rover_hil.bench.loop_process import NoticeSender
from rover_hil.bench.page_operator import PageOperator
from rover_hil.config import load_config, read_config_text
from rover_hil.run.composition import build_virtual_rig
from rover_hil.run.executive import CycleView

ROOT = Path(__file__).parents[2]
PAINT_BAR_MS, SLIDER_BAR_MS, STOP_BAR_MS, COST_BAR_US = 1000.0, 200.0, 150.0, 300.0
WAIT_S = 60.0
CYCLES, CAMERA_CYCLES = 3000, 1000
SLIDER_PX = 12
PROBE = """
window.seen = {};
const receiveFirst = source.onmessage;
source.onmessage = (event) => {
  receiveFirst(event);
  const data = JSON.parse(event.data);
  for (const view of data.views) {
    if (seen.gain === undefined && Object.keys(view.gains).length) seen.gain = performance.now();
    const rests = view.set_rad_s.every((speed) => speed === 0);
    if (seen.pressed && seen.rest === undefined && rests) seen.rest = performance.now();
  }
  if (seen.pressed && seen.rest === undefined && data.state !== "running") seen.rest = performance.now();
};
"""


@contextmanager
def served() -> Iterator[str]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        text = read_config_text("robotino").replace("settle_s = 3.0", "settle_s = 0.2")
        (folder / "rover.toml").write_text(text.replace('use = "yaw_probe"', 'use = "surfaces"'))
        command = [sys.executable, "-c", "from rover_hil.app.program import main; main()"]
        with subprocess.Popen(
            [*command, "bench", "rover.toml", "--port", "0"],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.PIPE,
            text=True,
        ) as process:
            assert process.stdout is not None
            try:
                yield process.stdout.readline().removeprefix("page: ").strip()
            finally:
                process.send_signal(signal.SIGINT)
                process.communicate(timeout=WAIT_S)


def open_browser() -> Any:
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    for argument in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--disable-gpu"):
        options.add_argument(argument)
    options.add_argument("--window-size=1400,1400")
    return webdriver.Chrome(options=options, service=webdriver.ChromeService(shutil.which("chromedriver")))


def until(condition: Any, what: str) -> None:
    clock = SystemClock()
    end_ns = clock.now_ns() + nanoseconds(WAIT_S)
    while not condition():
        assert clock.now_ns() < end_ns, what
        clock.sleep_until(clock.now_ns() + 50_000_000)


def click(driver: Any, text: str) -> None:
    def found() -> Any:
        buttons = driver.find_elements("tag name", "button")
        return next((item for item in buttons if item.text.strip() == text and item.is_enabled()), None)

    until(found, text)
    found().click()


def measure(url: str, number: int) -> tuple[float, float, float]:
    """Return first paint, slider to gain, stop to zero setpoints, in ms.

    Gains hold for the next run: with each number the slider is pressed at another place.
    """
    from selenium.webdriver import ActionChains

    driver = open_browser()
    try:
        driver.get(url)
        paint = (
            "const e = performance.getEntriesByName('first-contentful-paint')[0];"
            "return e ? e.startTime : null"
        )
        until(lambda: driver.execute_script(paint) is not None, "no paint")
        paint_ms = float(driver.execute_script(paint))
        click(driver, "Start mission")
        # The last view of the run before is shown until this one begins.
        moves = (
            "return live.state.state === 'running' && live.last !== null"
            " && live.last.set_rad_s.some((speed) => speed !== 0)"
        )
        until(lambda: driver.execute_script(moves), "no motion")
        driver.execute_script(PROBE)
        slider = driver.find_element("css selector", '[data-gain="lookahead_m"]')
        driver.execute_script(
            "arguments[0].addEventListener('pointerdown', () => { seen.slid ??= performance.now(); }, true);"
            "arguments[0].addEventListener('mousedown', () => { seen.slid ??= performance.now(); }, true);",
            slider,
        )
        ActionChains(driver).move_to_element_with_offset(
            slider, SLIDER_PX * (number + 1), 0
        ).click().perform()
        until(lambda: driver.execute_script("return seen.gain !== undefined"), "no gain")
        driver.execute_script("seen.pressed = performance.now(); emergencyStop();")
        until(lambda: driver.execute_script("return seen.rest !== undefined"), "no stop")
        seen = driver.execute_script("return seen")
        until(lambda: driver.execute_script("return live.state.state") == "idle", "no end")
    finally:
        driver.quit()
    return paint_ms, seen["gain"] - seen["slid"], seen["rest"] - seen["pressed"]


class Unread:
    """A queue that takes everything and keeps nothing."""

    def put_nowait(self, item: object, /) -> None:
        """Drop it."""


def cost_us(name: str, cycles: int, *, is_read: bool) -> tuple[float, float]:
    """Return the mean and the 99th percentile of what a cycle of a shipped rover costs for the page."""
    clock = VirtualClock()
    config = load_config(name)
    rig, _ = build_virtual_rig(config, clock, NoTap())
    rig.connect(1.0)
    orders, _page = Pipe(duplex=False)
    _reader, notices = Pipe(duplex=False)
    sender = None if is_read else NoticeSender(notices)
    rear = None if config.scomp is None or config.scomp.rig is None else config.scomp.rig.geometry()
    choice = FrameChoice(config.roles.camera, rear)
    wheel_count = make_kinematics(config.rover).wheel_count
    operator = PageOperator(orders, sender or Unread(), wheel_count, None, choice)
    costs: list[int] = []
    for _ in range(cycles):
        clock.sleep_until(clock.now_ns() + 20_000_000)
        samples, output, sent = rig.cycle(clock.now_ns())
        healths = rig.healths()
        begun_ns = stopwatch_ns()
        operator.wanted()
        operator.show(CycleView(samples, output, sent, healths, 0, 0))
        operator.end()
        costs.append(stopwatch_ns() - begun_ns)
    rig.close()
    costs.sort()
    return sum(costs) / len(costs) / 1e3, costs[int(0.99 * len(costs))] / 1e3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=3)
    times = parser.parse_args().times
    costs = []
    for name, cycles in (("robotino", CYCLES), ("el-dorado", CAMERA_CYCLES)):
        for words, is_read in (("a page that reads", True), ("a page that stops reading", False)):
            mean_us, most_us = cost_us(name, cycles, is_read=is_read)
            costs.append(mean_us)
            print(f"cost per cycle of {name}, {words}: mean {mean_us:.0f} us, 99 % {most_us:.0f} us")
    with served() as url:
        measured = [measure(url, number) for number in range(times)]
    paint_ms, slider_ms, stop_ms = (median(column) for column in zip(*measured, strict=True))
    for name, figure, bar in (
        ("first paint", paint_ms, PAINT_BAR_MS),
        ("slider to applied gain", slider_ms, SLIDER_BAR_MS),
        ("emergency stop to zero setpoints", stop_ms, STOP_BAR_MS),
    ):
        print(f"{name}: median {figure:.0f} ms of {times}, bar {bar:.0f} ms")
    one_minute, five, fifteen = os.getloadavg()
    print(f"load of the computer: {one_minute:.1f}, {five:.1f}, {fifteen:.1f} on {os.cpu_count()} processors")
    assert max(costs) <= COST_BAR_US
    assert paint_ms <= PAINT_BAR_MS
    assert slider_ms <= SLIDER_BAR_MS
    assert stop_ms <= STOP_BAR_MS


if __name__ == "__main__":
    main()
