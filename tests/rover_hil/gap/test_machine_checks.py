"""Requirements on the data of machines: a scale of noise, and channels slower than the inputs."""

from dataclasses import replace

import numpy as np
import pytest

from rover_hil.gap.checks import missing_values, object_to, samples_per_value, slower_channels
from sim_backends.models.interface import Array, Channel, Run
from tests.rover_hil.gap.small_machine import MODEL, small_runs


def _with_readings(runs: list[Run], keep: Array) -> list[Run]:
    """Return runs whose readings are missing where `keep` is 0."""
    return [
        replace(run, measured={"reading": np.where(keep > 0.0, run.measured["reading"], np.nan)})
        for run in runs
    ]


def test_a_channel_without_a_scale_cannot_decide() -> None:
    model = replace(MODEL, channels=(Channel(name="reading", unit="K"),))
    objection = object_to(model, small_runs())
    assert objection is not None
    assert objection.is_identifiability
    assert objection.reason == (
        "channel reading: sensor noise and model error are not separable: declare sigma or quantum of its "
        "sensor in the model"
    )


@pytest.mark.parametrize(
    "channel", [Channel(name="reading", unit="K", sigma=0.1), Channel(name="reading", unit="K", quantum=0.1)]
)
def test_a_declared_scale_is_enough(channel: Channel) -> None:
    assert object_to(replace(MODEL, channels=(channel,)), small_runs()) is None


def test_missing_values_of_a_machine_are_counted() -> None:
    keep = np.ones(60)
    keep[[7, 20, 41]] = 0.0
    runs = _with_readings(small_runs(), keep)
    assert object_to(MODEL, runs) is None
    assert [(one.run, one.count, one.total) for one in missing_values(MODEL, runs)][:1] == [("run0", 3, 60)]


def test_too_many_missing_values_of_a_machine_are_bad_data() -> None:
    keep = np.ones(60)
    keep[10:30] = 0.0
    objection = object_to(MODEL, _with_readings(small_runs(), keep))
    assert objection is not None
    assert not objection.is_identifiability
    assert "20 of 60 values of reading are missing" in objection.reason


def test_a_channel_in_its_own_slower_rhythm_is_complete() -> None:
    keep = (np.arange(60) % 3 == 1).astype(np.float64)
    runs = _with_readings(small_runs(), keep)
    assert object_to(MODEL, runs) is None
    assert missing_values(MODEL, runs) == []
    assert slower_channels(MODEL, runs) == [
        "channel reading has a value at every 3rd sample of the inputs; the samples between are not compared"
    ]


def test_a_channel_whose_clock_runs_beside_that_of_the_inputs_is_complete() -> None:
    keep = np.diff(np.floor(np.arange(60) / 3.4), prepend=-1.0)
    runs = _with_readings(small_runs(), keep)
    assert object_to(MODEL, runs) is None
    assert missing_values(MODEL, runs) == []
    keep[np.flatnonzero(keep)[4]] = 0.0
    runs = _with_readings(small_runs(), keep)
    assert [(one.count, one.total) for one in missing_values(MODEL, runs)][:1] == [(1, 18)]


def test_gaps_in_a_slower_rhythm_are_counted() -> None:
    keep = (np.arange(60) % 2 == 0).astype(np.float64)
    keep[[10, 12, 14, 40]] = 0.0
    objection = object_to(MODEL, _with_readings(small_runs(), keep))
    assert objection is not None
    assert "4 of 30 values of reading are missing" in objection.reason


def test_values_missing_at_random_have_no_rhythm() -> None:
    rng = np.random.default_rng(2)
    values = np.where(rng.random(300) < 0.4, 1.0, np.nan)
    assert samples_per_value(values) == 1
    assert slower_channels(MODEL, small_runs()) == []
