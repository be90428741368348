"""Every standard effect against a closed form, and at its null."""

from collections.abc import Mapping

import numpy as np
import pytest

from rover_hil.gap import Array, StateModel, Values, effects
from sim_backends.state_model.port_effect import PortEffect
from tests.sim_backends.state_model.machines import STEP_S, mass, run_of, simulated, tank, tank_run

TIMES = np.arange(200) * STEP_S
WAVE = 3.0 * np.sin(2.0 * TIMES) + np.where(TIMES > 1.0, 1.0, 0.0)

EVERY: tuple[PortEffect, ...] = (
    effects.coulomb_friction("force", velocity="speed", size=0.5, slow=0.02),
    effects.asymmetric_friction("force", velocity="speed", size=0.5, slow=0.02),
    effects.stribeck_friction("force", velocity="speed", size=0.5, speed=0.5, slow=0.02),
    effects.presliding("force", velocity="speed", size=0.5, distance=0.1),
    effects.viscous_friction("force", velocity="speed", size=0.5),
    effects.quadratic_drag("force", velocity="speed", size=0.5),
    effects.cubic_stiffness("force", position="position", size=0.5),
    effects.cogging("force", position="position", period=0.5, size=0.5),
    effects.end_stop("force", position="position", size=50.0, places=(0.3, 0.6)),
    effects.two_body_backlash(
        "force", inertia="mass", load="seen_position", ratio=1.0, size=0.1, impact_s=0.005
    ),
    effects.backlash("force", size=0.5, name="coupling_backlash"),
    effects.dead_zone("push", size=0.5),
    effects.delay("push", size=0.05, longest=0.5),
    effects.lag("push", size=0.05, longest=0.5),
    effects.gain_error("push", size=0.1),
    effects.offset("push", size=0.1),
    effects.play("push", size=0.5),
    effects.supply_sag("push", size=0.05),
    effects.saturation("push", limits=(1.0, 2.0)),
    effects.quantisation("push", step=0.7),
    effects.overflow("force", level="position", limits=(0.3, 0.6)),
    effects.wrong_parameter("mass", size=0.3),
    effects.delay("seen_speed", size=0.05, longest=0.5, name="late_sensor"),
    effects.lag("seen_speed", size=0.05, longest=0.5, name="slow_sensor"),
)
NAMES = [card.name for card in mass(*EVERY).effects]


@pytest.mark.parametrize("index", range(len(EVERY)), ids=NAMES)
def test_an_effect_at_its_null_changes_nothing_and_away_from_it_something(index: int) -> None:
    model, run = mass(EVERY[index]), run_of(WAVE)
    card = model.effects[0]
    strength = card.parameters[0]
    null = {card.name: {one.name: one.nominal for one in card.parameters}}
    full = {card.name: {strength.name: strength.nominal + strength.prior_sd}}
    base, at_null, changed = (
        tables[0] for tables in model.predict_points([run], [({}, {}), ({}, null), ({}, full)])
    )
    alone = model.predict([run], {}, {})[0]
    for name, values in base.items():
        np.testing.assert_array_equal(at_null[name], values)
        np.testing.assert_allclose(values, alone[name], rtol=0, atol=1e-13)
    assert max(np.abs(changed[name] - base[name]).max() for name in base) > 0.01


def push_behind(effect: PortEffect, values: Mapping[str, float], push: Array, substeps: int = 8) -> Array:
    """Return the push with an effect as the mass feels it, from its speed: the mean over each sample."""
    model = mass(effect, substeps=substeps)
    found = simulated(model, run_of(push), {model.effects[0].name: values})
    return 2.0 * np.diff(found["seen_speed"]) / STEP_S


def test_a_dead_zone_takes_its_half_width() -> None:
    expected = np.sign(WAVE) * np.maximum(np.abs(WAVE) - 0.8, 0.0)
    found = push_behind(effects.dead_zone("push", size=1.0), {"half_width": 0.8}, WAVE)
    np.testing.assert_allclose(found, expected[:-1], atol=1e-9)


