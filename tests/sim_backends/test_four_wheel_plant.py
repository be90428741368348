import math

import numpy as np
import pytest
from pydantic import ValidationError

from drivers.clock import nanoseconds
from sim_backends.four_wheel_plant import FourWheelPlant, FourWheelPlantSettings, Ground, Mound
from sim_backends.plant import Truth

START_NS = 1_000_000_000
RADIUS_M = 0.092
STEADY = {"slip_fluctuation": 0.0, "drift_fluctuation": 0.0}
HARD = Ground(rolling_resistance=0.0)


def settings(ground: Ground = HARD, **others: float) -> FourWheelPlantSettings:
    return FourWheelPlantSettings.model_validate({**STEADY, **others, "ground": ground})


def drive(
    rover_settings: FourWheelPlantSettings, left: float, right: float, duration_s: float, seed: int = 1
) -> Truth:
    rover = FourWheelPlant(rover_settings, np.random.default_rng(seed), START_NS)
    rover.set_wheel_speeds((left, right, left, right))
    rover.advance(START_NS + nanoseconds(duration_s))
    return rover.truth()


def test_on_hard_level_ground_it_drives_as_far_as_its_wheels_roll() -> None:
    truth = drive(settings(), 1.0, 1.0, 10.0)
    assert truth.x_m == pytest.approx(RADIUS_M * truth.wheel_position_rad[0])
    assert truth.x_m == pytest.approx(RADIUS_M * (10.0 - 0.1), rel=1e-6)
    assert (truth.y_m, truth.yaw_rad, truth.roll_rad, truth.pitch_rad) == (0, 0, 0, 0)
    assert truth.slip == pytest.approx((0, 0, 0, 0))


def test_a_wrong_radius_scales_the_distance() -> None:
    truth = drive(settings(wheel_radius_error=0.05), 1.0, 1.0, 10.0)
    assert truth.x_m == pytest.approx(1.05 * RADIUS_M * truth.wheel_position_rad[0])


def test_it_turns_as_if_its_track_were_wider_and_scrubs() -> None:
    truth = drive(settings(turn_resistance=1.5, turn_centre_x_m=0.1), -1.0, 1.0, 5.0)
    assert truth.yaw_rate_rad_s == pytest.approx(2 * RADIUS_M / (1.5 * 0.44))
    assert truth.velocity_x_m_s == pytest.approx(0)
    assert truth.velocity_y_m_s == pytest.approx(-0.1 * truth.yaw_rate_rad_s)
    assert truth.slip == pytest.approx((1 - 1 / 1.5,) * 4)


@pytest.mark.parametrize(
    ("yaw_deg", "roll_deg", "pitch_deg"),
    [(0, 0, -10), (180, 0, 10), (90, -10, 0), (-90, 10, 0)],  # uphill, downhill, across both ways
)
def test_attitude_on_a_slope(yaw_deg: float, roll_deg: float, pitch_deg: float) -> None:
    truth = drive(settings(Ground(inclination_deg=10), start_yaw_deg=yaw_deg), 0, 0, 0.1)
    assert math.degrees(truth.roll_rad) == pytest.approx(roll_deg, abs=1e-9)
    assert math.degrees(truth.pitch_rad) == pytest.approx(pitch_deg, abs=1e-9)


def test_the_body_stands_upright_on_the_slope_whatever_its_heading() -> None:
    truth = drive(settings(Ground(inclination_deg=30), start_yaw_deg=40.0), 0, 0, 0.1)
    upright = math.cos(truth.roll_rad) * math.cos(truth.pitch_rad)
    assert math.degrees(math.acos(upright)) == pytest.approx(30)


def test_slip_uphill_is_what_the_traction_curve_gives() -> None:
    ground = Ground(inclination_deg=12, grip=0.6, rolling_resistance=0.08, slip_at_half_grip=0.15)
    truth = drive(settings(ground), 1.0, 1.0, 5.0)
    slip = truth.slip[0]
    assert 0.6 * slip / (slip + 0.15) == pytest.approx(math.tan(math.radians(12)) + 0.08)
    assert truth.velocity_x_m_s == pytest.approx(RADIUS_M * truth.wheel_speed_rad_s[0] * (1 - slip))
    assert truth.velocity_y_m_s == pytest.approx(0)


def test_downhill_it_overruns_its_wheels_and_backing_down_too() -> None:
    steep = Ground(inclination_deg=12, uphill_deg=180)
    ahead, back = drive(settings(steep), 1.0, 1.0, 5.0), drive(settings(steep), -1.0, -1.0, 5.0)
    assert ahead.slip[0] < 0 < back.slip[0]
    assert ahead.velocity_x_m_s > RADIUS_M > -back.velocity_x_m_s > 0


