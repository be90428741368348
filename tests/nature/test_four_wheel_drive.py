import numpy as np
import pytest

from tests.nature.four_wheel_drive import (
    MOUNDS,
    SIDEWAYS,
    Rover,
    Site,
    Soil,
    drive,
    field_test,
)

LEVEL = Site(way_m=3.0, grade_deg=0.0, mounds=())
STILL = Soil(patchiness=0.0)
PERFECT = Rover(
    compass_bias=0.0,
    compass_errors=(0.0, 0.0, 0.0, 0.0),
    compass_noise=0.0,
    gyro_noise_s=0.0,
    tilt_noise=0.0,
    trace_rms=0.0,
    lost_share=0.0,
)


def test_level_ground_asks_for_the_rolling_resistance_only() -> None:
    truth = drive(LEVEL, STILL, PERFECT, np.random.default_rng(1)).truth
    drives = truth["t_s"] > 4.0
    assert truth["slip_angle_rad"][drives] == pytest.approx(0.0, abs=1e-6)
    # Hyperbola: grip s / (half + s) = rolling (1 + growth s), every wheel with a quarter of the weight.
    slip = float(truth["slip"][-1])
    assert 0.92 * slip / (0.75 + slip) == pytest.approx(0.055 * (1.0 + 0.8 * slip), rel=0.01)


@pytest.mark.parametrize("side", [1, -1])
def test_a_mound_on_the_left_pushes_to_the_right(side: int) -> None:
    site = Site(way_m=4.0, grade_deg=3.0, mounds=((2.0, side * 0.9, 0.25, 0.8),))
    truth = drive(site, STILL, PERFECT, np.random.default_rng(1)).truth
    at = int(np.argmin(np.abs(truth["x_m"] - 2.0)))
    assert side * truth["roll_rad"][at] > 0.05
    assert side * truth["slip_angle_rad"][at] < -0.05


def test_sensors_without_errors_tell_the_truth() -> None:
    site = Site(way_m=4.0, grade_deg=3.0, mounds=((2.0, 0.9, 0.25, 0.8),))
    recorded = drive(site, STILL, PERFECT, np.random.default_rng(1))
    log, truth = recorded.log, recorded.truth
    assert np.radians(log["pitch_deg"]) == pytest.approx(truth["pitch_rad"])
    new = (log["beta_new"] > 0.5) & (log["beta_valid"] > 0.5)
    aside = truth["ahead"] * np.tan(truth["slip_angle_rad"]) - 0.3 * truth["rate"]
    exact = np.degrees(np.arctan2(aside, truth["ahead"] - 0.22 * truth["rate"]))
    assert log["beta_ftrace_deg"][new] == pytest.approx(exact[new], abs=0.006)
    way = np.hypot(np.diff(truth["x_m"]), np.diff(truth["y_m"])).sum()
    assert way == pytest.approx(4.0, abs=0.01)


def test_the_field_tests_are_like_the_papers() -> None:
    errors: dict[str, list[float]] = {"first": [], "second": []}
    for name, site in (("first", SIDEWAYS), ("second", MOUNDS)):
        for seed in range(6):
            recorded = field_test(site, seed)
            truth = recorded.truth
            rim_m = 0.092 * recorded.log["position1_rad"][-1]
            errors[name].append(float(np.hypot(rim_m - truth["x_m"][-1], truth["y_m"][-1])))
            lost = 1.0 - recorded.log["beta_valid"][truth["turned"] > 2.2].mean()
            assert lost < 0.07
    assert 2.0 < np.median(errors["first"]) < 3.4
    assert 2.2 < np.median(errors["second"]) < 4.2


def test_the_same_seed_gives_the_same_drive() -> None:
    first, again, other = (field_test(SIDEWAYS, seed).log["heading_deg"] for seed in (3, 3, 4))
    assert first.tolist() == again.tolist()
    assert first.tolist() != other.tolist()
