"""Data that cannot be judged: the verdict says why, and never forces a name."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
import pytest

from rover_hil.gap.verdict import Answer, Verdict
from rover_hil.gap.workflow import analyse
from sim_backends.models.interface import Array, Model, Run
from tests.nature.axis import Drive
from tests.nature.cart import Experiment
from tests.rover_hil.gap.gap_data import axis_runs, cart_runs, make_axis
from tests.rover_hil.gap.gap_models import Cart


def judged(runs: list[Run], model: Model | None = None) -> Verdict:
    verdict = analyse(model or Cart(), runs).verdict
    assert verdict.effects == ()
    assert verdict.confidence_set == ()
    return verdict


def changed(run: Run, channel: str, value: float) -> Run:
    return dataclasses.replace(run, measured={**run.measured, channel: np.array([value])})


def test_too_few_runs_to_split() -> None:
    runs = cart_runs(1, Experiment(replicates=2, rolls=(0.0,), conditions=((10.0, 23.8), (20.0, 33.8))))
    runs += [
        dataclasses.replace(run, name=f"{run.name}b", conditions={**run.conditions, "roll_deg": 9.0})
        for run in runs[:1]
    ]
    verdict = judged(runs)
    assert verdict.verdict is Answer.BAD_DATA
    assert "5 runs are too few" in verdict.sentence


def test_a_channel_without_noise_estimate() -> None:
    runs = cart_runs(2, Experiment(replicates=1))
    verdict = judged(runs)
    assert verdict.verdict is Answer.BAD_DATA
    assert "slip has no noise estimate" in verdict.sentence
    assert "repeat runs" in verdict.sentence


def test_replicates_that_were_copied_are_no_noise_estimate() -> None:
    runs = cart_runs(2, Experiment(replicates=1))
    copies = [dataclasses.replace(run, name=f"{run.name}_{number}") for run in runs for number in range(3)]
    verdict = judged(copies)
    assert verdict.verdict is Answer.BAD_DATA
    assert "equal to the last digit" in verdict.sentence


def test_constant_conditions() -> None:
    runs = cart_runs(3, Experiment(replicates=20, conditions=((15.0, 23.8),), rolls=(0.0,)), yaw=3.0)
    verdict = judged(runs)
    assert verdict.verdict is Answer.NOT_IDENTIFIABLE
    assert "vary slope_deg, roll_deg, mass_kg" in verdict.sentence


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_values_that_are_no_numbers(value: float) -> None:
    runs = cart_runs(4)
    runs[7] = changed(runs[7], "slip", value)
    verdict = judged(runs)
    assert verdict.verdict is Answer.BAD_DATA
    assert runs[7].name in verdict.sentence
    assert "slip" in verdict.sentence


def test_a_condition_that_is_no_number() -> None:
    runs = cart_runs(4)
    runs[3] = dataclasses.replace(runs[3], conditions={**runs[3].conditions, "roll_deg": math.nan})
    verdict = judged(runs)
    assert verdict.verdict is Answer.BAD_DATA
    assert "roll_deg is nan" in verdict.sentence


def test_replicates_that_contradict_each_other() -> None:
    runs = cart_runs(5)
    odd = changed(changed(runs[4], "slip_angle_deg", 25.0), "slip", 0.6)
    runs[4] = odd
    verdict = judged(runs)
    assert verdict.verdict is Answer.BAD_DATA
    assert odd.name in verdict.sentence
    assert "contradict" in verdict.sentence


def test_runs_whose_labels_were_shuffled() -> None:
    runs = cart_runs(6)
    order = np.random.default_rng(0).permutation(len(runs))
    shuffled = [
        dataclasses.replace(run, measured=runs[index].measured)
        for run, index in zip(runs, order, strict=True)
    ]
    verdict = judged(shuffled)
    assert verdict.verdict is Answer.BAD_DATA
    assert "contradict" in verdict.sentence


def test_two_runs_of_one_name() -> None:
    runs = cart_runs(7)
    verdict = judged([*runs, runs[0]])
    assert verdict.verdict is Answer.BAD_DATA
    assert "appears 2 times" in verdict.sentence


def test_a_model_without_units() -> None:
    model = Cart()
    first, *rest = model.channels
    object.__setattr__(model, "channels", (dataclasses.replace(first, unit=" "), *rest))
    verdict = judged(cart_runs(8), model)
    assert verdict.verdict is Answer.BAD_DATA
    assert "channel slip of the model has no unit" in verdict.sentence


def test_a_few_outliers_of_heavy_tails_are_no_contradiction() -> None:
    for seed in range(4):
        verdict = analyse(Cart(), cart_runs(seed, Experiment(kind="heavy"))).verdict
        assert verdict.verdict is Answer.NO_GAP, verdict.sentence


def with_gap(run: Run, name: str, gap: slice) -> Run:
    def cut(table: Mapping[str, Array]) -> dict[str, Array]:
        copies = {key: values.copy() for key, values in table.items()}
        if name in copies:
            copies[name][gap] = math.nan
        return copies

    return dataclasses.replace(run, inputs=cut(run.inputs), measured=cut(run.measured))


def test_missing_values_of_a_series_are_counted_and_left_out() -> None:
    runs = axis_runs(9)
    runs[2] = with_gap(runs[2], "speed", slice(50, 53))
    verdict = analyse(make_axis(), runs).verdict
    assert verdict.verdict is Answer.NO_GAP
    assert verdict.missing == [{"run": "run3", "series": "speed", "count": 3, "total": 300}]
    assert "Missing values: 3 of 300 of speed in run run3" in verdict.lines()


@pytest.mark.parametrize(
    ("name", "gap", "words"),
    [
        ("speed", slice(50, 150), "100 of 300 values of speed are missing"),
        ("speed", slice(None), "300 of 300 values of speed are missing"),
        ("voltage", slice(10, 11), "1 of 300 values of voltage are missing"),
    ],
)
def test_series_that_lack_too_much_are_refused(name: str, gap: slice, words: str) -> None:
    runs = axis_runs(9)
    runs[2] = with_gap(runs[2], name, gap)
    runs[4] = with_gap(runs[4], name, gap)
    verdict = judged(runs, make_axis())
    assert verdict.verdict is Answer.BAD_DATA
    assert f"run run3: {words}; run run5: {words}; at most 5%" in verdict.sentence


def test_a_bridged_column_is_counted_as_missing() -> None:
    runs = axis_runs(9)
    runs[0] = dataclasses.replace(runs[0], missing={"position1_rad": (4, 300)})
    verdict = analyse(make_axis(), runs).verdict
    assert verdict.missing == [{"run": "run1", "series": "position1_rad", "count": 4, "total": 300}]
    runs[0] = dataclasses.replace(runs[0], missing={"position1_rad": (40, 300)})
    assert "40 of 300 values of position1_rad" in judged(runs, make_axis()).sentence


def test_overlaps_of_neighbouring_runs_are_not_missing() -> None:
    runs = [with_gap(run, "speed", slice(0, 2)) for run in axis_runs(9)]
    runs = [dataclasses.replace(run, overlap=(2, 0)) for run in runs]
    assert analyse(make_axis(), runs).verdict.missing == []


def test_inputs_that_never_change() -> None:
    runs = [dataclasses.replace(run, inputs={"voltage": np.full(300, 3.0)}) for run in axis_runs(10)]
    verdict = judged(runs, make_axis())
    assert verdict.verdict is Answer.NOT_IDENTIFIABLE
    assert "vary voltage" in verdict.sentence


def test_three_series_are_too_few() -> None:
    verdict = judged(axis_runs(11, Drive(runs=3)), make_axis())
    assert verdict.verdict is Answer.BAD_DATA
    assert "3 runs are too few" in verdict.sentence
