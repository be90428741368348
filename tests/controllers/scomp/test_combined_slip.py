import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.slip.scomp.combined_slip import CombinedSlip
from controllers.slip.scomp.two_segment_slip_law import fit_two_segments, two_segments_of_model
from drivers.errors import ModelError
from tests.controllers.scomp.single_wheel_fit import SingleWheelData, fit_single_wheel_data

TABLE_3 = CombinedSlip()
SLOPE = math.radians(12.0)
RANGE = (0.0, math.radians(25.0))


def one(value: float) -> np.ndarray:
    return np.array([value])


def forces(model: CombinedSlip, slip: float, angle_rad: float) -> tuple[float, float]:
    force_x_n, force_y_n = model.forces_n(one(slip), one(angle_rad))
    return float(force_x_n[0]), float(force_y_n[0])


def test_forces_of_table_3() -> None:
    assert forces(TABLE_3, 1.0, 0.0)[0] == pytest.approx(28.1, abs=0.05)
    assert float(TABLE_3.greatest_x_n(one(0.0))[0]) == pytest.approx(38.8, abs=0.05)
    slope_n = (forces(TABLE_3, 1e-6, 0.0)[0]) / 1e-6
    assert slope_n == pytest.approx(55.0 - TABLE_3.load_n * 0.02, rel=1e-4)
    slope_n = (forces(TABLE_3, 0.0, 1e-6)[1]) / 1e-6
    assert slope_n == pytest.approx(200.0 - TABLE_3.load_n * 0.04, rel=1e-4)


def test_forces_vanish_without_slip_and_are_odd() -> None:
    assert forces(TABLE_3, 0.0, 0.0) == (0.0, 0.0)
    ahead, aside = forces(TABLE_3, 0.3, 0.2)
    assert forces(TABLE_3, -0.3, -0.2) == pytest.approx((-ahead, -aside))


@pytest.mark.parametrize(
    ("angle_deg", "slip"),
    [(0, 0.3118), (5, 0.315), (10, 0.324), (15, 0.338), (20, 0.355), (25, 0.376), (30, 0.401)],
)
def test_slip_over_slip_angle_on_12_deg(angle_deg: float, slip: float) -> None:
    assert TABLE_3.slip_at(math.sin(SLOPE), math.radians(angle_deg)) == pytest.approx(slip, abs=6e-4)


@pytest.mark.parametrize(("slope_deg", "slip"), [(5, 0.114), (10, 0.250), (15, 0.416), (20, 0.632)])
def test_slip_over_slope(slope_deg: float, slip: float) -> None:
    assert TABLE_3.slip_at(math.sin(math.radians(slope_deg)), 0.0) == pytest.approx(slip, abs=6e-4)


@given(slip=st.floats(0.01, 0.95), angle_rad=st.floats(-0.6, 0.6))
def test_slip_at_inverts_the_forces(slip: float, angle_rad: float) -> None:
    traction = forces(TABLE_3, slip, angle_rad)[0] / TABLE_3.load_n
    assert TABLE_3.slip_at(traction, angle_rad) == pytest.approx(slip, abs=1e-6)
    assert TABLE_3.slip_at(-traction, angle_rad) == pytest.approx(-slip, abs=1e-6)


@given(traction=st.floats(0.01, 0.25), side_pull=st.floats(-0.2, 0.2).filter(lambda pull: abs(pull) > 1e-3))
def test_drift_at_delivers_both_forces(traction: float, side_pull: float) -> None:
    angle_rad = TABLE_3.drift_at(traction, side_pull)
    slip = TABLE_3.slip_at(traction, angle_rad)
    ahead_n, aside_n = forces(TABLE_3, slip, angle_rad)
    assert ahead_n / TABLE_3.load_n == pytest.approx(traction, rel=1e-4)
    assert aside_n / TABLE_3.load_n == pytest.approx(side_pull, rel=1e-4)


def test_traction_beyond_the_ground_gives_full_slip() -> None:
    assert TABLE_3.slip_at(0.9, 0.0) == pytest.approx(1.0)
    assert TABLE_3.slip_at(0.0, 0.3) == 0.0
    assert abs(TABLE_3.drift_at(0.1, -0.9)) <= math.pi / 3.0


def test_stiffness_in_place_of_the_models_own() -> None:
    soft = TABLE_3.model_copy(update={"c_x_n": 40.0})
    assert TABLE_3.slip_at(0.2, 0.1, 40.0) == soft.slip_at(0.2, 0.1)
    assert TABLE_3.slip_at(0.2, 0.1, 40.0) > TABLE_3.slip_at(0.2, 0.1)


