import math

import numpy as np
import pytest
from pydantic import ValidationError

from drivers.clock import nanoseconds
from drivers.errors import ConfigError
from sim_backends.plants.el_dorado.dynamics import Ground as GroundShape
from sim_backends.plants.el_dorado.dynamics import Rover, State, settle, surface
from sim_backends.plants.el_dorado.plant import ElDoradoPlant
from sim_backends.plants.el_dorado.settings import ElDoradoPlantSettings, Ground, Mound
from sim_backends.terramechanics.slope.rover import Conditions, SlopeRover
from sim_backends.terramechanics.slope.steady_state import solve_steady_state
from sim_backends.terramechanics.soil.library import load_soil, load_wheel
from sim_backends.world.plant import Truth

START_NS = 1_000_000_000
RADIUS_M = 0.092
CONTACTS_M = ((0.30, 0.22), (0.30, -0.22), (-0.30, 0.22), (-0.30, -0.22))
MOUND = Mound(x_m=1.0, y_m=0.6, height_m=0.2, radius_m=0.5)


def settings(ground: Ground | None = None, **others: float) -> ElDoradoPlantSettings:
    return ElDoradoPlantSettings.model_validate(
        {"force_fluctuation": 0.0, **others, "ground": ground or Ground()}
    )


def plant(rover: ElDoradoPlantSettings, seed: int = 1) -> ElDoradoPlant:
    return ElDoradoPlant(rover, np.random.default_rng(seed), START_NS)


def drive(
    rover: ElDoradoPlantSettings, speeds: tuple[float, float, float, float], duration_s: float, seed: int = 1
) -> Truth:
    driven = plant(rover, seed)
    driven.set_wheel_speeds(speeds)
    driven.advance(START_NS + nanoseconds(duration_s))
    return driven.truth()


AHEAD = (1.0,) * 4
BACK = (-1.0,) * 4


def drift_deg(truth: Truth) -> float:
    return math.degrees(math.atan2(truth.velocity_y_m_s, truth.velocity_x_m_s))


@pytest.mark.parametrize("heading_deg", [0.0, 30.0, 60.0, 90.0])
@pytest.mark.parametrize("slope_deg", [5.0, 10.0])
def test_on_a_plane_it_settles_in_the_steady_state_of_the_wheel_soil_model(
    slope_deg: float, heading_deg: float
) -> None:
    """Against the solver that calls the model itself; heading 0 is the traverse, uphill left."""
    rover = SlopeRover(
        mass_kg=26.4,
        wheel=load_wheel("el_dorado"),
        wheel_positions_m=CONTACTS_M,
        cog_height_m=0.25,
        cog_lateral_m=0.0,
        cog_forward_m=0.0,
    )
    conditions = Conditions(math.radians(slope_deg), heading_rad=math.radians(heading_deg))
    exact = solve_steady_state(rover, load_soil("toyoura"), conditions, bound=1e-5)
    ground = Ground(inclination_deg=slope_deg, uphill_deg=90.0)
    truth = drive(settings(ground, start_yaw_deg=heading_deg), AHEAD, 2.0)
    forward = truth.velocity_x_m_s / (RADIUS_M * truth.wheel_speed_rad_s[0])
    assert 1.0 - forward == pytest.approx(float(exact.slip), abs=0.02)
    assert drift_deg(truth) == pytest.approx(math.degrees(float(exact.slip_angle_rad)), abs=0.8)


def test_the_side_slopes_of_the_field_tests_give_their_slips_and_slip_angles() -> None:
    """The traverse of a 12 deg slope, half uphill: slip 0.3 to 0.4, slip angle 5 to 20 deg (paper 000)."""
    truth = drive(settings(Ground(inclination_deg=12, uphill_deg=45)), AHEAD, 5.0)
    assert 0.3 < 1.0 - truth.velocity_x_m_s / RADIUS_M < 0.4
    assert -20.0 < drift_deg(truth) < -5.0


def test_level_ground_is_driven_straight_with_hardly_any_slip() -> None:
    truth = drive(settings(), AHEAD, 20.0)
    assert truth.x_m == pytest.approx(RADIUS_M * truth.wheel_position_rad[0], rel=0.02)
    assert truth.x_m < RADIUS_M * truth.wheel_position_rad[0]
    assert (truth.y_m, truth.yaw_rad) == pytest.approx((0, 0), abs=1e-6)


@pytest.mark.parametrize(
    ("yaw_deg", "roll_deg", "pitch_deg"),
    [(0, 0, -10), (180, 0, 10), (90, -10, 0), (-90, 10, 0)],  # uphill, downhill, across both ways
)
def test_attitude_on_a_slope(yaw_deg: float, roll_deg: float, pitch_deg: float) -> None:
    truth = drive(settings(Ground(inclination_deg=10), start_yaw_deg=yaw_deg), (0,) * 4, 0.1)
    assert math.degrees(truth.roll_rad) == pytest.approx(roll_deg, abs=1e-9)
    assert math.degrees(truth.pitch_rad) == pytest.approx(pitch_deg, abs=1e-9)


