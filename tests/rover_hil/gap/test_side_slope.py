"""A handful of the battery of `benchmarks/gap/battery_side_slope.py`: hidden effects on a side slope."""

from pathlib import Path

import numpy as np
import pytest

from rover_hil.gap.data.readers.side_slope import read_side_slope
from rover_hil.gap.output.model_file import ExtendedModel, Provenance
from rover_hil.gap.output.results import model_file_of
from rover_hil.gap.verdict import Answer
from rover_hil.gap.workflow import analyse
from sim_backends.models.side_slope.model import make_model
from tests.cases import first_often
from tests.nature.side_slope import Experiment, some_nature, write

CONDITIONS = ((10.0, 23.8), (20.0, 23.8), (20.0, 33.8))
ROLLS_DEG = (0.0, 10.0, 20.0)
"""Fewer runs than the battery has: each test takes seconds."""


def folder_with(path: Path, seed: int, kind: str, **hidden: float) -> Path:
    rng = np.random.default_rng(seed)
    experiment = Experiment(kind=kind, conditions=CONDITIONS, rolls=ROLLS_DEG)
    write(path, some_nature(rng, **hidden), experiment, rng)
    return path


@pytest.mark.parametrize("kind", first_often(["ar", "heavy"]))
def test_without_effect_there_is_no_gap(tmp_path: Path, kind: str) -> None:
    model = make_model()
    verdict = analyse(model, read_side_slope(folder_with(tmp_path, 1, kind))).verdict
    assert verdict.verdict is Answer.NO_GAP, verdict.sentence


@pytest.mark.nightly
def test_flowing_soil_is_named_and_gone_once_it_is_in_the_model(tmp_path: Path) -> None:
    model = make_model()
    runs = read_side_slope(folder_with(tmp_path, 2, "white", flow=0.006))
    found = analyse(model, runs)
    assert found.verdict.verdict is Answer.NAMED, found.verdict.sentence
    assert found.verdict.confidence_set == [["slope_failure"]]
    assert found.machine is not None
    provenance = Provenance(date="", verdict="NAMED", data_sha256="", plan_sha256="", seed=0)
    file = model_file_of(found, "side-slope", provenance)
    again = analyse(ExtendedModel(model, file), runs).verdict
    assert again.verdict is Answer.NO_GAP, again.sentence


@pytest.mark.nightly
@pytest.mark.slow
def test_a_cable_that_pulls_back_gets_no_name_of_the_catalogue(tmp_path: Path) -> None:
    model = make_model()
    verdict = analyse(model, read_side_slope(folder_with(tmp_path, 3, "white", tether=20.0))).verdict
    assert verdict.verdict in (Answer.UNNAMED, Answer.PARTLY_NAMED, Answer.NAMED_SET), verdict.sentence
