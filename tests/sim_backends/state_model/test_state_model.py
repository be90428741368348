"""Integration, refinement, sensitivities and error messages of machines made of equations."""

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from drivers.errors import ConfigError
from rover_hil.gap import Array, Port, Run, effects
from sim_backends.state_model.equations import Signal
from tests.sim_backends.state_model.machines import STEP_S, mass, run_of, simulated

WAVE = np.sin(np.arange(150) * 0.2)


def test_a_driven_mass_moves_as_an_adaptive_integration_says() -> None:
    def rate(t: float, y: Array) -> list[float]:
        held = WAVE[min(int(t / STEP_S + 1e-9), WAVE.size - 1)]
        return [y[1], (held - 0.7 * y[1] - 30.0 * np.sin(y[0])) / 2.0]

    truth = [np.array([0.8, -0.1])]
    for sample in range(WAVE.size - 1):
        span = (sample * STEP_S, (sample + 1) * STEP_S - 1e-12)
        truth.append(solve_ivp(rate, span, truth[-1], rtol=1e-10, atol=1e-12).y[:, -1])
    model = mass(damping=0.7)
    linear = model.derivative

    def pendulum(
        x: SimpleNamespace, u: SimpleNamespace, p: SimpleNamespace, port: Signal
    ) -> Mapping[str, Array]:
        pulled = SimpleNamespace(push=u.push - 30.0 * np.sin(x.position))
        return linear(x, pulled, p, port)

    found = simulated(replace(model, derivative=pendulum), run_of(WAVE, position=0.8), {}, -0.1)
    np.testing.assert_allclose(found["seen_position"], np.array(truth)[:, 0], atol=1e-7)
    np.testing.assert_allclose(found["seen_speed"], np.array(truth)[:, 1], atol=1e-6)


def test_an_interpolated_input_is_exact_for_a_ramp() -> None:
    ramp = np.linspace(0.0, 99.0 * STEP_S, 100)
    found = simulated(replace(mass(), is_held=False), run_of(ramp), {})
    np.testing.assert_allclose(found["seen_speed"], ramp**2 / 4.0, atol=1e-12)


def test_a_channel_of_an_input_shows_it_at_every_sample() -> None:
    ramp = np.arange(60.0) ** 2
    for is_held in (True, False):
        model = replace(mass(effects.delay("push", size=0.05, longest=0.5)), is_held=is_held)
        np.testing.assert_allclose(simulated(model, run_of(ramp), {})["seen_push"], ramp, atol=1e-9)
        late = simulated(model, run_of(ramp), {"delay": {"time": 2.0 * STEP_S}})["seen_push"]
        np.testing.assert_allclose(late[2:], ramp[:-2], atol=1e-9)


