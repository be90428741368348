"""The explanations that are left, each with its weight, and "something else" among them."""

import math
from dataclasses import dataclass

import numpy as np
from scipy import stats

from rover_hil.gap.data.problem import Free, Problem
from rover_hil.gap.decision.analysis import MachineFindings
from rover_hil.gap.evidence.evidence import MachineFit
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.next_run.discrepancy import Discrepancy, learn_discrepancy, measured_basis
from rover_hil.gap.next_run.refit import Refit
from rover_hil.gap.next_run.unlisted_laws import draw_laws
from rover_hil.gap.noise.random_force import ForceBasis
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.search.search import ranked_scores
from rover_hil.gap.verdict import Answer
from sim_backends.models.interface import Array, Machine
from sim_backends.models.parameter_key import ParameterKey

SOMETHING_ELSE = "something else"
NO_EFFECT = "no effect"
CLEAR_T = 1.96
"""Half of a 95 % interval of a normal distribution, in standard deviations."""
LEAST_SPREAD = 1e-6
"""Of the logarithm of an error: explanations that predict the same are equally probable."""


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


def hypotheses_of(findings: MachineFindings, answer: Answer) -> tuple[list[Hypothesis], ForceBasis | None]:
    """Return the explanations that are left, the best first and "something else" last.

    The weight of an explanation is its odds against the best. Each measured run has one vote.
    """
    named = _named(findings, is_decided=answer in (Answer.NAMED, Answer.NAMED_SET))
    odds = np.array([odds_of(one, named[0][2]) for _, _, one in named])
    shares = odds / odds.sum()
    kept = [
        index
        for index in np.argsort(-shares, kind="stable")
        if shares[index] >= MACHINES.hypotheses.least_weight
    ][: MACHINES.hypotheses.most]
    tracked = findings.tracked
    basis = (
        measured_basis(findings.problem, findings.best.fit.point) if tracked is None else tracked.noise.basis
    )
    unknown = _else_weight(answer)
    total = float(shares[kept].sum())
    found = [
        _hypothesis(findings, named[index], (1.0 - unknown) * float(shares[index]) / total, basis)
        for index in kept
    ]
    base = (SOMETHING_ELSE, findings.machine, findings.base)
    return [*found, _hypothesis(findings, base, unknown, basis, is_else=True)], basis


def unlisted_of(
    findings: MachineFindings, basis: ForceBasis | None, rng: np.random.Generator
) -> list[Hypothesis]:
    """Return drawn laws that the measured runs do not exclude.

    The sum of their weights is the greatest odds of a law against the best explanation: where a law explains
    the runs as well, "something else" is a law, and not a force that follows no state.
    """
    best = _named(findings, is_decided=True)[0][2]
    laws = draw_laws(findings, rng)
    odds = np.array([odds_of(fit, best) for _, _, fit in laws])
    kept = np.flatnonzero(odds >= MACHINES.hypotheses.least_weight)
    return [
        _hypothesis(findings, laws[index], float(odds.max() * odds[index] / odds[kept].sum()), basis)
        for index in kept
    ]


def _else_weight(answer: Answer) -> float:
    """Return the probability that the cause is in no list, before the next run."""
    weights = {
        Answer.NAMED: MACHINES.hypotheses.else_named,
        Answer.NAMED_SET: MACHINES.hypotheses.else_named,
        Answer.PARTLY_NAMED: MACHINES.hypotheses.else_partly_named,
        Answer.UNNAMED: MACHINES.hypotheses.else_unnamed,
        Answer.NOT_IDENTIFIABLE: MACHINES.hypotheses.else_not_identifiable,
    }
    return weights[answer]


def _named(findings: MachineFindings, *, is_decided: bool) -> list[tuple[str, Machine, MachineFit]]:
    """Return the explanations of the verdict, and what it leaves open unless it has decided."""
    machine, best = findings.machine, findings.best
    found: list[tuple[str, Machine, MachineFit]] = []
    if best.names:
        found.append((_words(best), machine, best))
        found += [
            (_words(one), machine, one) for one in (findings.found.alternatives if findings.found else ())
        ]
    elif findings.p_gap > MACHINES.tests.alpha:
        found.append((NO_EFFECT, machine, best))
    if is_decided and found:
        return found
    found += [(_words(one), wider, one) for wider, one in findings.unlisted]
    rest = findings.runners_up if findings.found is not None else _scored(findings)
    found += [(_words(one), machine, one) for one in rest]
    return found or [(NO_EFFECT, machine, findings.base)]


def _words(found: MachineFit) -> str:
    return " and ".join(found.names) or NO_EFFECT


def _scored(findings: MachineFindings) -> list[MachineFit]:
    """Return the fits of the effects that explain most to first order."""
    ranked = ranked_scores(findings.scores)[: MACHINES.hypotheses.top_scores]
    fits = MachineFits(findings.problem, findings.machine.effects)
    return fits.fit_all(
        [
            ((one.direction.name,), {one.direction.name: one.direction.shapes}, findings.base.fit.point)
            for one in ranked
        ],
        is_near=True,
    )


def odds_of(one: MachineFit, best: MachineFit) -> float:
    """Return the odds that runs like these prefer an explanation to the best: a paired t test over runs."""
    differences = np.log(one.left_out.squares / best.left_out.squares)
    runs = differences.size
    if one is best or runs < 2:
        return 1.0
    spread = float(np.std(differences, ddof=1)) / math.sqrt(runs)
    better = float(stats.t.sf(float(differences.mean()) / max(spread, LEAST_SPREAD), runs - 1))
    return min(better / max(1.0 - better, 1e-9), 1.0)


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
