"""What users and files wrote is printed as it is, on a terminal and in pictures."""

import io

import matplotlib as mpl
import pytest
from matplotlib.figure import Figure
from rich.table import Table

from rover_hil.pages.style import STYLE
from rover_hil.terminal import Terminal, progress_columns, words_column
from tests.rover_hil.command import Command, assert_one_sentence

HOSTILE = "a[/x]b [filter] [red]c :warning: [link=http://x]d"


def printed(what: object) -> str:
    stream = io.StringIO()
    Terminal(file=stream, soft_wrap=True).print(what)
    return stream.getvalue()


def test_a_text_is_no_markup() -> None:
    assert printed(HOSTILE) == f"{HOSTILE}\n"


def test_a_cell_and_the_title_of_a_table_are_no_markup() -> None:
    table = Table("column", title=HOSTILE)
    table.add_row(HOSTILE)
    assert printed(table).count(HOSTILE) == 2


def test_a_text_sends_no_control_characters() -> None:
    assert printed("a\x1b[2Jb\x9b1mc\udcffd") == "a?[2Jb?1mc?d\n"


def test_the_description_of_a_task_is_no_markup() -> None:
    stream = io.StringIO()
    from rich.progress import Progress

    for columns in ((words_column(),), progress_columns()):
        progress = Progress(*columns, console=Terminal(file=stream))
        progress.add_task(HOSTILE, total=1)
        Terminal(file=stream, soft_wrap=True).print(progress.get_renderable())
    assert stream.getvalue().count("[/x]b [filter] [red]c :warning:") == 2


@pytest.mark.usefixtures("unrendered")
@pytest.mark.usefixtures("unrendered")
def test_a_run_whose_folder_looks_like_markup(command: Command) -> None:
    assert command("run", "robotino", "--virtual", "--duration", "4", "--out", "a[/x]b") == 0
    assert "report: a[/x]b/report.html" in command.out
    assert command("replay", "a[/x]b", "--out", "c[red]") == 0
    assert "c[red]/report.html" in command.out


def test_no_module_of_the_program_prints_on_a_console_of_its_own() -> None:
    """One place prints: a `Console` of rich reads markup by default."""
    from pathlib import Path

    folder = Path(__file__).parents[2] / "rover_hil"
    own = [path for path in folder.rglob("*.py") if "rich.console" in path.read_text("utf-8")]
    assert [path.name for path in own] == ["terminal.py"]


def test_a_dollar_sign_in_a_picture_is_no_formula() -> None:
    with mpl.rc_context(STYLE):
        figure = Figure()
        figure.subplots().set_title(r"run $\nothing{$")
        figure.savefig(io.BytesIO(), format="svg")


def test_an_unknown_command_that_looks_like_markup(command: Command) -> None:
    assert command("[/x]") == 2
    assert "No such command '[/x]'" in command.error
    assert command("run", "[/x].toml") == 2
    assert_one_sentence(command.error, "[/x].toml")
