"""Mistakes in the equations of a machine become one sentence with its place."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drivers.clock import NANOSECONDS_PER_SECOND
from drivers.errors import ConfigError
from rover_hil.gap import Array, Port
from rover_hil.gap.model_checks.model_trial import try_model
from sim_backends.state_model.equations import Signal
from tests.rover_hil.gap.small_machine import MODEL, derivative, small_runs

HERE = re.escape(str(Path(__file__)))
RUNS = small_runs()


class SlowClock:
    """A clock on which every reading takes two seconds."""

    def __init__(self) -> None:
        self._now_ns = 0

    def now_ns(self) -> int:
        self._now_ns += 2 * NANOSECONDS_PER_SECOND
        return self._now_ns

    def sleep_until(self, deadline_ns: int) -> None:
        self._now_ns = deadline_ns


def _refused(match: str, **parts: Any) -> None:
    with pytest.raises(ConfigError, match=match) as caught:
        try_model(replace(MODEL, **parts), RUNS)
    assert "\n" not in str(caught.value)


def test_a_sound_machine_passes_without_a_word() -> None:
    assert try_model(MODEL, RUNS) == []


def test_an_equation_that_raises_is_named_with_its_line() -> None:
    def raising(*_: object) -> dict[str, Array]:
        raise ZeroDivisionError("no gear")

    line = raising.__code__.co_firstlineno + 1
    for role in ("derivative", "start", "output"):
        _refused(rf"^{HERE}, line {line}: {role} raises ZeroDivisionError: no gear", **{role: raising})


def test_an_equation_that_raises_during_the_run_is_named() -> None:
    def late(x: SimpleNamespace, u: SimpleNamespace, p: SimpleNamespace, port: Signal) -> dict[str, Array]:
        if x.warmth.shape != (2, 3) and np.any(x.warmth > 0.5):
            raise ValueError("too warm")
        return derivative(x, u, p, port)

    _refused(rf"^{HERE}, line \d+: derivative raises ValueError: too warm", derivative=late)


def test_an_unknown_name_is_shown_with_those_that_exist() -> None:
    def misspelt(x: SimpleNamespace, *_: object) -> dict[str, Array]:
        rate: Array = -x.warmht
        return {"warmth": rate}

    _refused(
        r"derivative raises AttributeError: there is no 'warmht'; there are gain, loss, first, power, warmth",
        derivative=misspelt,
    )


@pytest.mark.parametrize(
    ("role", "returned", "match"),
    [
        ("derivative", (1.0,), "derivative returns tuple: return a dict with a value for each state, warmth"),
        (
            "derivative",
            {"heat": 0.0},
            "derivative returns nothing for state warmth of model body; it returns heat",
        ),
        ("start", {}, "start returns nothing for state warmth of model body; it returns an empty dict"),
        ("output", {"warmth": 0.0}, "output returns nothing for channel reading of model body"),
        (
            "derivative",
            {"warmth": np.zeros(7)},
            r"derivative returns the wrong shape for state warmth: \(7,\) where ",
        ),
        ("output", {"reading": "hot"}, "output returns no numbers for channel reading: str"),
    ],
)
def test_wrong_results_are_named(role: str, returned: object, match: str) -> None:
    _refused(rf"^{HERE}, line \d+: {match}", **{role: lambda *_: returned})


def test_no_number_at_nominal_is_named_with_run_and_sample() -> None:
    def root(x: SimpleNamespace, u: SimpleNamespace, p: SimpleNamespace, port: Signal) -> dict[str, Array]:
        return {"warmth": port("heat", np.where(u.power > -9.0, np.sqrt(0.5 - x.warmth), 0.0))}

    _refused(
        r"model body predicts no number for reading in run run\d from sample \d+ of 60 on", derivative=root
    )


def test_chance_in_a_model_is_refused() -> None:
    rng = np.random.default_rng(1)

    def noisy(x: SimpleNamespace, u: SimpleNamespace, p: SimpleNamespace, port: Signal) -> dict[str, Array]:
        return {"warmth": derivative(x, u, p, port)["warmth"] + rng.normal()}

    _refused(r"model body is not deterministic: two predictions differ by \S+ K in reading", derivative=noisy)


def test_runs_that_influence_each_other_are_refused() -> None:
    def mixing(x: SimpleNamespace, u: SimpleNamespace, p: SimpleNamespace, port: Signal) -> dict[str, Array]:
        return {"warmth": port("heat", u.power - np.mean(x.warmth))}

    _refused(r"model body mixes runs: a run alone is predicted differently", derivative=mixing)


def test_a_port_without_a_call_is_refused() -> None:
    ports = (*MODEL.ports, Port(name="leak", unit="K/s", force_sd=0.1))
    _refused(
        r'port leak of model body is declared, but port\("leak", ...\) is called neither in', ports=ports
    )


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("heta", r'derivative calls port\("heta", ...\), which is not declared: add Port\(name="heta"'),
        ("power", r'derivative calls port\("power", ...\), but power is an input, where effects act without'),
        ("reading", r'derivative calls port\("reading", ...\), but reading is a channel, where effects act'),
    ],
)
def test_a_call_of_a_port_that_is_not_declared_is_refused(name: str, match: str) -> None:
    def calling(x: SimpleNamespace, u: SimpleNamespace, p: SimpleNamespace, port: Signal) -> dict[str, Array]:
        return {"warmth": derivative(x, u, p, port)["warmth"] + port(name, 0.0 * x.warmth)}

    _refused(match, derivative=calling)


def test_a_slow_model_is_announced_with_its_total_time() -> None:
    (warning,) = try_model(MODEL, RUNS, SlowClock())
    assert warning.startswith(
        "one integration of all 4 runs takes 2.0 s; an analysis needs about 300: about 10 min"
    )


def test_equations_may_be_objects_without_a_file() -> None:
    class Equation:
        def __call__(self, *_: object) -> dict[str, Array]:
            raise KeyError("lost")

    with pytest.raises(ConfigError, match=r"^derivative raises KeyError: 'lost'"):
        try_model(replace(MODEL, derivative=Equation()), RUNS)
