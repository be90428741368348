import math
from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from drivers.clock import nanoseconds
from drivers.robotino_board.settings import RobotinoBoardSettings
from sim_backends.build import build_world
from sim_backends.plants.robotino.dynamics import slip_ratio
from sim_backends.plants.robotino.plant import RobotinoPlant
from sim_backends.plants.robotino.settings import MotorSettings, RobotinoPlantSettings, SpeedLoopSettings
from sim_backends.plants.robotino.site import Site
from sim_backends.plants.robotino.surfaces import Surface, shipped_surfaces
from sim_backends.settings import SimulationSettings
from sim_backends.world.plant import Truth
from tests.sim_backends.robotino_drives import (
    OFFSET_M,
    RADIUS_M,
    SIN_60,
    START_NS,
    STEP_RAD_S,
    ahead,
    drive,
    mean_currents,
    on,
    plant,
)


def floor(**surface: float) -> Site:
    values = {"friction": 0.7, "stiffness": 25.0, "drag_along": 0.0, "drag_across": 0.0} | surface
    return Site(floor="made", surfaces={"made": Surface(**values)})


def kinetic_energy(moving: RobotinoPlant) -> float:
    rover, state = moving._rover, moving._state
    body = 0.5 * float(state.twist @ rover.mass @ state.twist)
    return body + 0.5 * rover.wheel_inertia_kg_m2 * float(state.speed_rad_s @ state.speed_rad_s)


EASY = floor()
NO_GRIP = floor(friction=1e-9, stiffness=1e-9)


def test_wheels_that_do_not_grip_move_nothing() -> None:
    truth = drive(on(NO_GRIP), ahead(0.2), 3.0)
    assert truth.wheel_speed_rad_s[2] > 4.0
    assert truth.slip[2] == pytest.approx(1.0, abs=1e-6)
    assert math.hypot(truth.x_m, truth.y_m) < 1e-6


def test_a_body_that_nothing_holds_keeps_its_momentum_and_energy() -> None:
    moving = plant(on(NO_GRIP, centre_of_mass_x_m=-0.05))
    moving._state.twist[:] = (0.3, -0.2, 1.5)
    energy = kinetic_energy(moving)
    centres = []
    for t_s in range(5):
        moving.advance(START_NS + nanoseconds(t_s))
        truth = moving.truth()
        centres.append(
            (truth.x_m - 0.05 * math.cos(truth.yaw_rad), truth.y_m - 0.05 * math.sin(truth.yaw_rad))
        )
    assert kinetic_energy(moving) == pytest.approx(energy, rel=5e-3)
    assert moving.truth().yaw_rate_rad_s == pytest.approx(1.5, rel=5e-3)
    # Its centre of mass goes straight on.
    steps = np.diff(np.array(centres), axis=0)
    assert np.abs(steps - steps[0]).max() < 2e-3


def test_it_drives_straight_ahead_at_the_speed_of_its_wheels() -> None:
    truth = drive(on(EASY), ahead(0.1), 5.0)
    assert truth.velocity_x_m_s == pytest.approx(0.1, rel=0.08)  # the loop droops
    assert truth.velocity_x_m_s == pytest.approx(RADIUS_M * truth.wheel_speed_rad_s[2] / SIN_60, rel=1e-2)
    assert (truth.y_m, truth.yaw_rad) == pytest.approx((0, 0), abs=2e-4)
    assert truth.wheel_position_rad[1] == pytest.approx(0, abs=5e-3)


def test_it_turns_on_the_spot_and_drives_left() -> None:
    spinning = drive(on(EASY, centre_of_mass_x_m=0.0), (2.5, 2.5, 2.5), 4.0)
    assert spinning.yaw_rate_rad_s == pytest.approx(
        RADIUS_M * spinning.wheel_speed_rad_s[0] / OFFSET_M, rel=2e-3
    )
    assert math.hypot(spinning.x_m, spinning.y_m) < 1e-3
    left = drive(on(EASY), (0.5 * 2.5, -2.5, 0.5 * 2.5), 3.0)
    assert left.velocity_y_m_s == pytest.approx(0.1, rel=0.08)
    assert abs(left.velocity_x_m_s) < 1e-3


