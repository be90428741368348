"""The split: whole conditions, drawn without a look at what was measured, or chosen by an expression."""

import dataclasses

import numpy as np
import pytest

from drivers.errors import ConfigError
from rover_hil.gap.data.problem import condition_key
from rover_hil.gap.plan import Plan, make_plan
from tests.nature.axis import Drive
from tests.nature.cart import Experiment
from tests.rover_hil.gap.gap_data import axis_runs, cart_runs, make_axis
from tests.rover_hil.gap.gap_models import Cart


def plan_of(seed: int = 0, confirm: str = "", experiment: Experiment | None = None) -> Plan:
    return make_plan(Cart(), cart_runs(1, experiment), seed=seed, confirm=confirm, alphas={"gap": 0.01})


def test_whole_conditions_are_locked_and_every_level_stays_open() -> None:
    model, runs = Cart(), cart_runs(1)
    for seed in range(10):
        plan = make_plan(model, runs, seed=seed, alphas={})
        by_name = {run.name: run for run in runs}
        open_keys = {condition_key(model, by_name[name]) for name in plan.discover}
        locked_keys = {condition_key(model, by_name[name]) for name in plan.confirm}
        assert not open_keys & locked_keys
        assert len(plan.confirm) == 15
        for index, levels in enumerate(({10.0, 15.0, 20.0}, {0.0, 5.0, 10.0, 15.0, 20.0}, {23.8, 33.8})):
            assert {key[index] for key in open_keys} == levels
    assert plan_of(0).confirm != plan_of(1).confirm


def test_measured_values_play_no_part() -> None:
    runs = cart_runs(1)
    other = [
        dataclasses.replace(run, measured={name: values * 2.0 for name, values in run.measured.items()})
        for run in runs
    ]
    first, second = (make_plan(Cart(), one, seed=3, alphas={}) for one in (runs, other))
    assert first.confirm == second.confirm
    assert first.data_sha256 != second.data_sha256


def test_few_conditions_lock_single_replicates() -> None:
    plan = plan_of(experiment=Experiment(replicates=4, rolls=(0.0,)))
    assert len(plan.confirm) == 4
    assert len({name.split("_")[0] for name in plan.confirm}) == 4


def test_series_lock_a_quarter() -> None:
    plan = make_plan(make_axis(), axis_runs(1, Drive(runs=12)), seed=0, alphas={})
    assert len(plan.confirm) == 3
    assert len(plan.discover) == 9


@pytest.mark.parametrize(
    ("expression", "count"),
    [
        ("slope_deg >= 20 and mass_kg > 30", 15),
        ("slope_deg == 10 or roll_deg == 0 and not mass_kg > 30", 21),
        ("5 < roll_deg <= 15", 24),
        ("run == 'c4_*'", 15),
        ("run == 'c1_p0_r?'", 3),
        ("roll_deg > -1 and run != 'c4_*' and slope_deg == 20", 15),
    ],
)
def test_an_expression_chooses(expression: str, count: int) -> None:
    plan = plan_of(confirm=expression)
    assert len(plan.confirm) == count
    assert plan.confirm_rule == expression


@pytest.mark.parametrize(
    ("expression", "words"),
    [
        ("slope_deg >=", "not an expression"),
        ("incline > 3", "has no 'incline'"),
        ("__import__('os').system('true')", "only comparisons"),
        ("run > 'c1'", "== and !="),
        ("slope_deg >= 0", "leave some on both sides"),
        ("slope_deg > 90", "leave some on both sides"),
    ],
)
def test_a_wrong_expression_is_told(expression: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words.replace("(", r"\(")):
        plan_of(confirm=expression)


def test_the_hash_covers_the_plan() -> None:
    plan = plan_of()
    one, other = plan.content(), dataclasses.replace(plan, seed=7).content()
    assert one["plan_sha256"] != other["plan_sha256"]
    assert one["plan_sha256"] == plan_of().content()["plan_sha256"]
    assert len(np.unique([*plan.discover, *plan.confirm])) == 60
