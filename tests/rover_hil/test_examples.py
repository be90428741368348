"""The examples of README, docs and every `--help` parse, the quick ones run, and name their data."""

import re
import shlex
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.core import TyperGroup
from typer.main import get_command

from benchmarks.program.how_tos import blocks_of
from rover_hil import ready
from rover_hil.app.app import app
from rover_hil.app.arguments import spread
from rover_hil.app.lazy_group import LazyGroup
from rover_hil.sample.catalogue import SAMPLES
from tests.rover_hil.command import Command, assert_one_sentence

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
NEEDS_NOTHING = {
    *(
        "run",
        "sample",
        "bench",
        "simulate",
        "check",
        "gap check",
        "doctor",
        "terrain wheel",
        "terrain traverse",
        "terrain climb",
        "terrain papers",
    )
}
OF_A_ROVER = {
    "init",
    "commission",
    "tune gains",
    *(f"calibrate {path.parent.name}" for path in Path(ready.__file__).parent.glob("*/calibration.py")),
} - {"calibrate camera"}
"""Their data are drives of a rover, also a simulated one, or of another example."""
QUICK_ON_SAMPLES = {"replay", "compare", "export", "calibrate camera", "import robotino"}
"""`python -m benchmarks.program.examples` runs the others."""
QUICK = {"check", "doctor", "terrain wheel", "terrain traverse", "terrain climb"}
REPEATED = {"terrain traverse", "terrain climb"}
REPEATED_ON_SAMPLES = {"compare", "import robotino"}
"""The longest; the tests of these commands run them too."""


def helps(group: TyperGroup, before: str = "") -> Iterator[tuple[str, str]]:
    for name, item in group.commands.items():
        if isinstance(item, TyperGroup):
            yield from helps(item, f"{before}{name} ")
        elif not item.hidden:
            yield f"{before}{name}", item.help or ""


ROOT_GROUP = get_command(app)
assert isinstance(ROOT_GROUP, TyperGroup)
HELPS = dict(helps(ROOT_GROUP))


