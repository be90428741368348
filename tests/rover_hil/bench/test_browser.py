"""The page in a real browser: start, slider, pause, stop, two browsers, a lost browser."""

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from drivers.clock import seconds
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.run.replay import replay
from tests.rover_hil.bench.browser import Page, serving

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bench")


@pytest.fixture(scope="module")
def url(folder: Path) -> Iterator[str]:
    with serving(folder) as address:
        yield address


def newest_log(folder: Path) -> LogReader:
    return LogReader(max(folder.glob("runs/*/run.mcap"), key=lambda path: path.stat().st_mtime))


def messages(log: LogReader, topic: str) -> list[tuple[int, dict[str, object]]]:
    return [(m.t_ns, json.loads(m.data)) for m in log.messages() if m.topic == topic]


def test_a_run_is_started_watched_changed_paused_and_stopped_and_replays(url: str, folder: Path) -> None:
    from selenium.webdriver import ActionChains, Keys

    with Page(url) as page:
        elsewhere = "return performance.getEntriesByType('resource').map(e => e.name)"
        page.click("Start mission")
        page.wait(lambda: page.mode == "running", "the run does not begin")
        slider = page.driver.find_element("css selector", '[data-gain="lookahead_m"]')
        ActionChains(page.driver).move_to_element(slider).click_and_hold().pause(0.2).release().perform()
        number = page.driver.find_elements("css selector", ".bench-gain input")[0]
        number.send_keys(Keys.CONTROL + "a")
        number.send_keys("99", Keys.ENTER)
        page.wait(lambda: "mission.speed_m_s is 99, outside" in page.driver.page_source, "no sentence")
        page.click("Pause")
        page.wait(lambda: page.mode == "paused", "no pause")
        page.click("Resume")
        page.wait(lambda: page.mode == "running", "no end of the pause")
        with Page(url) as second:
            second.wait(lambda: "Another browser is in control" in second.driver.page_source, "no sentence")
            assert not second.button("Stop").is_enabled()
            second.click("EMERGENCY STOP")
        page.wait(lambda: page.mode == "idle", "no stop")
        assert "emergency stop pressed on the page" in page.text("bench-words")
        origin = url.partition("?")[0]
        assert all(name.startswith(origin) for name in page.driver.execute_script(elsewhere))
        page.wait(lambda: bool(page.links("/report/")), "no link to the report")
        page.driver.get(page.links("/report/")[0].get_attribute("href") or "")
        assert "emergency stop" in page.driver.page_source
        assert page.driver.execute_script("return charts.length") > 4
    log = newest_log(folder)
    inputs = [record for _, record in messages(log, "/operator")]
    # On a loaded machine the page may be silent for a moment: an input of its own.
    assert [record["is_paused"] for record in inputs if record["is_paused"] is not None] == [True, False]
    gains = [record["gains"] for record in inputs if record["gains"]]
    assert gains[-1] == {"lookahead_m": pytest.approx(0.765, abs=0.02)}  # the middle of 0.03 .. 1.5
    with restore_config(log) as config:
        assert replay(log, config, lambda: None).differences == []


def test_a_browser_that_disappears_while_driving_by_hand_stops_the_rover(url: str, folder: Path) -> None:
    from selenium.webdriver import ActionChains

    with Page(url) as page:
        page.click("Drive by hand")
        page.wait(lambda: page.mode == "running", "the run does not begin")
        ActionChains(page.driver).key_down("w").perform()
        page.wait(lambda: not page.driver.execute_script(AT_REST), "the rover does not move")
        page.driver.execute_async_script("setTimeout(arguments[0], 300)")
        page.kill()
    with Page(url) as page:
        page.wait(lambda: bool(page.driver.execute_script(AT_REST)), "the rover does not stop")
        page.click("Take control")
        page.click("Stop")
        page.wait(lambda: page.mode == "idle", "no end")
    log = newest_log(folder)
    motion_ns = [t_ns for t_ns, record in messages(log, "/operator") if record["motion"]]
    commands = messages(log, "/command")
    moving_ns = [t_ns for t_ns, record in commands if record["speed_rad_s"] != REST]
    assert len(motion_ns) > 2
    rest_ns = min(t_ns for t_ns, _ in commands if t_ns > moving_ns[-1])
    assert seconds(rest_ns - motion_ns[-1]) <= 0.3


def test_the_real_rover_starts_only_after_it_was_armed(url: str) -> None:
    with Page(url) as page:
        page.wait(lambda: page.button("Drive by hand").is_enabled(), "not in control")
        page.click("real rover")
        page.wait(lambda: not page.button("Drive by hand").is_enabled(), "it may start without being armed")
        assert "The real rover will move" in page.driver.page_source
        page.click("Arm")
        page.wait(lambda: page.button("Armed for 30 s") is not None, "it is not armed")
        page.click("EMERGENCY STOP")
        page.wait(lambda: not page.button("Drive by hand").is_enabled(), "the stop does not disarm")
        page.click("Arm")
        page.click("Drive by hand")
        page.wait(lambda: page.mode == "starting", "it does not start")
        page.wait(lambda: page.mode == "idle" and "ports/" in page.text("bench-words"), "no sentence")