@pytest.mark.parametrize("turn", [120.0, 240.0])
def test_a_rover_loaded_evenly_is_the_same_after_a_third_of_a_turn(turn: float) -> None:
    even = on("floor_gray", centre_of_mass_x_m=0.0)
    speed = 0.2 / RADIUS_M

    def course(direction_deg: float) -> tuple[float, ...]:
        x, y = math.cos(math.radians(direction_deg)), math.sin(math.radians(direction_deg))
        return (speed * (-SIN_60 * x + 0.5 * y), -speed * y, speed * (SIN_60 * x + 0.5 * y))

    one, other = drive(even, course(20.0), 4.0), drive(even, course(20.0 + turn), 4.0)
    ways = [math.hypot(truth.x_m, truth.y_m) for truth in (one, other)]
    assert ways[0] == pytest.approx(ways[1], rel=2e-3)
    assert sorted(np.abs(one.slip)) == pytest.approx(sorted(np.abs(other.slip)), abs=0.01)


@pytest.mark.parametrize("ahead_m", [0.04, -0.055])
def test_a_centre_of_mass_outside_the_wheels_is_refused(ahead_m: float) -> None:
    with pytest.raises(ValidationError, match="outside the triangle of the wheels"):
        RobotinoPlantSettings(type="robotino", wheel_offset_m=0.05, centre_of_mass_x_m=ahead_m)


def test_left_alone_it_comes_to_rest_and_stays_there() -> None:
    moving = plant(on("floor_brown"))
    moving.set_wheel_speeds(ahead(0.2))
    moving.advance(START_NS + nanoseconds(2.0))
    moving.set_wheel_speeds((0.0, 0.0, 0.0))
    moving.advance(START_NS + nanoseconds(2.5))
    stopped = moving.truth()
    energies = []
    for t_ms in range(2500, 4000, 3):
        moving.advance(START_NS + t_ms * 1_000_000)
        energies.append(kinetic_energy(moving))
        assert moving.truth().wheel_speed_rad_s == (0.0, 0.0, 0.0)  # no chatter about zero
    assert max(energies) <= energies[0]
    end = moving.truth()
    assert math.dist((end.x_m, end.y_m), (stopped.x_m, stopped.y_m)) < 1e-4
    assert end.motor_current_a == pytest.approx((0, 0, 0), abs=1e-9)


@pytest.mark.parametrize(("steps", "turns"), [(0.3, False), (1.0, True)])
def test_a_wheel_breaks_loose_only_when_the_motor_is_strong_enough(steps: float, turns: bool) -> None:
    truth = drive(on(NO_GRIP), (steps * STEP_RAD_S, 0.0, 0.0), 2.0)
    assert (truth.wheel_speed_rad_s[0] != 0.0) is turns
    if not turns:
        # The bridge's voltage over the resistance, below 1.3 times the friction.
        volts = 25.775 * steps * 21.8 / 255
        assert truth.motor_current_a[0] == pytest.approx(volts / 5.336, rel=2e-3)
        assert truth.motor_current_a[0] < 1.3 * 8.1e-3 / 0.0514


def test_speed_ends_at_the_voltage_of_the_battery() -> None:
    moving = plant(on(NO_GRIP))
    moving.set_wheel_speeds((60.0, 0.0, -60.0))
    moving.advance(START_NS + nanoseconds(3.0))
    truth = moving.truth()
    for wheel, voltage_v in ((0, truth.battery_v), (1, 0.0), (2, -truth.battery_v)):
        back_emf_v = 16 * 0.0501 * truth.wheel_speed_rad_s[wheel]
        assert back_emf_v == pytest.approx(
            voltage_v - 5.336 * truth.motor_current_a[wheel], rel=1e-3, abs=1e-9
        )
    assert truth.wheel_speed_rad_s[0] == pytest.approx(-truth.wheel_speed_rad_s[2], rel=1e-6)


