import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.clock import nanoseconds
from sim_backends.plant import Truth
from sim_backends.robotino_plant import (
    CirclePatch,
    RectanglePatch,
    RobotinoPlant,
    RobotinoPlantSettings,
    Surface,
)

START_NS = 1_000_000_000
RADIUS_M = 0.040
OFFSET_M = 0.125
SIN_60 = math.sqrt(3) / 2

IDEAL = RobotinoPlantSettings(
    floor=Surface(slip=0, load_current_a=0),
    droop_rad_s_per_a=0,
    no_load_current_a=0,
    slip_fluctuation=0,
    load_fluctuation=0,
)


def plant(settings: RobotinoPlantSettings, seed: int = 1) -> RobotinoPlant:
    return RobotinoPlant(settings, np.random.default_rng(seed), START_NS)


def drive(
    settings: RobotinoPlantSettings, speeds: tuple[float, ...], duration_s: float, seed: int = 1
) -> Truth:
    rover = plant(settings, seed)
    rover.set_wheel_speeds(speeds)
    rover.advance(START_NS + nanoseconds(duration_s))
    return rover.truth()


def test_it_drives_straight_ahead_when_the_outer_wheels_turn_against_each_other() -> None:
    rim_m_s = 0.1 * SIN_60
    truth = drive(IDEAL, (-rim_m_s / RADIUS_M, 0, rim_m_s / RADIUS_M), 5.0)
    assert truth.velocity_x_m_s == pytest.approx(0.1)
    assert truth.x_m == pytest.approx(0.1 * (5.0 - 0.1), rel=1e-4)  # the lag costs 0.1 s
    assert (truth.y_m, truth.yaw_rad) == pytest.approx((0, 0), abs=1e-12)
    assert truth.wheel_position_rad[1] == 0


def test_it_drives_left_with_the_rear_wheel_turning_twice_as_fast() -> None:
    speed = 0.1 / RADIUS_M
    truth = drive(IDEAL, (0.5 * speed, -speed, 0.5 * speed), 3.0)
    assert (truth.velocity_x_m_s, truth.velocity_y_m_s) == pytest.approx((0, 0.1), abs=1e-12)
    assert (truth.x_m, truth.yaw_rad) == pytest.approx((0, 0), abs=1e-12)
    assert truth.y_m == pytest.approx(0.1 * (3.0 - 0.1), rel=1e-4)


def test_it_turns_on_the_spot_when_all_wheels_turn_alike() -> None:
    truth = drive(IDEAL, (2.5, 2.5, 2.5), 4.0)
    assert truth.yaw_rate_rad_s == pytest.approx(2.5 * RADIUS_M / OFFSET_M)
    assert truth.yaw_rad == pytest.approx(0.8 * 3.9, rel=1e-4)
    assert (truth.x_m, truth.y_m) == pytest.approx((0, 0), abs=1e-12)


def test_a_curve_closes_to_a_circle() -> None:
    yaw_rate, forward = 0.5, 0.1
    rim = (-SIN_60 * forward, 0.0, SIN_60 * forward)
    speeds = tuple((side + OFFSET_M * yaw_rate) / RADIUS_M for side in rim)
    rover = plant(IDEAL)
    rover.set_wheel_speeds(speeds)
    rover.advance(START_NS + nanoseconds(2.0))
    start = rover.truth()
    rover.advance(START_NS + nanoseconds(2.0 + math.tau / yaw_rate))
    end = rover.truth()
    assert end.yaw_rad - start.yaw_rad == pytest.approx(math.tau, rel=1e-8)
    assert math.dist((start.x_m, start.y_m), (end.x_m, end.y_m)) < 1e-7


@given(st.tuples(*[st.floats(-15, 15)] * 3))
def test_every_contact_point_moves_along_its_wheel_at_rim_speed(speeds: tuple[float, ...]) -> None:
    truth = drive(IDEAL, speeds, 2.0)
    for angle_deg, speed in zip((60, 180, 300), truth.wheel_speed_rad_s, strict=True):
        angle = math.radians(angle_deg)
        contact_x, contact_y = OFFSET_M * math.cos(angle), OFFSET_M * math.sin(angle)
        velocity_x = truth.velocity_x_m_s - truth.yaw_rate_rad_s * contact_y
        velocity_y = truth.velocity_y_m_s + truth.yaw_rate_rad_s * contact_x
        along = -math.sin(angle) * velocity_x + math.cos(angle) * velocity_y
        assert along == pytest.approx(RADIUS_M * speed, abs=1e-12)


def test_slip_of_20_percent_under_one_wheel() -> None:
    under_the_rear_wheel = CirclePatch(
        type="circle", x_m=-OFFSET_M, y_m=0, radius_m=0.05, slip=0.2, load_current_a=0
    )
    settings = IDEAL.model_copy(update={"patches": (under_the_rear_wheel,)})
    truth = drive(settings, (2.0, 2.0, 2.0), 0.3)
    rim_m_s = RADIUS_M * truth.wheel_speed_rad_s[0]
    # Turning on the spot with the rear wheel 20 % too slow: that wheel's share of the turn is a third.
    assert truth.slip == pytest.approx((0, 0.2, 0))
    assert truth.yaw_rate_rad_s == pytest.approx((1 + 0.8 + 1) / 3 * rim_m_s / OFFSET_M)
    assert (truth.velocity_x_m_s, truth.velocity_y_m_s) == pytest.approx(
        (0, 2 / 3 * 0.2 * rim_m_s), abs=1e-12
    )