def test_a_gamepad_and_the_stick_drive_but_not_a_gamepad_that_was_never_at_rest(
    url: str, folder: Path
) -> None:
    from selenium.webdriver import ActionChains

    with Page(url) as page:
        page.driver.execute_script(GAMEPAD)
        page.click("Drive by hand")
        page.wait(lambda: page.mode == "running", "the run does not begin")
        page.driver.execute_async_script("setTimeout(arguments[0], 400)")
        assert page.driver.execute_script(AT_REST)  # its stick was never let go in this run
        page.driver.execute_script("pad.axes = [0, 0.05, 0, 0]")
        page.driver.execute_async_script("setTimeout(arguments[0], 200)")
        page.driver.execute_script("pad.axes = [0, -0.5, 0, 0]")
        page.wait(lambda: not page.driver.execute_script(AT_REST), "the gamepad does not drive")
        page.driver.execute_script("pad.connected = false")
        page.wait(lambda: bool(page.driver.execute_script(AT_REST)), "a lost gamepad does not stop the rover")
        page.driver.execute_script("pad.connected = true")
        page.driver.execute_async_script("setTimeout(arguments[0], 400)")
        assert page.driver.execute_script(AT_REST)  # its stick was not let go since it came back
        page.driver.execute_script("pad.connected = false")
        stick = page.driver.find_element("id", "bench-stick")
        held = ActionChains(page.driver).move_to_element(stick).click_and_hold()
        held.move_by_offset(0, -60).perform()
        page.wait(lambda: not page.driver.execute_script(AT_REST), "the stick does not drive")
        ActionChains(page.driver).release().perform()
        page.wait(lambda: bool(page.driver.execute_script(AT_REST)), "letting go does not stop the rover")
        page.click("Stop")
        page.wait(lambda: page.mode == "idle", "no end")
    motions = [
        record["motion"] for _, record in messages(newest_log(folder), "/operator") if record["motion"]
    ]
    assert [0.075, 0.0, 0.0] in motions  # half of mission.speed_m_s
    assert all(motion[1:] == [0.0, 0.0] for motion in motions if isinstance(motion, list))


def test_way_points_are_clicked_and_two_finished_runs_lie_on_top_of_each_other(
    url: str, folder: Path
) -> None:
    from selenium.webdriver import ActionChains

    with Page(url) as page:
        canvas = page.driver.find_element("css selector", 'canvas[data-chart="path"]')
        assert not page.button("Drive way-points").is_enabled()
        ActionChains(page.driver).move_to_element_with_offset(canvas, 40, -30).click().perform()
        page.click("Drive way-points")
        page.wait(lambda: page.mode == "running", "the run does not begin")
        clicked, mission = page.driver.execute_script("return [points, live.state.mission]")
        assert mission[-1] == pytest.approx(clicked[0])
        page.wait(lambda: page.driver.execute_script("return live.tx.length > 2"), "no truth")
        page.click("Stop")
        page.wait(lambda: page.mode == "idle", "no end")
        pictures = (
            "return [...document.querySelectorAll('canvas[data-chart]')].map((item) => item.toDataURL())"
        )
        before = page.driver.execute_script(pictures)
        field = page.driver.find_element("css selector", ".bench-page .q-select")
        field.click()
        options = "return document.querySelectorAll('.q-menu .q-item').length"
        count = len(list(folder.glob("runs/*/run.mcap")))
        assert count >= 2
        page.wait(lambda: page.driver.execute_script(options) == count, "not all finished runs")
        # Not by the mouse: the menu moves as soon as the field above it grows by what was chosen.
        for index, is_opened in enumerate(("opened.length === 1", "opened.length === 2")):
            page.driver.execute_script(CHOOSE, index)
            page.wait(partial(page.driver.execute_script, f"return {is_opened}"), "it is not opened")
        page.wait(
            lambda: all(
                now != then for now, then in zip(page.driver.execute_script(pictures), before, strict=True)
            ),
            "the finished runs do not take the place of the last one",
        )
        names = page.driver.execute_script("return opened.map((run) => run.paths.map((path) => path.name))")
        assert names[0] == names[1] == ["encoders", "truth", "estimate"]


GAMEPAD = """
window.pad = { connected: true, axes: [0, -1, 0, 0], buttons: [] };
navigator.getGamepads = () => [pad];
"""
CHOOSE = "document.querySelectorAll('.q-menu .q-item')[arguments[0]].click()"
REST = [0.0, 0.0, 0.0]
AT_REST = "return live.last !== null && live.last.set_rad_s.every((speed) => speed === 0)"
