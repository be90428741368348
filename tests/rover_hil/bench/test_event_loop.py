"""The event loop that serves the emergency stop does no long work, whatever else the page does."""

import json
import socket
import sys
from pathlib import Path

import pytest

from tests.rover_hil.bench.browser import Page, served, write_config
from tests.rover_hil.bench.network import port_of

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(300),
]
LONGEST_MS = 50.0


def test_no_work_of_more_than_50_ms_runs_on_it_while_a_report_is_made_and_runs_are_opened(
    tmp_path: Path,
) -> None:
    write_config(tmp_path, time_limit_s="8")
    works = tmp_path / "works.json"
    program = (sys.executable, "-m", "tests.rover_hil.bench.timed_server", str(works))
    with served(tmp_path, program) as (url, _), Page(url) as page:
        port = port_of(url)
        readers = [socket.create_connection(("127.0.0.1", port)) for _ in range(10)]
        for reader in readers:
            reader.sendall(f"GET /stream HTTP/1.1\r\nHost: localhost:{port}\r\n\r\n".encode())
        page.click("Start mission")
        page.wait(lambda: page.mode == "writing report", "the run does not end")
        page.wait(lambda: bool(page.links("/report/")), "no report")
        page.driver.find_element("css selector", ".bench-page .q-select").click()
        options = "return document.querySelectorAll('.q-menu .q-item').length"
        page.wait(lambda: page.driver.execute_script(options) >= 1, "no finished runs")
        page.driver.find_elements("css selector", ".q-menu .q-item")[0].click()
        page.wait(lambda: page.driver.execute_script("return opened.length") == 1, "it is not opened")
        for reader in readers:
            reader.close()
    longest_ms = max(json.loads(works.read_text()), default=0.0)
    assert longest_ms < LONGEST_MS