def test_two_segments_of_12_deg() -> None:
    law = two_segments_of_model(TABLE_3, SLOPE, RANGE)
    assert law.slip_0 == pytest.approx(0.3118, abs=1e-4)
    assert math.radians(law.k_per_rad) == pytest.approx(0.00325, abs=1e-4)
    assert math.degrees(law.beta_0_rad) == pytest.approx(6.4, abs=0.3)
    assert law.fit_range_rad == RANGE
    assert law.slip_at(-0.3) == law.slip_at(0.3) > law.slip_at(0.0) == law.slip_0


def test_two_segments_depend_on_its_range() -> None:
    narrow, wide = (two_segments_of_model(TABLE_3, SLOPE, (0.0, math.radians(end))) for end in (20.0, 30.0))
    assert wide.k_per_rad > 1.2 * narrow.k_per_rad


def test_fit_two_segments_finds_both_lines() -> None:
    angle = np.linspace(-0.4, 0.4, 161)
    law = fit_two_segments(angle, 0.1 + 0.5 * np.maximum(0.0, np.abs(angle) - 0.15), RANGE)
    assert (law.slip_0, law.k_per_rad, law.beta_0_rad) == pytest.approx((0.1, 0.5, 0.15), abs=2e-3)
    falling = fit_two_segments(angle, 0.3 - 0.5 * np.abs(angle), RANGE)
    assert falling.k_per_rad == 0.0


def test_fit_two_segments_needs_points_in_its_range() -> None:
    with pytest.raises(ModelError, match="needs 6 points"):
        fit_two_segments(np.full(20, 1.0), np.full(20, 0.2), RANGE)


def trials(model: CombinedSlip, noise_n: float = 0.0) -> SingleWheelData:
    slip, angle = np.meshgrid(np.linspace(0.0, 0.8, 9), np.radians([5.0, 10.0, 15.0, 20.0, 25.0]))
    force_x_n, force_y_n = model.forces_n(slip.ravel(), angle.ravel())
    noise = noise_n * np.random.default_rng(3).standard_normal((2, slip.size))
    return SingleWheelData(
        slip=slip.ravel(),
        slip_angle_rad=angle.ravel(),
        force_x_n=force_x_n + noise[0],
        force_y_n=force_y_n + noise[1],
        load_n=model.load_n,
    )


@pytest.mark.parametrize(
    "model", [TABLE_3, CombinedSlip(mu=0.45, c_x_n=80.0, c_y_n=130.0, a_x=0.05, a_y=-0.03, load_n=50.0)]
)
def test_tuning_recovers_a_model(model: CombinedSlip) -> None:
    fit = fit_single_wheel_data(trials(model))
    for name in ("mu", "c_x_n", "c_y_n", "a_x", "a_y"):
        assert getattr(fit.model, name) == pytest.approx(getattr(model, name), rel=2e-3, abs=1e-3), name
    assert fit.force_x_rms_n < 1e-2


def test_tuning_follows_noisy_forces() -> None:
    truth = CombinedSlip(mu=0.5, c_x_n=70.0, c_y_n=150.0)
    fit = fit_single_wheel_data(trials(truth, noise_n=0.3))
    assert fit.force_x_rms_n == pytest.approx(0.3, rel=0.3)
    slip, angle = np.array([0.4]), np.array([0.2])
    assert fit.model.forces_n(slip, angle)[0][0] == pytest.approx(truth.forces_n(slip, angle)[0][0], abs=0.3)


def test_tuning_needs_low_and_high_slip() -> None:
    data = trials(TABLE_3)
    low = data.slip < 0.4
    short = SingleWheelData(
        slip=data.slip[low],
        slip_angle_rad=data.slip_angle_rad[low],
        force_x_n=data.force_x_n[low],
        force_y_n=data.force_y_n[low],
        load_n=data.load_n,
    )
    with pytest.raises(ModelError, match="measure more slips"):
        fit_single_wheel_data(short)


def test_one_outlier_at_the_end_makes_no_corner() -> None:
    angle = np.linspace(0.0, 0.3, 40)
    slip = np.where(angle < 0.3, 0.2, 0.9)
    law = fit_two_segments(angle, slip, RANGE)
    assert law.beta_0_rad < 0.25
    assert law.k_per_rad < 5.0
