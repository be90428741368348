"""The guarded filter: textbook answers, and refusal of everything that would spoil the state."""

import math
from typing import Any

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from controllers.estimation.filter.guarded_filter import GuardedFilter
from controllers.estimation.filter.measurement_model import Measured

NOTHING = np.zeros((2, 2))
SAME = np.eye(2)
FIRST, SECOND = np.eye(2)


def make(angles: tuple[int, ...] = (), gate: float = 0.9995) -> GuardedFilter:
    return GuardedFilter([0.0, 0.0], [1.0, 4.0], angles, gate)


def memory(guarded: GuardedFilter) -> tuple[list[float], list[list[float]]]:
    return guarded.state, guarded.covariance


def test_an_update_gives_the_textbook_answer() -> None:
    guarded = make()
    innovation = guarded.update(Measured("level"), 3.0, SECOND, 4.0)
    assert guarded.state == pytest.approx([0.0, 1.5])
    assert np.array(guarded.covariance) == pytest.approx(np.diag([1.0, 2.0]))
    assert innovation.name == "level"
    assert (innovation.residual, innovation.variance, innovation.nis) == (3.0, 8.0, 9.0 / 8.0)
    assert innovation.accepted


def test_a_prediction_takes_the_given_state_and_spreads_the_covariance() -> None:
    guarded = make()
    transition = np.array([[1.0, 0.5], [0.0, 1.0]])
    assert guarded.predict(0.5, [7.0, 8.0], transition, np.diag([0.1, 0.2]))
    assert guarded.state == [7.0, 8.0]
    expected = [[1.0 + 0.25 * 4.0 + 0.1, 2.0], [2.0, 4.2]]
    assert np.array(guarded.covariance) == pytest.approx(np.array(expected))


def test_an_angle_goes_the_short_way_round() -> None:
    guarded = make(angles=(0,))
    guarded.predict(0.0, [3.1, 0.0], SAME, NOTHING)
    guarded.update(Measured("heading"), 0.3, FIRST, 1.0)
    assert guarded.state[0] == pytest.approx(3.25 - math.tau)
    guarded.predict(0.0, [4.0, 4.0], SAME, NOTHING)
    assert guarded.state == pytest.approx([4.0 - math.tau, 4.0])


@pytest.mark.parametrize("gate", [0.9, 0.99, 0.9995])
def test_the_gate_is_the_chi_square_quantile(gate: float) -> None:
    edge = math.sqrt(float(chi2.ppf(gate, 1)) * 2.0)
    inside, outside = make(gate=gate), make(gate=gate)
    assert inside.update(Measured("level"), 0.999 * edge, FIRST, 1.0).accepted
    before = memory(outside)
    innovation = outside.update(Measured("level"), 1.001 * edge, FIRST, 1.0)
    assert not innovation.accepted
    assert innovation.residual == 1.001 * edge
    assert memory(outside) == before


@pytest.mark.parametrize(
    ("residual", "row", "variance"),
    [
        (math.nan, FIRST, 1.0),
        (math.inf, FIRST, 1.0),
        (1.0, np.array([math.nan, 0.0]), 1.0),
        (1.0, np.array([math.inf, 0.0]), 1.0),
        (1.0, FIRST, math.nan),
        (1.0, FIRST, math.inf),
        (1.0, FIRST, 0.0),
        (1.0, FIRST, -1.0),
    ],
)
def test_an_unusable_measurement_is_reported_and_changes_nothing(
    residual: float, row: Any, variance: float
) -> None:
    guarded = make()
    before = memory(guarded)
    innovation = guarded.update(Measured("level"), residual, row, variance)
    assert not innovation.accepted
    assert innovation.nis is None
    assert memory(guarded) == before


@pytest.mark.parametrize(
    ("dt_s", "state", "transition", "noise"),
    [
        (-1e-9, [1.0, 1.0], SAME, NOTHING),
        (math.nan, [1.0, 1.0], SAME, NOTHING),
        (math.inf, [1.0, 1.0], SAME, NOTHING),
        (0.1, [math.nan, 1.0], SAME, NOTHING),
        (0.1, [1.0, math.inf], SAME, NOTHING),
        (0.1, [1.0, 1.0], SAME * math.nan, NOTHING),
        (0.1, [1.0, 1.0], SAME, np.full((2, 2), math.inf)),
    ],
)
def test_an_unusable_prediction_changes_nothing(
    dt_s: float, state: list[float], transition: Any, noise: Any
) -> None:
    guarded = make()
    before = memory(guarded)
    assert not guarded.predict(dt_s, state, transition, noise)
    assert memory(guarded) == before
    assert guarded.update(Measured("level"), 0.1, FIRST, 1.0).accepted


def test_an_indefinite_covariance_is_lifted_without_drowning_the_small_variance() -> None:
    guarded = GuardedFilter([0.0, 0.0], [1e-6, 1e6], (), 0.9995)
    assert guarded.predict(0.1, [0.0, 0.0], SAME, np.array([[0.0, 1.5], [1.5, 0.0]]))
    covariance = np.array(guarded.covariance)
    np.linalg.cholesky(covariance + np.diag([1e-18, 1e-6]))
    assert covariance[0, 0] < 1e-5
    assert guarded.update(Measured("level"), 0.0, FIRST, 1.0).accepted


small = st.floats(-1.0, 1.0)


