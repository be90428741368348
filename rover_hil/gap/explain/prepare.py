"""From runs to a problem: observations, their errors, and the base model fitted to them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.errors import ModelError
from rover_hil.gap.data.parameters import DATA
from rover_hil.gap.data.problem import (
    Key,
    Observations,
    Point,
    Problem,
    group_runs,
    is_steady,
    observe,
    predict_rows,
)
from rover_hil.gap.explain.candidates import card_changes
from rover_hil.gap.explain.parameters import EXPLAIN
from rover_hil.gap.explain.terms import Term, series_terms, steady_terms, term_changes
from rover_hil.gap.statistics.fit import Fit, fit, whitened_jacobian
from rover_hil.gap.statistics.noise import Noise, series_noise, steady_noise
from rover_hil.gap.statistics.replicates import Scatter, estimate_scatter, winsorise
from rover_hil.gap.statistics.score import Direction, one_sided_z, score_all
from sim_backends.models.interface import Array, DrivenModel, Model, Run


@dataclass(frozen=True, slots=True, kw_only=True)
class Prepared:
    """A base model fitted to runs.

    Attributes:
        problem: Model and observations.
        noise: Of the observations.
        scatter: Of replicates; None for series.
        start: The base model under its priors, with derivatives at the fit.
        terms: Free-form terms of these observations.
        left_out: Runs without solution of the model.
    """

    problem: Problem
    noise: Noise
    scatter: Scatter | None
    start: Fit
    terms: tuple[Term, ...]
    left_out: tuple[str, ...]


def prepare(model: Model, runs: Sequence[Run]) -> Prepared:
    """Fit the base model to `runs`.

    Raises:
        ModelError: The model has no solution for many of the runs.
    """
    solved, left_out = _solved(model, runs)
    if is_steady(solved):
        return _steady(model, solved, left_out)
    return _series(model, solved, left_out)


def relearn_noise(prepared: Prepared, best: Fit) -> Prepared:
    """Return the same with the errors of series estimated from the residual of `best`."""
    if prepared.scatter is not None:
        return prepared
    problem = prepared.problem
    residual = problem.observations.values - problem.predict(best.point)
    noise = series_noise(problem.observations, residual)
    return replace(prepared, noise=noise, start=fit_base(problem, noise, prepared.start))


def fit_base(problem: Problem, noise: Noise, begin: Fit | None = None) -> Fit:
    """Return the base model's fit, with derivatives at it."""
    found = fit(problem, noise, problem.base_free(), begin.point if begin is not None else {})
    return replace(found, jacobian=whitened_jacobian(problem, noise, found.free, found.point))


def condition_gradient(model: Model, sites: Sequence[Run]) -> Array:
    """Return the change of each channel per unit of each condition: sites x channels x conditions."""
    base = _table(model, sites)
    gradient = np.zeros((*base.shape, len(model.condition_units)))
    for index, name in enumerate(model.condition_units):
        values = [site.conditions[name] for site in sites]
        step = EXPLAIN.prepare.condition_step * float(np.ptp(values))
        if step <= 0.0:
            continue
        moved = [
            replace(site, conditions={**site.conditions, name: site.conditions[name] + step})
            for site in sites
        ]
        gradient[:, :, index] = (_table(model, moved) - base) / step
    return np.where(np.isfinite(gradient), gradient, 0.0)


def _table(model: Model, sites: Sequence[Run]) -> Array:
    predicted = model.predict(sites, {}, {})
    return np.array([[float(one[item.name][0]) for item in model.channels] for one in predicted])


def _solved(model: Model, runs: Sequence[Run]) -> tuple[list[Run], tuple[str, ...]]:
    groups = group_runs(model, runs)
    tables = model.predict([group.site for group in groups], {}, {})
    good: list[Run] = []
    bad: list[str] = []
    for group, table in zip(groups, tables, strict=True):
        finite = all(np.isfinite(table[name]).all() for name in group.site.measured)
        if finite:
            good += group.runs
        else:
            bad += [run.name for run in group.runs]
    if len(bad) > EXPLAIN.prepare.unsolved_share * len(runs):
        raise ModelError(
            f"{model.name} has no solution for {len(bad)} of {len(runs)} runs, {bad[0]} among them: "
            "its parameters or the conditions are out of its domain"
        )
    return good, tuple(bad)


