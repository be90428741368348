"""Data for tests of the gap workflow: runs of nature, as a model sees them and as files."""

import csv
import io
import re
import types
from pathlib import Path

import numpy as np

from sim_backends.models.interface import Model, Run
from tests.nature.axis import Drive, measure_axis, some_axis
from tests.nature.cart import Experiment, measure, some_nature
from tests.rover_hil.gap.gap_models import Cart

TUTORIAL = Path(__file__).resolve().parents[3] / "docs/tutorials/gap_tutorial.md"
BLOCK = re.compile(r"```python\n# (?P<name>\S+)\n(?P<text>.*?)```", re.DOTALL)


def cart_rows(
    seed: int, experiment: Experiment | None = None, **hidden: float
) -> list[dict[str, float | str]]:
    rng = np.random.default_rng(seed)
    return measure(some_nature(rng, **hidden), experiment or Experiment(), rng)


def cart_runs(seed: int, experiment: Experiment | None = None, **hidden: float) -> list[Run]:
    model = Cart()
    return [
        Run(
            name=str(row["run"]),
            conditions={name: float(row[name]) for name in model.condition_units},
            measured={channel.name: np.array([float(row[channel.name])]) for channel in model.channels},
        )
        for row in cart_rows(seed, experiment, **hidden)
    ]


def write_cart(path: Path, rows: list[dict[str, float | str]]) -> Path:
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    path.write_text(stream.getvalue())
    return path


def axis_runs(seed: int, drive: Drive | None = None, **hidden: float) -> list[Run]:
    rng = np.random.default_rng(seed)
    measured = measure_axis(some_axis(rng, **hidden), drive or Drive(), rng)
    return [
        Run(
            name=f"run{number}",
            conditions={"load": 1.0},
            inputs={"voltage": voltage},
            measured={"speed": speed},
        )
        for number, (voltage, speed) in enumerate(measured, start=1)
    ]


def tutorial_files() -> dict[str, str]:
    """Return the files that the tutorial asks its reader to save."""
    return {match["name"]: match["text"] for match in BLOCK.finditer(TUTORIAL.read_text("utf-8"))}


def make_axis() -> Model:
    """Return the tutorial's model."""
    module = types.ModuleType("my_axis")
    exec(compile(tutorial_files()["my_axis.py"], "my_axis.py", "exec"), module.__dict__)  # noqa: S102
    model: Model = module.__dict__["make"]()
    return model
