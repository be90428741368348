"""Confidence in a trace."""

from controllers.ftrace.parameters import DEFAULTS
from controllers.ftrace.rut.confidence import confidence, within


def test_it_increases_with_the_evidence() -> None:
    values = [confidence(log_odds, DEFAULTS.confidence) for log_odds in (-float("inf"), -5.0, 0.0, 5.0, 50.0)]

    assert values == sorted(set(values))
    assert values[0] < 0.05
    assert values[-1] > 0.95


def test_a_trace_that_is_reported_is_more_likely_than_not() -> None:
    assert confidence(DEFAULTS.presence.lock_odds, DEFAULTS.confidence) > 0.5


def test_an_angle_of_great_deviation_is_less_likely_right() -> None:
    assert within(5.0, 0.5) > 0.999
    assert round(within(5.0, 5.0), 3) == 0.683
    assert round(within(5.0, 2.5), 3) == 0.954