def test_a_slope_beyond_the_grip_is_not_climbed() -> None:
    ground = Ground(inclination_deg=35, grip=0.6)
    truth = drive(settings(ground), 1.0, 1.0, 5.0)
    assert truth.slip[0] == pytest.approx(0.95)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_across_a_slope_it_drifts_downhill_whichever_way_it_drives(direction: float) -> None:
    ground = Ground(
        inclination_deg=10, uphill_deg=90, grip=0.6, rolling_resistance=0.0, drift_at_half_grip=0.3
    )
    truth = drive(settings(ground), direction, direction, 5.0)
    demand = math.tan(math.radians(10))
    drift = 0.3 * demand / (0.6 - demand)
    assert truth.velocity_y_m_s == pytest.approx(-drift * abs(truth.velocity_x_m_s))
    assert truth.y_m == pytest.approx(-drift * abs(truth.x_m))


def test_drift_costs_traction() -> None:
    straight_up = drive(settings(Ground(inclination_deg=10)), 1.0, 1.0, 5.0)
    sideways_too = Ground(inclination_deg=math.degrees(math.atan(math.tan(math.radians(10)) * math.sqrt(2))))
    slanted = drive(settings(sideways_too, start_yaw_deg=45.0), 1.0, 1.0, 5.0)
    assert slanted.pitch_rad == pytest.approx(straight_up.pitch_rad)
    assert slanted.slip[0] > 1.02 * straight_up.slip[0]


def test_a_mound_on_the_left_lifts_the_left_side_and_pushes_right() -> None:
    ground = Ground(mounds=(Mound(x_m=1.0, y_m=0.6, height_m=0.2, radius_m=0.5),))
    truth = drive(settings(ground), 1.0, 1.0, 1.0 / RADIUS_M)
    assert 0.9 < truth.x_m < 1.0
    assert truth.roll_rad > math.radians(5)
    assert truth.velocity_y_m_s < 0


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_the_current_carries_friction_climb_and_rolling(direction: float) -> None:
    ground = Ground(inclination_deg=8, rolling_resistance=0.1)
    truth = drive(settings(ground), direction, direction, 8.0)
    load_n = 26.4 * 9.81 / 4
    climb_n = load_n * math.sin(math.radians(8))
    rolling_n = 0.1 * load_n * math.cos(math.radians(8))
    expected_a = direction * 0.15 + (climb_n + direction * rolling_n) * RADIUS_M / 1.8
    assert truth.motor_current_a == pytest.approx((expected_a,) * 4, rel=1e-3)


def test_at_rest_on_a_slope_it_stays_and_needs_no_current() -> None:
    truth = drive(settings(Ground(inclination_deg=20)), 0, 0, 10.0)
    assert (truth.x_m, truth.y_m) == (0, 0)
    assert truth.motor_current_a == pytest.approx((0, 0, 0, 0))
    assert truth.battery_v == pytest.approx(25.0 - 0.1 * 1.0)


HILLY = FourWheelPlantSettings(
    ground=Ground(inclination_deg=5, mounds=(Mound(x_m=1.0, y_m=0.6, height_m=0.2, radius_m=0.5),))
)


def test_a_seed_gives_one_run_and_another_seed_another() -> None:
    assert drive(HILLY, 1.0, 1.1, 20.0, seed=3) == drive(HILLY, 1.0, 1.1, 20.0, seed=3)
    assert drive(HILLY, 1.0, 1.1, 20.0, seed=3).x_m != drive(HILLY, 1.0, 1.1, 20.0, seed=4).x_m


def test_slip_and_drift_fluctuate_by_the_share_in_the_settings() -> None:
    slope = Ground(inclination_deg=10, uphill_deg=45)
    fluctuating = settings(slope, slip_fluctuation=0.1, drift_fluctuation=0.2)
    rover = FourWheelPlant(fluctuating, np.random.default_rng(1), START_NS)
    rover.set_wheel_speeds((0.1,) * 4)
    slips, drifts = [], []
    for second in range(10, 500):
        rover.advance(START_NS + nanoseconds(second))
        truth = rover.truth()
        slips.append(1 - truth.velocity_x_m_s / (RADIUS_M * truth.wheel_speed_rad_s[0]))
        drifts.append(truth.velocity_y_m_s / truth.velocity_x_m_s)
    steady = drive(settings(slope), 0.1, 0.1, 10.0)
    assert np.std(slips) / steady.slip[0] == pytest.approx(0.1 / math.sqrt(2), rel=0.3)  # mean of two sides
    steady_drift = steady.velocity_y_m_s / steady.velocity_x_m_s
    assert np.std(drifts) / abs(steady_drift) == pytest.approx(0.2, rel=0.3)


def test_half_the_step_gives_the_same_path() -> None:
    coarse = drive(HILLY, 1.0, 1.1, 20.0)
    fine = drive(HILLY.model_copy(update={"step_s": 0.0025}), 1.0, 1.1, 20.0)
    assert math.dist((coarse.x_m, coarse.y_m), (fine.x_m, fine.y_m)) < 0.5e-3
    assert coarse.yaw_rad == pytest.approx(fine.yaw_rad, abs=0.5e-3)
    assert coarse.wheel_position_rad == pytest.approx(fine.wheel_position_rad)


def test_ground_on_which_no_rover_moves_is_refused() -> None:
    with pytest.raises(ValidationError, match="rolling_resistance must be smaller than grip"):
        Ground(grip=0.1, rolling_resistance=0.2)
