"""The phrases that CONTRIBUTING forbids are in no document, docstring, comment or message."""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = (
    "benchmarks",
    "controllers",
    "docs",
    "drivers",
    "rover_hil",
    "sim_backends",
    "tests",
    ".ci",
    ".github",
)
ENDS = frozenset(
    {"", ".c", ".cpp", ".css", ".csv", ".html", ".js", ".json", ".md", ".mjs", ".py", ".sh", ".toml", ".yml"}
)
NOT_DONE = (
    "benchmarks/datasets/planted_faults.py",
    "benchmarks/datasets/visible_faults.csv",
    "benchmarks/ftrace/ground_drives.py",
    "benchmarks/gap/rover_of_wheels.py",
    "benchmarks/gap/strangers_rovers.py",
    "benchmarks/gates/gap_constants.py",
    "benchmarks/ground_motion/scores.py",
    "benchmarks/hostile/__init__.py",
    "benchmarks/hostile_files.py",
    "benchmarks/program/page_stop.py",
    "benchmarks/robotino/fit.py",
    "benchmarks/robotino/plant.py",
    "benchmarks/robotino/rectangle_experiment.py",
    "benchmarks/robotino/yaw_inertia.py",
    "benchmarks/robotino/yaw_probe_faults.py",
    "benchmarks/safety/entrapped_missions.py",
    "benchmarks/safety/faults/injection.py",
    "benchmarks/safety/hung_loop.py",
    "benchmarks/sensitivity/robotino.py",
    "controllers/",
    "docs/contributing/gap_constants.md",
    "docs/decisions/0022-the-page-of-the-bench-is-an-operator.md",
    "docs/explanation/ground_motion.md",
    "docs/how-to/troubleshooting.md",
    "docs/reference/",
    "rover_hil/app/arguments.py",
    "rover_hil/bench/loop_process.py",
    "rover_hil/bench/server.py",
    "rover_hil/bench/session.py",
    "rover_hil/config/loader.py",
    "rover_hil/config/ros2_settings.py",
    "rover_hil/config/schema.py",
    "rover_hil/config/shipped/configs/robotino-camera.toml",
    "rover_hil/config/shipped/configs/robotino.toml",
    "rover_hil/config/shipped/configs/rover-hil-config.schema.json",
    "rover_hil/connect/cycle_record.py",
    "rover_hil/connect/ros2/connection.py",
    "rover_hil/connect/ros2/neighbours.py",
    "rover_hil/connect/ros2/process.py",
    "rover_hil/connect/shared_ring.py",
    "rover_hil/datasets/flight_table.py",
    "rover_hil/datasets/truth_check.py",
    "rover_hil/doctor/devices/rejections.py",
    "rover_hil/drive/run_surroundings.py",
    "rover_hil/gap/data/load.py",
    "rover_hil/gap/machines/analysis.py",
    "rover_hil/gap/machines/base_parameters.py",
    "rover_hil/gap/machines/model_checks/model_trial.py",
    "rover_hil/gap/machines/next_run/planned.py",
    "rover_hil/gap/machines/parameters.py",
    "rover_hil/identify/scomp/parameters.py",
    "rover_hil/importing/drive.py",
    "rover_hil/importing/rosbag/topics.py",
    "rover_hil/importing/table/columns.py",
    "rover_hil/importing/table/drive_table.py",
    "rover_hil/ready/commission/worth.py",
    "rover_hil/ready/imu/calibration.py",
    "rover_hil/ready/imu/turns.py",
    "rover_hil/ready/procedure.py",
    "rover_hil/ready/set_up/command.py",
    "rover_hil/ready/time/calibration.py",
    "rover_hil/ready/time/fit.py",
    "rover_hil/recording/made_with.py",
    "rover_hil/report/read_run.py",
    "rover_hil/report/report.html",
    "rover_hil/report/run_data.py",
    "rover_hil/report/summary.py",
    "rover_hil/run/sign_of_life.py",
    "rover_hil/run/watchdog_process.py",
    "rover_hil/run/watchdog_program.py",
    "rover_hil/terrain/setup.py",
    "rover_hil/tune/logs/judged_log.py",
    "sim_backends/fmu/example/build.py",
    "sim_backends/models/shared_cards.toml",
    "sim_backends/models/tables.py",
    "sim_backends/state_model/integrate.py",
    "tests/controllers/",
    "tests/drivers/test_can_link.py",
    "tests/drivers/test_can_wheels_mapping.py",
    "tests/nature/sinking_drives/README.md",
    "tests/nature/wheeled_rover.py",
    "tests/once.py",
    "tests/rover_hil/bench/test_loop_process.py",
    "tests/rover_hil/bench/test_page_operator.py",
    "tests/rover_hil/bench/test_stop_in_browser.py",
    "tests/rover_hil/connect/test_ros2_run.py",
    "tests/rover_hil/data/configs/2026-11-27-robotino-area.toml",
    "tests/rover_hil/data/configs/2026-11-27-robotino.toml",
    "tests/rover_hil/field_bags.py",
    "tests/rover_hil/gap/test_finding.py",
    "tests/rover_hil/identify/test_timing.py",
    "tests/rover_hil/report/test_read_run.py",
    "tests/rover_hil/test_drive_order.py",
    "tests/rover_hil/test_excitation_in_the_loop.py",
    "tests/rover_hil/test_executive.py",
    "tests/rover_hil/test_field_tests.py",
    "tests/rover_hil/test_four_wheel_faults.py",
    "tests/rover_hil/test_gnss_run.py",
    "tests/rover_hil/test_hostile_files.py",
    "tests/rover_hil/test_import_oddities.py",
    "tests/rover_hil/test_log_schema.py",
    "tests/rover_hil/test_operators.py",
    "tests/rover_hil/test_sign_of_life.py",
    "tests/rover_hil/test_watchdog.py",
    "tests/rover_hil/test_watchdog_process.py",
    "tests/rover_hil/test_watchdog_program.py",
    "tests/sim_backends/obedient_plant.py",
    "tests/sim_backends/test_model_robotino_motor.py",
    "tests/sim_backends/test_robotino_board.py",
)
"""Starts of the paths whose prose is still to be changed."""
NAME = re.compile(r"`[^`\s]*`")
"""An identifier, key, topic, command or option: it is quoted and has no space."""
THIS_TEST = "tests/test_phrases.py"


