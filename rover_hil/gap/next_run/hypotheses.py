"""The explanations that are left, each with its weight, and "something else" among them."""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from rover_hil.gap.data.problem import Free, Problem
from rover_hil.gap.decision.analysis import MachineFindings
from rover_hil.gap.decision.decide import Candidate, decide
from rover_hil.gap.evidence.evidence import MachineFit
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.next_run.discrepancy import Discrepancy, learn_discrepancy, measured_basis
from rover_hil.gap.next_run.refit import Refit
from rover_hil.gap.noise.random_force import ForceBasis
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.search.search import ranked_scores
from sim_backends.models.interface import Array, Machine
from sim_backends.models.parameter_key import ParameterKey

SOMETHING_ELSE = "something else"
NO_EFFECT = "no effect"
CLEAR_T = 1.96
"""Half of a 95 % interval of a normal distribution, in standard deviations."""
LEAST_WEIGHT = 0.02
"""Probability of an explanation that is looked at, and the least of "something else"."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hypothesis:
    """One explanation of the measured runs.

    Attributes:
        name: Its effects, in words.
        machine: The model that has them.
        fit: To the measured runs.
        weight: Probability before the next run.
        is_else: The cause is none of the others; the fit is that of the base model.
        shared: Parameters of all runs.
        pulls: Their values, in prior deviations.
        covariance: Of the pulls, with the scatter between runs.
        discrepancy: Model error that it leaves.
        refit: Errors of the measured runs once there are new ones.
    """

    name: str
    machine: Machine
    fit: MachineFit
    weight: float
    is_else: bool
    shared: tuple[Free, ...]
    pulls: Array
    covariance: Array
    discrepancy: Discrepancy
    refit: Refit

    def point(self) -> dict[ParameterKey, float]:
        """Return its parameters without those of single runs."""
        return {key: value for key, value in self.fit.fit.point.items() if not key.run}


def hypotheses_of(findings: MachineFindings) -> tuple[list[Hypothesis], ForceBasis | None]:
    """Return the explanations that are left, the best first and "something else" last.

    Their weights are the probabilities of the decision; without a gap, of one between the best scores.
    """
    decision = findings.decision or decide(findings.problem, _scored(findings), findings.base)
    ranked = [pair for pair in decision.ranked()[: MACHINES.hypotheses.most] if pair[0] >= LEAST_WEIGHT]
    if not ranked:
        ranked = [(1.0, decision.chosen)]
    tracked = findings.tracked
    basis = (
        measured_basis(findings.problem, findings.best.fit.point) if tracked is None else tracked.noise.basis
    )
    unknown = max(decision.none, LEAST_WEIGHT)
    total = sum(share for share, _ in ranked)
    found = [
        _hypothesis(findings, (_words(one.fit), one.machine, one.fit), (1.0 - unknown) * share / total, basis)
        for share, one in ranked
    ]
    base = (SOMETHING_ELSE, findings.machine, findings.base)
    return [*found, _hypothesis(findings, base, unknown, basis, is_else=True)], basis


def _words(found: MachineFit) -> str:
    return " and ".join(found.names) or NO_EFFECT


def _scored(findings: MachineFindings) -> list[Candidate]:
    """Return no effect, and the effects that explain most to first order."""
    ranked = ranked_scores(findings.scores)[: MACHINES.hypotheses.top_scores]
    fits = MachineFits(findings.problem, findings.machine.effects)
    fitted = fits.fit_all(
        [
            ((one.direction.name,), {one.direction.name: one.direction.shapes}, findings.base.fit.point)
            for one in ranked
        ],
        is_near=True,
    )
    return [
        Candidate(names=one.names, machine=findings.machine, fit=one, is_listed=True)
        for one in (findings.base, *fitted)
    ]


def _hypothesis(
    findings: MachineFindings,
    option: tuple[str, Machine, MachineFit],
    weight: float,
    basis: ForceBasis | None,
    *,
    is_else: bool = False,
) -> Hypothesis:
    name, machine, fit = option
    shared, pulls, covariance = _posterior(fit)
    problem = findings.problem
    if machine is not findings.machine:
        problem = Problem(machine, findings.problem.observations)
    return Hypothesis(
        name=name,
        machine=machine,
        fit=fit,
        weight=weight,
        is_else=is_else,
        shared=shared,
        pulls=pulls,
        covariance=covariance,
        discrepancy=learn_discrepancy(problem, fit.fit.point, basis),
        refit=Refit(fit, problem.owner[fit.noise.keep]),
    )


def _posterior(found: MachineFit) -> tuple[tuple[Free, ...], Array, Array]:
    """Return the parameters of all runs, their pulls, and their covariance with the scatter of runs."""
    free = found.fit.free
    normal = found.fit.jacobian.gram() + np.eye(len(free))
    normal += 1e-12 * float(np.diag(normal).max(initial=1.0)) * np.eye(len(free))
    covariance = np.linalg.inv(normal)
    shared = [index for index, item in enumerate(free) if not item.key.run]
    scatters = [found.left_out.scatter(index) for index, _ in enumerate(shared)]
    factors = [spread * float(stats.t.ppf(0.975, freedom)) / CLEAR_T for spread, freedom in scatters]
    part = covariance[np.ix_(shared, shared)]
    # Runs that scatter make a parameter no less certain than its prior.
    wide = np.minimum(factors, 1.0 / np.sqrt(np.diag(part)))
    part = part * np.outer(wide, wide)
    return tuple(free[index] for index in shared), found.fit.pull[shared], part


def starts_of(found: MachineFit) -> dict[str, dict[str, float]]:
    """Return the fitted unknowns of each run by name."""
    starts: dict[str, dict[str, float]] = {}
    for item in found.fit.free:
        if item.key.run:
            starts.setdefault(item.key.run, {})[item.key.shared.text] = found.fit.point[item.key]
    return starts
