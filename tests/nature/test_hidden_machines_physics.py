"""Nature of the hidden machines: balances, steady states, known solutions."""

from dataclasses import replace

import numpy as np
import pytest

from tests.nature.hidden_machines import forces, signals
from tests.nature.hidden_machines.drives import DriveCase, draw_drives, drive
from tests.nature.hidden_machines.excitation import excite
from tests.nature.hidden_machines.kinds import (
    boat,
    conveyor,
    crane,
    cylinder,
    heater,
    ladder,
    pump,
    table,
    valve,
)
from tests.nature.hidden_machines.machine import Array, Machine, Sensor, Values
from tests.nature.hidden_machines.noise import read
from tests.nature.hidden_machines.rover_motion import ROVERS
from tests.nature.hidden_machines.simulate import Hidden, simulate


def run(machine: Machine, starts: Values, level: float, hidden: Hidden = (), **numbers: float) -> Values:
    """Return the channels of one run with a constant input."""
    values = {number.name: np.array([number.nominal]) for number in machine.numbers}
    values |= {condition.name: np.array([condition.low]) for condition in machine.conditions}
    values |= {name: np.array([value]) for name, value in numbers.items()}
    inputs = {command.name: np.full((1, machine.samples), level) for command in machine.inputs}
    return {name: series[0] for name, series in simulate(machine, values, starts, inputs, hidden).items()}


def nominal(machine: Machine, name: str) -> float:
    return next(number.nominal for number in machine.numbers if number.name == name)


def at(**states: float) -> Values:
    return {name: np.array([value]) for name, value in states.items()}


def test_a_ladder_settles_at_its_source() -> None:
    channels = run(ladder.MACHINE, at(first=-2.0, second=1.0), 3.0)
    assert channels["probe"][-1] == pytest.approx(3.0, abs=0.01)
    assert channels["meter"][-1] == pytest.approx(3.0, abs=0.01)


def test_a_heater_gives_off_what_it_takes_up() -> None:
    channels = run(replace(heater.MACHINE, samples=600), at(), 100.0)
    assert channels["body_probe"][-1] == pytest.approx(100.0 / nominal(heater.MACHINE, "loss"), rel=1e-3)
    warmer = channels["element_probe"][-1] - channels["body_probe"][-1]
    assert warmer == pytest.approx(100.0 / nominal(heater.MACHINE, "coupling"), rel=1e-3)


def test_the_heat_of_a_heater_balances() -> None:
    channels = run(heater.MACHINE, at(), 120.0)
    element, body = channels["element_probe"], channels["body_probe"]
    stored = nominal(heater.MACHINE, "element_capacity") * element[-1]
    stored += nominal(heater.MACHINE, "body_capacity") * body[-1]
    lost = nominal(heater.MACHINE, "loss") * np.sum(0.5 * (body[1:] + body[:-1])) * heater.MACHINE.step_s
    assert stored + lost == pytest.approx(120.0 * (body.size - 1) * heater.MACHINE.step_s, rel=1e-3)


def test_a_radiating_body_is_colder_by_the_law_of_stefan() -> None:
    hidden = [(heater.MACHINE.effect("body_heat_radiation"), 0.05)]
    body = run(replace(heater.MACHINE, samples=600), at(), 150.0, hidden)["body_probe"][-1]
    radiated = 0.05 * 5.67e-8 * ((body + 293.0) ** 4 - 293.0**4)
    assert nominal(heater.MACHINE, "loss") * body + radiated == pytest.approx(150.0, rel=1e-3)


def test_a_crane_swings_with_the_period_of_a_pendulum() -> None:
    machine = replace(crane.MACHINE, samples=400)
    angle = run(machine, at(angle=0.02), 0.0, air=0.0)["inclination"]
    crossings = np.flatnonzero(np.diff(np.sign(angle)))
    share = angle[crossings] / (angle[crossings] - angle[crossings + 1])
    times = (crossings + share) * machine.step_s
    half = np.pi * np.sqrt(nominal(crane.MACHINE, "rope") / 9.81)
    assert np.mean(np.diff(times)) == pytest.approx(half, rel=1e-3)


