"""Fits of machines that run away, and at bounds."""

from dataclasses import replace

import numpy as np
import pytest

from rover_hil.gap import Channel, Parameter, Port, Run, RunParameter, StateModel, effects
from rover_hil.gap.data.problem import Problem, observe
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.search.search import MachineSearch
from sim_backends.models.parameter_key import ParameterKey
from tests.rover_hil.gap.small_machine import MODEL, small_runs

SEED = 3

LOSS = ParameterKey(name="loss")


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


@pytest.mark.parametrize("lower", [0.1, 0.3, 0.33, 0.47])
def test_a_bound_that_holds_a_parameter_holds_it_without_a_run_too(lower: float) -> None:
    """The true loss of 0.2 is below the least value that the model allows."""
    loss = replace(MODEL.parameters[1], nominal=lower + 0.61, lower=lower + 0.3, prior_sd=0.17)
    model = replace(MODEL, parameters=(MODEL.parameters[0], loss))
    runs = small_runs()
    slower = replace(MODEL, parameters=(MODEL.parameters[0], replace(loss, nominal=0.2, lower=0.0)))
    tables = slower.predict(runs, {}, {})
    runs = [replace(run, measured=table) for run, table in zip(runs, tables, strict=True)]
    found = MachineFits(Problem(model, observe(model, runs)), model.effects).base()
    assert found.fit.point[LOSS] == pytest.approx(lower + 0.3)
    index = found.left_out.keys.index(LOSS)
    assert np.abs(found.left_out.moved[:, index]).max() == 0.0
