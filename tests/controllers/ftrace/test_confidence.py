"""What lowers the confidence in an angle."""

from dataclasses import replace

import pytest

from controllers.ftrace.parameters import DEFAULTS
from controllers.ftrace.rut.confidence import CurveQuality, confidence

CLEAR = CurveQuality(spread_m=0.004, residual_m=0.001, bend_rad=0.02)


@pytest.mark.parametrize("name", ["spread_m", "residual_m", "bend_rad"])
def test_each_predictor_lowers_it(name: str) -> None:
    values = [
        confidence(replace(CLEAR, **{name: value}), DEFAULTS.confidence) for value in (0.0, 0.01, 0.1, 1.0)
    ]

    assert values == sorted(values, reverse=True)
    assert len(set(values)) == len(values)


def test_it_is_near_one_for_a_clear_curve_and_near_zero_for_an_unclear_one() -> None:
    assert confidence(CLEAR, DEFAULTS.confidence) > 0.95
    assert confidence(CurveQuality(spread_m=0.05, residual_m=0.02, bend_rad=0.5), DEFAULTS.confidence) < 0.3
