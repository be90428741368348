"""The hidden machines: models that run and agree with nature, and answers that repeat."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.nature.hidden_machines import cases
from tests.nature.hidden_machines.draw import CLASSES, Case, draw
from tests.nature.hidden_machines.drives import draw_drives
from tests.nature.hidden_machines.kinds import MACHINES
from tests.nature.hidden_machines.machine import Array
from tests.nature.hidden_machines.model_file import model_text
from tests.nature.hidden_machines.simulate import simulate
from tests.nature.hidden_machines.write import readings

SEED = 90
DIGESTS = Path(cases.__file__).with_name("digests.txt")
"""A line each: SHA-256 of answers, class, how many, seed."""
NAMES = [machine.name for machine in MACHINES]


class Effects:
    """What a user's list calls, recorded."""

    def __getattr__(self, kind: str) -> Any:
        return lambda *args, **kwargs: {"kind": kind, "place": args[0], **kwargs}


def model_of(case: Case) -> SimpleNamespace:
    """Return the parts of a user's model, read without the program."""
    text = model_text(case).replace("from rover_hil.gap import", "# ")
    names = dict.fromkeys(("Channel", "Parameter", "Port", "RunParameter", "StateModel"), SimpleNamespace)
    space: dict[str, Any] = {**names, "effects": Effects()}
    exec(compile(text, "machine.py", "exec"), space)  # noqa: S102
    made: SimpleNamespace = space["make"]()
    return made


def case_of(name: str) -> Case:
    """Return a case of a machine in which nothing is hidden."""
    return next(
        case for number in range(len(MACHINES)) if (case := draw(SEED, "none", number)).machine.name == name
    )


def user_simulation(case: Case, model: SimpleNamespace, run: int) -> dict[str, Array]:
    """Return the channels of a run by the user's equations, with nature's numbers."""
    numbers = {name: value[run] for name, value in case.numbers.items()}
    firsts = {f"first_{name}": value[run] for name, value in case.starts.items()}
    p = SimpleNamespace(**numbers, **firsts)
    names, inputs = list(model.states), {name: series[run] for name, series in case.inputs.items()}

    def rates(_: float, x: Array, k: int) -> list[float]:
        u = SimpleNamespace(**{name: series[k] for name, series in inputs.items()})
        given = model.derivative(SimpleNamespace(**dict(zip(names, x, strict=True))), u, p, lambda _, s: s)
        return [float(given[name]) for name in names]

    state = np.array([model.start(p, None)[name] for name in names])
    path = [state]
    for k in range(case.machine.samples - 1):
        span = (0.0, model.step_s)
        state = solve_ivp(rates, span, state, args=(k,), rtol=1e-7, atol=1e-9).y[:, -1]
        path.append(state)
    x = SimpleNamespace(**dict(zip(names, np.array(path).T, strict=True)))
    return dict(model.output(x, SimpleNamespace(**inputs), p, None))


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_model_of_the_user_runs_and_agrees_with_nature(name: str) -> None:
    case = case_of(name)
    by_user = user_simulation(case, model_of(case), 0)
    by_nature = simulate(case.machine, case.numbers, case.starts, case.inputs, ())
    for sensor in case.machine.sensors:
        difference = by_user[sensor.name] - by_nature[sensor.name][0]
        assert np.sqrt(np.mean(difference**2)) < 0.2 * sensor.noise, sensor.name


@pytest.mark.parametrize("machine", MACHINES, ids=NAMES)
def test_places_of_effects_exist_and_names_differ(machine: Any) -> None:
    places = {
        "port": set(machine.ports),
        "input": {command.name for command in machine.inputs},
        "channel": {sensor.name for sensor in machine.sensors},
        "parameter": {number.name for number in machine.numbers},
    }
    every = (*machine.catalogue, *machine.outside)
    assert [effect.name for effect in every if effect.place not in places[effect.where]] == []
    assert len({effect.name for effect in every}) == len(every)
    assert all(machine.effect(name).line for pair in machine.pairs for name in pair)
    for port in machine.ports:
        assert f'port("{port}"' in machine.derivative
    known = {*machine.states, *places["input"]}
    terms = [term for effect in machine.outside for term in effect.terms]
    assert all(set(term.sources) <= known for term in terms)