def test_the_last_patch_counts_where_patches_overlap() -> None:
    below = CirclePatch(type="circle", x_m=0, y_m=0, radius_m=9, slip=0.3, load_current_a=0)
    above = RectanglePatch(
        type="rectangle", x_min_m=0, x_max_m=9, y_min_m=-9, y_max_m=9, slip=0.1, load_current_a=0
    )
    truth = drive(IDEAL.model_copy(update={"patches": (below, above)}), (0, 0, 0), 0.1)
    assert truth.slip == pytest.approx((0.1, 0.3, 0.1))  # the rear wheel stands at x < 0


def test_wheels_lag_by_the_time_constant_and_droop_under_load() -> None:
    set_point = 5.0
    truth = drive(IDEAL, (set_point,) * 3, 0.1)
    assert truth.wheel_speed_rad_s[0] == pytest.approx(set_point * (1 - math.exp(-1)), rel=2e-3)
    loaded = IDEAL.model_copy(update={"no_load_current_a": 0.4, "droop_rad_s_per_a": 1.3})
    truth = drive(loaded, (set_point,) * 3, 3.0)
    assert truth.wheel_speed_rad_s[0] == pytest.approx(set_point - 1.3 * 0.4, rel=1e-3)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_the_current_is_signed_and_carries_friction_and_acceleration(direction: float) -> None:
    surface = Surface(slip=0, load_current_a=0.3)
    settings = IDEAL.model_copy(update={"no_load_current_a": 0.2, "floor": surface})
    rover = plant(settings)
    rover.set_wheel_speeds((direction * 5.0,) * 3)
    inertia_a = settings.inertia_kg_m2 * settings.gear_ratio * (5.0 / settings.speed_lag_s) / 0.0514
    assert rover.truth().motor_current_a[0] == pytest.approx(direction * inertia_a)
    rover.advance(START_NS + nanoseconds(3.0))
    assert rover.truth().motor_current_a[0] == pytest.approx(direction * 0.5, rel=2e-3)
    rover.set_wheel_speeds((0.0,) * 3)
    assert rover.truth().motor_current_a[0] * direction < 0.0  # braking
    rover.advance(START_NS + nanoseconds(9.0))
    assert rover.truth().motor_current_a[0] == pytest.approx(0, abs=1e-6)


def test_the_battery_sags_by_what_the_motors_draw() -> None:
    settings = IDEAL.model_copy(update={"no_load_current_a": 0.5})
    at_rest = drive(settings, (0, 0, 0), 1.0).battery_v
    assert at_rest == pytest.approx(25.0 - 0.15 * 1.5)
    truth = drive(settings, (5.0, 5.0, 5.0), 3.0)
    current = truth.motor_current_a[0]
    power_w = 3 * current * (5.95 * current + 0.0501 * 16 * truth.wheel_speed_rad_s[0])
    assert at_rest - truth.battery_v == pytest.approx(0.15 * power_w / 25.0)


PATCHY = RobotinoPlantSettings(
    patches=(
        RectanglePatch(
            type="rectangle", x_min_m=0.2, x_max_m=0.6, y_min_m=-1, y_max_m=0.05, slip=0.3, load_current_a=0.3
        ),
    )
)
AHEAD = (-4.0, 0.3, 4.0)


def test_a_seed_gives_one_run_and_another_seed_another() -> None:
    assert drive(PATCHY, AHEAD, 5.0, seed=3) == drive(PATCHY, AHEAD, 5.0, seed=3)
    assert drive(PATCHY, AHEAD, 5.0, seed=3).x_m != drive(PATCHY, AHEAD, 5.0, seed=4).x_m


def test_half_the_step_gives_the_same_path_between_edges() -> None:
    even = PATCHY.model_copy(update={"patches": ()})
    coarse = drive(even, AHEAD, 6.0)
    fine = drive(even.model_copy(update={"step_s": 0.0025}), AHEAD, 6.0)
    assert math.dist((coarse.x_m, coarse.y_m), (fine.x_m, fine.y_m)) < 0.05e-3
    assert coarse.yaw_rad == pytest.approx(fine.yaw_rad, abs=0.05e-3)
    assert coarse.wheel_position_rad == pytest.approx(fine.wheel_position_rad, abs=1e-3)


def test_half_the_step_gives_nearly_the_same_path_across_edges() -> None:
    coarse = drive(PATCHY, AHEAD, 6.0)
    fine = drive(PATCHY.model_copy(update={"step_s": 0.0025}), AHEAD, 6.0)
    assert math.dist((coarse.x_m, coarse.y_m), (fine.x_m, fine.y_m)) < 1e-3
    assert coarse.yaw_rad == pytest.approx(fine.yaw_rad, abs=1.5e-3)
    assert coarse.x_m > 0.6  # it did cross the patch


def test_it_matters_little_how_often_it_is_asked() -> None:
    rover = plant(PATCHY)
    rover.set_wheel_speeds(AHEAD)
    for t_ms in range(0, 6000, 3):
        rover.advance(START_NS + t_ms * 1_000_000)
        rover.advance(START_NS + t_ms * 1_000_000)  # a time already reached changes nothing
    rover.advance(START_NS + nanoseconds(6.0))
    asked_often = rover.truth()
    asked_once = drive(PATCHY, AHEAD, 6.0)
    assert asked_often.t_ns == asked_once.t_ns
    assert math.dist((asked_often.x_m, asked_often.y_m), (asked_once.x_m, asked_once.y_m)) < 1e-3


def test_slip_fluctuates_about_the_surface_by_the_share_in_the_settings() -> None:
    surface = Surface(slip=0.3, load_current_a=0)
    rover = plant(IDEAL.model_copy(update={"floor": surface, "slip_fluctuation": 0.1}))
    slips: list[float] = []
    for second in range(300):
        rover.advance(START_NS + nanoseconds(second))
        slips.extend(rover.truth().slip)
    assert np.mean(slips) == pytest.approx(0.3, abs=0.01)
    assert np.std(slips) == pytest.approx(0.03, rel=0.2)
