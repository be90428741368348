"""Integration steps that are small enough at the natural size of an effect, and not at the found one."""

import numpy as np
import pytest

from rover_hil.gap import Channel, Port, Run, RunParameter, StateModel, effects, parameter
from rover_hil.gap.workflow import analyse

SEED, STEP_S, SLOW_M_S = 5, 0.01, 0.002
TRUE_M_S2 = 4.0

MODEL = StateModel(
    name="sprung body",
    states={"place": "m", "speed": "m/s"},
    inputs={"push": "m/s^2"},
    channels=(Channel(name="scale", unit="m", sigma=0.0003), Channel(name="rate", unit="m/s", sigma=0.003)),
    parameters=(
        parameter("stiffness", "1/s^2", 400.0, 5.0, 100.0, 900.0),
        parameter("damping", "1/s", 4.0, 0.5, 0.0, 20.0),
    ),
    run_parameters=(
        RunParameter(name="first_place", unit="m", prior_sd=0.0003, channel="scale"),
        RunParameter(name="first_speed", unit="m/s", prior_sd=0.003, channel="rate"),
    ),
    ports=(Port(name="force", unit="m/s^2", force_sd=0.5),),
    derivative=lambda x, u, p, port: {
        "place": x.speed,
        "speed": port("force", u.push - p.stiffness * x.place - p.damping * x.speed),
    },
    start=lambda p, _: {"place": p.first_place, "speed": p.first_speed},
    output=lambda x, *_: {"scale": x.place, "rate": x.speed},
    step_s=STEP_S,
    port_effects=(effects.coulomb_friction("force", velocity="speed", size=0.42, slow=SLOW_M_S),),
)


def true_runs(samples: int = 200, fine: int = 200) -> list[Run]:
    """Truth: the same body by many small implicit steps of its speed."""
    rng = np.random.default_rng(SEED)
    runs, step_s = [], STEP_S / fine
    for number in range(6):
        push = np.repeat(rng.uniform(-12.0, 12.0, samples // 8), 8)
        place, speed, seen = 0.0, 0.0, np.zeros((samples, 2))
        for index in range(samples):
            seen[index] = place, speed
            for _ in range(fine):
                stuck = TRUE_M_S2 / np.hypot(speed, SLOW_M_S)
                speed += step_s * (push[index] - 400.0 * place - (4.0 + stuck) * speed)
                place += step_s * speed
        seen += rng.normal(0.0, (0.0003, 0.003), seen.shape)
        measured = {"scale": seen[:, 0], "rate": seen[:, 1]}
        runs.append(Run(name=f"run{number}", conditions={}, inputs={"push": push}, measured=measured))
    return runs


@pytest.mark.slow
def test_friction_far_from_its_natural_size_has_its_true_size() -> None:
    """With the steps of the natural size the integration left an error of half the sensor noise."""
    runs = true_runs()
    machine = MODEL.refined(runs)
    found = {"coulomb_friction": {"level": TRUE_M_S2}}
    assert machine.refined_at(runs, {}, {"coulomb_friction": {"level": 0.3}}) is machine
    assert machine.refined_at(runs, {}, found).effect_substeps != machine.effect_substeps
    verdict = analyse(MODEL, runs).verdict
    assert verdict.confidence_set == [["coulomb_friction"]], verdict.sentence
    assert float(str(verdict.error_budget["rate"]["model_error_after"])) < 0.001
    assert verdict.effects[0].parameters["level"].value == pytest.approx(TRUE_M_S2, rel=0.02)