def test_refining_ends_where_the_error_is_small_and_not_before() -> None:
    run = run_of(WAVE, position=1.0)
    model = mass(stiffness=800.0, noise=0.02)
    refined = model.refined([run])
    exact = replace(model, substeps=256).predict([run], {}, {})[0]

    def share(substeps: int) -> float:
        found = replace(model, substeps=substeps).predict([run], {}, {})[0]
        return max(
            float(np.sqrt(np.mean((found[one.name] - exact[one.name]) ** 2))) / one.noise_sd
            for one in model.channels
        )

    assert refined.substeps > 1
    assert share(refined.substeps) < 0.06
    assert share(refined.substeps // 2) > 0.05


def test_a_stiff_model_is_refused_with_advice() -> None:
    with pytest.raises(ConfigError, match=r"32 integration steps per sample are not enough.*stiff"):
        mass(damping=2e5).refined([run_of(WAVE)])


def test_a_run_at_a_tipping_point_of_an_effect_is_not_stiff() -> None:
    # With this ratio of push to cogging the mass comes to rest just on top of the first cog.
    ratio = brentq(lambda r: r * (np.pi - np.arcsin(r)) - 1.0 - np.sqrt(1.0 - r * r), 0.5, 0.99)
    model = mass(effects.cogging("force", position="position", period=0.1, size=1.0 / ratio))
    pushes = (1.0, 0.5, 0.6, 0.4)
    runs = [run_of(np.full(400, push), name=f"run{index}") for index, push in enumerate(pushes)]
    with pytest.raises(ConfigError, match="32 integration steps per sample are not enough with cogging"):
        model.refined(runs[:1])
    assert 1 <= model.refined(runs).effect_substeps["cogging"] <= 8


def test_refining_looks_at_each_effect_by_itself() -> None:
    friction = effects.coulomb_friction("force", velocity="speed", size=20.0, slow=0.01)
    idle = [effects.offset("seen_push", size=0.1, name=f"offset_{index}") for index in range(8)]
    assert mass().refined([run_of(WAVE)]).substeps == 1
    refined = mass(friction, *idle, noise=1e-3).refined([run_of(5.0 * WAVE)])
    alone = mass(friction, noise=1e-3).refined([run_of(5.0 * WAVE)])
    assert refined.substeps == refined.effect_substeps["offset_0"] == 1
    assert refined.effect_substeps["coulomb_friction"] == alone.effect_substeps["coulomb_friction"] > 1


def test_responses_to_a_force_are_finite_differences() -> None:
    model = mass(damping=0.5)
    runs = [run_of(WAVE), run_of(WAVE[:80], name="b")]
    shape = np.cos(np.arange(WAVE.size) * 0.1)
    found = model.force_responses(runs, {}, {}, model.ports[0], shape[None, :])[0]
    for run, response in zip(runs, found, strict=True):
        size = run.inputs["push"].size
        middle = run_of(0.5 * (shape[:size] + np.append(shape[1:size], shape[size - 1])))
        direct = simulated(replace(model, substeps=64), middle, {})
        np.testing.assert_allclose(response["seen_speed"], direct["seen_speed"], atol=2e-4)
        np.testing.assert_allclose(response["seen_push"], 0.0, atol=1e-12)


def test_an_unknown_of_a_run_acts_on_that_run_only() -> None:
    model, runs = mass(), [run_of(WAVE), run_of(WAVE, name="b")]
    base = model.predict(runs, {}, {})
    moved = model.predict(runs, {"first_speed@b": 0.3}, {})
    np.testing.assert_array_equal(base[0]["seen_speed"], moved[0]["seen_speed"])
    np.testing.assert_allclose(moved[1]["seen_speed"] - base[1]["seen_speed"], 0.3)


def test_runs_of_different_lengths_are_simulated_as_alone() -> None:
    friction = effects.presliding("force", velocity="speed", size=1.0, distance=0.01)
    model = mass(friction, damping=0.3)
    runs = [run_of(WAVE), run_of(-2.0 * WAVE[:60], name="short", position=1.0)]
    hidden = {"presliding": {"level": 0.4, "distance": 0.01}}
    together = model.predict(runs, {"mass": 1.5}, hidden)
    for run, table in zip(runs, together, strict=True):
        alone = model.predict([run], {"mass": 1.5}, hidden)[0]
        for name, values in alone.items():
            assert values.size == run.inputs["push"].size
            np.testing.assert_array_equal(table[name], values)


def test_points_do_not_influence_each_other() -> None:
    friction = effects.coulomb_friction("force", velocity="speed", size=1.0, slow=0.01)
    model, run = mass(friction), run_of(5.0 * WAVE)
    points = [({}, {}), ({"mass": 3.0}, {"coulomb_friction": {"level": 1.0}}), ({"mass": 3.0}, {})]
    for point, tables in zip(points, model.predict_points([run], points), strict=True):
        np.testing.assert_allclose(
            tables[0]["seen_speed"], model.predict([run], *point)[0]["seen_speed"], rtol=0, atol=1e-14
        )


def test_an_effect_at_an_unknown_port_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"an effect refers to 'torque', which is no port.*force"):
        mass(effects.offset("torque", size=1.0))


def test_an_effect_of_an_unknown_state_is_refused() -> None:
    with pytest.raises(ConfigError, match="refers to 'rate'"):
        mass(effects.coulomb_friction("force", velocity="rate", size=1.0, slow=0.1))


def test_two_effects_of_one_name_are_refused() -> None:
    with pytest.raises(ConfigError, match="two effects are called 'offset': give one another name"):
        mass(effects.offset("push", size=1.0), effects.offset("force", size=1.0))


def test_a_name_of_a_state_and_an_input_is_refused() -> None:
    with pytest.raises(ConfigError, match="two quantities are called 'speed'"):
        replace(mass(), inputs={"push": "N", "speed": "m/s"})


def test_a_name_of_a_port_and_an_input_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"two signals \(inputs, channels, ports\) are called 'push'"):
        replace(mass(), ports=(Port(name="push", unit="N", force_sd=1.0),))


def test_a_port_that_is_not_declared_is_refused() -> None:
    model = replace(mass(), ports=(Port(name="forse", unit="N", force_sd=1.0),))
    with pytest.raises(ConfigError, match="port 'force' that `ports` does not declare; there are forse"):
        model.predict([run_of(WAVE)], {}, {})


def test_times_that_do_not_increase_are_refused() -> None:
    run = run_of(WAVE)
    times = np.arange(WAVE.size) * STEP_S
    times[70] = times[69]
    run = replace(run, inputs={**run.inputs, "t_s": times})
    with pytest.raises(ConfigError, match=r"run a: the time does not increase after 1\.38 s"):
        mass(step_s=None).predict([run], {}, {})