def test_a_hard_limit_and_a_soft_one() -> None:
    hard = push_behind(effects.saturation("push", limits=(1.0,)), {"share": 1.0, "limit": 1.5}, WAVE)
    np.testing.assert_allclose(hard, np.clip(WAVE, -1.5, 1.5)[:-1], atol=1e-9)
    soft = push_behind(effects.saturation("push", limits=(1.0,)), {"share": 0.5, "limit": 1.5}, WAVE)
    np.testing.assert_allclose(soft, (0.5 * WAVE + 0.5 * np.clip(WAVE, -1.5, 1.5))[:-1], atol=1e-9)


def test_sag_gain_and_offset() -> None:
    sag = push_behind(effects.supply_sag("push", size=0.1), {"per_unit": 0.1}, WAVE)
    np.testing.assert_allclose(sag, (WAVE * (1.0 - 0.1 * np.abs(WAVE)))[:-1], atol=1e-9)
    gain = push_behind(effects.gain_error("push", size=0.1), {"share": -0.2}, WAVE)
    np.testing.assert_allclose(gain, 0.8 * WAVE[:-1], atol=1e-9)
    offset = push_behind(effects.offset("push", size=0.1), {"offset": 0.4}, WAVE)
    np.testing.assert_allclose(offset, WAVE[:-1] + 0.4, atol=1e-9)


def test_a_held_input_is_shifted_by_its_delay() -> None:
    delay = effects.delay("push", size=0.05, longest=0.5)
    whole = push_behind(delay, {"time": 3.0 * STEP_S}, WAVE)
    np.testing.assert_allclose(whole[3:], WAVE[:-4], atol=1e-9)
    np.testing.assert_allclose(whole[:3], WAVE[0], atol=1e-9)
    part = push_behind(delay, {"time": 0.3 * STEP_S}, WAVE)
    np.testing.assert_allclose(part[1:], 0.7 * WAVE[1:-1] + 0.3 * WAVE[:-2], atol=1e-9)


def test_the_response_is_smooth_in_a_delay() -> None:
    model, run = mass(effects.delay("push", size=0.05, longest=0.5)), run_of(WAVE)
    times = np.linspace(0.4, 1.6, 25) * STEP_S
    points: list[tuple[Values, Mapping[str, Values]]] = [
        ({}, {"delay": {"time": float(one)}}) for one in times
    ]
    speed = np.array([one[0]["seen_position"][-1] for one in model.predict_points([run], points)])
    slopes = np.diff(speed) / np.diff(times)
    assert np.ptp(slopes) < 0.1 * abs(slopes.mean())


def lagged_exactly(push: Array, time_s: float) -> Array:
    """Return the mean over each sample of a held push behind a lag."""
    value, means, keep = push[0], [], np.exp(-STEP_S / time_s)
    for one in push[:-1]:
        means.append(one + (value - one) * time_s / STEP_S * (1.0 - keep))
        value = one + keep * (value - one)
    return np.array(means)


@pytest.mark.parametrize("substeps", [1, 8])
@pytest.mark.parametrize("time_s", [0.003, 0.05, 1.0])
def test_a_lag_is_an_exact_exponential_with_any_step(substeps: int, time_s: float) -> None:
    found = push_behind(effects.lag("push", size=0.05, longest=2.0), {"time": time_s}, WAVE, substeps)
    np.testing.assert_allclose(found, lagged_exactly(WAVE, time_s), atol=1e-9)


def test_a_lagging_sensor_follows_a_ramp_late_by_its_time_constant() -> None:
    model = mass(effects.lag("seen_speed", size=0.05, longest=0.5))
    found = simulated(model, run_of(np.full(200, 2.0)), {"lag": {"time": 0.1}})
    expected = TIMES - 0.1 * (1.0 - np.exp(-TIMES / 0.1))
    np.testing.assert_allclose(found["seen_speed"], expected, atol=1e-9)