def examples_of(text: str) -> list[str]:
    """Return the command lines in blocks and between back-ticks, without those that stand for a form."""
    text = text.replace("\\\n", " ")
    blocks = re.findall(r"^```\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines() if line.startswith("rover-hil ")]
    prose = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    lines += [" ".join(line.split()) for line in re.findall(r"`(rover-hil [^`]*)`", prose)]
    return [line for line in lines if "..." not in line and not re.search(r"\b[A-Z]{3,}\b", line)]


TEXTS = [*HELPS.values(), *(page.read_text("utf-8") for page in PAGES)]
EXAMPLES = sorted({line for text in TEXTS for line in examples_of(text)})


@pytest.mark.parametrize("line", EXAMPLES)
def test_every_example_parses(line: str) -> None:
    arguments = [each for each in spread(shlex.split(line, comments=True)[1:]) if each != "--help"]
    item: Any = get_command(app)
    if arguments and arguments[0] == "--install-completion":
        return  # to parse it is to install it
    while isinstance(item, TyperGroup) and arguments:
        if isinstance(item, LazyGroup):
            arguments = item.completed(arguments)
        item = item.commands[arguments.pop(0)]
    if arguments:  # a bare name of a command is no call
        item.make_context("rover-hil", arguments)


def test_there_are_examples() -> None:
    assert len(EXAMPLES) > 40


@pytest.mark.parametrize("name", HELPS)
def test_every_help_has_an_example_and_names_its_data(name: str) -> None:
    text = " ".join(HELPS[name].split())
    (example,) = re.findall(r"Example: `(rover-hil [^`]*)`", text)
    assert example.startswith(f"rover-hil {name} ")
    assert ("Data: " in text) is (name not in NEEDS_NOTHING)
    for page in re.findall(r"docs/[\w/-]+\.md", text):
        assert (ROOT / page).is_file()


@pytest.mark.parametrize(
    "name",
    [
        *sorted(QUICK - REPEATED),
        *(pytest.param(name, marks=pytest.mark.nightly) for name in sorted(REPEATED)),
    ],
)
def test_quick_examples_run(command: Command, name: str) -> None:
    (example,) = re.findall(r"Example: `(rover-hil [^`]*)`", " ".join(HELPS[name].split()))
    # The doctor of a computer without a rover finds something to fix.
    assert command(*shlex.split(example)[1:]) == (1 if name == "doctor" else 0)
    assert command.out


def sample_of(name: str) -> str:
    """Return the sample that the example of a command needs."""
    data = " ".join(HELPS[name].split()).partition("Data: ")[2]
    samples: list[str] = re.findall(r"`rover-hil sample (\w+)`", data)
    return samples[0]


@pytest.mark.parametrize("name", sorted(HELPS.keys() - NEEDS_NOTHING - OF_A_ROVER))
def test_data_of_an_example_come_from_a_sample(name: str) -> None:
    assert sample_of(name) in SAMPLES


def test_samples_in_the_table_of_examples_exist() -> None:
    page = (ROOT / "docs/reference/examples.md").read_text("utf-8")
    cells = [line.split("|") for line in page.splitlines() if line.count("|") == 5]
    named = {row[4].strip(" `") for row in cells if row[4].strip().startswith("`")}
    assert len(named) >= 8
    assert named <= SAMPLES.keys()


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return the function that makes a sample once and gives its folder."""
    made: dict[str, Path] = {}

    def make(name: str) -> Path:
        if name not in made:
            folder = tmp_path_factory.mktemp(name)
            SAMPLES[name].make(folder)
            made[name] = folder
        return made[name]

    return make


@pytest.mark.parametrize(
    "name",
    [
        *sorted(QUICK_ON_SAMPLES - REPEATED_ON_SAMPLES),
        *(pytest.param(name, marks=pytest.mark.nightly) for name in sorted(REPEATED_ON_SAMPLES)),
    ],
)
def test_quick_examples_run_on_their_sample(
    command: Command, samples: Callable[[str], Path], tmp_path: Path, name: str
) -> None:
    shutil.copytree(samples(sample_of(name)), tmp_path, dirs_exist_ok=True)
    (example,) = re.findall(r"Example: `(rover-hil [^`]*)`", " ".join(HELPS[name].split()))
    assert command(*shlex.split(example)[1:]) == 0, command.error
    assert command.out


@pytest.mark.parametrize(
    "line",
    [
        "gap side-slope nowhere --out a",
        "ftrace nowhere --rig rig.json --out a.csv",
        "identify slip nowhere",
        "identify motor nowhere",
        "terrain fit nowhere",
        "calibrate camera nowhere --ground g.png --rover r.json --out a.json --columns 8 --rows 6 "
        "--square 0.04 --ground-x 0 --ground-y 0",
    ],
)
def test_a_missing_folder_is_reported_as_such(command: Command, line: str) -> None:
    assert command(*line.split()) == 2
    assert re.match("rover-hil: no (file or )?folder nowhere: ", command.error)
    assert_one_sentence(command.error)


@pytest.mark.parametrize(
    ("page", "word"),
    [
        ("calibrate_the_gyro", "calibrate imu"),
        ("commission_a_rover", "commission"),
        ("compensate_slip_while_driving", "run"),
        ("correct_a_recorded_drive", "scomp"),
        ("fit_slip_maps", "identify slip"),
        ("measure_a_wheel_trace", "ftrace"),
    ],
)
def test_a_how_to_can_be_tried_without_a_rover(page: str, word: str) -> None:
    """`python -m benchmarks.program.how_tos` runs these blocks."""
    blocks = blocks_of((ROOT / f"docs/how-to/{page}.md").read_text("utf-8"))
    assert any(line.startswith(f"rover-hil {word} ") for block in blocks for line in block)
