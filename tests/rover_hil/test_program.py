"""The program itself: version, bare groups, models with errors, and ctrl-C while it starts."""

import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.gap.gap_data import cart_rows, write_cart

INTERRUPTED_IMPORT = """
import sys
class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == {name!r}:
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupt())
sys.argv = ["rover-hil", "terrain", "traverse"]
from rover_hil.app.program import main
main()
"""


def test_version(command: Command) -> None:
    assert command("--version") == 0
    assert command.out == f"rover-hil {version('rover-hil')}\n"


@pytest.mark.parametrize("group", ["", "identify", "terrain", "calibrate", "import"])
def test_a_bare_group_prints_its_help(command: Command, group: str) -> None:
    assert command(*group.split()) == 0
    assert command.out.split()[:2] == ["Usage:", "rover-hil"]
    assert "Commands" in command.out


@pytest.mark.parametrize("name", ["typer", "numpy"])
def test_ctrl_c_while_modules_load_is_one_sentence(name: str) -> None:
    program = INTERRUPTED_IMPORT.format(name=name)
    done = subprocess.run([sys.executable, "-c", program], check=False, capture_output=True, text=True)
    assert done.returncode == 130
    assert done.stderr == "rover-hil: interrupted by ctrl-C\n"


def test_the_installed_program_is_the_one_that_takes_ctrl_c() -> None:
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text()
    assert 'rover-hil = "rover_hil.app.program:main"' in text


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("def make():\n    raise ValueError('no\\nmass')\n", 2, "ValueError: no mass"),
        ("import this_is_not_installed\n", 1, "ModuleNotFoundError"),
        ("def make(:\n", 1, "SyntaxError"),
        ("import sys\ndef make():\n    sys.exit(0)\n", 3, "SystemExit: 0"),
        (
            "from tests.rover_hil.gap.gap_models import Cart\nclass Model(Cart):\n"
            "    def predict(self, runs, parameters, effects):\n        return {}['slip']\ndef make():\n"
            "    return Model()\n",
            4,
            "KeyError: 'slip'",
        ),
        (
            "from tests.rover_hil.gap.gap_models import Cart\nclass Model(Cart):\n"
            "    def read_runs(self, path):\n        return 1 / 0\ndef make():\n    return Model()\n",
            4,
            "ZeroDivisionError",
        ),
    ],
)
def test_a_model_file_with_an_error_is_named_with_its_line(
    command: Command, tmp_path: Path, text: str, line: int, words: str
) -> None:
    (tmp_path / "mine.py").write_text(text)
    write_cart(tmp_path / "runs.csv", cart_rows(5))
    assert command("gap", "mine.py:make", "runs.csv", "--out", "a") == 2
    assert_one_sentence(command.error.lstrip("\n"), f"mine.py, line {line}: {words}")
    assert not (tmp_path / "a").exists()