@given(
    steps=st.lists(
        st.tuples(small, small, small, st.floats(0.0, 1.0), st.floats(1e-8, 1.0)), min_size=1, max_size=30
    )
)
def test_the_covariance_stays_symmetric_and_positive(
    steps: list[tuple[float, float, float, float, float]],
) -> None:
    guarded = GuardedFilter([0.0] * 4, [1e-12, 1e-12, 1e-12, 10.0], (2,), 0.9995)
    for a, b, c, noise, variance in steps:
        transition = np.eye(4)
        transition[0, 2], transition[1, 2], transition[2, 3] = a, b, c
        assert guarded.predict(0.1, guarded.state, transition, np.diag([noise, 0.0, noise * 1e-9, 0.0]))
        guarded.update(Measured("level"), a, np.array([0.0, b, 1.0, c]), variance)
        covariance = np.array(guarded.covariance)
        assert (covariance == covariance.T).all()
        scale = np.sqrt(np.diag(covariance))
        assert (scale > 0.0).all()
        assert np.linalg.eigvalsh(covariance / np.outer(scale, scale)).min() > -1e-12


def test_a_prediction_spreads_the_covariance_as_filterpy_does() -> None:
    generator = np.random.default_rng(4)
    start = [1e-6, 1.0, 4.0, 0.3]
    guarded, peer = GuardedFilter([0.0] * 4, start, (), 0.9995), ExtendedKalmanFilter(4, 1)
    peer.P = np.diag(start)
    for _ in range(20):
        peer.F = np.eye(4) + 0.3 * generator.standard_normal((4, 4))
        root = generator.standard_normal((4, 4))
        peer.Q = root @ root.T
        peer.predict()
        assert guarded.predict(0.1, [0.0] * 4, peer.F, peer.Q)
        assert np.array(guarded.covariance) == pytest.approx(peer.P, rel=1e-12, abs=1e-12 * peer.P.max())


@pytest.mark.parametrize("count", [1, 3])
def test_an_update_is_filterpys(count: int) -> None:
    generator = np.random.default_rng(5)
    start = [1e-6, 1.0, 4.0, 0.3]
    guarded, peer = GuardedFilter([0.0] * 4, start, (), 0.9995), ExtendedKalmanFilter(4, count)
    peer.P = np.diag(start)
    for _ in range(20):
        transition = np.eye(4) + 0.1 * generator.standard_normal((4, 4))
        guarded.predict(0.1, guarded.state, transition, 0.01 * np.eye(4))
        peer.P = transition @ peer.P @ transition.T + 0.01 * np.eye(4)
        rows, variances = generator.standard_normal((count, 4)), generator.uniform(0.1, 1.0, count)
        totals = rows @ peer.P @ rows.T + np.diag(variances)
        residuals = 0.3 * generator.standard_normal(count)
        if count == 1:
            innovations: tuple[Any, ...] = (
                guarded.update(Measured("one"), residuals.item(), rows[0], variances.item()),
            )
        else:
            innovations = guarded.update_together([Measured("one")] * count, residuals, rows, variances)
        expected = rows @ peer.x.ravel()
        peer.update(
            (residuals + expected).reshape(-1, 1),
            lambda _, rows=rows: rows,
            lambda x, rows=rows: rows @ x,
            R=np.diag(variances),
        )
        assert all(innovation.accepted for innovation in innovations)
        assert [innovation.variance for innovation in innovations] == pytest.approx(np.diag(totals))
        assert guarded.state == pytest.approx(peer.x.ravel(), abs=1e-12)
        assert np.array(guarded.covariance) == pytest.approx(peer.P, rel=1e-9, abs=1e-12 * peer.P.max())


def test_measurements_together_are_gated_by_their_common_nis() -> None:
    guarded = GuardedFilter([0.0, 0.0], [1.0, 4.0], (), 0.95)
    rows, variances = np.array([[1.0, 0.5], [0.0, 1.0]]), np.array([0.5, 0.2])
    totals = rows @ np.diag([1.0, 4.0]) @ rows.T + np.diag(variances)
    direction = np.array([0.3, -0.4])
    edge = math.sqrt(float(chi2.ppf(0.95, 2)) / float(direction @ np.linalg.solve(totals, direction)))
    outside = guarded.update_together(
        [Measured("x"), Measured("y")], 1.001 * edge * direction, rows, variances
    )
    assert not any(innovation.accepted for innovation in outside)
    assert guarded.state == [0.0, 0.0]
    inside = guarded.update_together(
        [Measured("x"), Measured("y")], 0.999 * edge * direction, rows, variances
    )
    assert all(innovation.accepted for innovation in inside)


def test_a_held_state_is_not_corrected_but_its_uncertainty_and_correlation_count() -> None:
    """Schmidt's filter in closed form: Joseph's form with a gain of zero for the held state."""
    start, rows, variances = np.diag([1.0, 4.0]), np.array([[1.0, 2.0], [1.0, -1.0]]), np.array([0.5, 0.2])
    guarded = make()
    names = [Measured("x"), Measured("y")]
    guarded.update_together(names, np.array([1.0, 0.4]), rows, variances, held=(1,))

    state, covariance = np.zeros(2), start
    for reading, row, variance in zip((1.0, 0.4), rows, variances, strict=True):
        gain = covariance @ row / (row @ covariance @ row + variance) * [1.0, 0.0]
        state = state + gain * (reading - row @ state)
        rest = np.eye(2) - np.outer(gain, row)
        covariance = rest @ covariance @ rest.T + variance * np.outer(gain, gain)
    assert guarded.state == pytest.approx(state)
    assert guarded.state[1] == 0.0
    assert np.array(guarded.covariance) == pytest.approx(covariance)
    assert guarded.covariance[1][1] == 4.0
    assert guarded.covariance[0][1] != 0.0
