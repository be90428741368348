"""The committed reference pages are those that the program generates, and no key is without a meaning."""

import re
from pathlib import Path
from typing import Any

import pytest
import typer

from docs.generate.__main__ import PAGES, write_pages
from rover_hil.app.app import app
from rover_hil.app.lazy_group import LazyGroup

REFERENCE = Path(__file__).parents[1] / "docs" / "reference"


@pytest.mark.parametrize("name", PAGES)
def test_the_committed_page_is_up_to_date(tmp_path: Path, name: str) -> None:
    write_pages(tmp_path)
    assert (REFERENCE / name).read_text("utf-8") == (tmp_path / name).read_text("utf-8"), (
        "run `make reference`"
    )


def test_every_command_that_a_page_or_a_message_names_exists_with_its_options() -> None:
    root = REFERENCE.parents[1]
    files = [*root.glob("*.md"), *(root / "docs").rglob("*.md"), *(root / "rover_hil").rglob("*.py")]
    program: Any = typer.main.get_command(app)
    wrong: list[str] = []
    count = 0
    for file in files:
        text = file.read_text("utf-8").replace("\\\n", " ")
        for line in re.findall(r"(?m)(?:^|`)rover-hil ([a-z][^`\n]*)", text):
            words = line.partition("  #")[0].split()
            place = program
            while words and hasattr(place, "commands") and words[0] in place.commands:
                place = place.commands[words.pop(0)]
            if isinstance(place, LazyGroup) and place.has_default:
                place = place.commands[place.completed(["MODEL"])[0]]
            options = {"--help", *(option for parameter in place.params for option in parameter.opts)}
            named = {word.partition("=")[0].rstrip(".,:;)") for word in words if word.startswith("--")}
            count += 1
            if place is program or named - options:
                wrong.append(f"{file.relative_to(root)}: {line}")
    assert count > 250
    assert wrong == []


def rows_of(name: str) -> list[list[str]]:
    """Return the cells of every row of a page, empty ones too."""
    return [
        [cell.strip() for cell in line.replace("\\|", "/").removeprefix("|").removesuffix("|").split("|")]
        for line in (REFERENCE / name).read_text("utf-8").splitlines()
        if line.startswith("| `")
    ]


@pytest.mark.parametrize("name", PAGES)
def test_every_key_and_option_has_a_type_and_a_meaning(name: str) -> None:
    rows = rows_of(name)
    assert len(rows) > {"gap_effects.md": 25, "gap_fmu.md": 60, "safety.md": 50}.get(name, 80)
    assert [row for row in rows if not row[1] or not row[-1]] == []


def test_no_meaning_has_swallowed_the_next_key() -> None:
    rows = rows_of("configuration.md")
    keys = {row[0].strip("`") for row in rows}
    assert [row for row in rows if keys & set(re.findall(r"[.;] (\w+): ", row[-1]))] == []


@pytest.mark.parametrize(
    "row",
    [
        "| `wheel_radius_m` | number | m | 0.005 to 1 | required | Radius of the wheels. |",
        "| `rate_hz` | number | Hz | 1 to 1000 | required | Cycles per second. |",
        "| `baud_rate` | integer | bit/s | 300 to 4000000 | 115200 | Line speed; the device leaves",
        "| `require_fixes` | true or false |  |  | false | The rover also stops when one of them",
        '| `scale` | "linear", "log" |  |  | "linear" | `log` where a factor matters rather',
        "## [devices.NAME] with type = \"witmotion\"",
        "## [[simulation.faults]] with type = \"drop\", \"duplicate\", \"reorder\", \"corrupt\"",
        "## [tune.parameters.NAME]",
    ],
)  # fmt: skip
def test_rows_of_the_configuration(row: str) -> None:
    assert f"\n{row}" in (REFERENCE / "configuration.md").read_text("utf-8")


@pytest.mark.parametrize(
    "row",
    [
        "## rover-hil identify scomp",
        "| `--model` | path |  |  | The model.toml of an earlier analysis. |",
        "| `--trials` | integer |  | 60 | ",
    ],
)
def test_rows_of_the_commands(row: str) -> None:
    assert f"\n{row}" in (REFERENCE / "commands.md").read_text("utf-8")
