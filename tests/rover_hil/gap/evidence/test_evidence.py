"""What counts as evidence: left-out runs with declared or learned noise, or the likelihood of all values."""

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rover_hil.gap.evidence.evidence import Evidence, LearnedEvidence, RowEvidence
from rover_hil.gap.noise.autoregression import Autoregression

RUNS, LEARNED, ROWS = Evidence(), LearnedEvidence((), Autoregression(lags=(), new_sd=())), RowEvidence(10.0)


def fit(**values: object) -> Any:
    return cast("Any", SimpleNamespace(**values))


@pytest.mark.parametrize(("evidence", "is_within"), [(RUNS, True), (LEARNED, False), (ROWS, False)])
def test_only_declared_noise_explains_a_rest(evidence: Evidence, *, is_within: bool) -> None:
    assert evidence.is_within_noise(fit(is_noise=True)) is is_within


def test_learned_noise_charges_the_pulls_of_base_parameters() -> None:
    left_out = SimpleNamespace(squares=np.array([8.0, 4.0]), counts=np.array([4.0, 4.0]))
    found = fit(left_out=left_out, pulls=3.0)
    assert RUNS.merit(found) == pytest.approx(4.0 * math.log(2.0))
    assert LEARNED.merit(found) == pytest.approx(4.0 * math.log(2.0) + 3.0)


def test_of_uncertain_errors_a_larger_difference_of_the_likelihood_is_equal() -> None:
    one, other = fit(merit=8.0), fit(merit=0.0, inflation=1.0, freedom=math.inf)
    assert not RowEvidence(math.inf).is_equal(one, other)
    assert RowEvidence(10.0).is_equal(one, fit(merit=0.0, inflation=1.0, freedom=10.0))


def test_a_gap_in_the_pulls_alone_is_explained_where_nothing_is_left() -> None:
    """No closure is defined there: declared noise falls back on left-out runs, the others on the rest."""
    shares = [one.share_of_gap(None, 0.2, 0.5) for one in (RUNS, LEARNED, ROWS)]
    assert shares == [0.2, 1.0, 1.0]
    assert [one.share_of_gap(0.7, 0.2, 0.001) for one in (RUNS, LEARNED, ROWS)] == [0.7, 0.7, 0.2]


def test_locked_runs_contradict_by_runs_or_by_the_lean_of_values() -> None:
    assert RUNS.is_contradicted(0.4, 0.5, (0.0, 10.0))
    assert not RUNS.is_contradicted(0.6, 0.5, (9.0, 10.0))
    assert ROWS.is_contradicted(0.6, 0.5, (9.0, 10.0))
    assert not ROWS.is_contradicted(0.4, -0.5, (2.0, 10.0))
