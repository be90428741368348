"""Recorded equations against the same equations called through Python."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest

from rover_hil.gap import Array, StateModel, effects
from sim_backends.state_model import integrate, recorded
from sim_backends.state_model.port_effect import PortEffect
from sim_backends.state_model.tape import make_tape
from sim_backends.state_model.tape_kernel import BLOCK, compute
from sim_backends.state_model.tracing import Graph, Source
from tests.sim_backends.state_model.machines import STEP_S, mass, run_of

SAMPLES = 200
PUSH = 3.0 * np.sin(np.arange(SAMPLES) * 0.13) + 1.0
RUNS = [run_of(PUSH, name="a"), run_of(-0.6 * PUSH, position=0.2, name="b"), run_of(PUSH[::-1], name="c")]
EFFECTS = (
    effects.coulomb_friction("force", velocity="speed", size=1.0, slow=0.05),
    effects.asymmetric_friction("force", velocity="speed", size=0.5, slow=0.05),
    effects.stribeck_friction("force", velocity="speed", size=0.5, speed=0.3, slow=0.05),
    effects.presliding("force", velocity="speed", size=1.0, distance=0.05),
    effects.quadratic_drag("force", velocity="speed", size=0.5),
    effects.cubic_stiffness("force", position="position", size=2.0),
    effects.cogging("force", position="position", period=0.3, size=0.5),
    effects.end_stop("force", position="position", size=50.0, places=(0.2, 0.4)),
    effects.two_body_backlash(
        "force", inertia="mass", load="seen_position", ratio=1.0, size=0.1, impact_s=0.01
    ),
    effects.dead_zone("push", size=0.5),
    effects.dead_zone("force", size=0.5, name="inner_dead_zone"),
    effects.saturation("force", limits=(1.0, 2.0)),
    effects.supply_sag("push", size=0.05),
    effects.delay("push", size=0.03, longest=0.2),
    effects.lag("push", size=0.05, longest=0.3),
    effects.play("seen_position", size=0.02),
)


def _without_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(integrate.Simulation, "_recorded", lambda _: None)


def _values(model: StateModel, points: Sequence[Mapping[str, Mapping[str, float]]]) -> Array:
    found = model.predict_points(RUNS, [({"first_speed@b": 0.3}, one) for one in points])
    return np.array([[list(table.values()) for table in tables] for tables in found])


def _strong(model: StateModel) -> dict[str, Mapping[str, float]]:
    return {card.name: {card.parameters[0].name: card.parameters[0].prior_sd} for card in model.effects}


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda one: str(one.build.__qualname__).partition(".")[0])
def test_a_standard_effect_is_recorded_and_has_the_same_motion(
    effect: PortEffect, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = mass(effect, damping=0.4, stiffness=3.0)
    acting = _strong(model)
    called: list[bool] = []
    found = integrate.Simulation._recorded

    def watched(one: integrate.Simulation) -> recorded.RecordedLanes | None:
        result = found(one)
        called.append(result is not None)
        return result

    monkeypatch.setattr(integrate.Simulation, "_recorded", watched)
    fast = _values(model, [{}, acting])
    assert called == [True, True]
    _without_recording(monkeypatch)
    slow = _values(model, [{}, acting])
    assert np.abs(slow[1] - slow[0]).max() > 1e-3
    np.testing.assert_allclose(fast, slow, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("order", ["C", "F"])
def test_the_integration_is_compiled_for_one_memory_order(order: Literal["C", "F"]) -> None:
    samples = np.arange(6.0).reshape(2, 3)
    one = np.array(samples, order=order)[None]
    rows, sources = recorded._rows_of_lanes([one], (2, 2), 3)
    assert rows.flags.c_contiguous
    np.testing.assert_array_equal(rows[sources[0]], np.concatenate((samples, samples)))


def test_a_long_record_needs_few_calls_of_the_equations() -> None:
    model, calls = _counting()
    _values(model, [{}] * 40)
    assert 0 < calls[0] < 10


def test_effects_of_other_points_do_not_change_a_prediction() -> None:
    model = mass(*EFFECTS[:9], damping=0.4)
    some = [{}, *({name: values} for name, values in _strong(model).items())]
    together = _values(model, some)
    for one, found in zip(some, together, strict=True):
        np.testing.assert_array_equal(_values(model, [one])[0], found)


def test_the_number_of_processors_does_not_change_a_prediction(monkeypatch: pytest.MonkeyPatch) -> None:
    model = mass(EFFECTS[0], EFFECTS[8], damping=0.4)
    points = [{"coulomb_friction": {"level": 0.01 * number}} for number in range(BLOCK)]
    alone = _values(model, points)
    monkeypatch.setattr(recorded, "LEAST_WORK", 0)
    for count in (2, 3):
        monkeypatch.setattr(recorded, "_processors", lambda count=count: count)
        np.testing.assert_array_equal(_values(model, points), alone)


Rate = Callable[[SimpleNamespace], Any]


@pytest.mark.parametrize(
    "pull",
    [
        lambda x: np.sum(x.speed) * np.ones(np.shape(x.speed)),
        lambda x: x.speed.mean() + 0.0 * x.speed,
        lambda x: x.speed if np.all(np.abs(x.position) < 1e9) else 0.0,
        lambda x: np.interp(x.speed, [-1.0, 1.0], [-2.0, 2.0]),
        lambda x: np.asarray(x.speed) ** 3,
        lambda x: x.speed @ np.eye(x.speed.shape[-1]),
        lambda x: np.array([[0.1, 0.2, 0.3]]) * np.ones(np.shape(x.speed)),
    ],
    ids=["sum", "mean", "choice", "table", "array", "matrix", "rows"],
)
def test_equations_that_cannot_be_recorded_are_called(pull: Rate, monkeypatch: pytest.MonkeyPatch) -> None:
    model = _pulled(pull)
    found = _values(model, [{}, {}])
    _without_recording(monkeypatch)
    np.testing.assert_array_equal(found, _values(model, [{}, {}]))
    assert np.ptp(found) > 0.0


def test_equations_that_change_between_calls_are_not_frozen() -> None:
    rng = np.random.default_rng(3)
    model = _pulled(lambda x: x.speed * rng.uniform(0.5, 1.5))
    assert np.abs(_values(model, [{}]) - _values(model, [{}])).max() > 1e-3


def test_a_model_without_states_does_not_step_through_its_samples() -> None:
    model = mass()

    def never(*_: object) -> Mapping[str, Array]:
        raise AssertionError("there is nothing to integrate")

    still = replace(
        model,
        states={},
        derivative=never,
        start=lambda *_: {},
        output=lambda _, u, __, ___: dict.fromkeys(("seen_position", "seen_speed", "seen_push"), u.push),
        ports=(),
        run_parameters=(),
    )
    found = still.predict([RUNS[0]], {}, {})[0]["seen_push"]
    np.testing.assert_allclose(found, PUSH, rtol=1e-9)


A, B = np.meshgrid([-2.0, -0.5, 0.0, 0.3, 1.0, 2.5, np.nan, np.inf], [-1.5, 0.0, 0.3, 2.0, np.nan])


@pytest.mark.parametrize(
    "function",
    [
        lambda a, b: (a + b) * (a - b) / b,
        lambda a, b: -a + abs(b) - +b,
        lambda a, b: np.minimum(a, b) - 2.0 * np.maximum(b, a),
        lambda a, b: np.clip(a, -b, np.abs(b)) + a.clip(0.1, 0.4),
        lambda a, b: np.where(a > b, a, np.where(b >= 0.3, b, 1.0)),
        lambda a, b: (a < b) * a + (a <= b) * b + (a == b) * 3.0 - (a != b) * 1.0,
        lambda a, b: np.where((a > 0.0) & ~(b > 0.0), 1.0, 2.0) + np.where((a > 0) | (b > 0), 1.0, 2.0),
        lambda a, b: np.where(np.logical_or(a, b), a, 5.0) + np.where(np.logical_and(a, b), 1.0, 2.0),
        lambda a, b: np.where(np.logical_not(a), a, b) + np.where(a, 1.0, 2.0),
        lambda a, b: np.sign(a) * np.copysign(b, a) + np.isfinite(a),
        lambda a, b: np.sqrt(np.abs(a)) + np.exp(-(b**2)) + np.expm1(b) + np.log(np.abs(a)) + np.log1p(b * b),
        lambda a, b: np.sin(a) + np.cos(b) + np.tan(b) + np.tanh(30.0 * a) + np.sinh(b) + np.cosh(b),
        lambda a, b: np.arctan(a) + np.arctan2(a, b) + np.hypot(a, b),
        lambda a, b: np.arcsin(np.tanh(a) / 2) * np.arccos(b / 9),
        lambda a, b: a**2 + a**3 + np.abs(a) ** 1.5 + np.square(b) + np.power(2.0, b) + a**1,
        lambda a, b: np.floor(a) - np.ceil(b) + np.zeros_like(a) + 2.0 * np.ones_like(b),
        lambda a, b: a + np.full_like(a, 0.5),
    ],
)  # fmt: skip
def test_an_operation_has_the_result_of_numpy(function: Callable[[Any, Any], Any]) -> None:
    graph = Graph()
    with np.errstate(all="ignore"):
        expected = np.broadcast_to(function(A, B), A.shape)
        for first, second in ((Source.STATE, Source.STATE), (Source.PARAMETER, Source.INPUT)):
            graph = Graph()
            given = sorted([graph.given(first), graph.given(second)], key=lambda one: one.place)
            tape = make_tape(graph, given, [function(*given)])
            values = np.zeros((tape.registers, A.size))
            values[: tape.constants.size] = tape.constants[:, None]
            values[tape.constants.size : tape.constants.size + 2] = A.reshape(-1), B.reshape(-1)
            for rows in (tape.once, tape.step, tape.stage):
                compute(values, rows, A.size)
            np.testing.assert_allclose(
                values[tape.rates[0]].reshape(A.shape), expected, rtol=1e-12, atol=1e-13
            )


def _pulled(pull: Rate) -> StateModel:
    return replace(
        mass(),
        derivative=lambda x, u, p, port: {
            "position": x.speed,
            "speed": port("force", u.push - pull(x)) / p.mass,
        },
    )


def _counting() -> tuple[StateModel, list[int]]:
    model, calls = mass(damping=0.4), [0]
    equations = model.derivative

    def derivative(*arguments: Any) -> Mapping[str, Array]:
        calls[0] += 1
        return equations(*arguments)

    return replace(model, derivative=derivative, step_s=STEP_S), calls


def test_a_law_that_acts_only_where_a_state_is_largest_is_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """A number that is recorded is no array, so that this function leaves its law out of the recording."""

    def pull(x: SimpleNamespace) -> Any:
        speed = x.speed
        return np.where(np.abs(speed) > 0.4, 5.0 * speed, speed) if isinstance(speed, np.ndarray) else speed

    model = _pulled(pull)
    found = _values(model, [{}])
    _without_recording(monkeypatch)
    called = _values(model, [{}])
    np.testing.assert_array_equal(found, called)
