"""The emergency stop in a real browser, with something broken between it and the rover."""

import re
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from benchmarks.program.page_stop import (
    ALARM,
    CASES,
    HANG,
    LOSSES,
    MOVES,
    PRESSES,
    ended,
    losses_in,
    stop_by,
    stop_in,
    wait_for_end,
    wait_s,
)
from tests.rover_hil.bench.browser import Page, served, serving, write_config
from tests.rover_hil.bench.network import Network, port_of, through

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(300),
]
LIMIT_S = 5.0
"""On a loaded machine; `benchmarks.program.page_stop` asserts the bar of 1 s."""
SILENT = "page: no heartbeat of its program for 0.5 s"
GONE = "page: the script of the page in control did not answer for 0.5 s"
PRESSED, ENDED = "emergency stop pressed on the page", "the program of the page has ended"
ANSWERS = {
    "nothing broken": ("", PRESSED, False),
    "server stopped": (SILENT, PRESSED, True),
    "server killed": ("", ENDED, True),
    "network gone": (GONE, "goes on", True),
    "network back": (GONE, PRESSED, True),
    "tunnel closed": (GONE, PRESSED, True),
    "300 readers": ("", PRESSED, False),
}
PRESS = """
const nowMs = performance.now();
press = { number: ++numbers, run: arguments[0], pressedMs: nowMs - arguments[1], sinceMs: nowMs,
          postedMs: -Infinity, answer: null };
sendPress();
"""
LATE_PRESS = "emergencyStop(); press.pressedMs -= 5000"
OFTEN = ("nothing broken", "server stopped", "network back")
STOPS = (b"GET /line", b"POST /stop")
HELD = "dispatchEvent(new KeyboardEvent('keydown', { code: 'KeyW', repeat: arguments[0], bubbles: true }))"
LET_GO = "dispatchEvent(new KeyboardEvent('keyup', { code: 'KeyW', bubbles: true }))"


@pytest.mark.parametrize(
    "case",
    [case if case in OFTEN else pytest.param(case, marks=pytest.mark.nightly) for case in CASES],
)
def test_the_rover_stops_whatever_is_broken_and_the_page_says_what_it_knows(
    case: str, tmp_path: Path
) -> None:
    stop = stop_in(case, tmp_path)
    reason, end, is_alarmed = ANSWERS[case]
    assert stop.to_zero_s < LIMIT_S
    assert stop.end == end
    assert stop.reasons[-1:] == ((reason,) if reason else ())
    assert stop.alarm.startswith("EMERGENCY STOP NOT CONFIRMED for ") == is_alarmed


@pytest.fixture
def served_page(tmp_path: Path) -> Iterator[tuple[Page, Network]]:
    write_config(tmp_path, length_m="9.0", width_m="4.0")
    with (
        served(tmp_path) as (url, _),
        Network(port_of(url)) as network,
        Page(through(network, url)) as page,
    ):
        yield page, network


def log_of(folder: Path) -> Path:
    return max(folder.glob("runs/*/run.mcap"), key=lambda path: path.stat().st_mtime)


@pytest.mark.parametrize(
    "case",
    [case if case == "page closed" else pytest.param(case, marks=pytest.mark.nightly) for case in LOSSES],
)
def test_after_a_loss_the_rover_rests_until_the_user_clicks_whatever_comes_back(
    case: str, tmp_path: Path
) -> None:
    (loss,) = losses_in(case, tmp_path, 1)
    assert loss.to_rest_s < LIMIT_S
    assert loss.reason.startswith(f"STOPPED: {SILENT if case == 'server stopped' else GONE}. ")


@pytest.mark.parametrize(
    "press",
    # "nothing broken" above presses the button.
    [pytest.param(press, marks=pytest.mark.nightly) if press == "button" else press for press in PRESSES],
)
def test_button_key_and_another_program_stop_the_rover(press: str, tmp_path: Path) -> None:
    stop = stop_by(press, tmp_path)
    assert stop.to_zero_s < LIMIT_S
    assert stop.end == PRESSED


def test_a_hidden_page_stops_nothing(served_page: tuple[Page, Network], tmp_path: Path) -> None:
    page, _ = served_page
    page.click("Start mission")
    page.wait(lambda: bool(page.driver.execute_script(MOVES)), "the rover does not move")
    own = page.driver.current_window_handle
    page.driver.switch_to.new_window("tab")
    wait_s(3.0)
    page.driver.switch_to.window(own)
    page.click("EMERGENCY STOP")
    wait_for_end(log_of(tmp_path))
    assert ended(log_of(tmp_path)) == ((), PRESSED)


def test_the_page_comes_with_disabled_buttons_since_it_is_not_yet_in_control(tmp_path: Path) -> None:
    with serving(tmp_path) as url:
        page = httpx.get(url).text
    buttons = re.findall(r'"tag":"q-btn","props":{([^}]*)}', page)
    assert any('"label":"Start mission"' in button for button in buttons)
    assert [button for button in buttons if '"disable":true' not in button] == []


def test_a_second_page_that_answers_does_not_hide_that_the_page_in_control_hangs(
    served_page: tuple[Page, Network], tmp_path: Path
) -> None:
    page, _ = served_page
    page.click("Start mission")
    with Page(page.url) as second:  # of another process
        second.wait(lambda: bool(second.driver.execute_script(MOVES)), "it does not watch")
        page.driver.execute_script(HANG, 4.0)
        second.wait(lambda: second.mode == "safe stop", "the rover does not stop")
        assert not second.driver.find_element("id", "bench-confirm").is_displayed()
        assert "Only the page in control" in second.text("bench-why")
        wait_s(4.0)
        assert not second.driver.execute_script(MOVES)
        page.confirm()
        page.wait(lambda: bool(page.driver.execute_script(MOVES)), "the rover does not drive on")
        second.click("EMERGENCY STOP")
    wait_for_end(log_of(tmp_path))
    assert ended(log_of(tmp_path))[1] == PRESSED