def test_a_delayed_sensor_shows_what_was_before() -> None:
    model = mass(effects.delay("seen_speed", size=0.05, longest=0.5))
    found = simulated(model, run_of(np.full(200, 2.0)), {"delay": {"time": 2.5 * STEP_S}})
    np.testing.assert_allclose(found["seen_speed"], np.maximum(TIMES - 0.05, 0.0), atol=1e-9)


def test_play_holds_its_output_after_a_reversal() -> None:
    push = np.concatenate((np.linspace(0.0, 2.0, 50), np.linspace(2.0, 0.0, 50)))
    found = push_behind(effects.play("push", size=0.3), {"half_play": 0.25}, push)
    np.testing.assert_allclose(found[10:50], push[10:50] - 0.25, atol=1e-9)
    np.testing.assert_allclose(found[50:60], 1.75, atol=1e-9)
    np.testing.assert_allclose(found[70:], push[70:-1] + 0.25, atol=1e-9)


def test_a_coupling_transmits_nothing_inside_its_play() -> None:
    found = push_behind(effects.backlash("force", size=1.0), {"half_play": 1.0}, 0.9 * WAVE / 4.0)
    np.testing.assert_allclose(found, 0.0, atol=1e-12)
    above = push_behind(effects.backlash("force", size=1.0), {"half_play": 1.0}, np.full(50, 3.0))
    np.testing.assert_allclose(above, 2.0, atol=1e-9)


def test_quantisation_rounds_to_steps() -> None:
    found = push_behind(effects.quantisation("push", step=0.7), {"share": 1.0}, WAVE)
    np.testing.assert_allclose(found, 0.7 * np.round(WAVE / 0.7)[:-1], atol=1e-9)


def amplitudes(model: StateModel, values: Mapping[str, Mapping[str, float]]) -> Array:
    """Return the sizes of the extremes of a free oscillation from 1 m."""
    found = simulated(model, run_of(np.zeros(700), position=1.0), values)["seen_position"]
    inner = np.abs(found[1:-1])
    return inner[(inner > np.abs(found[:-2])) & (inner >= np.abs(found[2:]))]


def test_dry_friction_takes_the_same_amplitude_each_half_swing() -> None:
    friction = effects.coulomb_friction("force", velocity="speed", size=1.0, slow=0.002)
    peaks = amplitudes(mass(friction, stiffness=50.0, substeps=64), {"coulomb_friction": {"level": 1.0}})
    losses = -np.diff(np.concatenate(([1.0], peaks)))[:10]
    np.testing.assert_allclose(losses, 2.0 * 1.0 / 50.0, rtol=0.05)


def test_drag_slows_a_mass_by_its_closed_forms() -> None:
    quadratic = mass(effects.quadratic_drag("force", velocity="speed", size=1.0))
    found = simulated(quadratic, run_of(np.zeros(200)), {"quadratic_drag": {"coefficient": 0.6}}, 3.0)
    np.testing.assert_allclose(found["seen_speed"], 3.0 / (1.0 + 3.0 * 0.3 * TIMES), atol=1e-8)
    viscous = mass(effects.viscous_friction("force", velocity="speed", size=1.0))
    found = simulated(viscous, run_of(np.zeros(200)), {"viscous_friction": {"coefficient": 0.6}}, 3.0)
    np.testing.assert_allclose(found["seen_speed"], 3.0 * np.exp(-0.3 * TIMES), atol=1e-8)


def test_friction_of_one_direction_and_stribeck_friction_have_their_force() -> None:
    asymmetric = mass(effects.asymmetric_friction("force", velocity="speed", size=1.0, slow=0.01))
    for first in (3.0, -3.0):
        found = simulated(asymmetric, run_of(np.zeros(50)), {"asymmetric_friction": {"excess": 0.5}}, first)
        np.testing.assert_allclose(found["seen_speed"], first - 0.25 * TIMES[:50], atol=1e-9)
    stribeck = effects.stribeck_friction("force", velocity="speed", size=1.0, speed=1.0, slow=0.01)
    found = simulated(
        mass(stribeck), run_of(np.zeros(2)), {"stribeck_friction": {"excess": 0.5, "speed": 2.0}}, 2.0
    )
    lost = (2.0 - found["seen_speed"][1]) / STEP_S
    assert lost == pytest.approx(0.25 * np.exp(-1.0), rel=0.01)


