"""Unknown forces that keep a machine on its runs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from rover_hil.gap import Array
from rover_hil.gap.data.problem import Problem, observe
from rover_hil.gap.machines.tracking import track
from sim_backends.state_model.equations import Signal
from tests.rover_hil.gap_machines.small_machine import MODEL, small_runs


def test_a_parameter_whose_step_has_no_solution_carries_no_information() -> None:
    """The equations have a solution at the fitted point, and none where the loss is larger."""

    def output(x: SimpleNamespace, _: SimpleNamespace, p: SimpleNamespace, __: Signal) -> dict[str, Array]:
        return {"reading": x.warmth + np.where(p.loss > 0.5, np.nan, 0.0)}

    machine = replace(MODEL, output=output)
    runs = small_runs(samples=60, count=3)
    problem = Problem(machine, observe(machine, runs))
    tracked = track(problem, machine, problem.base_free(), {})
    assert np.isfinite(tracked.pulls).all()
    assert all(np.isfinite(one).all() for one in tracked.forces)