def forbidden_phrases() -> list[str]:
    """Return the first column of the table in CONTRIBUTING; a row may have several forms of a phrase."""
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    table = text.split("| forbidden phrase | write |\n|---|---|\n")[1].split("\n\n")[0]
    return [phrase for row in table.splitlines() for phrase in row.split("|")[1].strip().split(", ")]


def pattern_of(phrases: list[str], between: str) -> re.Pattern[str]:
    """Return what finds the phrases, with `between` for the space or hyphen between two words."""
    spelled = (between.join(map(re.escape, re.split("[ -]", phrase))) for phrase in phrases)
    return re.compile(rf"\b(?:{'|'.join(spelled)})s?\b", re.IGNORECASE)


PHRASE = pattern_of(forbidden_phrases(), r"[\s-]+")
PERHAPS = pattern_of(forbidden_phrases(), r"\W+(?:[a-z]+[\"'])?")
"""Also finds a phrase across the quotes and comment signs of two lines: fast, where most files have none."""


def phrases_in(text: str, *, is_python: bool = False) -> list[str]:
    """Return what a file has of the forbidden phrases, outside of names and of the table itself."""
    if not PERHAPS.search(text):
        return []
    prose = "\n\n".join(_python_prose(text)) if is_python else text
    prose = re.sub(r"(?m)^\| forbidden phrase (?:.*\n)*?\n", "", prose)
    return list(dict.fromkeys(" ".join(found.split()) for found in PHRASE.findall(NAME.sub("", prose))))


def _python_prose(source: str) -> Iterator[str]:
    """Yield the comments of Python code, those that follow each other as one, and its strings."""
    comment, last_line = "", -1
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            if token.start[0] != last_line + 1:
                yield comment
                comment = ""
            comment, last_line = f"{comment} {token.string.lstrip('# ')}", token.start[0]
    yield comment
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value
        elif isinstance(node, ast.JoinedStr):
            yield "".join(part.value if isinstance(part, ast.Constant) else "0" for part in node.values)  # type: ignore[misc]


def texts_of(folder: str) -> Iterator[Path]:
    """Yield the text files of a folder; those of the project itself for an empty name."""
    files = (ROOT / folder).rglob("*") if folder else ROOT.glob("*")
    for file in sorted(files):
        if file.is_file() and file.suffix in ENDS and "__pycache__" not in file.parts:
            yield file


def test_the_list_is_complete() -> None:
    assert {"sign of life", "set-point", "in place of", "is told"} <= set(forbidden_phrases())


def test_a_phrase_is_found_in_prose_and_not_in_a_name() -> None:
    assert phrases_in("It sends Set-points, in place\nof speeds.") == ["Set-points", "in place of"]
    assert phrases_in("It gave no `sign of life`.") == ["sign of life"]
    assert phrases_in("The key `set-point` is missing.") == []


@pytest.mark.parametrize(
    "source",
    [
        'def f():\n    """Return\n    a set-point."""\n',
        "x = 1  # the\n# set-point\n",
        'x = "the set-" "point"\n',
        'x = f"the {x} set-" f"point"\n',
    ],
)
def test_a_phrase_is_found_in_docstrings_comments_and_messages(source: str) -> None:
    assert phrases_in(source, is_python=True) == ["set-point"]


def test_a_phrase_is_not_found_in_identifiers() -> None:
    assert phrases_in("set_point = sign_of_life.set - point\n", is_python=True) == []


@pytest.mark.parametrize("folder", ["", *FOLDERS])
def test_a_folder_has_no_forbidden_phrase(folder: str) -> None:
    broken = {}
    for file in texts_of(folder):
        name = file.relative_to(ROOT).as_posix()
        if name != THIS_TEST and not name.startswith(NOT_DONE):
            found = phrases_in(file.read_text("utf-8"), is_python=file.suffix == ".py")
            broken |= {name: found} if found else {}
    assert broken == {}