def test_the_energy_of_a_table_falls_by_what_its_damper_takes() -> None:
    machine = table.MACHINE
    channels = run(machine, at(position=0.01), 0.0)
    position, speed = channels["laser"], channels["geophone"]
    energy = 0.5 * nominal(machine, "spring") * position**2 + 0.5 * nominal(machine, "mass") * speed**2
    taken = nominal(machine, "damping") * np.trapezoid(speed**2, dx=machine.step_s)
    assert energy[0] - energy[-1] == pytest.approx(taken, rel=5e-3)


def test_dry_friction_slows_a_belt_by_a_constant_and_then_holds_it() -> None:
    hidden = [(forces.dry("drive", "speed", 4.0, 0.015), 8.0)]
    speed = run(conveyor.MACHINE, at(speed=0.5), 0.0, hidden, resistance=0.0)["tachometer"]
    moving = speed > 0.1
    time_s = conveyor.MACHINE.step_s * np.arange(speed.size)
    slope = np.polyfit(time_s[moving], speed[moving], 1)[0]
    assert slope == pytest.approx(-8.0 / nominal(conveyor.MACHINE, "belt"), rel=0.02)
    assert abs(speed[-1]) < 1e-3


def test_a_boat_turns_at_the_rate_of_nomoto() -> None:
    rate = run(boat.MACHINE, at(), 0.3)["gyro"]
    time_s = boat.MACHINE.step_s * np.arange(rate.size)
    damping = nominal(boat.MACHINE, "damping")
    steady = nominal(boat.MACHINE, "rudder_gain") * 0.3 / damping
    assert rate == pytest.approx(steady * (1.0 - np.exp(-damping * time_s)), abs=1e-5)


def test_a_standpipe_carries_the_pressure_of_its_pump() -> None:
    level = run(replace(pump.MACHINE, samples=2000), at(), 40.0)["gauge"]
    assert level[-1] == pytest.approx(40.0 / 9.81, rel=1e-3)


def ramp() -> Array:
    return np.concatenate([np.zeros(20), np.linspace(0.0, 1.0, 81), np.linspace(0.99, -1.0, 200)])[None]


def test_a_delay_shifts_and_a_lag_follows() -> None:
    late = signals.delay("input", "a", 0.1, 1.0).act(ramp(), 0.01, 0.105)
    assert late[0, 11:] == pytest.approx(0.5 * (ramp()[0, 1:-10] + ramp()[0, :-11]))
    step = np.concatenate([np.zeros(10), np.ones(90)])[None]
    lagged = signals.lag("input", "a", 0.1, 1.0).act(step, 0.01, 0.2)
    in_the_middle_s = 19.5 * 0.01
    assert lagged[0, 29] == pytest.approx(1.0 - np.exp(-in_the_middle_s / 0.2), abs=3e-4)


def test_play_crosses_twice_its_half_width_when_it_reverses() -> None:
    follower = signals.play("a", 0.1).act(ramp(), 0.01, 0.1)[0]
    top = int(np.argmax(ramp()[0]))
    assert follower[top] == pytest.approx(0.9)
    held = np.flatnonzero(np.isclose(follower, 0.9))
    assert ramp()[0, held[-1]] == pytest.approx(0.8, abs=0.011)


def test_a_dead_zone_and_a_limit_do_not_commute_with_an_offset() -> None:
    dead, offset = signals.dead_zone("a", 0.1), signals.offset("input", "a", 0.1)
    one = offset.act(dead.act(ramp(), 0.01, 0.2), 0.01, 0.1)
    other = dead.act(offset.act(ramp(), 0.01, 0.1), 0.01, 0.2)
    assert np.max(np.abs(one - other)) == pytest.approx(0.1)
    limit = signals.saturation("input", "a", 1.0)
    assert limit.reported(0.3) == pytest.approx(0.7)
    assert np.max(limit.act(ramp(), 0.01, 0.3)) == pytest.approx(0.7)


