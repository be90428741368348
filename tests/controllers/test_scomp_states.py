"""Motion of the body and its noise, by the states of slip, for wheels that are steered."""

import cmath
import math

import numpy as np
import pytest

from controllers.estimation.odometry import BodyIncrement
from controllers.slip.scomp.settings import ScompSettings
from controllers.slip.scomp.states import ScompStates


def states() -> ScompStates:
    made = ScompStates(ScompSettings().parameters)
    made.take_tilt(math.radians(8.0), math.radians(-6.0))
    return made


@pytest.mark.parametrize("steering_deg", [0.0, 45.0, -30.0, 180.0])
def test_the_noise_of_the_travel_is_along_the_travel(steering_deg: float) -> None:
    slip = states()
    rolled_m = cmath.rect(0.004, math.radians(steering_deg))
    step = slip.predict(
        slip.start, BodyIncrement(x_m=rolled_m.real, y_m=rolled_m.imag, turn_rad=0.0, duration_s=0.05)
    )
    variances_m2, axes = np.linalg.eigh(step.travel_noise_m2)
    travel = np.array([step.travel_m.real, step.travel_m.imag]) / abs(step.travel_m)
    assert abs(float(axes[:, -1] @ travel)) == pytest.approx(1.0, abs=1e-9)
    assert variances_m2[-1] > 1e-8
    assert abs(variances_m2[0]) < 1e-9 * variances_m2[-1]


def test_wheels_at_rest_add_no_noise() -> None:
    slip = states()
    step = slip.predict(slip.start, BodyIncrement(x_m=0.0, y_m=0.0, turn_rad=0.0, duration_s=0.05))
    assert not step.travel_noise_m2.any()
