"""Completion in a real bash, and the manual page."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from docs.generate.__main__ import MAN_PAGE
from docs.generate.commands_page import commands, options_of
from rover_hil.config.loader import shipped_configs
from rover_hil.console.options import SHIPPED_CONFIGS
from tests.cases import first_often

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "reference" / MAN_PAGE
COMPLETE = """
eval "$(_ROVER_HIL_COMPLETE=source_bash rover-hil)"
COMP_WORDS=({words}); COMP_CWORD={last}
_rover_hil_completion rover-hil
echo "${{COMPREPLY[@]}}"
"""


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the program of this tree."""
    folder = tmp_path_factory.mktemp("bin")
    path = folder / "rover-hil"
    path.write_text(f"#!{sys.executable}\nfrom rover_hil.app.program import main\nmain()\n")
    path.chmod(0o755)
    return folder


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
@pytest.mark.parametrize(
    ("words", "expected"),
    first_often(
        [
            ("rover-hil run el-dorado-cr", "el-dorado-crab"),
            ("rover-hil rep", "replay"),
            ("rover-hil calibrate comp", "compass"),
            ("rover-hil run --virt", "--virtual"),
            ("rover-hil export run.mcap --parq", "--parquet"),
        ]
    ),
)
def test_bash_completes_commands_options_and_shipped_configurations(
    program: Path, words: str, expected: str
) -> None:
    script = COMPLETE.format(words=words, last=len(words.split()) - 1)
    environment = {
        **os.environ,
        "PATH": f"{program}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
    }
    done = subprocess.run(
        [shutil.which("bash") or "", "-c", script],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert done.stdout.split() == [expected], done.stderr


def test_the_names_that_are_completed_are_those_that_are_shipped() -> None:
    assert set(SHIPPED_CONFIGS) == set(shipped_configs())


def test_the_manual_page_has_every_command_and_option() -> None:
    text = PAGE.read_text("utf-8").replace("\\-", "-").replace("\\e", "\\")
    sections = dict(re.findall(r'^\.SS "(.*?)"\n(.*?)(?=^\.S)', text, re.MULTILINE | re.DOTALL))
    assert set(sections) == {command.name for command in commands()}
    for command in commands():
        for option in options_of(command):
            assert f"\\fB{option.spelling}\\fR" in sections[command.name]


@pytest.mark.slow
def test_the_manual_page_is_set_without_warnings() -> None:
    done = subprocess.run(
        [shutil.which("groff") or "", "-man", "-Tutf8", "-ww", "-Kutf8", PAGE],
        capture_output=True,
        check=True,
        timeout=60,
    )
    assert done.stderr == b""
    assert len(done.stdout) > 10_000