def test_presliding_builds_up_over_its_distance() -> None:
    model = mass(effects.presliding("force", velocity="speed", size=1.0, distance=0.1), substeps=32)
    values = {"presliding": {"level": 1e-6, "distance": 0.1}}
    for first in (1.0, -1.0):
        found = simulated(model, run_of(np.zeros(200)), values, first)
        way = np.abs(found["seen_position"])
        lost = (1.0 - np.abs(found["seen_speed"])) * 2.0 / 1e-6
        expected = way - 0.1 * (1.0 - np.exp(-way / 0.1))
        np.testing.assert_allclose(lost, expected, atol=1e-4)


def test_a_spring_and_a_cog_keep_the_energy() -> None:
    spring = effects.cubic_stiffness("force", position="position", size=10.0)
    found = simulated(
        mass(spring), run_of(np.zeros(200), position=1.0), {"cubic_stiffness": {"coefficient": 8.0}}
    )
    energy = found["seen_speed"] ** 2 + 2.0 * found["seen_position"] ** 4
    np.testing.assert_allclose(energy, 2.0, atol=1e-6)
    cog = mass(effects.cogging("force", position="position", period=0.5, size=1.0))
    found = simulated(cog, run_of(np.zeros(200)), {"cogging": {"amplitude": 1.5, "phase": 0.4}}, 1.0)
    potential = -1.5 * 0.5 / (2.0 * np.pi) * np.cos(4.0 * np.pi * found["seen_position"] + 0.4)
    np.testing.assert_allclose(np.ptp(found["seen_speed"] ** 2 + potential), 0.0, atol=1e-6)


def test_an_end_stop_throws_back_with_its_stiffness() -> None:
    model = mass(effects.end_stop("force", position="position", size=800.0, places=(0.3,)))
    values = {"end_stop": {"stiffness": 800.0, "place": 0.3}}
    found = simulated(model, run_of(np.zeros(100)), values, 1.0)
    deepest = 0.3 + np.sqrt(2.0 / 800.0)
    assert found["seen_position"].max() == pytest.approx(deepest, abs=1e-3)
    assert found["seen_speed"][-1] == pytest.approx(-1.0, abs=1e-3)


def test_an_overflow_stays_at_the_edge() -> None:
    overflow = effects.overflow("flow", level="level", limits=(0.5,))
    model = tank(overflow)
    found = model.predict([tank_run()], {}, {"overflow": {"share": 1.0, "limit": 0.5}})[0]["seen_level"]
    free = model.predict([tank_run()], {}, {})[0]["seen_level"]
    assert free.max() == pytest.approx(1.0)
    below = free < 0.49
    before = np.arange(free.size) < np.argmax(free)
    np.testing.assert_allclose(found[below & before], free[below & before], atol=1e-12)
    assert found.max() == pytest.approx(0.5, abs=0.001)
    np.testing.assert_allclose(np.diff(found[-20:]), np.diff(free[-20:]), atol=1e-12)


def test_what_begins_above_the_edge_runs_off() -> None:
    model = tank(effects.overflow("flow", level="level", limits=(0.5,), weir=10.0), first_level=0.8)
    values = {"overflow": {"share": 1.0, "limit": 0.5}}
    found = model.predict([tank_run()], {}, values)[0]["seen_level"]
    np.testing.assert_allclose(found[:100], 0.5 + 0.3 * np.exp(-10.0 * TIMES[:100]), atol=1e-5)


