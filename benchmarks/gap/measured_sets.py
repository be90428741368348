"""Every measured set, by its name in measured_expectations.toml, and how its verdict is asked for."""

import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

from benchmarks.gap.measured_rovers import ROBOTS, circles
from benchmarks.gap.models import MEASURED, extended
from benchmarks.gap.rover_of_wheels import verdict_of
from benchmarks.gap_machines.measured import CARDS, EVERY, pendulum_model, pendulum_runs
from rover_hil.gap.data.load import load_model, read_runs
from rover_hil.gap.findings import Analysis
from rover_hil.gap.output.results import verdict_text
from rover_hil.gap.workflow import analyse
from sim_backends.models.interface import Model, Run
from tests.rover_hil.gap.emps import emps_model, emps_runs
from tests.rover_hil.pages import blocks_of, read_page

Content = Mapping[str, Any]
"""Of verdict.json."""
PAGE = "docs/tutorials/gap.md"
SHIPPED = ("robotino_motor", "robotino_drive_2023", "robotino_drive_2021", "single_wheel")


def measured_sets(data: Path) -> dict[str, Callable[[], Content]]:
    """Return a function for each set, which returns the content of its verdict.json."""
    friction, first = emps_model(has_friction=True), emps_runs(data, "identification")
    both = [*first, *emps_runs(data, "pulses")]
    sets: dict[str, Callable[[], Content]] = {
        "emps_identification": partial(_ask, friction, first),
        "emps_pulses_locked": partial(_ask, friction, both, 'run == "pulses*"'),
        "emps_without_friction_effects": partial(_ask, emps_model(has_friction=False), first),
        "pendulum": partial(_ask, pendulum_model(CARDS), pendulum_runs(data, EVERY)),
    }
    for name, (model, place) in zip(SHIPPED, MEASURED, strict=True):
        sets[name] = partial(_shipped, model, data / place)
        if name in ("robotino_motor", "robotino_drive_2023"):
            sets[f"{name}_extended"] = partial(_extended, model, data / place)
    for folder in sorted((data / "side_slope").glob("blind_*")):
        sets[folder.name] = partial(_shipped, "side-slope", folder)
    for robot in ROBOTS:
        files = circles(data / "vehicles" / "optiodom", robot, 6)
        sets[robot] = partial(verdict_of, f"optiodom_{robot}", files)
    sets["axis_in_degrees"] = partial(_axis, data / "field_reports4" / "gap" / "axis_in_degrees.csv.gz")
    return sets


def _ask(model: Model, runs: Sequence[Run], confirm: str = "") -> Content:
    return _content(analyse(model, runs, confirm=confirm))


def _content(analysis: Analysis) -> Content:
    content: Content = json.loads(verdict_text(analysis))
    return content


@cache
def _analysed(name: str, path: Path) -> Analysis:
    model = load_model(name)
    return analyse(model, read_runs(model, path))


def _shipped(name: str, path: Path) -> Content:
    return _content(_analysed(name, path))


def _extended(name: str, path: Path) -> Content:
    """Ask the model with what was named in it; the same verdict where nothing was."""
    base = load_model(name)
    more = extended(base, _analysed(name, path), name)
    return _ask(base if more is None else more, read_runs(base, path))


def _axis(path: Path) -> Content:
    """Ask the model of the tutorial."""
    text = next(
        block for info, block in blocks_of(read_page(PAGE)) if info == "python" and "def make" in block
    )
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "axis.py"
        file.write_text(text, "utf-8")
        model = load_model(f"{file}:make")
        return _ask(model, read_runs(model, path))