def test_a_free_wheel_draws_the_recorded_no_load_current() -> None:
    for motor_rad_s, current_a in ((20.0, 0.165), (95.0, 0.20), (168.0, 0.22)):
        speed = motor_rad_s / 16
        assert mean_currents(on(NO_GRIP), (speed,) * 3) == pytest.approx([current_a] * 3, rel=0.08)


def test_the_battery_sags_by_what_the_motors_draw() -> None:
    assert drive(on(EASY), (0, 0, 0), 1.0).battery_v == pytest.approx(26.0 - 0.15 * 1.5)
    assert drive(on("floor_gray"), ahead(0.3), 2.0).battery_v < 26.0 - 0.15 * 1.5 - 0.05


def test_wheels_are_a_tenth_of_a_second_behind_the_set_point() -> None:
    moving = plant(on(EASY))
    moving.set_wheel_speeds((4.0, 4.0, 4.0))
    moving.advance(START_NS + nanoseconds(0.089))
    assert moving.truth().wheel_speed_rad_s == (0.0, 0.0, 0.0)
    moving.advance(START_NS + nanoseconds(1.0))
    final = moving.truth()
    behind_s = 1.0 - final.wheel_position_rad[0] / final.wheel_speed_rad_s[0]
    assert behind_s == pytest.approx(0.1, abs=0.02)


def test_speed_droops_by_two_and_a_half_steps_per_ampere() -> None:
    set_point = 12 * STEP_RAD_S
    rover = on("floor_gray")
    current = mean_currents(rover, (-set_point, 0.0, set_point))[2]
    moving = plant(rover)
    moving.set_wheel_speeds((-set_point, 0.0, set_point))
    moving.advance(START_NS + nanoseconds(1.0))
    begin = moving.truth().wheel_position_rad[2]
    moving.advance(START_NS + nanoseconds(3.0))
    droop = (set_point - (moving.truth().wheel_position_rad[2] - begin) / 2.0) / STEP_RAD_S
    assert droop == pytest.approx(2.52 * current + 0.0767 + 0.0167 * 12, abs=0.25)


def with_steps(steps: int) -> RobotinoPlantSettings:
    loop = SpeedLoopSettings(steps_per_period=steps, rate_error=0.0)
    return on("floor_gray", speed_loop=loop)


def test_smaller_steps_give_nearly_the_same_path() -> None:
    curve = (-4.0, 0.8, 5.0)
    coarse, fine, finest = (drive(with_steps(steps), curve, 4.0) for steps in (2, 8, 32))

    def off(truth: Truth) -> float:
        return math.dist(
            (truth.x_m, truth.y_m, 0.1 * truth.yaw_rad), (finest.x_m, finest.y_m, 0.1 * finest.yaw_rad)
        )

    assert off(coarse) < 0.01 * math.hypot(finest.x_m, finest.y_m)
    assert off(fine) < 0.003 * math.hypot(finest.x_m, finest.y_m)


def test_a_seed_gives_one_run_and_another_seed_another() -> None:
    rover = on("paper_like")
    assert drive(rover, ahead(0.2), 3.0, seed=3) == drive(rover, ahead(0.2), 3.0, seed=3)
    assert drive(rover, ahead(0.2), 3.0, seed=3).x_m != drive(rover, ahead(0.2), 3.0, seed=4).x_m


def test_it_does_not_matter_how_often_it_is_asked() -> None:
    asked_often, asked_once = plant(on("paper_like")), plant(on("paper_like"))
    for moving in (asked_often, asked_once):
        moving.set_wheel_speeds(ahead(0.2))
    for t_ns in range(START_NS, START_NS + nanoseconds(2.0), 1_234_567):
        asked_often.advance(t_ns)
        asked_often.advance(t_ns - 5_000_000)  # a time already reached changes nothing
        asked_often.truth()
    for moving in (asked_often, asked_once):
        moving.advance(START_NS + nanoseconds(2.0))
    assert asked_often.truth() == asked_once.truth()


