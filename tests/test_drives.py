"""One way to read a recorded drive."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "rover_hil"
LOOPS_OF_THEIR_OWN = ("exporting/", "report/", "run/", "recording/")
DRIVE = "drives/drive.py"
BAGS = "drives/formats/rosbag/"
"""Their messages are not those of a log."""


def looping(path: Path) -> list[int]:
    """Return the lines on which the messages of a log are asked for."""
    calls = (each for each in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(each, ast.Call))
    return [
        call.lineno for call in calls if isinstance(call.func, ast.Attribute) and call.func.attr == "messages"
    ]


def test_analyses_read_the_messages_of_a_log_by_its_drive() -> None:
    names = [path.relative_to(PACKAGE).as_posix() for path in sorted(PACKAGE.rglob("*.py"))]
    others = [name for name in names if not name.startswith((*LOOPS_OF_THEIR_OWN, DRIVE, BAGS))]
    assert len(others) > 300
    assert [name for name in others if looping(PACKAGE / name)] == []


@pytest.mark.parametrize("path", [DRIVE, "report/read_run.py"])
def test_such_a_loop_is_found(path: str) -> None:
    assert looping(PACKAGE / path)


def test_quantities_are_cut_into_windows_in_one_place() -> None:
    assert [path.parent.name for path in PACKAGE.rglob("windows.py")] == ["drives"]
