"""The workflow from runs to a verdict: plan, test, localise, name, validate."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from drivers.clock import SystemClock, seconds
from drivers.errors import ModelError
from rover_hil.gap import verdict_rules
from rover_hil.gap.base_parameters import Trial, judged, with_base_parameters
from rover_hil.gap.checks import missing_values, object_to
from rover_hil.gap.data.observed_model import ObservedModel
from rover_hil.gap.explain.alternative_models import find_alternative_terms
from rover_hil.gap.explain.base_trial import model_bases, model_trial
from rover_hil.gap.explain.candidates import candidate_directions
from rover_hil.gap.explain.gap_test import GapTest, find_gap
from rover_hil.gap.explain.holdout_validation import validate
from rover_hil.gap.explain.localise_residuals import localise_residuals
from rover_hil.gap.explain.naming import Naming, name_effects
from rover_hil.gap.explain.parameters import EXPLAIN
from rover_hil.gap.explain.prepare import Prepared, input_units, prepare, relearn_noise
from rover_hil.gap.explain.residual_equations import Equation, find_equations
from rover_hil.gap.explain.search import Explanation
from rover_hil.gap.findings import Analysis, Findings
from rover_hil.gap.machines.analysis import analyse_machine
from rover_hil.gap.machines.base_trial import machine_bases, machine_trial
from rover_hil.gap.machines.next_run.allowed import Allowed
from rover_hil.gap.machines.next_run.planned import require_durations
from rover_hil.gap.machines.next_run.proposal import propose_run
from rover_hil.gap.machines.next_run.words import option_table, proposal_sentence
from rover_hil.gap.machines.verdict import decide_machine
from rover_hil.gap.plan import Plan, TooFewRunsError, make_plan, require_runs
from rover_hil.gap.statistics.fit import Fit, fit, whitened_jacobian
from rover_hil.gap.statistics.score import score_all
from rover_hil.gap.verdict import Answer
from sim_backends.models.interface import Machine, Model, Run

ALPHAS = {
    "gap": EXPLAIN.gap.alpha,
    "first name": EXPLAIN.naming.alpha,
    "further name": EXPLAIN.naming.more_alpha,
}


def analyse(
    model: Model,
    runs: Sequence[Run],
    *,
    seed: int = 0,
    confirm: str = "",
    allowed: Allowed | None = None,
    on_plan: Callable[[Plan], None] = lambda _: None,
    advance: Callable[[str], None] = lambda _: None,
    announce: Callable[[str], None] = lambda _: None,
) -> Analysis:
    """Find where model and runs disagree, name the missing effects, and validate them.

    Args:
        model: The simulator with its effects.
        runs: Measured.
        seed: Of all random numbers.
        confirm: Expression that selects the runs to lock; empty for a random choice.
        allowed: Runs of a machine that may be made next; by default repetitions of the measured ones.
        on_plan: Called with the plan before anything is computed from measured values.
        advance: Called with the current step.
        announce: Called with a first answer on a machine, long before the verdict.

    Raises:
        ConfigError: `confirm` is not an expression, or `allowed` names what the model does not have or
            durations that no run can have.
    """
    clock = SystemClock()
    start_ns = clock.now_ns()
    if not isinstance(model, Machine):
        model = ObservedModel(model, runs)
    elif allowed is not None:
        allowed.require_names(model)
        require_durations(model, runs, allowed)
    analysis = _analyse(model, runs, seed, confirm, on_plan, advance, announce)
    analysis = _with_next_run(analysis, allowed or Allowed(), seed, advance)
    analysis = _with_base_parameters(analysis, seed, advance)
    missing: list[dict[str, str | int]] = [
        {"run": one.run, "series": one.series, "count": one.count, "total": one.total}
        for one in missing_values(model, runs)
    ]
    duration_s = round(seconds(clock.now_ns() - start_ns), 3)
    return replace(analysis, verdict=replace(analysis.verdict, missing=missing, seconds=duration_s))


def _with_next_run(
    analysis: Analysis, allowed: Allowed, seed: int, advance: Callable[[str], None]
) -> Analysis:
    """Return an analysis of a machine with the proposal of its next run."""
    if analysis.machine is None:
        return analysis
    verdict = analysis.verdict
    proposal = propose_run(analysis.machine, verdict.verdict, allowed, seed, advance)
    if proposal is None:
        return analysis
    tables = [option_table(proposal, one, rank) for rank, one in enumerate(proposal.options)]
    verdict = replace(verdict, next_run=proposal_sentence(proposal), next_runs=tables)
    return replace(analysis, verdict=verdict, proposal=proposal)


def _with_base_parameters(analysis: Analysis, seed: int, advance: Callable[[str], None]) -> Analysis:
    """Return an analysis with its base parameters, and those far from nominal in its verdict."""
    plan, verdict = analysis.plan, analysis.verdict
    if plan is None:
        return analysis
    locked = [run for run in analysis.runs if run.name in plan.confirm]
    if analysis.machine is not None:
        machine = analysis.machine
        fitted = machine.best if verdict.effects else machine.base
        rows = machine_bases(machine, fitted)
        trial_of: Callable[[str], Trial] = partial(machine_trial, machine, fitted, locked, seed)
    elif analysis.findings is not None:
        findings = analysis.findings
        best = findings.best if verdict.effects else None
        start = findings.prepared.start if best is None else best.fit
        rows = model_bases(findings.prepared, start, verdict_rules.intervals(findings, start))
        trial_of = partial(model_trial, findings.prepared, best, findings.naming.inflation, locked)
    else:
        return analysis
    advance("comparing base parameters with their nominal values")
    return replace(analysis, verdict=with_base_parameters(verdict, judged(rows, trial_of)))


def _analyse(
    model: Model,
    runs: Sequence[Run],
    seed: int,
    confirm: str,
    on_plan: Callable[[Plan], None],
    advance: Callable[[str], None],
    announce: Callable[[str], None],
) -> Analysis:
    def refused(answer: Answer, reason: str, plan: Plan | None = None) -> Analysis:
        verdict = verdict_rules.refuse(answer, reason)
        return Analysis(model=model, verdict=verdict, runs=tuple(runs), plan=plan, findings=None)

    try:
        require_runs(runs)
    except TooFewRunsError as error:
        return refused(Answer.BAD_DATA, str(error))
    objection = object_to(model, runs)
    if objection is not None:
        answer = Answer.NOT_IDENTIFIABLE if objection.is_identifiability else Answer.BAD_DATA
        return refused(answer, objection.reason)
    try:
        plan = make_plan(model, runs, seed=seed, confirm=confirm, alphas=ALPHAS)
    except TooFewRunsError as error:
        return refused(Answer.BAD_DATA, str(error))
    on_plan(plan)
    locked = set(plan.confirm)
    open_runs = [run for run in runs if run.name not in locked]
    objection = object_to(model, open_runs)
    if objection is not None:
        return refused(Answer.BAD_DATA, f"without the locked runs, {objection.reason}", plan)
    locked_runs = [run for run in runs if run.name in locked]
    if isinstance(model, Machine):
        advance("choosing the integration steps")
        model = model.refined(runs)
        found = analyse_machine(model, open_runs, locked_runs, seed, advance, announce)
        verdict = decide_machine(found)
        return Analysis(
            model=model, verdict=verdict, runs=tuple(runs), plan=plan, findings=None, machine=found
        )
    try:
        findings = _learn(model, open_runs, np.random.default_rng(seed), advance)
    except ModelError as error:
        return refused(Answer.BAD_DATA, str(error), plan)
    if findings.best is not None:
        advance("opening the locked runs")
        findings = _validated(findings, locked_runs, seed + 1)
    verdict = verdict_rules.decide(findings)
    return Analysis(model=model, verdict=verdict, runs=tuple(runs), plan=plan, findings=findings)


def _learn(
    model: Model, runs: Sequence[Run], rng: np.random.Generator, advance: Callable[[str], None]
) -> Findings:
    advance("fitting the base model")
    prepared = prepare(model, runs)
    naming, gap = _test(prepared, rng, advance)
    if naming.best is not None and prepared.scatter is None:
        prepared = relearn_noise(prepared, naming.best.fit)
        naming, gap = _test(prepared, rng, advance)
    locations = tuple(
        localise_residuals(prepared.problem, prepared.noise, prepared.start.point, input_units(model))
    )
    findings = Findings(prepared=prepared, gap=gap, locations=locations, naming=naming)
    if gap.p > EXPLAIN.gap.alpha:
        return findings
    advance("testing the remaining gap")
    return _with_best(findings, naming.best, rng)


def _with_best(findings: Findings, best: Explanation | None, rng: np.random.Generator) -> Findings:
    """Return findings with an explanation: its remaining gap, and equations for it."""
    prepared, remaining_gap = findings.prepared, None
    observations, noise, fitted = prepared.problem.observations, prepared.noise, prepared.start
    if best is not None:
        fitted = _polished(prepared, best.fit)
        best = replace(best, fit=fitted)
        remaining_gap = find_gap(
            observations, noise, prepared.scatter, fitted, prepared.terms, len(best.names), None, rng
        )
    equations: list[Equation] = []
    if remaining_gap is None or remaining_gap.p <= EXPLAIN.gap.alpha:
        named = () if best is None else best.names
        others = [item for item in findings.naming.scores if item.card.name not in named]
        changes = candidate_directions(prepared.problem, noise, fitted, others)
        effects = score_all(fitted, noise, changes, is_steady=observations.is_steady)
        threshold = (remaining_gap or findings.gap).threshold
        equations = find_equations(observations, noise, fitted, prepared.terms, effects, threshold)
    alternatives = {} if best is None else find_alternative_terms(prepared, findings.naming, best)
    return replace(
        findings,
        best=best,
        remaining_gap=remaining_gap,
        alternatives=alternatives,
        equations=tuple(equations),
    )


def _polished(prepared: Prepared, found: Fit) -> Fit:
    """Return a converged fit with its derivatives, for intervals and scores."""
    free = {item.key for item in found.free}
    fixed = {key: value for key, value in found.point.items() if key not in free}
    best = fit(prepared.problem, prepared.noise, found.free, found.point, fixed=fixed)
    jacobian = whitened_jacobian(prepared.problem, prepared.noise, best.free, best.point)
    return replace(best, jacobian=jacobian)


def _validated(findings: Findings, locked_runs: Sequence[Run], seed: int) -> Findings:
    """Return findings with their validation; effects that the locked runs contradict are withdrawn."""
    rng = np.random.default_rng(seed)
    while findings.best is not None:
        best, naming = findings.best, findings.naming
        validation = validate(findings.prepared, locked_runs, best, naming, rng)
        findings = replace(findings, validation=validation)
        fewer = [one for key, one in naming.tried.items() if len(key) == len(best.names) - 1]
        fewer = [one for one in fewer if set(one.names) < set(best.names)]
        if validation.is_confirmed or not fewer:
            break
        instead = min(fewer, key=lambda one: one.cost)
        findings = replace(findings, naming=replace(naming, best=instead, members=(instead,)))
        findings = _with_best(findings, instead, rng)
    return findings


def _test(
    prepared: Prepared, rng: np.random.Generator, advance: Callable[[str], None]
) -> tuple[Naming, GapTest]:
    problem = prepared.problem
    naming = name_effects(problem, prepared.noise, prepared.start, problem.model.effects, rng, advance)
    p_effects = naming.p_name if naming.scores else None
    gap = find_gap(
        problem.observations,
        prepared.noise,
        prepared.scatter,
        prepared.start,
        prepared.terms,
        0,
        p_effects,
        rng,
    )
    return naming, gap