def test_noise_has_its_standard_deviation_and_correlation() -> None:
    rng = np.random.default_rng(1)
    readings = read(np.zeros((50, 1000)), Sensor("a", "1", 0.2), 0.6, rng)
    assert np.std(readings) == pytest.approx(0.2, rel=0.03)
    assert np.corrcoef(readings[:, 1:].ravel(), readings[:, :-1].ravel())[0, 1] == pytest.approx(
        0.6, abs=0.02
    )
    coarse = read(np.zeros((1, 1000)), Sensor("a", "1", 0.2, 0.1), 0.0, rng)
    assert coarse == pytest.approx(0.1 * np.round(coarse / 0.1), abs=1e-12)


def plain_drive(rover: int) -> tuple[DriveCase, dict[str, Array]]:
    case = replace(draw_drives(3, "none", 5), rover=ROVERS[rover], wheel=0)
    case = replace(case, errors=dict.fromkeys(case.errors, 0.0))
    return case, drive(case, np.random.default_rng(4), np.random.default_rng(5))


def test_two_wheels_add_up_to_the_path_of_their_rover() -> None:
    case, columns = plain_drive(0)
    radius, track = case.rover.radius_m, case.rover.wheels[0].y_m - case.rover.wheels[1].y_m
    left, right = (radius * np.diff(columns[f"wheel{k}"]) for k in (0, 1))
    yaw = columns["yaw"][0] + np.cumsum((right - left) / track)
    assert yaw[-1] == pytest.approx(columns["yaw"][-1], abs=0.02)
    ahead = 0.5 * (left + right)
    x = columns["x"][0] + np.sum(ahead * np.cos(yaw))
    y = columns["y"][0] + np.sum(ahead * np.sin(yaw))
    assert (x, y) == pytest.approx((columns["x"][-1], columns["y"][-1]), abs=0.03)


@pytest.mark.parametrize("rover", [1, 2])
def test_steered_wheels_roll_where_they_point(rover: int) -> None:
    case, columns = plain_drive(rover)
    dt = case.time_s[1] - case.time_s[0]
    places = [k for k, wheel in enumerate(case.rover.wheels) if wheel.steers]
    velocities = []
    for k in places:
        rolling = case.rover.radius_m * np.gradient(columns[f"wheel{k}"], dt)
        angle = columns[f"steer{k}"]
        velocities.append((rolling * np.cos(angle), rolling * np.sin(angle)))
    rate = columns["gyro"]
    for k, (ahead, left) in zip(places, velocities, strict=True):
        wheel = case.rover.wheels[k]
        body = ahead + rate * wheel.y_m
        across = rate * wheel.x_m
        assert np.sqrt(np.mean((left - across) ** 2)) < 0.1 * np.sqrt(np.mean(across**2)) + 0.001
        assert np.sqrt(np.mean((body - (velocities[0][0] + rate * case.rover.wheels[0].y_m)) ** 2)) < 0.015


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "strength"), [(valve.MACHINE, 25.0), (cylinder.MACHINE, 100.0), (table.MACHINE, 5.0)]
)
def test_finer_steps_change_sticking_by_less_than_the_noise(machine: Machine, strength: float) -> None:
    effect = next(effect for effect in machine.catalogue if effect.name.endswith("coulomb_friction"))
    rng = np.random.default_rng(6)
    numbers = {number.name: np.full(2, number.nominal) for number in machine.numbers}
    inputs = {
        command.name: np.stack([excite(command, machine.samples, rng) for _ in range(2)])
        for command in machine.inputs
    }
    coarse, fine = (
        simulate(replace(machine, substeps=count), numbers, {}, inputs, [(effect, strength)])
        for count in (machine.substeps, 4 * machine.substeps)
    )
    for sensor in machine.sensors:
        difference = coarse[sensor.name] - fine[sensor.name]
        assert np.sqrt(np.mean(difference**2)) < 0.2 * sensor.noise
