"""The truth of the machines against closed forms, conservation laws and an integrator of another kind."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from tests.nature.machines import FAMILIES
from tests.nature.machines.case import Effect, Term
from tests.nature.machines.family import Family, Plan
from tests.nature.machines.integrator import TOLERANCE
from tests.nature.machines.machine import Machine
from tests.nature.machines.make import LEVELS, draw_effect, draw_machine, effect_ratio, find_size

pytestmark = pytest.mark.nightly  # a truth generator, which no change of the program touches

Array = NDArray[np.float64]
Law = Callable[[dict[str, float], Array, Array], list[float]]

RUNS = 4
HIDDEN = [(family, effect) for family in FAMILIES.values() for effect in (*family.catalogue, *family.outside)]


def _label(value: Family | Effect | Term) -> str:
    return value.name


def _machine(family: Family, seed: int = 1) -> Machine:
    machine = draw_machine(family, 1.0, np.random.default_rng(seed))
    return replace(
        machine,
        plans=machine.plans[:RUNS],
        run_parameters=machine.run_parameters[:RUNS],
        starts=machine.starts[:RUNS],
        disturbances=machine.disturbances[:RUNS],
    )


def _run(
    name: str,
    start: dict[str, float],
    inputs: dict[str, Array],
    tolerance: float = TOLERANCE,
    **hidden: float,
) -> dict[str, Array]:
    family = FAMILIES[name]
    constants = {one.name: one.nominal for one in family.parameters} | family.nothing_hidden() | hidden
    samples = next(iter(inputs.values())).size
    plan = Plan(name="run", conditions={}, inputs=inputs)
    return family.run(plan, constants, start, np.zeros(samples), tolerance)


def _axis_law(p: dict[str, float], x: Array, u: Array) -> list[float]:
    torque = p["torque_constant_v_s"] / p["resistance_ohm"] * (u[0] - p["torque_constant_v_s"] * x[0])
    return [(torque - p["viscous_nm_s"] * x[0]) / p["inertia_kg_m2"], x[0]]


def _pendulum_law(p: dict[str, float], x: Array, u: Array) -> list[float]:
    torque = p["drive_gain"] * u[0] - p["gravity_nm"] * np.sin(x[0]) - p["viscous_nm_s"] * x[1]
    return [x[1], torque / p["inertia_kg_m2"]]


def _tanks_law(p: dict[str, float], x: Array, u: Array) -> list[float]:
    def orifice(head: float) -> float:
        return math.sqrt(2 * 9.81) * head / math.sqrt(abs(head) + 0.0005)

    through = p["pipe_m2"] * orifice(x[0] - x[1])
    return [
        (p["pump_m3_s_v"] * u[0] - through) / p["area_1_m2"],
        (through - p["outlet_m2"] * orifice(x[1])) / p["area_2_m2"],
    ]


def _thermal_law(p: dict[str, float], x: Array, u: Array) -> list[float]:
    through = p["conductance_w_k"] * (x[0] - x[1])
    return [
        (p["heater_gain"] * u[0] - through) / p["capacity_1_j_k"],
        (through - p["loss_w_k"] * (x[1] - u[1])) / p["capacity_2_j_k"],
    ]


def _circuit_law(p: dict[str, float], x: Array, u: Array) -> list[float]:
    voltage = p["amplifier_gain"] * u[0] - p["resistance_ohm"] * x[0] - x[1]
    return [voltage / p["inductance_h"], x[0] / p["capacitance_f"]]


def _vehicle_law(p: dict[str, float], x: Array, u: Array) -> list[float]:
    turn = x[0] * u[1] / (p["wheelbase_m"] * (1 + (x[0] / p["characteristic_m_s"]) ** 2))
    return [
        (p["drive_gain"] * u[0] - p["damping_n_s_m"] * x[0]) / p["mass_kg"],
        (turn - x[1]) / p["yaw_lag_s"],
    ]


LAWS: dict[str, Law] = {
    "geared_axis": _axis_law,
    "pendulum": _pendulum_law,
    "tanks": _tanks_law,
    "thermal": _thermal_law,
    "circuit": _circuit_law,
    "vehicle": _vehicle_law,
}


@pytest.mark.parametrize("name", LAWS)
def test_without_effects_it_is_the_documented_law(name: str) -> None:
    family = FAMILIES[name]
    machine = _machine(family)
    parameters = dict(machine.run_parameters[0])
    inputs = np.array([machine.plans[0].inputs[signal.name] for signal in family.inputs])
    truth = machine.record({})[0]
    state = np.array([machine.starts[0][one.name] for one in family.states])
    for index in range(150):
        for one, value in zip(family.states, state, strict=True):
            assert truth[one.name][index] == pytest.approx(value, abs=1e-5 * one.scale, rel=1e-5)
        solved = solve_ivp(
            lambda _, x, held: LAWS[name](parameters, x, held),
            (0.0, family.dt_s),
            state,
            method="LSODA",
            args=(inputs[:, index],),
            rtol=1e-9,
            atol=1e-10 * min(one.scale for one in family.states),
        )
        state = solved.y[:, -1]


@pytest.mark.parametrize(("family", "effect"), HIDDEN, ids=_label)
def test_an_effect_of_size_zero_changes_nothing(family: Family, effect: Effect | Term) -> None:
    machine = _machine(family)
    hidden = draw_effect(effect, np.random.default_rng(2))
    plain = machine.record({})
    assert np.isfinite(machine.snr(plain, machine.record(hidden.constants(1.0))))
    assert machine.snr(plain, machine.record(hidden.constants(0.0))) < 1e-6
    ratio = effect_ratio(machine, plain, hidden)
    assert ratio(1e-4) < 0.05 * ratio(1.0)


@pytest.mark.parametrize(("family", "effect"), HIDDEN, ids=_label)
def test_the_asked_ratio_is_reached(family: Family, effect: Effect | Term) -> None:
    machine = _machine(family, 3)
    ratio = effect_ratio(machine, machine.record({}), draw_effect(effect, np.random.default_rng(4)))
    for level in LEVELS[:3]:
        share = find_size(ratio, level)
        if share < 1.0:
            assert ratio(share) == pytest.approx(level, rel=0.02)
        else:
            assert level > LEVELS[1]
            assert ratio(share) <= level


@pytest.mark.parametrize(("family", "effect"), HIDDEN, ids=_label)
def test_the_tolerance_does_not_matter(family: Family, effect: Effect | Term) -> None:
    machine = _machine(family, 5)
    hidden = draw_effect(effect, np.random.default_rng(6))
    ratio = effect_ratio(machine, machine.record({}), hidden)
    constants = family.nothing_hidden() | hidden.constants(find_size(ratio, 10.0))
    for plan, parameters, start in zip(machine.plans, machine.run_parameters, machine.starts, strict=True):
        still = np.zeros(next(iter(plan.inputs.values())).size)
        coarse, fine = (
            family.run(plan, constants | dict(parameters), start, still, TOLERANCE * factor)
            for factor in (1.0, 0.5)
        )
        for channel in family.channels:
            assert np.abs(coarse[channel.name] - fine[channel.name]).max() < channel.sigma / 20


def test_a_pendulum_without_losses_keeps_its_energy_and_the_exact_period() -> None:
    start = 1.2
    free = np.zeros(400)
    truth = _run("pendulum", {"angle_rad": start, "rate_rad_s": 0.0}, {"torque_nm": free}, viscous_nm_s=0.0)
    energy = 0.5 * 0.02 * truth["rate_rad_s"] ** 2 - 0.75 * np.cos(truth["angle_rad"])
    assert energy == pytest.approx(energy[0], abs=1e-6)
    period_s = 4 * math.sqrt(0.02 / 0.75) * ellipk(math.sin(start / 2) ** 2)
    falls = np.flatnonzero((truth["angle_rad"][:-1] > 0.0) & (truth["angle_rad"][1:] <= 0.0))
    share = truth["angle_rad"][falls] / (truth["angle_rad"][falls] - truth["angle_rad"][falls + 1])
    crossings_s = 0.02 * (falls + share)
    assert np.diff(crossings_s) == pytest.approx(period_s, abs=2e-4)


def test_a_pendulum_sticks_off_its_lowest_point() -> None:
    free = np.zeros(400)
    for factor in (1.0, 2.0):
        dry = 0.06 * factor
        truth = _run("pendulum", {"angle_rad": 1.0, "rate_rad_s": 0.0}, {"torque_nm": free}, coulomb_nm=dry)
        stuck = truth["mode"] == 2
        assert stuck[-100:].all()
        first = int(np.argmax(stuck))
        assert np.ptp(truth["angle_rad"][first:]) == 0.0
        assert np.abs(truth["rate_rad_s"][first:]).max() == 0.0
        assert 0.0 < abs(0.75 * math.sin(truth["angle_rad"][-1])) <= dry


def test_dry_friction_alone_takes_the_same_from_every_swing() -> None:
    # A small swing with dry friction loses 2 friction/stiffness of amplitude in each half period.
    free = np.zeros(400)
    truth = _run(
        "pendulum",
        {"angle_rad": 0.1, "rate_rad_s": 0.0},
        {"torque_nm": free},
        viscous_nm_s=0.0,
        coulomb_nm=0.0075,
    )
    half = round(math.pi * math.sqrt(0.02 / 0.75) / 0.02)
    extremes = [abs(truth["angle_rad"][index]) for index in (0, half, 2 * half)]
    assert np.diff(extremes) == pytest.approx(-0.02, abs=5e-4)


def test_more_friction_at_rest_holds_a_larger_torque() -> None:
    ramp = np.minimum(np.arange(400) * 0.0005, 0.2)
    start = {"angle_rad": 0.0, "rate_rad_s": 0.0}
    truth = _run(
        "pendulum", start, {"torque_nm": ramp}, coulomb_nm=0.05, stiction_share=1.0, stribeck_rad_s=0.05
    )
    leaves = int(np.argmax(truth["angle_rad"] != 0.0))
    assert ramp[leaves - 2] <= 0.1 <= ramp[leaves]
    # Once it moves, friction has fallen: it jumps past the balance of the torques.
    assert truth["rate_rad_s"].max() > 0.2


def test_a_shaft_with_dry_friction_alone_stops_after_the_exact_time() -> None:
    start = {"motor_speed_rad_s": 50.0, "motor_angle_rad": 0.0}
    truth = _run(
        "geared_axis",
        start,
        {"voltage_v": np.zeros(200)},
        torque_constant_v_s=0.0,
        viscous_nm_s=0.0,
        coulomb_nm=0.005,
    )
    time_s = 0.01 * np.arange(200)
    assert truth["speed_rad_s"] == pytest.approx(np.maximum(50.0 - 50.0 * time_s, 0.0), abs=1e-6)
    assert truth["load_angle_rad"][-1] == pytest.approx(25.0 / 20.0, abs=1e-7)


def test_asymmetric_friction_brakes_more_forward_than_backward() -> None:
    speeds = [
        _run(
            "geared_axis",
            {"motor_speed_rad_s": 0.0, "motor_angle_rad": 0.0},
            {"voltage_v": np.full(200, volts)},
            coulomb_nm=0.02,
            asymmetry=0.5,
        )["speed_rad_s"][-1]
        for volts in (6.0, -6.0)
    ]
    damping = 0.05**2 + 2e-4
    assert speeds[0] == pytest.approx((0.3 - 0.03) / damping, rel=1e-4)
    assert speeds[1] == pytest.approx(-(0.3 - 0.01) / damping, rel=1e-4)


def test_presliding_gives_way_like_a_spring_and_then_slides() -> None:
    for volts, slides in ((0.2, False), (1.0, True)):
        truth = _run(
            "geared_axis",
            {"motor_speed_rad_s": 0.0, "motor_angle_rad": 0.0},
            {"voltage_v": np.full(400, volts)},
            bristle_nm=0.02,
            bristle_rad=1.0,
        )
        assert bool(truth["motor_angle_rad"][-1] > 10.0) is slides
        if not slides:
            # The bristle holds: 1 - exp(-angle/bristle_rad) of its largest torque.
            bent = 1.0 - math.exp(-truth["motor_angle_rad"][-1])
            assert truth["bristle"][-1] == pytest.approx(bent, rel=1e-5)
            assert 0.02 * bent == pytest.approx(0.05 * volts, rel=0.02)


def test_a_load_in_the_backlash_turns_freely_and_is_hit_without_loss_of_momentum() -> None:
    start = {"motor_speed_rad_s": 60.0, "motor_angle_rad": 0.0}
    truth = _run(
        "geared_axis", start, {"voltage_v": np.zeros(200)}, backlash_rad=0.4, load_share=0.5, coulomb_nm=0.001
    )
    gap = truth["motor_angle_rad"] - truth["load_angle_at_motor_rad"]
    assert gap[0] == pytest.approx(4.0)
    assert np.abs(gap).max() <= 4.0 + 1e-6
    apart = truth["mode"] > 25
    free = apart[:-1] & apart[1:]
    changes = np.diff(truth["load_speed_at_motor_rad_s"])[free]
    assert changes[:2] == pytest.approx(0.0, abs=1e-9)
    behind = int(np.argmax((truth["mode"] > 15) & ~apart))
    assert gap[behind] == pytest.approx(-4.0, abs=1e-6)
    # One body after the impact.
    assert truth["load_speed_at_motor_rad_s"][behind] == pytest.approx(truth["motor_speed_rad_s"][behind])


def test_impacts_in_the_backlash_keep_the_momentum() -> None:
    # No torque at all but a short friction at the start cannot be had: drive by voltage without losses.
    volts = np.zeros(300)
    volts[:10], volts[10:20] = 6.0, -3.0
    truth = _run(
        "geared_axis",
        {"motor_speed_rad_s": 0.0, "motor_angle_rad": 0.0},
        {"voltage_v": volts},
        resistance_ohm=1e3,
        torque_constant_v_s=1e-3,
        viscous_nm_s=0.0,
        backlash_rad=0.001,
        load_share=0.5,
    )
    momentum = 1e-4 * (0.5 * truth["motor_speed_rad_s"] + 0.5 * truth["load_speed_at_motor_rad_s"])
    pushed = 1e-3 / 1e3 * np.concatenate(([0.0], np.cumsum(volts[:-1]) * 0.01))
    assert momentum == pytest.approx(pushed, abs=1e-11)


def test_a_vehicle_stops_by_rolling_friction_and_stays() -> None:
    still = np.zeros(300)
    truth = _run(
        "vehicle",
        {"speed_m_s": 5.0, "yaw_rate_rad_s": 0.0},
        {"force_n": np.where(np.arange(300) < 250, 0.0, 900.0), "steering_rad": still},
        rolling_n=1000.0,
        damping_n_s_m=0.0,
    )
    stop_s = 5.0 * 1200.0 / 1000.0
    assert truth["speed_m_s"][:119] == pytest.approx(5.0 - np.arange(119) * 0.05 * 1000 / 1200, abs=1e-6)
    assert np.abs(truth["speed_m_s"][int(stop_s / 0.05) + 1 :]).max() == 0.0


def test_quadratic_drag_alone_coasts_as_a_hyperbola() -> None:
    still = np.zeros(300)
    truth = _run(
        "vehicle",
        {"speed_m_s": 20.0, "yaw_rate_rad_s": 0.0},
        {"force_n": still, "steering_rad": still},
        damping_n_s_m=0.0,
        drag_n_s2_m2=6.0,
    )
    time_s = 0.05 * np.arange(300)
    assert truth["speed_m_s"] == pytest.approx(20.0 / (1.0 + 6.0 * 20.0 / 1200.0 * time_s), abs=1e-6)


def test_steering_follows_through_the_play() -> None:
    angle = np.concatenate((np.linspace(0.0, 0.1, 100), np.linspace(0.1, 0.0, 100)))
    truth = _run(
        "vehicle",
        {"speed_m_s": 10.0, "yaw_rate_rad_s": 0.0},
        {"force_n": np.full(200, 600.0), "steering_rad": angle},
        play_rad=0.04,
        yaw_lag_s=1e-3,
    )
    wheels = truth["yaw_rate_rad_s"] * 2.6 * (1.0 + 0.25) / 10.0
    # Sample k shows what the input of sample k - 1 made.
    assert wheels[1:21] == pytest.approx(np.maximum(angle[:20] - 0.02, 0.0), abs=1e-6)
    assert wheels[100] == pytest.approx(0.08, abs=2e-3)
    assert wheels[101:138] == pytest.approx(0.08, abs=1e-6)
    assert wheels[-1] == pytest.approx(angle[-2] + 0.02, abs=1e-6)


def test_tanks_without_outlet_keep_their_water_and_level_out() -> None:
    truth = _run(
        "tanks",
        {"level_1_m": 0.2, "level_2_m": 0.05},
        {"pump_v": np.zeros(300)},
        outlet_m2=0.0,
        area_2_m2=0.03,
    )
    water = 0.0154 * truth["level_1_m"] + 0.03 * truth["level_2_m"]
    assert water == pytest.approx(water[0], abs=1e-9)
    assert truth["level_1_m"][-1] == pytest.approx(truth["level_2_m"][-1], abs=1e-6)


def test_a_tank_overflows_at_its_rim() -> None:
    truth = _run("tanks", {"level_1_m": 0.1, "level_2_m": 0.05}, {"pump_v": np.full(300, 10.0)}, rim_m=0.15)
    assert truth["level_1_m"][-1] == pytest.approx(0.15, abs=5e-4)
    assert truth["level_1_m"].max() < 0.1505


def test_an_empty_tank_stays_empty() -> None:
    truth = _run("tanks", {"level_1_m": 0.02, "level_2_m": 0.01}, {"pump_v": np.zeros(400)}, leak_m2=3e-5)
    for name in ("level_1_m", "level_2_m"):
        assert truth[name].min() > -1e-6
        assert truth[name][-1] < 1e-3


def test_a_closed_thermal_body_keeps_its_heat() -> None:
    inputs = {"heater_w": np.zeros(300), "room_c": np.full(300, 20.0)}
    truth = _run("thermal", {"temperature_1_c": 60.0, "temperature_2_c": 20.0}, inputs, loss_w_k=0.0)
    heat = 40.0 * truth["temperature_1_c"] + 150.0 * truth["temperature_2_c"]
    assert heat == pytest.approx(heat[0], abs=1e-4)
    over = truth["temperature_1_c"] - truth["temperature_2_c"]
    assert over == pytest.approx(40.0 * np.exp(-4.0 * np.arange(300) * (1 / 40 + 1 / 150)), abs=1e-4)


def test_radiation_balances_the_heater_in_the_end() -> None:
    inputs = {"heater_w": np.full(3000, 20.0), "room_c": np.full(3000, 20.0)}
    truth = _run(
        "thermal",
        {"temperature_1_c": 20.0, "temperature_2_c": 20.0},
        inputs,
        loss_w_k=0.0,
        radiation_w_k4=5e-9,
    )
    final_k = (20.0 / 5e-9 + 293.15**4) ** 0.25
    assert truth["temperature_2_c"][-1] + 273.15 == pytest.approx(final_k, abs=1e-3)


def test_a_circuit_rings_as_the_closed_form() -> None:
    truth = _run("circuit", {"current_a": 0.0, "capacitor_v": 10.0}, {"voltage_v": np.zeros(200)})
    time_s = 2e-4 * np.arange(200)
    decay = 30.0 / 0.2
    turning = math.sqrt(1.0 / (0.1 * 1e-5) - decay**2)
    wave = np.cos(turning * time_s) + decay / turning * np.sin(turning * time_s)
    assert truth["capacitor_v"] == pytest.approx(10.0 * np.exp(-decay * time_s) * wave, abs=1e-5)


def test_a_contact_drop_leaves_the_capacitor_charged() -> None:
    truth = _run("circuit", {"current_a": 0.0, "capacitor_v": 10.0}, {"voltage_v": np.zeros(300)}, drop_v=1.0)
    assert truth["mode"][-1] == 2
    assert np.abs(truth["current_a"][-100:]).max() == 0.0
    assert np.ptp(truth["capacitor_v"][-100:]) == 0.0
    assert 0.0 < abs(truth["capacitor_v"][-1]) <= 1.0


def test_a_delay_of_whole_samples_shifts_the_answer() -> None:
    volts = np.concatenate((np.zeros(20), np.full(180, 6.0)))
    start = {"motor_speed_rad_s": 0.0, "motor_angle_rad": 0.0}
    plain, late, half = (
        _run("geared_axis", start, {"voltage_v": volts}, delay_s=delay_s)["speed_rad_s"]
        for delay_s in (0.0, 0.03, 0.005)
    )
    assert late[3:] == pytest.approx(plain[:-3], abs=1e-5)
    # The step comes in the middle of a sample: the closed form after that time.
    damping = 0.05**2 + 2e-4
    exact = 0.3 / damping * (1.0 - np.exp(-damping / 1e-4 * (0.01 * np.arange(180) - 0.005)))
    assert half[21:] == pytest.approx(exact[1:], abs=1e-4)


def test_a_lag_is_the_exact_first_order_lag() -> None:
    rng = np.random.default_rng(0)
    torque = np.repeat(rng.uniform(-0.2, 0.2, 20), 10)
    truth = _run("pendulum", {"angle_rad": 0.0, "rate_rad_s": 0.0}, {"torque_nm": torque}, lag_s=0.1)
    lagged, keep = torque[0], math.exp(-0.02 / 0.1)
    for index in range(200):
        assert truth["lagged_torque_nm"][index] == pytest.approx(lagged, abs=1e-7)
        lagged = torque[index] + (lagged - torque[index]) * keep


def test_dead_zone_limit_and_sag_act_on_the_command() -> None:
    volts = np.full(200, 6.0)
    start = {"motor_speed_rad_s": 0.0, "motor_angle_rad": 0.0}
    per_volt = 0.05 / (0.05**2 + 2e-4)
    dead = _run("geared_axis", start, {"voltage_v": volts}, dead_zone_v=1.0)["speed_rad_s"][-1]
    weak = _run("geared_axis", start, {"voltage_v": -volts}, sag_per_v=0.02)["speed_rad_s"][-1]
    heater = {"heater_w": np.full(2000, 50.0), "room_c": np.full(2000, 20.0)}
    cold = {"temperature_1_c": 20.0, "temperature_2_c": 20.0}
    limited = _run("thermal", cold, heater, limit_w=24.0)["temperature_2_c"][-1]
    assert dead == pytest.approx(5.0 * per_volt, rel=1e-4)
    assert weak == pytest.approx(-6.0 * (1.0 - 0.12) * per_volt, rel=1e-4)
    assert limited == pytest.approx(20.0 + 24.0 / 0.8, rel=1e-4)
