"""Small machines for the tests: a mass with a force, and a pendulum."""

from collections.abc import Mapping
from types import SimpleNamespace

import numpy as np

from rover_hil.gap import Array, Channel, Parameter, Port, Run, RunParameter, StateModel
from sim_backends.state_model.equations import Signal
from sim_backends.state_model.port_effect import PortEffect

STEP_S = 0.02


def mass(
    *port_effects: PortEffect,
    damping: float = 0.0,
    stiffness: float = 0.0,
    noise: float = 0.01,
    substeps: int = 8,
    step_s: float | None = STEP_S,
) -> StateModel:
    """Return a mass of 2 kg with damper, spring and the inputs force and drag-free channels."""

    def derivative(
        x: SimpleNamespace, u: SimpleNamespace, p: SimpleNamespace, port: Signal
    ) -> Mapping[str, Array]:
        force = port("force", u.push - damping * x.speed - stiffness * x.position)
        return {"position": x.speed, "speed": force / p.mass}

    def start(p: SimpleNamespace, _: SimpleNamespace) -> Mapping[str, Array]:
        return {"position": p.first_position + 0.0 * p.mass, "speed": p.first_speed}

    def output(x: SimpleNamespace, u: SimpleNamespace, _: SimpleNamespace, __: Signal) -> Mapping[str, Array]:
        return {"seen_position": x.position, "seen_speed": x.speed, "seen_push": u.push}

    return StateModel(
        name="mass",
        states={"position": "m", "speed": "m/s"},
        inputs={"push": "N"},
        channels=tuple(
            Channel(name=f"seen_{name}", unit=unit, sigma=noise)
            for name, unit in (("position", "m"), ("speed", "m/s"), ("push", "N"))
        ),
        parameters=(Parameter(name="mass", unit="kg", nominal=2.0, prior_sd=0.1, lower=0.1, upper=10.0),),
        derivative=derivative,
        start=start,
        output=output,
        step_s=step_s,
        run_parameters=(RunParameter(name="first_speed", unit="m/s", prior_sd=1.0),),
        ports=(Port(name="force", unit="N", force_sd=0.5),),
        port_effects=port_effects,
        condition_units={"first_position": "m"},
        substeps=substeps,
    )


def run_of(push: Array, *, position: float = 0.0, name: str = "a") -> Run:
    """Return a run with a push."""
    push = np.asarray(push, dtype=float)
    return Run(
        name=name,
        conditions={"first_position": position},
        inputs={"push": push},
        measured={f"seen_{one}": np.zeros(push.size) for one in ("position", "speed", "push")},
    )


def simulated(
    model: StateModel, run: Run, effects: Mapping[str, Mapping[str, float]], first_speed: float = 0.0
) -> dict[str, Array]:
    """Return the channels of one run."""
    return model.predict([run], {f"first_speed@{run.name}": first_speed}, effects)[0]


def tank(*port_effects: PortEffect, first_level: float = 0.0) -> StateModel:
    """Return a tank of 1 m^2 that its inflow fills."""
    return StateModel(
        name="tank",
        states={"level": "m"},
        inputs={"inflow": "m^3/s"},
        channels=(Channel(name="seen_level", unit="m", sigma=0.001),),
        parameters=(),
        derivative=lambda _, u, __, port: {"level": port("flow", u.inflow)},
        start=lambda _, __: {"level": first_level},
        output=lambda x, _, __, ___: {"seen_level": x.level},
        step_s=STEP_S,
        ports=(Port(name="flow", unit="m^3/s", force_sd=0.1),),
        port_effects=port_effects,
        substeps=16,
    )


def tank_run() -> Run:
    """Return a run that fills the tank to 1 m and begins to empty it."""
    inflow = np.concatenate((np.full(100, 0.5), np.full(31, -0.5)))
    return Run(name="fill", conditions={}, inputs={"inflow": inflow}, measured={"seen_level": 0.0 * inflow})
