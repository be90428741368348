"""A served page and a headless browser on it."""

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Self, TextIO

import pytest

from drivers.clock import SystemClock, nanoseconds
from rover_hil.config import read_config_text
from rover_hil.console.exit_codes import EXIT_TERMINATED

if TYPE_CHECKING:
    from selenium.webdriver.remote.webelement import WebElement

ROOT = Path(__file__).parents[3]
WAIT_S = 100.0
CONFIG = "rover.toml"
QUIETLY = (
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


def program(name: str) -> str:
    """Return the path of a program of the browser; fail where it is missing: a skip would hide a fault."""
    path = shutil.which(name)
    if path is None:
        pytest.fail(f"{name} is not installed; `make test-slow` installs it")
    return path


PROGRAM = (sys.executable, "-c", "from rover_hil.app.program import main; main()")
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT)}


def write_config(folder: Path, **replaced: str) -> None:
    """Write the configuration of a Robotino whose runs begin soon, with these keys."""
    text = read_config_text("robotino").replace("settle_s = 3.0", "settle_s = 0.2")
    text = text.replace('use = "yaw_probe"', 'use = "surfaces"')
    for key, value in replaced.items():
        text, count = re.subn(rf"^{key} = \S+", f"{key} = {value}", text, flags=re.MULTILINE)
        assert count == 1, key
    (folder / CONFIG).write_text(text)


@contextmanager
def serving(folder: Path) -> Iterator[str]:
    """Serve the page of a Robotino whose runs begin soon; give its address."""
    write_config(folder)
    with served(folder) as (url, _):
        yield url


@contextmanager
def served(
    folder: Path, program: Sequence[str] = PROGRAM, stderr: TextIO | None = None
) -> "Iterator[tuple[str, subprocess.Popen[str]]]":
    """Serve the page of the configuration in a folder; give its address and the process."""
    with subprocess.Popen(
        [*program, "bench", CONFIG, "--port", "0", "--out", "runs"],
        cwd=folder,
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=stderr,
        text=True,
    ) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line.startswith("page: ")
        try:
            yield line.removeprefix("page: ").strip(), process
        finally:
            process.send_signal(signal.SIGCONT)
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=WAIT_S)
    assert process.returncode in (0, EXIT_TERMINATED, -signal.SIGKILL)


class Page:
    """The page in a browser of its own."""

    def __init__(self, url: str) -> None:
        from selenium import webdriver

        options = webdriver.ChromeOptions()
        options.binary_location = program("chromium")
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        for argument in (*QUIETLY, "--window-size=1400,1400", f"--user-data-dir={self._profile.name}"):
            options.add_argument(argument)
        service = webdriver.ChromeService(program("chromedriver"), popen_kw={"start_new_session": True})
        self.driver = webdriver.Chrome(options=options, service=service)
        self._group = service.process.pid
        self._clock = SystemClock()
        self.url = url
        try:
            self.driver.get(url)
        except Exception:
            self.kill()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        with suppress(Exception):
            self.driver.quit()
        self.kill()

    def kill(self) -> None:
        """Let the browser disappear without a word."""
        with suppress(ProcessLookupError):
            os.killpg(self._group, signal.SIGKILL)
        self._profile.cleanup()

    def wait(self, condition: Callable[[], bool], what: str) -> None:
        """Wait for a condition."""
        deadline_ns = self._clock.now_ns() + nanoseconds(WAIT_S)
        while not condition():
            assert self._clock.now_ns() < deadline_ns, f"{what}: {self.mode!r}, {self._sentences()!r}"
            self._clock.sleep_until(self._clock.now_ns() + 50_000_000)

    def confirm(self) -> None:
        """Confirm that the stopped rover may move, by a click, as soon as the page asks for it."""
        button = self.driver.find_element("id", "bench-confirm")
        self.wait(button.is_displayed, "the page asks for no confirmation")
        button.click()

    def text(self, name: str) -> str:
        """Return the text of the element with an id."""
        return str(
            self.driver.execute_script("return document.getElementById(arguments[0]).textContent", name)
        )

    @property
    def mode(self) -> str:
        """What the page shows as the mode."""
        return self.text("bench-mode")

    def button(self, text: str) -> "WebElement":
        """Return a button."""
        self.wait(lambda: any(item.text.strip() == text for item in self._buttons()), f"no button {text!r}")
        return next(item for item in self._buttons() if item.text.strip() == text)

    def click(self, text: str) -> None:
        """Click a button as soon as it is enabled and rests: a page that still grows moves it aside."""
        button = self.button(text)
        self.wait(button.is_enabled, f"button {text!r} is not enabled")
        places = [button.rect]

        def rests() -> bool:
            places.append(button.rect)
            return places[-1] == places[-2]

        self.wait(rests, f"button {text!r} does not rest")
        button.click()

    def links(self, start: str) -> "list[WebElement]":
        """Return the links whose address begins so."""
        return self.driver.find_elements("css selector", f'a[href^="{start}"]')

    def _sentences(self) -> list[str]:
        """Return what the page says beside the mode, errors too; they disappear after seconds."""
        notes = self.driver.find_elements("class name", "q-notification__message")
        return [self.text("bench-words"), *(note.text for note in notes)]

    def _buttons(self) -> "list[WebElement]":
        return self.driver.find_elements("tag name", "button")
