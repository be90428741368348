"""Motion of the body and its noise, by the states of slip, for wheels that are steered."""

import cmath
import math

import numpy as np
import pytest

from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.filter.transition import Turn
from controllers.estimation.pose_estimate import YawSource
from controllers.estimation.settings import FilterSettings
from controllers.estimation.wheels.odometry import BodyIncrement
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


@pytest.mark.parametrize("steering_deg", [0.0, 45.0, 90.0])
def test_the_noise_of_a_step_is_that_of_its_most_uncertain_axis(steering_deg: float) -> None:
    """A fix that comes late is compared with the motion since; it must not count as better than it is."""
    slip = states()
    steps = []
    for angle_rad in (0.0, math.radians(steering_deg)):
        pose_filter = PoseFilter(FilterSettings(), (), ("floor",), is_compensated=True, slip=slip)
        rolled_m = cmath.rect(0.004, angle_rad)
        increment = BodyIncrement(x_m=rolled_m.real, y_m=rolled_m.imag, turn_rad=0.0, duration_s=0.05)
        steps.append(pose_filter.predict(increment, Turn(angle_rad=0.0, source=YawSource.WHEELS)))
    assert steps[1].position_m2 == pytest.approx(steps[0].position_m2, rel=1e-9)
    step = slip.predict(slip.start, BodyIncrement(x_m=0.004, y_m=0.0, turn_rad=0.0, duration_s=0.05))
    by_slip_m2 = float(np.trace(step.travel_noise_m2))
    by_wheels_m2 = FilterSettings().position_noise_m_sqrt_m ** 2 * 0.004
    assert steps[0].position_m2 == pytest.approx(by_slip_m2 + by_wheels_m2, rel=1e-9)