def test_the_body_stands_upright_on_the_slope_whatever_its_heading() -> None:
    truth = drive(settings(Ground(inclination_deg=30), start_yaw_deg=40.0), (0,) * 4, 0.1)
    assert math.degrees(math.acos(math.cos(truth.roll_rad) * math.cos(truth.pitch_rad))) == pytest.approx(30)


def test_distances_are_horizontal() -> None:
    ground = Ground(inclination_deg=8)
    before, after = drive(settings(ground), AHEAD, 5.0), drive(settings(ground), AHEAD, 6.0)
    assert after.x_m - before.x_m == pytest.approx(after.velocity_x_m_s * math.cos(math.radians(8)), rel=1e-6)


def test_backing_mirrors_driving_ahead() -> None:
    side = Ground(inclination_deg=10, uphill_deg=90)
    ahead, back = drive(settings(side), AHEAD, 5.0), drive(settings(side), BACK, 5.0)
    assert (back.x_m, back.y_m, back.yaw_rad) == pytest.approx((-ahead.x_m, ahead.y_m, -ahead.yaw_rad))
    front_left, front_right, rear_left, rear_right = (-current for current in ahead.motor_current_a)
    assert back.motor_current_a == pytest.approx((rear_left, rear_right, front_left, front_right))
    assert ahead.y_m < -0.02


def test_downhill_it_overruns_its_wheels() -> None:
    truth = drive(settings(Ground(inclination_deg=12, uphill_deg=180)), AHEAD, 5.0)
    assert truth.velocity_x_m_s > 1.05 * RADIUS_M
    assert all(slip < -0.05 for slip in truth.slip)


def test_a_slope_too_steep_is_not_climbed() -> None:
    truth = drive(settings(Ground(inclination_deg=30)), AHEAD, 20.0)
    assert -1.0 < truth.x_m < 0.0
    assert min(truth.slip) > 0.9


def test_at_rest_on_a_slope_it_stays_and_needs_no_current() -> None:
    truth = drive(settings(Ground(inclination_deg=20, uphill_deg=70)), (0,) * 4, 10.0)
    assert (truth.x_m, truth.y_m, truth.yaw_rad) == (0, 0, 0)
    assert truth.motor_current_a == pytest.approx((0, 0, 0, 0))
    assert truth.battery_v == pytest.approx(25.0 - 0.1 * 1.0)


def test_it_comes_to_rest_on_a_slope_when_its_wheels_do() -> None:
    rover = plant(settings(Ground(inclination_deg=12, uphill_deg=45)))
    rover.set_wheel_speeds(AHEAD)
    rover.advance(START_NS + nanoseconds(5.0))
    rover.set_wheel_speeds((0,) * 4)
    rover.advance(START_NS + nanoseconds(8.0))
    stopped = rover.truth()
    rover.advance(START_NS + nanoseconds(20.0))
    assert math.dist((rover.truth().x_m, rover.truth().y_m), (stopped.x_m, stopped.y_m)) == 0.0
    assert stopped.velocity_x_m_s == 0.0


def test_turning_on_the_spot_scrubs() -> None:
    truth = drive(settings(), (-1.0, 1.0, -1.0, 1.0), 5.0)
    rolling = 2 * RADIUS_M / 0.44
    assert 0.05 * rolling < truth.yaw_rate_rad_s < 0.6 * rolling
    assert (truth.x_m, truth.y_m) == pytest.approx((0, 0), abs=1e-3)


def test_wheels_steered_alike_make_it_crab() -> None:
    rover = plant(settings())
    rover.set_steering((0.2,) * 4)
    rover.advance(START_NS + nanoseconds(2.0))
    rover.set_wheel_speeds(AHEAD)
    rover.advance(START_NS + nanoseconds(12.0))
    truth = rover.truth()
    assert math.atan2(truth.y_m, truth.x_m) == pytest.approx(0.2, abs=0.005)
    assert truth.yaw_rad == pytest.approx(0, abs=1e-3)


def test_front_wheels_steered_turn_it_about_the_rear_axle() -> None:
    rover = plant(settings())
    rover.set_steering((0.3, 0.3, 0.0, 0.0))
    rover.advance(START_NS + nanoseconds(2.0))
    rover.set_wheel_speeds(AHEAD)
    rover.advance(START_NS + nanoseconds(7.0))
    rolling = RADIUS_M * math.tan(0.3) / 0.60
    assert 0.6 * rolling < rover.truth().yaw_rate_rad_s < rolling


