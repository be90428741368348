"""The simulated decision against real ones: errors after a new run."""

import numpy as np
import pytest

from benchmarks.gap_machines.small_carts import SmallCart, make_cart, make_model
from rover_hil.gap.findings import Analysis
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.next_run.prediction import Planning
from rover_hil.gap.next_run.refit import NewRun
from rover_hil.gap.workflow import analyse
from sim_backends.models.interface import Array

SIMILAR = 16
"""Number of a cart whose drag the runs hardly distinguish from viscous friction."""


@pytest.fixture(scope="module")
def cart() -> SmallCart:
    return make_cart(SIMILAR)


@pytest.fixture(scope="module")
def analysis(cart: SmallCart) -> Analysis:
    return analyse(make_model(), cart.runs, allowed=cart.allowed)


def simulated(cart: SmallCart, analysis: Analysis, effect: str, *, has_slopes: bool = True) -> Array:
    """Return the left-out errors with a repetition that was measured, by linearisation."""
    assert analysis.proposal is not None
    planned = next(one.planned for one in analysis.proposal.options if one.planned.is_repeat)
    hypotheses = [one for one in analysis.proposal.hypotheses if one.name == effect]
    planning = Planning(hypotheses, [planned], None)
    ((prediction,),) = planning.predictions()
    run = cart.made(planned, np.random.default_rng(1))
    data = planning.blocks[0].of(run.measured["speedometer"])
    new = NewRun(
        errors=(data - prediction.mean)[:, None],
        slopes=prediction.slopes * float(has_slopes),
        starts=prediction.starts,
        channel=prediction.channel,
    )
    found: Array = hypotheses[0].refit.squares([new])[0]
    return found


def refitted(cart: SmallCart, analysis: Analysis, effect: str) -> Array:
    """Return the left-out errors with the same repetition, by a new analysis."""
    assert analysis.proposal is not None
    assert analysis.plan is not None
    planned = next(one.planned for one in analysis.proposal.options if one.planned.is_repeat)
    run = cart.made(planned, np.random.default_rng(1))
    locked = " or ".join(f'run == "{name}"' for name in analysis.plan.confirm)
    after = analyse(make_model(), [*cart.runs, run], confirm=locked).machine
    assert after is not None
    fits = MachineFits(after.problem, after.machine.effects)
    return fits.best((effect,), {}, after.base.fit.point).left_out.squares


@pytest.mark.parametrize("effect", ["quadratic_drag", "viscous_friction"])
@pytest.mark.nightly
def test_errors_with_a_new_run_are_those_of_a_new_fit(
    cart: SmallCart, analysis: Analysis, effect: str
) -> None:
    expected = refitted(cart, analysis, effect)
    np.testing.assert_allclose(simulated(cart, analysis, effect), expected, rtol=0.03)


def test_a_new_run_that_says_nothing_about_the_parameters_changes_no_other(
    cart: SmallCart, analysis: Analysis
) -> None:
    assert analysis.proposal is not None
    found = simulated(cart, analysis, "viscous_friction", has_slopes=False)
    before = next(one for one in analysis.proposal.hypotheses if one.name == "viscous_friction")
    np.testing.assert_allclose(found[:-1], before.fit.left_out.squares, rtol=1e-6)
