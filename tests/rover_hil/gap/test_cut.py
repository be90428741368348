"""Long records are cut into runs, and the beginning of records is left out."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from drivers.errors import ConfigError
from rover_hil.gap.checks import missing_values, object_to
from rover_hil.gap.data.cut import cut_runs, without_warm_up
from rover_hil.gap.workflow import analyse
from sim_backends.models.interface import Array, Run
from sim_backends.state_model import effects
from tests.rover_hil.gap.gap_models import Cart
from tests.rover_hil.gap.small_machine import MODEL, small_runs


def test_a_record_is_cut_into_runs_and_a_long_remainder_is_a_run() -> None:
    (record,) = small_runs(samples=175, count=1)
    parts = cut_runs(MODEL, [record], 5.0)
    assert [part.name for part in parts] == ["run0 part 1", "run0 part 2", "run0 part 3", "run0 part 4"]
    assert [part.inputs["power"].size for part in parts] == [50, 50, 50, 25]
    joined = np.concatenate([part.measured["reading"] for part in parts])
    assert np.array_equal(joined, record.measured["reading"])


def test_a_short_remainder_stays_with_the_last_run() -> None:
    parts = cut_runs(MODEL, small_runs(samples=120, count=1), 5.0)
    assert [part.inputs["power"].size for part in parts] == [50, 70]


def test_times_begin_at_zero_in_every_part() -> None:
    model = replace(MODEL, step_s=None)
    record = small_runs(model, samples=100, count=1)
    first, second = cut_runs(model, record, 5.0)
    assert first.inputs["t_s"][0] == second.inputs["t_s"][0] == 0.0
    assert second.inputs["t_s"][-1] == pytest.approx(4.9)


def test_short_records_and_their_names_stay() -> None:
    runs = small_runs()
    assert cut_runs(MODEL, runs, 6.0) == runs


LATE = replace(
    MODEL,
    port_effects=(
        effects.delay("power", size=0.1, longest=1.0),
        effects.lag("power", size=0.1, longest=1.5),
    ),
)


def test_parts_begin_earlier_where_a_delay_and_a_lag_remember_the_input_and_are_not_compared_there() -> None:
    (record,) = small_runs(samples=200, count=1)
    first, second, *_ = cut_runs(LATE, [record], 5.0)
    assert (first.count, second.count, second.overlap) == (50, 50 + 25, (25, 0))
    assert np.array_equal(second.inputs["power"], record.inputs["power"][25:100])
    assert np.flatnonzero(np.isfinite(second.measured["reading"])).tolist() == [*range(25, 75)]
    assert second.first == {"reading": record.measured["reading"][25]}
    assert cut_runs(LATE, [record], 3.0)[1].overlap == (25, 0)
    longer = replace(LATE, port_effects=(effects.delay("power", size=0.1, longest=60.0),))
    assert cut_runs(longer, [record], 5.0)[1].overlap == (50, 0)


def test_a_delay_in_a_record_that_is_cut_has_its_size() -> None:
    """Truth: the input seven samples late, then the exact response. Without the input before: not NAMED."""
    rng = np.random.default_rng(3)
    power = np.repeat(rng.uniform(-2.0, 2.0, 80), 10)
    late, keep = np.concatenate((np.full(7, power[0]), power[:-7])), np.exp(-0.05)
    warmth = np.zeros(800)
    for index in range(1, 800):
        warmth[index] = keep * warmth[index - 1] + (1.0 - keep) / 0.5 * late[index - 1]
    measured = {"reading": warmth + rng.normal(0.0, 0.02, 800)}
    record = Run(name="record", conditions={}, inputs={"power": power}, measured=measured)
    verdict = analyse(LATE, cut_runs(LATE, [record], 10.0)).verdict
    assert (verdict.verdict, verdict.confidence_set) == ("NAMED", [["delay"]]), verdict.sentence
    assert verdict.effects[0].parameters["time"].value == pytest.approx(0.7, abs=0.01)


def test_missing_values_are_counted_with_the_first_part() -> None:
    (record,) = small_runs(samples=100, count=1)
    parts = cut_runs(MODEL, [replace(record, missing={"speed": (3, 100)})], 5.0)
    assert [dict(part.missing) for part in parts] == [{"speed": (3, 100)}, {}]


def test_too_short_parts_are_refused() -> None:
    with pytest.raises(
        ConfigError, match=r"run0 has 20 samples in 2 s; at least 30 are needed.* 3 s or more"
    ):
        cut_runs(MODEL, small_runs(), 2.0)


def test_a_state_with_a_fixed_start_is_refused() -> None:
    def start(p: SimpleNamespace, u: SimpleNamespace) -> dict[str, Array]:
        return {"warmth": p.first, "wear": 0.0 * p.first}

    model = replace(MODEL, states={"warmth": "K", "wear": "1"}, start=start)
    with pytest.raises(
        ConfigError, match=r"state wear of model body begins with the same value in every run"
    ):
        cut_runs(model, small_runs(samples=120), 5.0)


def test_a_start_from_an_input_is_no_fixed_start() -> None:
    def start(p: SimpleNamespace, u: SimpleNamespace) -> dict[str, Array]:
        return {"warmth": p.gain * u.power / p.loss}

    model = replace(MODEL, start=start)
    assert len(cut_runs(model, small_runs(samples=120, count=1), 5.0)) == 2


def test_only_machines_are_cut() -> None:
    with pytest.raises(ConfigError, match="--cut: only a StateModel"):
        cut_runs(Cart(), [], 5.0)
    with pytest.raises(ConfigError, match="--warm-up: only records of a StateModel"):
        without_warm_up(Cart(), [], 5.0)


def test_the_warm_up_is_not_compared_but_simulated() -> None:
    runs = small_runs()
    shorter = without_warm_up(MODEL, runs, 1.0)
    for before, after in zip(runs, shorter, strict=True):
        assert after.inputs["power"] is before.inputs["power"]
        # The first value stays: the state begins there.
        assert np.flatnonzero(np.isnan(after.measured["reading"])).tolist() == list(range(10))
        assert after.overlap == (10, 0)
    assert missing_values(MODEL, shorter) == []
    assert object_to(MODEL, shorter) is None


def test_a_warm_up_leaves_nothing_where_no_state_starts_from_the_channel() -> None:
    model = replace(MODEL, run_parameters=(replace(MODEL.run_parameters[0], channel=""),))
    (run, *_) = without_warm_up(model, small_runs(), 1.0)
    assert np.isnan(run.measured["reading"][:10]).all()


def test_a_warm_up_as_long_as_the_record_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"--warm-up: 10 samples of run run0 are left; at least 30"):
        without_warm_up(MODEL, small_runs(), 5.0)