def test_steering_takes_time() -> None:
    def yaw_rate(after_s: float) -> float:
        rover = plant(settings(steer_rate_rad_s=0.1))
        rover.set_wheel_speeds(AHEAD)
        rover.set_steering((0.3, 0.3, -0.3, -0.3))
        rover.advance(START_NS + nanoseconds(after_s))
        return rover.truth().yaw_rate_rad_s

    assert 0 < yaw_rate(1.0) < 0.6 * yaw_rate(4.0)


def test_a_mound_on_the_left_lifts_the_left_side_and_pushes_right() -> None:
    truth = drive(settings(Ground(mounds=(MOUND,))), AHEAD, 1.05 / RADIUS_M)
    assert 0.8 < truth.x_m < 1.0
    assert truth.roll_rad > math.radians(5)
    assert truth.velocity_y_m_s < 0


def test_the_weight_takes_for_a_climb_what_it_gives_on_the_way_down() -> None:
    """Its pull, summed along a straight way over a mound, is weight times height."""
    rover = Rover(np.array(CONTACTS_M), RADIUS_M, 0.25, np.array([26.4, 26.4, 1.2]))
    ground = GroundShape(np.zeros(2), np.array([[1.5, 0.1, 0.10, 0.5]]))
    step_m, work_nm = 0.005, [0.0]
    for x_m in np.arange(-1.0, 4.0, step_m).tolist():
        state = State(np.array([x_m, 0.0, 0.0]), *(np.zeros(n) for n in (2, 3, 4, 4)))
        contact = settle(state, rover, ground)
        work_nm.append(work_nm[-1] - float(contact.pull[0]) * step_m / math.cos(state.tilt[0]))
    heights = [surface(ground, 1.5 + x_m, y_m)[0] for x_m, y_m in CONTACTS_M]
    assert max(work_nm) == pytest.approx(26.4 * 9.80665 * np.mean(heights), rel=0.05)
    assert work_nm[-1] == pytest.approx(0, abs=0.02 * max(work_nm))


@pytest.mark.parametrize("climb_deg", [0, 8])
def test_the_currents_do_the_work_of_the_climb(climb_deg: float) -> None:
    """Torques over radius exceed the weight's pull by the resistance of the soil, and no more."""
    truth = drive(settings(Ground(inclination_deg=climb_deg)), AHEAD, 8.0)
    thrust_n = sum(1.8 * (current - 0.15) for current in truth.motor_current_a) / RADIUS_M
    resistance_n = thrust_n - 26.4 * 9.80665 * math.sin(math.radians(climb_deg))
    assert 0.05 < resistance_n / (26.4 * 9.80665) < 0.25


def test_uphill_the_rear_wheels_carry_and_work_more() -> None:
    front_left, front_right, rear_left, rear_right = drive(
        settings(Ground(inclination_deg=10)), AHEAD, 5.0
    ).motor_current_a
    assert front_left == pytest.approx(front_right)
    assert rear_left == pytest.approx(rear_right)
    assert rear_left > 1.2 * front_left


HILLY = ElDoradoPlantSettings(ground=Ground(inclination_deg=5, mounds=(MOUND,)))


def test_a_seed_gives_one_run_and_another_seed_another() -> None:
    assert drive(HILLY, AHEAD, 20.0, seed=3) == drive(HILLY, AHEAD, 20.0, seed=3)
    assert drive(HILLY, AHEAD, 20.0, seed=3).x_m != drive(HILLY, AHEAD, 20.0, seed=4).x_m


def test_it_hardly_matters_how_often_it_is_asked() -> None:
    once = drive(HILLY, AHEAD, 20.0)
    often = plant(HILLY)
    often.set_wheel_speeds(AHEAD)
    for step in range(1, 4001):
        often.advance(START_NS + step * 5_000_000)
        often.truth()
    truth = often.truth()
    assert math.dist((truth.x_m, truth.y_m), (once.x_m, once.y_m)) < 2e-3
    assert truth.yaw_rad == pytest.approx(once.yaw_rad, abs=1e-3)


def test_soil_strength_fluctuates() -> None:
    slope = Ground(inclination_deg=8)
    uneven, even = plant(settings(slope, force_fluctuation=0.1)), plant(settings(slope))
    slips: list[list[float]] = [[], []]
    for rover, found in zip((uneven, even), slips, strict=True):
        rover.set_wheel_speeds((0.2,) * 4)
        for second in range(5, 200, 2):
            rover.advance(START_NS + nanoseconds(second))
            found.append(1.0 - rover.truth().velocity_x_m_s / (0.2 * RADIUS_M))
    assert 0.01 < np.std(slips[0]) < 0.08
    assert np.std(slips[1]) < 1e-3


def test_a_soil_that_does_not_exist_is_named() -> None:
    with pytest.raises(ConfigError, match="moondust"):
        plant(settings(Ground(soil="moondust")))


def test_nonsense_is_refused() -> None:
    with pytest.raises(ValidationError):
        ElDoradoPlantSettings.model_validate({"mass_kg": -1})
    with pytest.raises(ValidationError):
        Ground(inclination_deg=float("nan"))
