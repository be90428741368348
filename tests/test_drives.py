"""One way to read a recorded drive."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "rover_hil"
MAY_LOOP = ("drives", "exporting", "report", "run", "recording", "live")
NO_LOGS = ("importing/rosbag/bag.py", "importing/rosbag/to_log.py")
"""Messages of a bag."""


def looping(path: Path) -> list[int]:
    """Return the lines on which the messages of a log are asked for."""
    calls = (each for each in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(each, ast.Call))
    return [
        call.lineno for call in calls if isinstance(call.func, ast.Attribute) and call.func.attr == "messages"
    ]


def test_analyses_read_the_messages_of_a_log_by_its_drive() -> None:
    others = [
        path
        for path in sorted(PACKAGE.rglob("*.py"))
        if path.relative_to(PACKAGE).parts[0] not in MAY_LOOP
        and path.relative_to(PACKAGE).as_posix() not in NO_LOGS
    ]
    assert len(others) > 300
    assert [path.relative_to(PACKAGE).as_posix() for path in others if looping(path)] == []


@pytest.mark.parametrize("path", ["drives/drive.py", "report/read_run.py"])
def test_such_a_loop_is_found(path: str) -> None:
    assert looping(PACKAGE / path)


def test_quantities_are_cut_into_windows_in_one_place() -> None:
    assert [path.parent.name for path in PACKAGE.rglob("windows.py")] == ["drives"]