def test_truth_moves_on_between_steps() -> None:
    moving = plant(on(EASY))
    moving.set_wheel_speeds(ahead(0.3))
    moving.advance(START_NS + nanoseconds(1.0))
    before = moving.truth()
    moving.advance(START_NS + nanoseconds(1.0) + 50_000)
    after = moving.truth()
    assert after.x_m - before.x_m == pytest.approx(0.3 * 50e-6, rel=0.2)
    assert after.wheel_position_rad[2] > before.wheel_position_rad[2]


def test_the_clock_of_the_speed_loop_is_not_that_of_the_host() -> None:
    host_ns = 20_000_000  # 18 periods of 1/900 s
    periods = [2 * plant(on(EASY), seed)._step_ns for seed in range(20)]
    assert len(set(periods)) > 15
    assert np.mean(periods) == pytest.approx(1e9 / 900, rel=1e-3)
    drifts = [abs(host_ns / period - 18) for period in periods]
    assert np.median(drifts) > 0.005  # sampled every 20 ms it passes through the ripple within seconds
    phases = {plant(on(EASY), seed)._grid_ns for seed in range(20)}
    assert len(phases) == 20


def test_the_current_ripples_because_speed_is_counted_in_ticks() -> None:
    moving = plant(on("floor_gray"))
    moving.set_wheel_speeds(ahead(0.2))
    currents = []
    for t_ms in range(1000, 3000, 7):
        moving.advance(START_NS + t_ms * 1_000_000)
        currents.append(moving.truth().motor_current_a[2])
    assert 0.03 < np.std(currents) < 0.16


def test_a_wall_presses_the_bumper() -> None:
    rover = on(EASY, bumper_x_m=0.1)
    assert not drive(rover, ahead(0.1), 0.5).bumper_pressed
    assert drive(rover, ahead(0.1), 2.0).bumper_pressed


def test_slip_is_the_lost_share_of_the_faster_speed() -> None:
    assert slip_ratio(0.2, 0.15) == pytest.approx(0.25)
    assert slip_ratio(-0.2, -0.15) == pytest.approx(0.25)
    assert slip_ratio(0.15, 0.2) == pytest.approx(-0.25)  # braking
    assert slip_ratio(0.2, -0.1) == 1.0
    assert slip_ratio(0.0, 0.0) == 0.0
    assert slip_ratio(1e-4, 0.0) == pytest.approx(0.005)


@given(st.floats(-1, 1), st.floats(-1, 1))
def test_slip_stays_within_one(rim: float, ground: float) -> None:
    assert -1.0 <= slip_ratio(rim, ground) <= 1.0


@settings(max_examples=20, deadline=None)
@given(st.tuples(*[st.floats(-30, 30)] * 3), st.sampled_from(sorted(shipped_surfaces())), st.integers(0, 99))
def test_whatever_is_commanded_the_body_is_not_faster_than_its_wheels(
    speeds: tuple[float, ...], surface: str, seed: int
) -> None:
    truth = drive(on(f"floor_{surface}"), speeds, 1.0, seed)
    fastest = RADIUS_M * max(abs(speed) for speed in truth.wheel_speed_rad_s)
    assert math.hypot(truth.velocity_x_m_s, truth.velocity_y_m_s) <= 1.16 * fastest + 0.05
    assert all(math.isfinite(current) and abs(current) < 10 for current in truth.motor_current_a)


def test_inertia_is_that_of_the_motor_seen_through_the_gear() -> None:
    light = MotorSettings(inertia_kg_m2=1e-5)
    assert plant(on(EASY, motor=light))._rover.wheel_inertia_kg_m2 == pytest.approx(256e-5)


def test_a_configuration_can_name_it() -> None:
    table: Mapping[str, object] = {"plant": {"type": "robotino", "site": "paper_like"}}
    board = RobotinoBoardSettings(type="robotino_board", port="none")
    world = build_world({"board": board}, SimulationSettings.model_validate(table), START_NS)
    assert isinstance(world.plant, RobotinoPlant)
    world.advance(START_NS + nanoseconds(0.1))
    assert world.plant.truth().t_ns == START_NS + nanoseconds(0.1)
