"""Derivatives whose unknowns of single runs share columns, against the same in full."""

from dataclasses import replace

import numpy as np
import pytest

from rover_hil.gap.data.derivatives import Derivatives, in_full
from rover_hil.gap.data.problem import DerivativeRequest, Problem, observe
from rover_hil.gap.evidence import score
from rover_hil.gap.evidence.fit import Fit
from rover_hil.gap.evidence.score import Projection
from tests.rover_hil.gap.small_machine import MODEL, small_runs

RUNS, ROWS, SEED = 7, 6, 3


def packed() -> Derivatives:
    """Two parameters of all runs, an unknown of each run, and one of every second run."""
    rng = np.random.default_rng(SEED)
    places = np.full((RUNS, 4), -1, dtype=np.intp)
    places[:, 0], places[:, 1] = 0, 1
    places[:, 2] = 2 + np.arange(RUNS)
    places[::2, 3] = 2 + RUNS + np.arange((RUNS + 1) // 2)
    site = np.repeat(np.arange(RUNS), ROWS).astype(np.intp)
    values = rng.standard_normal((site.size, 4))
    values[places[site] < 0] = 0.0
    return Derivatives(
        values=values.astype(np.float64), site=site, places=places, count=int(places.max()) + 1
    )


def test_all_products_are_those_of_the_full_matrix() -> None:
    some = packed()
    full, rng = some.dense(), np.random.default_rng(SEED)
    rows, parameters = rng.standard_normal(RUNS * ROWS), rng.standard_normal(some.count)
    covariance = np.cov(rng.standard_normal((some.count, 40)))
    assert full.shape == (RUNS * ROWS, 2 + RUNS + 4)
    assert np.count_nonzero(full[:, 3]) == ROWS
    np.testing.assert_allclose(some.gram(), full.T @ full, atol=1e-12)
    np.testing.assert_allclose(some.along(rows), full.T @ rows, atol=1e-12)
    np.testing.assert_allclose(some.times(parameters), full @ parameters, atol=1e-12)
    np.testing.assert_allclose(some.scaled(parameters).dense(), full * parameters, atol=1e-12)
    np.testing.assert_allclose(some.columns([9, 0, 4]), full[:, [9, 0, 4]])
    np.testing.assert_allclose(some.squares(), (full**2).sum(axis=0), atol=1e-12)
    np.testing.assert_allclose(some.spread(covariance), np.diag(full @ covariance @ full.T), atol=1e-12)


def test_rows_of_one_run_have_its_parameters_only() -> None:
    some = packed()
    values, places = some.rows(some.site == 2)
    assert places == [0, 1, 4, 10]
    np.testing.assert_allclose(values, some.dense()[some.site == 2][:, places])


def test_a_matrix_in_full_stays_as_it_is() -> None:
    matrix = np.random.default_rng(SEED).standard_normal((5, 3))
    np.testing.assert_array_equal(in_full(matrix).dense(), matrix)


def test_what_base_parameters_absorb_is_the_same_without_the_full_matrix(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng, some = np.random.default_rng(SEED), packed().scaled(np.geomspace(1.0, 1e6, 13))
    residual, pull = rng.standard_normal(RUNS * ROWS), rng.standard_normal(some.count)
    fit = Fit(free=(), point={}, residual=residual, jacobian=some, pull=pull, cost=0.0)
    in_one = Projection(fit).residual
    monkeypatch.setattr(score, "MOST_DENSE", 0)
    np.testing.assert_allclose(Projection(fit).residual, in_one, atol=1e-9)


def test_known_derivatives_by_deviations_act_in_their_own_runs() -> None:
    first = replace(MODEL.parameters[0], scatter_sd=0.1)
    model = replace(MODEL, parameters=(first, *MODEL.parameters[1:]))
    problem = Problem(model, observe(model, small_runs(count=3)))
    free = problem.base_free()
    assert sum(item.key.is_deviation for item in free) == 3
    found = problem.derivatives({}, free)
    known = {item.key: found[:, place] for place, item in enumerate(free)}
    request = DerivativeRequest(problem, {}, free, known)
    assert not request.points
    np.testing.assert_array_equal(request.matrix([]).dense(), found)