@pytest.mark.slow
def test_the_list_of_the_user_holds_the_hidden_effects_of_the_catalogue() -> None:
    for case in (*(draw(SEED, kind, 1) for kind in CLASSES), draw(77, "order", 0)):
        kind = case.kind
        listed = [entry.get("name", f"wrong_{entry['place']}") for entry in model_of(case).port_effects]
        assert sorted(listed) == sorted(effect.name for effect in case.listed)
        late = [entry for entry in model_of(case).port_effects if "longest" in entry]
        assert [entry for entry in late if entry["size"] >= entry["longest"]] == []
        hidden = {effect.name for effect, _ in case.hidden}
        known = {effect.name for effect, _ in case.hidden if effect.line}
        assert known <= set(listed)
        assert not (hidden - known) & set(listed)
        assert kind == "faint" or known == (hidden if kind in {"catalogue", "order"} else set())


@pytest.mark.slow
def test_a_case_and_its_answer_depend_on_seed_class_and_number_alone(tmp_path: Any) -> None:
    for key in (("catalogue", 2), ("outside", cases.AT)):
        first, second = (cases.write(SEED, key, tmp_path / name) for name in ("one", "two"))
        assert first == second
        one, two = (
            {path.name: path.read_bytes() for path in sorted((tmp_path / name).rglob("*")) if path.is_file()}
            for name in ("one", "two")
        )
        assert one == two
    assert cases.answer_of(SEED + 1, ("catalogue", 2)) != first


def test_a_variant_changes_noise_and_order_of_runs_only() -> None:
    case = draw(SEED, "catalogue", 3)
    exact = simulate(case.machine, case.numbers, case.starts, case.inputs, case.hidden)
    for sensor in case.machine.sensors:
        one, two = (readings(case, variant)[sensor.name] for variant in (0, 1))
        assert np.any(one != two)
        for given in (one, two):
            assert np.std(given - exact[sensor.name]) == pytest.approx(sensor.noise, rel=0.3)


def test_a_case_holds_no_answer(tmp_path: Any) -> None:
    for key in (("catalogue", 2), ("catalogue", cases.AT)):
        entry: Any = cases.write(SEED, key, tmp_path)
        assert entry["effects"]
    text = "".join(path.read_text("utf-8") for path in tmp_path.rglob("*.toml"))
    assert not re.search(r"catalogue|outside|hidden|size", text)


def test_all_classes_are_drawn_in_turn_with_a_tenth_of_rovers() -> None:
    drawn = list(cases.keys("all", 200))
    assert len(set(drawn)) == 200
    assert {kind: sum(key[0] == kind for key in drawn) for kind in CLASSES} == {
        "catalogue": 80, "order": 20, "outside": 50, "none": 50, "faint": 0,
    }  # fmt: skip
    rovers = sum(cases.is_drive(key) for key in drawn)
    assert rovers >= 20


@pytest.mark.slow
def test_the_effect_that_is_drawn_shows_as_much_as_was_asked() -> None:
    shown = [draw(SEED, "catalogue", number).ratio for number in (1, 4)]
    assert all(0.1 < ratio < 30.0 for ratio in shown)


def test_hidden_effects_of_drives_belong_to_their_rover() -> None:
    for number in range(cases.AT, 80, cases.EVERY):
        case = draw_drives(SEED, "catalogue", number)
        assert case.hidden is not None
        assert case.rover.least_turn_m or not case.hidden.needs_steering
        assert case.hidden.name != "steering_offset" or case.rover.wheels[case.wheel].steers


def answers_digest(line: str) -> str:
    """Return the digest of the answers that a line of `digests.txt` states."""
    kind, first, seed = line.split()[1:]
    answers = [cases.answer_of(int(seed), key) for key in cases.keys(kind, int(first))]
    return cases.digest([cases.answer_line(answer) for answer in answers])


@pytest.mark.slow
def test_the_answers_are_those_that_were_committed() -> None:
    line = DIGESTS.read_text("utf-8").splitlines()[1]
    assert answers_digest(line) == line.split()[0]


@pytest.mark.nightly
@pytest.mark.timeout(3600)
def test_all_answers_are_those_that_were_committed() -> None:
    line = DIGESTS.read_text("utf-8").splitlines()[0]
    assert answers_digest(line) == line.split()[0]
