import math

import numpy as np
import pytest

from controllers.ftrace.parameters import DEFAULTS
from controllers.ftrace.rut.path_filter import PathFilter

STEP_M = 0.016
GATE_SD = DEFAULTS.search.contradiction_sd
SEEN_M = np.arange(0.08, 0.6, 0.04)


def circle(curvature_1_m: float, slope: float) -> np.ndarray:
    """Return y at the seen places of a path with this slope and curvature at the contact."""
    return slope * SEEN_M + curvature_1_m * SEEN_M**2 / 2


@pytest.mark.parametrize(("slope", "curvature"), [(0.1, 0.0), (-0.15, 0.4), (0.05, -0.6)])
def test_one_observed_curve_gives_its_direction_at_the_wheel(slope: float, curvature: float) -> None:
    path = PathFilter(0.6, DEFAULTS.path)

    path.observe_trace(SEEN_M, circle(curvature, slope), np.full(len(SEEN_M), 0.001), 0.001, 0.001)

    assert math.degrees(path.theta_rad) == pytest.approx(-math.degrees(math.atan(slope)), abs=1.5)
    assert np.allclose(path.curve(SEEN_M), circle(curvature, slope), atol=0.003)


def test_without_observations_the_direction_is_kept() -> None:
    path = PathFilter(0.6, DEFAULTS.path)
    path.observe_trace(SEEN_M, circle(0.0, 0.1), np.full(len(SEEN_M), 0.001), 0.0005, 0.001)
    before = path.theta_rad, path.trace(SEEN_M)[1][0, 0]

    for _ in range(5):
        path.advance(STEP_M, 0.0, 0.0005)

    assert path.theta_rad == pytest.approx(before[0], abs=math.radians(1.0))
    assert path.trace(SEEN_M)[1][0, 0] > before[1]


def test_a_turn_of_the_rover_shows_in_the_angle_at_once() -> None:
    """After a turn to the left on the spot the wheel moves to the right of its axis."""
    path = PathFilter(0.6, DEFAULTS.path)
    path.observe_trace(SEEN_M, circle(0.0, 0.0), np.full(len(SEEN_M), 0.001), 0.0005, 0.001)
    before = path.theta_rad

    path.advance(0.001, math.radians(3.0), 0.0005)

    assert math.degrees(path.theta_rad - before) == pytest.approx(-3.0, abs=0.3)


def test_motion_seen_directly_gives_the_angle() -> None:
    path = PathFilter(0.6, DEFAULTS.path)
    for _ in range(20):
        path.advance(STEP_M, 0.0, 0.0005)
        path.observe_motion(STEP_M, 0.1 * STEP_M, 0.0001, GATE_SD)

    assert math.tan(path.theta_rad) == pytest.approx(-0.1, abs=0.01)


def test_the_covariance_stays_symmetric_and_positive_over_a_long_drive() -> None:
    path = PathFilter(0.6, DEFAULTS.path)
    rng = np.random.default_rng(3)
    for _ in range(150):
        path.advance(STEP_M, float(rng.normal(0, 0.003)), 0.001)
        y = circle(0.2, 0.05) + rng.normal(0, 0.003, len(SEEN_M))
        path.observe_trace(SEEN_M, y, np.full(len(SEEN_M), 0.004), 0.006, 0.01)

    _, covariance = path.trace(SEEN_M)
    assert np.linalg.eigvalsh(covariance).min() > -1e-12
    assert math.isfinite(path.theta_rad)


def test_a_motion_that_no_wheel_can_make_is_not_believed_and_widens_the_angle() -> None:
    """From one frame to the next the direction cannot turn by 20 deg: the shadow that sweeps is followed."""
    path = PathFilter(0.6, DEFAULTS.path)

    def step(slope: float) -> float:
        path.advance(STEP_M, 0.0, 0.0005)
        return path.observe_motion(STEP_M, slope * STEP_M, 0.0001, GATE_SD)

    ratios = [step(0.1) for _ in range(30)]
    before_rad, before_sd_rad = path.theta_rad, path.theta_sd_rad
    wrong = [step(0.1 + math.tan(math.radians(20.0))) for _ in range(4)]

    assert max(ratios[5:]) < 1.0
    assert min(wrong) > GATE_SD**2
    assert path.theta_rad == pytest.approx(before_rad, abs=math.radians(0.5))
    assert path.theta_sd_rad > 2.0 * before_sd_rad
