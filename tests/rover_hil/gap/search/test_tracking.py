"""Unknown forces that keep a machine on its runs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from rover_hil.gap import Array
from rover_hil.gap.data.problem import Problem, observe
from rover_hil.gap.search.tracking import track
from sim_backends.state_model.equations import Signal
from tests.rover_hil.gap.small_machine import MODEL, small_runs


def test_a_machine_that_runs_away_beside_the_fit_is_not_followed() -> None:
    """The smallest change of a parameter moves the prediction beyond all numbers, so that no step exists."""

    def output(x: SimpleNamespace, _: SimpleNamespace, p: SimpleNamespace, __: Signal) -> dict[str, Array]:
        return {"reading": x.warmth + 1e147 * np.sign(p.loss - 0.5)}

    machine = replace(MODEL, output=output, channels=(replace(MODEL.channels[0], sigma=1e-8),))
    runs = small_runs(samples=60, count=3)
    problem = Problem(machine, observe(machine, runs))
    assert track(problem, machine, problem.base_free(), {}) is None
    sound = Problem(MODEL, observe(MODEL, runs))
    assert track(sound, MODEL, sound.base_free(), {}) is not None
