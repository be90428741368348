"""Fits of machines that run away."""

import numpy as np

from rover_hil.gap import Channel, Parameter, Port, Run, RunParameter, StateModel, effects
from rover_hil.gap.data.problem import Problem, observe
from rover_hil.gap.machines.machine_fit import MachineFits
from rover_hil.gap.machines.search import MachineSearch

SEED = 3


def test_a_machine_that_runs_away_spoils_no_other_fit() -> None:
    """With a positive feedback the state grows to 1e150 within a run; its square is no number."""
    rng = np.random.default_rng(SEED)
    runs = [
        Run(name=f"run{index}", conditions={}, inputs={}, measured={"level": rng.normal(1.0, 0.01, 60)})
        for index in range(4)
    ]
    growing = effects.term("rate", source="x", form="linear", size=400.0, scale=1.0)
    model = StateModel(
        name="growth",
        states={"x": "m"},
        inputs={},
        channels=(Channel(name="level", unit="m", sigma=0.01),),
        parameters=(Parameter(name="decay", unit="1/s", nominal=1.0, prior_sd=0.1, lower=0.0, upper=9.0),),
        run_parameters=(RunParameter(name="first", unit="m", prior_sd=1.0, nominal=1.0),),
        ports=(Port(name="rate", unit="m/s", force_sd=1.0),),
        derivative=lambda x, _, p, port: {"x": port("rate", p.decay * (1.0 - x.x))},
        start=lambda p, _: {"x": p.first},
        output=lambda x, *_: {"level": x.x},
        step_s=0.1,
        port_effects=(growing, effects.offset("level", size=0.1)),
    )
    problem = Problem(model, observe(model, runs))
    fits = MachineFits(problem, model.effects)
    found = MachineSearch(fits, lambda _: None).run()
    assert found.best.names == ()
    assert np.isfinite(fits.base().left_out.squares).all()
