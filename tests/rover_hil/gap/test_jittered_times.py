"""Records whose samples come early and late, as every logger writes them, through the whole command."""

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rover_hil.gap import Channel, Port, RunParameter, StateModel, effects, parameter
from sim_backends.models.interface import Array
from tests.rover_hil.command import Command

STEP_S, JITTER_S = 0.01, 0.002
RUNS, SAMPLES, HELD = 5, 300, 30
GAIN, DAMPING, SPRING = 20.0, 0.5, 15.0
PLACE_M, SPEED_M_S = 0.001, 0.02
SEED = 20261128
DROPPED, SLOW_EVERY_S = 100, 0.031


def make(step_s: float | None = None) -> StateModel:
    """Return a mass on a spring, written without its drag."""
    return StateModel(
        name="cart",
        states={"place": "m", "speed": "m/s"},
        inputs={"push": "N"},
        channels=(
            Channel(name="seen_place", unit="m", sigma=PLACE_M),
            Channel(name="seen_speed", unit="m/s", sigma=SPEED_M_S),
        ),
        parameters=(
            parameter("gain", "1/kg", GAIN, 0.1 * GAIN, 1.0, 100.0),
            parameter("damping", "1/s", DAMPING, 0.3, 0.0, 10.0),
            parameter("spring", "1/s^2", SPRING, 1.5, 0.0, 100.0),
        ),
        derivative=lambda x, u, p, port: {
            "place": x.speed,
            "speed": port("force", p.gain * u.push - p.damping * x.speed - p.spring * x.place),
        },
        start=lambda p, _: {"place": p.first_place, "speed": p.first_speed},
        output=lambda x, *_: {"seen_place": x.place, "seen_speed": x.speed},
        step_s=step_s,
        run_parameters=(
            RunParameter(name="first_place", unit="m", prior_sd=0.2, channel="seen_place"),
            RunParameter(name="first_speed", unit="m/s", prior_sd=1.0),
        ),
        ports=(Port(name="force", unit="m/s^2", force_sd=2.0),),
        port_effects=(
            effects.quadratic_drag("force", velocity="speed", size=0.5),
            effects.delay("push", size=0.02, longest=0.1),
            effects.lag("seen_place", size=0.02, longest=0.1, name="slow_sensor"),
        ),
    )


def make_with_step() -> StateModel:
    return make(STEP_S)


def truth(times_s: Array, push: Array, start: Array, drag: float, late_s: float) -> Array:
    """Return place and speed at the samples, by scipy; the push holds until the next sample."""
    edges = np.concatenate(([0.0], times_s[HELD::HELD] + late_s, [times_s[-1] + 1.0]))
    states, found = start, np.empty((2, times_s.size))
    for number, (begin, end) in enumerate(itertools.pairwise(edges)):
        here = (times_s >= begin - 1e-12) & (times_s < end - 1e-12)

        def rate(
            _: float, x: Array, force: float = push[number * HELD] if number * HELD < push.size else 0.0
        ) -> list[float]:
            return [x[1], GAIN * force - DAMPING * x[1] - SPRING * x[0] - drag * abs(x[1]) * x[1]]

        at_s = np.append(times_s[here], end)
        solved = solve_ivp(rate, (begin, end), states, t_eval=at_s, rtol=1e-9, atol=1e-10).y
        found[:, here], states = solved[:, :-1], solved[:, -1]
    return found


def written(path: Path, *, drag: float = 0.0, late_s: float = 0.0) -> Path:
    """Write records of a logger: rows early or late by up to 2 ms, one lost, a speed in about every third."""
    rng = np.random.default_rng(SEED)
    lines = ["run,time [s],push [N],seen_place [m],seen_speed [m/s]"]
    for number in range(RUNS):
        times_s = STEP_S * np.arange(SAMPLES) + rng.uniform(-JITTER_S, JITTER_S, SAMPLES)
        times_s -= times_s[0]
        push = np.repeat(rng.uniform(-1.5, 1.5, SAMPLES // HELD), HELD)
        place, speed = truth(times_s, push, rng.normal(0.0, (0.2, 1.0)), drag, late_s)
        place += PLACE_M * rng.standard_normal(SAMPLES)
        speed += SPEED_M_S * rng.standard_normal(SAMPLES)
        slow = np.diff(np.floor(times_s / SLOW_EVERY_S), prepend=-1.0) > 0.0
        lines += [
            f"run {number},{times_s[row]:.6f},{push[row]:.6f},{place[row]:.6f},"
            + (f"{speed[row]:.6f}" if slow[row] else "")
            for row in range(SAMPLES)
            if row != DROPPED
        ]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(
    ("drag", "late_s", "named"),
    [
        (0.0, 0.0, {}),
        (0.5, 0.0, {"quadratic_drag": 0.5}),
        pytest.param(0.0, 0.033, {"delay": 0.033}, marks=pytest.mark.nightly),
    ],
)
def test_what_is_hidden_in_jittered_records_is_named(
    command: Command, tmp_path: Path, unrendered: None, drag: float, late_s: float, named: dict[str, float]
) -> None:
    data = written(tmp_path / "runs.csv", drag=drag, late_s=late_s)
    assert command("gap", f"{__file__}:make", str(data), "--out", str(tmp_path / "out")) == 0
    verdict = json.loads((tmp_path / "out" / "verdict.json").read_text("utf-8"))
    assert verdict["verdict"] == ("NAMED" if named else "NO_GAP"), verdict["sentence"]
    assert [one["name"] for one in verdict["effects"]] == list(named)
    for effect in verdict["effects"]:
        (size,) = effect["parameters"].values()
        low, high = size["ci95"]
        assert low < named[effect["name"]] < high
        assert high - low < 0.2 * named[effect["name"]]


def test_a_model_with_a_step_refuses_jittered_times(command: Command, tmp_path: Path) -> None:
    data = written(tmp_path / "runs.csv")
    assert command("gap", f"{__file__}:make_with_step", str(data), "--out", str(tmp_path / "out")) == 1
    assert "leave step_s out of the model and the times of the data are used" in " ".join(command.out.split())
