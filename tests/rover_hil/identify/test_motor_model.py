import numpy as np
import pytest

from rover_hil.identify.motor.record import Scale, find_moves
from rover_hil.identify.motor.response import MotorModel, respond
from rover_hil.identify.motor.sensing import CurrentSensor
from rover_hil.report.tracks import Series

STEP_S = 1e-5


def integrate(model: MotorModel, t_s: np.ndarray, set_point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return speed and position of the motor by small steps; its current is a state."""
    speed = position = current = 0.0
    speeds, positions = [], []
    for told in set_point.tolist():
        speeds.append(speed)
        positions.append(position)
        wanted = (model.gain * told - speed) / model.droop_rad_s_per_a if told or speed else 0.0
        current += STEP_S * (wanted - current) / model.electric_lag_s
        free = current - model.viscous_a_s_per_rad * speed
        if speed == 0.0 and abs(free) <= model.coulomb_a:
            continue
        side = np.sign(speed) if speed else np.sign(free)
        after = speed + STEP_S * (free - side * model.coulomb_a) / model.inertia_a_s2_per_rad
        speed = 0.0 if after * side < 0 else after
        position += STEP_S * speed
    return np.array(speeds), np.array(positions)


def test_the_closed_form_is_the_motor_s_own_equations() -> None:
    droop, inertia, viscous = 50.0, 1e-3, 3e-4
    model = MotorModel(
        gain=0.9,
        droop_rad_s_per_a=droop,
        lag_s=inertia * droop / (1 + droop * viscous),
        coulomb_a=0.2,
        viscous_a_s_per_rad=viscous,
        inertia_a_s2_per_rad=inertia,
        electric_lag_s=0.002,
    )
    told = Series(np.array([0.0, 0.5, 1.0, 1.5, 1.7, 2.2]), np.array([0.0, 60.0, 0.0, -80.0, 40.0, 5.0]))
    delay_s = 0.1
    t_s = np.arange(0.0, 3.0, STEP_S)
    place = np.maximum(np.searchsorted(told.t_s + delay_s, t_s, side="right") - 1, 0)
    speed, position = integrate(model, t_s, told.value[place])
    moves = find_moves(told)
    motion = respond(model, moves, np.full(moves.start_s.size, delay_s), 0.0).at(t_s)
    assert np.abs(motion.speed - speed).max() < 0.02 * 80
    assert np.abs(motion.position - position).max() < 0.05
    np.testing.assert_allclose(np.gradient(motion.position, STEP_S)[1:-1], motion.speed[1:-1], atol=0.1)


def test_without_droop_friction_does_not_change_the_speed() -> None:
    told = Series(np.array([0.0, 1.0, 2.0]), np.array([0.0, 50.0, 0.0]))
    model = MotorModel(droop_rad_s_per_a=0.0, lag_s=0.05, coulomb_a=0.3)
    moves = find_moves(told)
    motion = respond(model, moves, np.zeros(moves.start_s.size), 0.0).at(np.array([0.5, 1.05, 1.9, 2.05]))
    expected = [0.0, 50 * (1 - np.exp(-1)), 50.0, 50 * np.exp(-1)]
    np.testing.assert_allclose(motion.speed, expected, atol=0.01)


@pytest.mark.parametrize("is_cut", [True, False])
@pytest.mark.parametrize("current_a", [0.0, 0.05, 0.2, 1.0])
def test_the_sensor_s_average_is_that_of_many_readings(is_cut: bool, current_a: float) -> None:
    step_a, ripple = 4 / 156, 0.18
    sensor = CurrentSensor(Scale(current_a=step_a, current_is_cut=is_cut), is_signed=False, ripple=ripple)
    deviation = max(ripple * np.sqrt(current_a), step_a / 3)
    noisy = np.abs(current_a + deviation * np.random.default_rng(1).standard_normal(400_000)) / step_a
    readings = step_a * (np.floor(noisy) if is_cut else np.round(noisy))
    assert float(sensor.expected(np.array([-current_a]))[0]) == pytest.approx(readings.mean(), abs=1.5e-3)


def test_fast_changing_set_points_are_one_move_and_held_ones_are_many() -> None:
    ramp = find_moves(Series(np.arange(0.0, 5.0, 0.02), np.arange(250.0)))
    stairs = find_moves(Series(np.arange(0.0, 5.0, 0.02), np.repeat(np.arange(5.0), 50)))
    assert ramp.start_s.size == 1
    assert stairs.start_s.size == 5
