"""The report in a real browser: zoom on one time axis, light and dark, wide and on a phone."""

from pathlib import Path

import pytest

from rover_hil.report.write import write_report
from tests.rover_hil.bench.browser import Page
from tests.rover_hil.report.test_read_run import Drive, write_log

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    write_report(write_log(folder / "run.mcap", Drive(stop=(4.0, 6.0))), folder)
    return folder / "report.html"


def test_a_time_chosen_on_one_chart_is_shown_on_all_and_on_the_path(page: Path) -> None:
    from selenium.webdriver import ActionChains

    with Page(page.as_uri()) as browser:
        driver = browser.driver
        whole = driver.execute_script("return span")
        pictures = (
            "return [...document.querySelectorAll('#viewer canvas')].map((canvas) => canvas.toDataURL())"
        )
        before = driver.execute_script(pictures)
        assert len(before) >= 5
        canvas = driver.find_elements("css selector", "#viewer canvas")[2]
        driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", canvas)
        drag = ActionChains(driver).move_to_element_with_offset(canvas, -150, 0).click_and_hold()
        drag.move_by_offset(120, 0).release().perform()
        browser.wait(lambda: driver.execute_script("return span") != whole, "no zoom")
        first_s, last_s = driver.execute_script("return span")
        shares = [
            driver.execute_script(
                f"return (canvasWidth => (canvasWidth / 2 {place} - LEFT)"
                " / (canvasWidth - LEFT - RIGHT))(arguments[0].clientWidth)",
                canvas,
            )
            for place in ("- 150", "- 30")
        ]
        assert [first_s, last_s] == pytest.approx([share * whole[1] for share in shares], abs=0.1)
        browser.wait(
            lambda: all(
                now != then for now, then in zip(driver.execute_script(pictures), before, strict=True)
            ),
            "a chart has not followed",
        )
        driver.find_element("css selector", "#viewer .tools button:nth-child(5)").click()
        browser.wait(lambda: driver.execute_script("return span") == whole, "not the whole run")
        entry = driver.find_element("css selector", "#viewer .legend button")
        driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", entry)
        entry.click()
        browser.wait(lambda: entry.get_attribute("aria-pressed") == "false", "the curve is not hidden")


def test_on_a_phone_two_fingers_zoom_and_one_moves(page: Path) -> None:
    with Page(page.as_uri()) as browser:
        driver = browser.driver
        phone = {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", phone)
        driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": True, "maxTouchPoints": 2})
        canvas = driver.find_elements("css selector", "#viewer canvas")[2]
        driver.execute_script("arguments[0].scrollIntoView({block: 'center'})", canvas)
        middle_y = driver.execute_script(
            "const box = arguments[0].getBoundingClientRect(); return box.top + box.height / 2", canvas
        )

        def touch(kind: str, *places_x: float) -> None:
            points = [{"x": x, "y": middle_y, "id": number} for number, x in enumerate(places_x)]
            driver.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

        whole_s = driver.execute_script("return span[1] - span[0]")
        touch("touchStart", 180.0, 240.0)
        for step in range(1, 7):
            touch("touchMove", 180.0 - 10 * step, 240.0 + 10 * step)
        touch("touchEnd")
        first_s, last_s = driver.execute_script("return span")
        assert last_s - first_s == pytest.approx(whole_s * 60 / 180, rel=0.1)
        touch("touchStart", 200.0)
        for step in range(1, 7):
            touch("touchMove", 200.0 - 10 * step)
        touch("touchEnd")
        moved = driver.execute_script("return span")
        assert moved[0] > first_s + 0.05 * whole_s
        assert moved[1] - moved[0] == pytest.approx(last_s - first_s)


@pytest.mark.parametrize(("scheme", "is_dark"), [("light", False), ("dark", True)])
def test_the_page_is_light_or_dark_and_fits_a_phone(page: Path, scheme: str, is_dark: bool) -> None:
    with Page(page.as_uri()) as browser:
        driver = browser.driver
        feature = {"name": "prefers-color-scheme", "value": scheme}
        driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})
        phone = {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", phone)
        ground = driver.execute_script("return getComputedStyle(document.body).backgroundColor")
        assert (ground == "rgb(18, 22, 28)") is is_dark
        drawn = driver.execute_script("return getComputedStyle(document.querySelector('img.drawn')).filter")
        assert ("invert" in drawn) is is_dark
        assert driver.execute_script("return document.documentElement.scrollWidth") <= 390
        assert driver.get_log("browser") == []  # type: ignore[no-untyped-call]
