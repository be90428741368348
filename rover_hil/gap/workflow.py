"""The workflow from runs to a verdict: plan, test, localise, name, validate."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from drivers.clock import SystemClock, seconds
from drivers.errors import ModelError
from rover_hil.gap.checks import missing_values, object_to
from rover_hil.gap.data.observed_model import ObservedModel
from rover_hil.gap.data.pieces import stable_pieces
from rover_hil.gap.data.problem import is_steady, split_point
from rover_hil.gap.decision.analysis import analyse_machine
from rover_hil.gap.decision.base_trial import machine_bases, machine_trial
from rover_hil.gap.decision.verdict import decide_machine, is_gap_in_tests_alone
from rover_hil.gap.findings import Analysis
from rover_hil.gap.fit.base_parameters import Trial, doubted, judged, with_base_parameters
from rover_hil.gap.fit.called_machine import CalledMachine, called_machine
from rover_hil.gap.fit.released_fit import released_fit
from rover_hil.gap.fit.steady import steady_machine
from rover_hil.gap.next_run.allowed import Allowed
from rover_hil.gap.next_run.conditions import propose_conditions
from rover_hil.gap.next_run.planned import require_durations
from rover_hil.gap.next_run.proposal import propose_run
from rover_hil.gap.next_run.words import option_table, proposal_sentence
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.plan import Plan, TooFewRunsError, make_plan, require_runs
from rover_hil.gap.verdict import Answer, refuse
from sim_backends.models.interface import Machine, Model, Run
from sim_backends.state_model.model import StateModel

ALPHAS = {"gap": MACHINES.tests.alpha}


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
        announce: Called with a first answer, long before the verdict.

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
    of_effects = analysis.verdict.verdict
    analysis = _with_base_parameters(analysis, seed, advance)
    analysis = _with_next_run(analysis, of_effects, allowed or Allowed(), seed, advance)
    missing: list[dict[str, str | int]] = [
        {"run": one.run, "series": one.series, "count": one.count, "total": one.total}
        for one in missing_values(model, runs)
    ]
    duration_s = round(seconds(clock.now_ns() - start_ns), 3)
    return replace(analysis, verdict=replace(analysis.verdict, missing=missing, seconds=duration_s))


def _with_next_run(
    analysis: Analysis, answer: Answer, allowed: Allowed, seed: int, advance: Callable[[str], None]
) -> Analysis:
    """Return an analysis with the proposal of its next run; `answer` is the verdict on the effects."""
    verdict = analysis.verdict
    if analysis.machine is None or (verdict.verdict is Answer.NAMED and not verdict.effects):
        return analysis
    if is_gap_in_tests_alone(analysis.machine, verdict.verdict):
        # No run of the search shows what is missing: none can be planned to distinguish causes.
        return analysis
    if isinstance(analysis.machine.machine, CalledMachine):
        next_run = propose_conditions(analysis.machine, answer)
        return replace(analysis, verdict=replace(verdict, next_run=next_run))
    proposal = propose_run(analysis.machine, answer, allowed, seed, advance)
    if proposal is None:
        return analysis
    tables = [option_table(proposal, one, rank) for rank, one in enumerate(proposal.options)]
    verdict = replace(verdict, next_run=proposal_sentence(proposal), next_runs=tables)
    return replace(analysis, verdict=verdict, proposal=proposal)


def _with_base_parameters(analysis: Analysis, seed: int, advance: Callable[[str], None]) -> Analysis:
    """Return an analysis with its base parameters, and those far from nominal in its verdict."""
    verdict, machine = analysis.verdict, analysis.machine
    if machine is None:
        return analysis
    fitted = machine.best if verdict.effects else machine.base
    advance("comparing base parameters with their nominal values")
    fitted, problem = released_fit(machine.problem, fitted)
    trial_of: Callable[[str], Trial] = partial(machine_trial, machine, problem, fitted, machine.locked, seed)
    rows = judged(machine_bases(machine, fitted), trial_of)
    if machine.decision is not None:
        rows = doubted(rows, machine.decision.base_probability)
    has_gap_in_tests = is_gap_in_tests_alone(machine, verdict.verdict)
    verdict = with_base_parameters(verdict, rows, has_gap_in_tests=has_gap_in_tests)
    return replace(analysis, verdict=verdict)


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
        return Analysis(model=model, verdict=refuse(answer, reason), runs=tuple(runs), plan=plan)

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
    try:
        machine, open_runs, locked_runs = _as_machine(model, runs, open_runs, locked_runs, advance)
    except ModelError as error:
        return refused(Answer.BAD_DATA, str(error), plan)
    advance("looking for unstable records")
    open_runs, told = stable_pieces(machine, open_runs)
    locked_runs, also_told = stable_pieces(machine, locked_runs)
    found = analyse_machine(machine, open_runs, locked_runs, seed, advance, announce)
    while isinstance(machine, StateModel):
        # Steps were chosen at the natural sizes of the effects; the found ones may need smaller steps.
        finer = machine.refined_at(open_runs, *split_point(found.best.fit.point))
        if finer is machine:
            break
        advance("once more with smaller integration steps")
        machine = finer
        found = analyse_machine(machine, open_runs, locked_runs, seed, advance, announce)
    if found.unit_error:
        return refused(Answer.BAD_DATA, found.unit_error, plan)
    shown = machine if isinstance(model, Machine) else model
    verdict = decide_machine(found)
    verdict = replace(verdict, warnings=(*told, *also_told, *verdict.warnings))
    return Analysis(model=shown, verdict=verdict, runs=tuple(runs), plan=plan, machine=found)


def _as_machine(
    model: Model,
    runs: Sequence[Run],
    open_runs: list[Run],
    locked_runs: list[Run],
    advance: Callable[[str], None],
) -> tuple[Machine, list[Run], list[Run]]:
    """Return a model as a machine whose sensors have a noise, and the runs as those of this machine.

    Raises:
        ModelError: The model has no solution for many of the runs.
    """
    if isinstance(model, Machine):
        advance("choosing the integration steps")
        return model.refined(runs), open_runs, locked_runs
    if is_steady(runs):
        advance("learning the scatter of replicates")
        return steady_machine(model, open_runs, locked_runs)
    advance("learning the noise of the sensors")
    return called_machine(model, open_runs), open_runs, locked_runs