def _steady(model: Model, runs: Sequence[Run], left_out: tuple[str, ...]) -> Prepared:
    groups = group_runs(model, runs)
    gradient = condition_gradient(model, [group.site for group in groups])
    scatter = estimate_scatter(groups, model.channels, gradient)
    cleaned = winsorise(groups, model.channels, scatter)
    if any(new is not old for new, old in zip(cleaned, runs, strict=True)):
        groups = group_runs(model, cleaned)
        scatter = estimate_scatter(groups, model.channels, gradient)
    observations = observe(model, cleaned)
    noise = steady_noise(observations, scatter)
    problem = Problem(model, observations)
    return Prepared(
        problem=problem,
        noise=noise,
        scatter=scatter,
        start=fit_base(problem, noise),
        terms=terms_of(model, observations, {}),
        left_out=left_out,
    )


def _series(model: Model, runs: Sequence[Run], left_out: tuple[str, ...]) -> Prepared:
    observations = observe(model, runs)
    problem = Problem(model, observations)
    noise = series_noise(observations, _overfitted(problem), is_final=False)
    start = fit_base(problem, noise)
    for is_final in (False, True):
        noise = series_noise(observations, _without_effects(problem, noise, start), is_final=is_final)
        start = fit_base(problem, noise, start)
    return Prepared(
        problem=problem,
        noise=noise,
        scatter=None,
        start=start,
        terms=terms_of(model, observations, start.point),
        left_out=left_out,
    )


def _overfitted(problem: Problem) -> Array:
    """Return the residual of an overfitted model.

    A large effect resembles slow errors, which would hide it. These errors are too small, which is harmless:
    they only select what to remove before the final errors are estimated.
    """
    observations, point = problem.observations, dict[Key, float]()
    columns = list(problem.derivatives(point, problem.base_free()).T)
    columns += [one.change for one in _changes(problem, point)]
    residual = observations.values - problem.predict(point)
    here = np.isfinite(residual)
    matrix = np.stack(columns, axis=1)
    matrix /= np.maximum(np.sqrt((matrix**2).mean(axis=0)), 1e-300)
    shift, *_ = np.linalg.lstsq(matrix[here], residual[here], rcond=1e-6)
    remaining: Array = residual - matrix @ shift
    return remaining


def _changes(problem: Problem, point: Point) -> list[Direction]:
    """Return the changes by effects and by free-form terms, before whitening."""
    terms = terms_of(problem.model, problem.observations, point)
    return [*card_changes(problem, point, problem.model.effects), *term_changes(problem.observations, terms)]


def _without_effects(problem: Problem, noise: Noise, start: Fit) -> Array:
    """Return measured minus predicted, without the significant effects and free-form terms."""
    observations = problem.observations
    sizes = np.array([item.sd for item in start.free])
    columns = list((problem.derivatives(start.point, start.free) * sizes).T)
    changes = _changes(problem, start.point)
    directions = [replace(one, change=noise.whiten(one.change)) for one in changes]
    raw = {id(one): change.change for one, change in zip(directions, changes, strict=True)}
    fitted = start
    # Each channel may have its own: one that remains makes errors look slow and is hidden by them.
    for _ in range(EXPLAIN.naming.most_effects * len(observations.channels)):
        scores = score_all(fitted, noise, directions, is_steady=False)
        # By samples: a term on which runs disagree is still no error.
        best = max(scores, key=lambda score: one_sided_z(score, by_samples=True), default=None)
        if best is None or one_sided_z(best, by_samples=True) < EXPLAIN.prepare.stands_out:
            break
        columns.append(raw[id(best.direction)] * DATA.fit.weak * best.direction.size)
        jacobian = noise.whiten(np.stack(columns, axis=1))
        fitted = replace(fitted, jacobian=jacobian, pull=np.append(fitted.pull, 0.0))
    residual = observations.values - problem.predict(start.point)
    if len(columns) == len(start.free):
        return residual
    matrix = np.vstack((fitted.jacobian, np.eye(len(columns))))
    shift, *_ = np.linalg.lstsq(matrix, np.concatenate((start.residual, -fitted.pull)), rcond=None)
    remaining: Array = residual - np.stack(columns, axis=1) @ shift
    return remaining


def input_units(model: Model) -> Mapping[str, str]:
    """Return the inputs of a model and their units."""
    return model.input_units if isinstance(model, DrivenModel) else {}


def terms_of(model: Model, observations: Observations, point: Point) -> tuple[Term, ...]:
    """Return the free-form terms of observations."""
    if observations.is_steady:
        return tuple(steady_terms(observations, model.condition_units))
    predicted = predict_rows(model, [group.site for group in observations.groups], point)
    return tuple(series_terms(observations, predicted, input_units(model), model.condition_units))
