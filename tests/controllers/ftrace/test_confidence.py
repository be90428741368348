"""What lowers the confidence in an angle."""

from dataclasses import replace

import pytest

from controllers.ftrace.rut.confidence import RutMethod, Signs, confidence

CLEAR = Signs(spread_m=0.004, residual_m=0.001, bend_rad=0.02)


@pytest.mark.parametrize("method", ["rut", "memory", "fused"])
@pytest.mark.parametrize("sign", ["spread_m", "residual_m", "bend_rad"])
def test_each_sign_lowers_it(method: RutMethod, sign: str) -> None:
    values = [confidence(replace(CLEAR, **{sign: value}), method) for value in (0.0, 0.01, 0.1, 1.0)]

    assert values == sorted(values, reverse=True)
    assert len(set(values)) == len(values)


@pytest.mark.parametrize("method", ["rut", "memory", "fused"])
def test_it_is_near_one_for_a_clear_curve_and_near_zero_for_an_unclear_one(method: RutMethod) -> None:
    assert confidence(CLEAR, method) > 0.95
    assert confidence(Signs(spread_m=0.05, residual_m=0.02, bend_rad=0.5), method) < 0.3