def test_a_body_and_its_load_fly_apart_and_meet_again() -> None:
    backlash = effects.two_body_backlash(
        "force", inertia="mass", load="seen_position", ratio=1.0, size=0.1, impact_s=0.001
    )
    model = mass(backlash, substeps=32)
    values = {"backlash": {"play": 0.1, "load_share": 0.5}}
    push = np.concatenate((np.full(20, 2.0), np.full(40, -2.0)))
    found = simulated(model, run_of(push), values)
    base = simulated(model, run_of(push), {})
    together = slice(0, 20)
    np.testing.assert_allclose(found["seen_speed"][together], base["seen_speed"][together], atol=1e-6)
    np.testing.assert_allclose(
        found["seen_position"][together], base["seen_position"][together] - 0.05, atol=1e-4
    )
    flying = found["seen_speed"][22:28]
    np.testing.assert_allclose(np.diff(flying), -2.0 / 1.0 * STEP_S, rtol=0.02)
    np.testing.assert_allclose(found["seen_speed"][-5:], base["seen_speed"][-5:], atol=0.01)


def test_two_effects_with_memory_at_one_port_add_up() -> None:
    one = effects.presliding("force", velocity="speed", size=1.0, distance=0.1, name="one")
    other = effects.presliding("force", velocity="speed", size=1.0, distance=0.1, name="other")
    double = simulated(mass(one), run_of(WAVE), {"one": {"level": 0.6}})
    both = simulated(mass(one, other), run_of(WAVE), {"one": {"level": 0.3}, "other": {"level": 0.3}})
    np.testing.assert_allclose(both["seen_speed"], double["seen_speed"], atol=1e-12)
    mixed = {"one": {"level": 0.3, "distance": 1.0}, "other": {"level": 0.3, "distance": 0.01}}
    swapped = {"one": mixed["other"], "other": mixed["one"]}
    first, second = (simulated(mass(one, other), run_of(WAVE), values) for values in (mixed, swapped))
    np.testing.assert_allclose(first["seen_speed"], second["seen_speed"], atol=1e-12)
    assert np.abs(first["seen_speed"] - both["seen_speed"]).max() > 0.01


def test_a_released_parameter_takes_its_error() -> None:
    model = mass(effects.wrong_parameter("mass", size=0.3))
    assert model.effects[0].releases == "mass"
    found = simulated(model, run_of(WAVE), {"wrong_mass": {"error": 0.4}})
    direct = model.predict([run_of(WAVE)], {"mass": 2.4}, {})[0]
    np.testing.assert_allclose(found["seen_speed"], direct["seen_speed"], atol=1e-12)


@pytest.mark.parametrize("port", ["push", "seen_speed"])
def test_a_lag_as_fast_as_the_machine_and_its_samples_is_exact(port: str) -> None:
    """Of a mass with a damper whose time constant is one sample, too, pushed from the third sample on."""
    damping = 2.0 / STEP_S
    model = mass(effects.lag(port, size=STEP_S, longest=0.5), damping=damping, substeps=1)
    run = run_of(np.array([0.0, 0.0, *np.full(38, damping)]))
    found = simulated(model, run, {"lag": {"time": STEP_S}})["seen_speed"]
    since = np.maximum(np.arange(40) - 2.0, 0.0)
    np.testing.assert_allclose(found, 1.0 - (1.0 + since) * np.exp(-since), atol=0.005)


def test_a_delay_between_samples_of_a_machine_as_fast_as_they_are_is_exact() -> None:
    damping = 2.0 / STEP_S
    model = mass(effects.delay("seen_speed", size=STEP_S, longest=0.5), damping=damping, substeps=1)
    run = run_of(np.array([0.0, 0.0, *np.full(38, damping)]))
    found = simulated(model, run, {"delay": {"time": 0.4 * STEP_S}})["seen_speed"]
    since = np.maximum(np.arange(40) - 2.4, 0.0)
    np.testing.assert_allclose(found, 1.0 - np.exp(-since), atol=0.01)