def test_without_the_token_the_page_is_one_sentence(served_page: tuple[Page, Network]) -> None:
    page, _ = served_page
    page.driver.get(page.url.split("?")[0])
    assert "open the address that `rover-hil bench` printed" in page.driver.page_source


def test_a_press_that_comes_late_stops_no_other_run_and_one_of_just_now_does(
    served_page: tuple[Page, Network], tmp_path: Path
) -> None:
    page, _ = served_page
    page.click("Start mission")
    page.wait(lambda: bool(page.driver.execute_script(MOVES)), "the rover does not move")
    page.driver.execute_script(PRESS, "an older run", 5000)
    page.wait(lambda: "another one goes on" in page.driver.execute_script(ALARM), "the page does not say so")
    wait_s(1.0)
    assert page.driver.execute_script(MOVES)
    page.driver.execute_script(PRESS, "an older run", 0)
    page.wait(lambda: page.mode != "running", "the run does not end")
    wait_for_end(log_of(tmp_path))
    assert ended(log_of(tmp_path))[1] == PRESSED


def test_a_press_outlives_a_reload_of_the_page(served_page: tuple[Page, Network], tmp_path: Path) -> None:
    page, network = served_page
    page.click("Start mission")
    page.wait(lambda: bool(page.driver.execute_script(MOVES)), "the rover does not move")
    network.close()
    page.driver.execute_script("document.getElementById('bench-stop').click()")
    network.refused = STOPS
    network.reopen()
    page.driver.refresh()
    page.wait(lambda: "NOT CONFIRMED" in page.driver.execute_script(ALARM), "the press is forgotten")
    assert ended(log_of(tmp_path))[1] == "goes on"
    network.refused = ()
    page.wait(lambda: page.driver.execute_script(ALARM) == "", "the press is not confirmed")
    wait_for_end(log_of(tmp_path))
    assert ended(log_of(tmp_path))[1] == PRESSED
    page.driver.refresh()
    wait_s(1.0)
    assert page.driver.execute_script("return press === null")


def test_a_second_press_stops_the_run_that_an_answer_named_while_the_stream_is_silent(
    served_page: tuple[Page, Network], tmp_path: Path
) -> None:
    page, _ = served_page
    page.click("Start mission")
    page.wait(lambda: bool(page.driver.execute_script(MOVES)), "the rover does not move")
    page.driver.execute_script("source.close(); live.run = 'an older run'")
    page.driver.execute_script(LATE_PRESS)
    page.wait(lambda: "another one goes on" in page.driver.execute_script(ALARM), "the page does not say so")
    assert ended(log_of(tmp_path))[1] == "goes on"
    page.driver.execute_script(LATE_PRESS)
    wait_for_end(log_of(tmp_path))
    assert ended(log_of(tmp_path))[1] == PRESSED


def test_a_watching_tab_takes_control_of_a_run_only_by_a_click(
    served_page: tuple[Page, Network], tmp_path: Path
) -> None:
    page, _ = served_page
    page.click("Start mission")
    page.wait(lambda: bool(page.driver.execute_script(MOVES)), "the rover does not move")
    own = page.driver.current_window_handle
    page.driver.switch_to.new_window("tab")
    watching = page.driver.current_window_handle
    page.driver.get(page.url)
    page.wait(lambda: bool(page.driver.execute_script(MOVES)), "it does not watch")
    page.driver.switch_to.window(own)
    page.driver.close()
    page.driver.switch_to.window(watching)
    page.wait(lambda: page.mode == "safe stop", "the rover does not stop")
    wait_s(2.0)
    assert not page.driver.execute_script(MOVES)
    page.click("Take control")
    wait_s(2.0)
    assert not page.driver.execute_script(MOVES)
    page.confirm()
    page.wait(lambda: bool(page.driver.execute_script(MOVES)), "the rover does not drive on")
    page.click("Stop")
    wait_for_end(log_of(tmp_path))
    assert ended(log_of(tmp_path))[1] == "stopped by the user"


def test_a_key_that_is_held_over_a_lost_network_drives_again_only_after_it_was_let_go(
    served_page: tuple[Page, Network],
) -> None:
    page, network = served_page

    def moves() -> bool:
        return bool(page.driver.execute_script(MOVES))

    page.click("Drive by hand")
    page.wait(lambda: page.mode == "running", "the run does not begin")
    page.driver.execute_script("emitEvent('drive', ['nan', 0, 0])")
    page.wait(lambda: page.driver.execute_script("return live.state.refused") == 1, "it is not refused")
    assert not moves()
    page.driver.execute_script(HELD, False)
    page.wait(moves, "the rover does not move")
    network.freeze()
    wait_s(2.0)
    network.thaw()
    for _ in range(10):
        page.driver.execute_script(HELD, True)
        wait_s(0.1)
        assert not moves()
    page.confirm()
    page.wait(lambda: page.mode == "running" and not moves(), "the loop does not recover")
    for _ in range(20):
        page.driver.execute_script(HELD, True)  # as the keyboard repeats it
        wait_s(0.1)
        assert not moves()
    page.driver.execute_script(LET_GO)
    page.driver.execute_script(HELD, False)
    page.wait(moves, "the rover does not move again")
    page.driver.execute_script(LET_GO)
    page.wait(lambda: not moves(), "the rover does not stop")
