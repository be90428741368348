"""Free-form terms at the outputs of a machine that has no ports: laws that no effect describes."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rover_hil.gap.data.problem import Point, Problem, observe
from rover_hil.gap.evidence.evidence import MachineFit
from rover_hil.gap.evidence.score import Projection, Score, family_draws, of_terms, quantile, score_all
from rover_hil.gap.evidence.terms import Term, directions, series_terms, steady_terms
from rover_hil.gap.fit.called_machine import CalledMachine
from rover_hil.gap.fit.descent import residual_of
from rover_hil.gap.fit.holdout import closed, with_own_unknowns
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.search.residual_equations import Equation, find_equations
from rover_hil.gap.search.search import score_effects
from sim_backends.models.interface import Array, Run


def output_terms(machine: CalledMachine, problem: Problem, point: Point) -> tuple[Term, ...]:
    """Return shapes of inputs and predicted channels, and of time; of steady experiments, of conditions."""
    units = machine.condition_units
    if problem.observations.is_steady:
        return tuple(steady_terms(problem.observations, units))
    predicted = problem.predict(point)
    return tuple(series_terms(problem.observations, predicted, machine.input_units, units))


def term_scores(machine: CalledMachine, problem: Problem, at: MachineFit) -> list[Score]:
    """Return the first-order score of each term in each channel; runs must agree on it."""
    at = at.decorrelated
    terms = directions(problem.observations, at.noise, output_terms(machine, problem, at.fit.point))
    return of_terms(score_all(at.fit, at.noise, terms, is_steady=problem.observations.is_steady))


def equal_terms(
    machine: CalledMachine,
    problem: Problem,
    part: MachineFit,
    best: MachineFit,
) -> list[str]:
    """Return the terms that explain what an explanation explains, the best first.

    A term with nearly the same change is the effect as an equation; it is another law only where it explains
    more.
    """
    change = part.noise.whiten(_finite(problem.predict(best.fit.point) - problem.predict(part.fit.point)))
    left = part.fit.residual - change
    gain = float(part.fit.residual @ part.fit.residual - left @ left) + _base_pulls(part) - _base_pulls(best)
    effect = Projection(part.fit).apply(part.noise.whiten(_own_change(problem, part, best)))
    effect = effect / max(float(np.linalg.norm(effect)), 1e-300)
    terms = directions(problem.observations, part.noise, output_terms(machine, problem, part.fit.point))
    found = {}
    for score in score_all(part.fit, part.noise, terms, is_steady=True):
        is_alike = abs(float(score.projected @ effect)) >= MACHINES.terms.alike
        explained = score.z_by_samples**2
        if is_alike and explained <= gain / MACHINES.search.set_share:
            continue
        if explained >= MACHINES.search.set_share * gain:
            found[score.direction.name] = explained
    return sorted(found, key=lambda name: -found[name])


def _own_change(problem: Problem, part: MachineFit, best: MachineFit) -> Array:
    """Return what the effects that `best` adds change in the predictions, other parameters being equal."""
    point = best.fit.point
    without = {key: value for key, value in point.items() if not key.is_of_effect or key in part.fit.point}
    return _finite(problem.predict(point) - problem.predict(without))


def _base_pulls(found: MachineFit) -> float:
    """Return what the base parameters cost by their priors."""
    return sum(
        float(pull) ** 2
        for item, pull in zip(found.fit.free, found.fit.pull, strict=True)
        if not item.key.is_of_effect
    )


def equations_of(
    machine: CalledMachine,
    problem: Problem,
    fits: MachineFits,
    locked: Sequence[Run],
    best: MachineFit,
    rng: np.random.Generator,
) -> tuple[Equation, ...]:
    """Return equations for what an explanation leaves, those that the locked runs confirm first."""
    scores = term_scores(machine, problem, best)
    threshold = quantile(family_draws(scores, best.evidence.freedom, rng), MACHINES.tests.alpha)
    terms = output_terms(machine, problem, best.fit.point)
    effects: Sequence[Score] = score_effects(fits, best)
    best = best.decorrelated
    found = find_equations(problem.observations, best.noise, best.fit, terms, effects, threshold)
    tests = Problem(machine, observe(machine, locked))
    judged = [
        _on_test_runs(machine, tests, best, one, _with_equation(problem, best, terms, one)) for one in found
    ]
    return tuple(sorted(judged, key=lambda one: not one.is_confirmed))


def _with_equation(problem: Problem, best: MachineFit, terms: Sequence[Term], equation: Equation) -> Point:
    """Return the parameters of a fit where an equation takes its part of the errors, to first order."""
    fit = best.fit
    change = best.noise.whiten(_sum_of(problem, terms, equation))
    aim = fit.jacobian.along(fit.residual - change) - fit.pull
    shift = np.linalg.solve(fit.jacobian.gram() + np.eye(len(fit.free)), aim)
    moved = {
        one.key: fit.point[one.key] + one.sd * float(by) for one, by in zip(fit.free, shift, strict=True)
    }
    return {**fit.point, **moved}


def _on_test_runs(
    machine: CalledMachine, tests: Problem, best: MachineFit, equation: Equation, moved: Point
) -> Equation:
    """Return an equation with what the locked runs say of it."""
    before, after = (with_own_unknowns(tests, one) for one in (best.fit.point, moved))
    added = _sum_of(tests, output_terms(machine, tests, before), equation)
    residuals = [residual_of(tests.observations, tests.predict(one)) for one in (before, after)]
    closure, improved = closed(tests, (residuals[0], residuals[1] - added), best)
    return replace(equation, closure=closure, improved=improved)


def _sum_of(problem: Problem, terms: Sequence[Term], equation: Equation) -> Array:
    """Return what an equation adds to the predictions, by row."""
    values = {one.text: one.values for one in terms}
    names = [one.name for one in problem.observations.channels]
    is_here = problem.observations.channel == names.index(equation.channel)
    total = sum(
        (value * values[text] for text, value, _, _ in equation.terms if text in values),
        start=np.zeros(is_here.size),
    )
    return np.where(is_here, total, 0.0)


def _finite(values: Array) -> Array:
    finite: Array = np.where(np.isfinite(values), values, 0.0)
    return finite
