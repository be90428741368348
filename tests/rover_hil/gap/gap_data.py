"""Data for tests of the gap workflow: runs of nature, as a model sees them and as files."""

import csv
import io
from pathlib import Path

import numpy as np

from rover_hil.gap.data.load import load_model
from sim_backends.models.interface import Model, Run
from tests.nature.axis import Drive, measure_axis, some_axis
from tests.nature.cart import Experiment, measure, some_nature
from tests.rover_hil.gap.gap_models import Cart

EXAMPLES = Path(__file__).resolve().parents[3] / "docs/examples/gap"


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


def make_axis() -> Model:
    """Return the model of the example of a simulator that can only be called."""
    return load_model(f"{EXAMPLES / 'my_axis.py'}:make")