def uneven_run(name: str, size: int, seed: int) -> Run:
    """Return a run with a constant push at uneven times."""
    steps: Array = np.random.default_rng(seed).uniform(0.5 * STEP_S, 1.5 * STEP_S, size)
    times: Array = np.cumsum(steps, dtype=np.float64)
    run = run_of(np.ones(size), name=name)
    return replace(run, inputs={**run.inputs, "t_s": times})


def test_each_run_moves_by_its_own_uneven_times() -> None:
    """Under a constant push the speed is the time since the start over two."""
    model = mass(effects.delay("seen_speed", size=0.05, longest=0.5), step_s=None)
    runs = [uneven_run("a", 80, 1), uneven_run("b", 50, 2), run_of(np.ones(60), name="c")]
    runs[2] = replace(runs[2], inputs={**runs[2].inputs, "t_s": np.linspace(0.0, 59.0 * STEP_S, 60)})
    found = model.predict(runs, {}, {"delay": {"time": 0.07}})
    for run, table in zip(runs, found, strict=True):
        times = run.inputs["t_s"] - run.inputs["t_s"][0]
        np.testing.assert_allclose(table["seen_position"], times**2 / 4.0, atol=1e-12)
        place = np.interp(times - 0.07, times, times)
        np.testing.assert_allclose(table["seen_speed"], place / 2.0, atol=1e-12)


def test_a_lag_of_an_uneven_ramp_is_that_of_its_time() -> None:
    model = mass(effects.lag("seen_speed", size=0.05, longest=0.5), step_s=None)
    run = uneven_run("a", 80, 3)
    found = model.predict([run], {}, {"lag": {"time": 0.1}})[0]["seen_speed"]
    times = run.inputs["t_s"] - run.inputs["t_s"][0]
    np.testing.assert_allclose(found, 0.5 * (times - 0.1 * (1.0 - np.exp(-times / 0.1))), atol=1e-12)


def test_a_delayed_held_input_acts_at_its_uneven_time() -> None:
    """The push of 1 at the third sample arrives later by the delay, between samples."""
    model = mass(effects.delay("push", size=0.05, longest=0.5), step_s=None)
    run = uneven_run("a", 80, 4)
    run = replace(run, inputs={**run.inputs, "push": np.array([0.0, 0.0, *np.ones(78)])})
    found = model.predict([run], {}, {"delay": {"time": 0.033}})[0]["seen_speed"]
    times = run.inputs["t_s"] - run.inputs["t_s"][0]
    np.testing.assert_allclose(found, 0.5 * np.maximum(times - times[2] - 0.033, 0.0), atol=1e-12)


def test_times_of_a_run_give_its_step() -> None:
    times = np.arange(WAVE.size) * 2.0 * STEP_S
    run = replace(run_of(np.ones(WAVE.size)), inputs={"push": np.ones(WAVE.size), "t_s": times})
    found = mass(step_s=None).predict([run], {}, {})[0]
    np.testing.assert_allclose(found["seen_speed"], times / 2.0, atol=1e-12)


def test_an_effect_at_the_wrong_kind_of_signal_is_refused_with_the_right_one() -> None:
    with pytest.raises(ConfigError, match="'push' depends on speed: attach it to a port inside"):
        mass(effects.coulomb_friction("push", velocity="speed", size=1.0, slow=0.01))
    with pytest.raises(ConfigError, match="a delay cannot act at the port 'force': attach it to an input"):
        mass(effects.delay("force", size=0.1, longest=1.0))


def test_a_wrong_parameter_stays_inside_its_bounds() -> None:
    model = mass()
    released = model.parameters[0]
    (card,) = replace(model, port_effects=(effects.wrong_parameter(released.name, size=1.0),)).effects
    error = card.parameters[0]
    assert (error.lower, error.upper) == (
        released.lower - released.nominal,
        released.upper - released.nominal,
    )


def test_trajectories_take_the_steps_that_their_effects_need() -> None:
    friction = effects.coulomb_friction("force", velocity="speed", size=20.0, slow=0.01)
    run = run_of(5.0 * WAVE)
    model = mass(friction, noise=1e-3).refined([run])
    (name,) = model.effect_substeps
    point = {name: {card.name: card.natural for card in model.effects[0].parameters}}
    assert model.substeps < model.effect_substeps[name]
    channels = simulated(model, run, point)
    series = model.trajectories([run], {f"first_speed@{run.name}": 0.0}, point)[0]
    np.testing.assert_array_equal(series["speed"], channels["seen_speed"])
