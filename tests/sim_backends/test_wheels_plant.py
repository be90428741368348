"""The plant of any wheels against mechanics."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from drivers.clock import nanoseconds
from drivers.errors import ConfigError
from drivers.units import STANDARD_GRAVITY_M_S2
from sim_backends.plants.wheels.plant import WheelsPlant, make_rover
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from sim_backends.world.plant import Truth

START_NS = 1_000_000_000
RADIUS_M = 0.05


def wheel(x_m: float, y_m: float, **more: Any) -> dict[str, Any]:
    return {"x_m": x_m, "y_m": y_m, "radius_m": RADIUS_M, **more}


def settings(wheels: Sequence[dict[str, Any]], friction: float = 0.8, **more: Any) -> WheelsPlantSettings:
    floor = {"friction": friction, "stiffness": 25.0, "drag_along": 0.01, "drag_across": 0.04}
    site = {"floor": "floor", "surfaces": {"floor": floor}, "roughness": 0.0}
    return WheelsPlantSettings.model_validate({"wheels": wheels, "site": site, **more})


def corners(**more: Any) -> list[dict[str, Any]]:
    return [wheel(x, y, **more) for x in (0.2, -0.2) for y in (0.15, -0.15)]


STEERED = corners(steering={"low_deg": -90, "high_deg": 90, "rate_deg_s": 45})
MECANUM = [wheel(x, y, roller_deg=math.copysign(45.0, x * y)) for x in (0.2, -0.2) for y in (0.15, -0.15)]


def drive(
    rover: WheelsPlantSettings,
    speeds: Sequence[float],
    duration_s: float,
    steering_rad: Sequence[float] = (),
    steered_s: float = 0.0,
) -> Truth:
    plant = WheelsPlant(rover, np.random.default_rng(1), START_NS)
    if steering_rad:
        plant.set_steering(steering_rad)
        plant.advance(START_NS + nanoseconds(steered_s))
    plant.truth()
    plant.set_wheel_speeds(speeds)
    plant.advance(START_NS + nanoseconds(steered_s + duration_s))
    return plant.truth()


def test_at_rest_nothing_moves() -> None:
    truth = drive(settings(corners()), (0.0,) * 4, 5.0)
    assert (truth.x_m, truth.y_m, truth.yaw_rad, *truth.wheel_position_rad) == (0.0,) * 7


def test_on_a_firm_floor_the_wheels_roll() -> None:
    truth = drive(settings(corners()), (4.0,) * 4, 3.0)
    assert truth.velocity_x_m_s == pytest.approx(4.0 * RADIUS_M, rel=0.003)
    assert truth.wheel_speed_rad_s == pytest.approx((4.0,) * 4, rel=1e-3)
    assert truth.x_m == pytest.approx(RADIUS_M * truth.wheel_position_rad[0], rel=0.005)


def test_two_wheels_and_a_castor_turn_about_the_middle_of_the_axle() -> None:
    rover = settings(
        [wheel(0.0, 0.15), wheel(0.0, -0.15)],
        castors=[{"x_m": -0.2, "y_m": 0.0}],
        centre_of_mass_x_m=-0.02,
    )
    truth = drive(rover, (-3.0, 3.0), 4.0)
    assert truth.yaw_rate_rad_s == pytest.approx(3.0 * RADIUS_M / 0.15, rel=0.01)
    assert math.hypot(truth.x_m, truth.y_m) < 0.005


def test_four_fixed_wheels_skid_in_a_turn() -> None:
    rolling = 3.0 * RADIUS_M / 0.15
    truth = drive(settings(corners()), (-3.0, 3.0) * 2, 4.0)
    # The side slip of contacts 0.2 m ahead of and behind the middle takes a share of the turn.
    assert 0.1 * rolling < truth.yaw_rate_rad_s < 0.8 * rolling


def test_mecanum_wheels_drive_sideways_and_turn() -> None:
    aside = drive(settings(MECANUM), (-4.0, 4.0, 4.0, -4.0), 4.0)
    assert aside.velocity_y_m_s == pytest.approx(4.0 * RADIUS_M, rel=0.02)
    assert abs(aside.velocity_x_m_s) < 1e-6
    turning = drive(settings(MECANUM), (-4.0, 4.0, -4.0, 4.0), 4.0)
    assert turning.yaw_rate_rad_s == pytest.approx(4.0 * RADIUS_M / 0.35, rel=0.02)


def test_steered_wheels_crab() -> None:
    angle = math.radians(30.0)
    truth = drive(settings(STEERED), (4.0,) * 4, 4.0, (angle,) * 4, 1.0)
    assert math.atan2(truth.velocity_y_m_s, truth.velocity_x_m_s) == pytest.approx(angle, abs=1e-3)
    assert abs(truth.yaw_rad) < 1e-6


def test_the_steering_keeps_its_rate_and_its_limits() -> None:
    half = drive(settings(STEERED, set_point_delay_s=0.0), (0.0,) * 4, 0.0, (1.0,) * 4, 0.5)
    assert half.steering_rad == pytest.approx((math.radians(22.5),) * 4)
    full = drive(settings(STEERED), (0.0,) * 4, 0.0, (3.0,) * 4, 5.0)
    assert full.steering_rad == pytest.approx((math.radians(90.0),) * 4)


def test_a_wheel_cannot_turn_faster_than_its_torque_speed_line_allows() -> None:
    motor = {"stall_torque_nm": 3.0, "no_load_rad_s": 10.0}
    truth = drive(settings(corners(motor=motor), wheel_friction_nm=0.3), (50.0,) * 4, 10.0)
    # Steady: stall torque (1 - w / w_0) = friction + rolling resistance r c m g / 4.
    load_nm = 0.3 + RADIUS_M * 0.01 * 20.0 * STANDARD_GRAVITY_M_S2 / 4.0
    assert truth.wheel_speed_rad_s == pytest.approx((10.0 * (1.0 - load_nm / 3.0),) * 4, rel=0.005)
    assert truth.motor_current_a == pytest.approx((5.0 * load_nm / 3.0,) * 4, rel=0.02)


def test_friction_limits_the_acceleration() -> None:
    strong = {"stall_torque_nm": 5.0, "no_load_rad_s": 1000.0}
    rover = settings(corners(motor=strong), friction=0.1, set_point_delay_s=0.0)
    truth = drive(rover, (400.0,) * 4, 2.0)
    # Traction at the limit less the resistance, until the wheels grip.
    most_m_s = (0.1 - 0.01) * STANDARD_GRAVITY_M_S2 * 2.0
    assert truth.velocity_x_m_s == pytest.approx(most_m_s, rel=0.05)
    assert min(truth.slip) > 0.5


def test_a_wheel_on_another_patch_turns_the_rover() -> None:
    slick = {"friction": 0.05, "stiffness": 1.0, "drag_along": 0.01, "drag_across": 0.04}
    firm = {"friction": 0.8, "stiffness": 25.0, "drag_along": 0.05, "drag_across": 0.04}
    patch = {"type": "rectangle", "surface": "slick"}
    area = {"x_min_m": -1.0, "x_max_m": 5.0, "y_min_m": 0.0, "y_max_m": 2.0}
    site = {"floor": "firm", "surfaces": {"firm": firm, "slick": slick}, "patches": [{**patch, **area}]}
    rover = settings([wheel(0.0, 0.15), wheel(0.0, -0.15)], castors=[{"x_m": -0.2, "y_m": -0.1, "drag": 0.3}])
    rover = WheelsPlantSettings.model_validate(
        {**rover.model_dump(), "site": site, "centre_of_mass_x_m": -0.05}
    )
    truth = drive(rover, (3.0, 3.0), 4.0)
    assert truth.slip[0] > truth.slip[1] + 0.01
    assert truth.yaw_rad > 0.01


def test_the_result_does_not_depend_on_how_often_it_is_read() -> None:
    rover = settings(STEERED)
    once, often = (WheelsPlant(rover, np.random.default_rng(1), START_NS) for _ in range(2))
    for plant in (once, often):
        plant.set_wheel_speeds((3.0,) * 4)
        plant.set_steering((0.3, 0.3, 0.0, 0.0))
    for t_ns in range(START_NS, START_NS + nanoseconds(1.0), 3_300_000):
        often.advance(t_ns)
        often.truth()
    for plant in (once, often):
        plant.advance(START_NS + nanoseconds(1.0))
    assert once.truth() == often.truth()


def test_loads_balance_the_weight() -> None:
    rover = make_rover(settings(corners(), centre_of_mass_x_m=0.05, centre_of_mass_y_m=-0.03, mass_kg=10.0))
    weight_n = 10.0 * STANDARD_GRAVITY_M_S2
    assert rover.load_n.sum() == pytest.approx(weight_n)
    assert rover.load_n @ rover.place == pytest.approx(weight_n * np.array([0.05, -0.03]))
    with pytest.raises(ConfigError, match="not between the contacts"):
        make_rover(settings(corners(), centre_of_mass_x_m=0.3))
