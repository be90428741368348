"""Effects at one input in each order: a one-sided overlap of a valve is an offset and then a dead zone."""

from pathlib import Path

import numpy as np

from rover_hil.gap import Run, StateModel, effects
from rover_hil.gap.output.extended_machine import ExtendedMachine, extend_model
from rover_hil.gap.output.model_file import read_model_file
from rover_hil.gap.output.results import MODEL_NAME, write_results
from rover_hil.gap.verdict import Answer
from rover_hil.gap.workflow import analyse
from tests.rover_hil.gap.axis import STEP_S, axis_model

GAIN, DAMPING, SD = 8.0, 4.0, 0.05
OFFSET_V, HALF_WIDTH_V = -0.5, 0.5


def valve() -> StateModel:
    """Return an axis whose input may have a dead zone and an offset, listed in the wrong order."""
    model = axis_model()
    two = (effects.dead_zone("voltage", size=0.5), effects.offset("voltage", size=0.5, name="bias"))
    return model.with_effects([*two, model.port_effects[0]])


def overlapped(count: int = 8) -> list[Run]:
    """Return runs of an axis behind an overlap from 0 V to 1 V, in closed form between samples."""
    rng = np.random.default_rng(3)
    keep = np.exp(-DAMPING * STEP_S)
    runs = []
    for number in range(count):
        volts = np.repeat(rng.uniform(-5.0, 5.0, 15), 10)
        shifted = volts + OFFSET_V
        acting = np.sign(shifted) * np.maximum(np.abs(shifted) - HALF_WIDTH_V, 0.0)
        speed, speeds = 0.0, []
        for volt in acting:
            speeds.append(speed + rng.normal(0.0, SD))
            speed = keep * speed + (1.0 - keep) * GAIN / DAMPING * float(volt)
        runs.append(
            Run(
                name=f"run{number}",
                conditions={},
                inputs={"voltage": volts},
                measured={"speed_sensor": np.array(speeds)},
            )
        )
    return runs


def test_the_order_that_fits_is_found_stated_and_kept_in_the_model_file(tmp_path: Path) -> None:
    analysis = analyse(valve(), overlapped())
    verdict = analysis.verdict
    assert (verdict.verdict, verdict.confidence_set) == (Answer.NAMED, [["bias", "dead_zone"]]), (
        verdict.sentence
    )
    assert "Order at voltage: bias, then dead_zone." in verdict.sentence
    sizes = {one.name: next(iter(one.parameters.values())) for one in verdict.effects}
    for name, size in (("bias", OFFSET_V), ("dead_zone", HALF_WIDTH_V)):
        assert sizes[name].ci95[0] <= size <= sizes[name].ci95[1]
    write_results(tmp_path, analysis, "valve", "")
    file = read_model_file(tmp_path / MODEL_NAME)
    assert file.order == ("bias", "dead_zone")
    extended = extend_model(valve(), file)
    assert isinstance(extended, ExtendedMachine)
    assert extended.active == ("bias", "dead_zone")
