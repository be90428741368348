"""Priors that contradict the runs: the interval of a base parameter is what the runs alone determine."""

from dataclasses import replace

import pytest

from rover_hil.gap.data.problem import Problem, observe
from rover_hil.gap.evidence.evidence import MachineFit
from rover_hil.gap.evidence.sizes import size_of
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.fit.released_fit import released_fit
from sim_backends.models.parameter_key import ParameterKey
from tests.cases import first_often
from tests.rover_hil.gap.axis import axis_model, measured_runs

TRUTH = {"gain": 8.0, "damping": 4.0}
SEEDS = range(10)


def fitted(seed: int, gain: float) -> tuple[MachineFit, Problem]:
    """Return the base fit of runs by a model that is certain of its gain and its damping, which resemble."""
    model = axis_model()
    parameters = [
        replace(item, nominal=gain if item.name == "gain" else item.nominal, prior_sd=0.01)
        for item in model.parameters
    ]
    model = replace(model, parameters=tuple(parameters))
    problem = Problem(model, observe(model, measured_runs(8, seed=seed)))
    return MachineFits(problem, ()).base(), problem


def covered(found: MachineFit, name: str) -> bool:
    size = size_of(found, ParameterKey(name=name))
    return size.low <= TRUTH[name] <= size.high


@pytest.mark.parametrize("name", first_often(TRUTH))
def test_the_interval_of_a_value_against_its_prior_holds_the_truth(name: str) -> None:
    """One wrong gain pulls the right damping too; both intervals would be beside the truth."""
    hits = [
        covered(released_fit(problem, found)[0], name) for found, problem in (fitted(s, 7.6) for s in SEEDS)
    ]
    assert sum(hits) >= 8, (name, hits)


def test_what_the_wrong_prior_pushed_into_another_parameter_returns() -> None:
    found, problem = fitted(1, 7.8)
    place = [item.key for item in found.fit.free].index(ParameterKey(name="damping"))
    again, released = released_fit(problem, found)
    assert released.released == ("gain",)
    assert abs(found.fit.pull[place]) > 0.3 > abs(again.fit.pull[place])


def test_a_fit_within_its_priors_stays_as_it_is() -> None:
    found, problem = fitted(0, 8.0)
    again, same = released_fit(problem, found)
    assert again is found
    assert same is problem
