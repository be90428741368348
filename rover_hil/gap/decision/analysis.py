"""From the runs of a machine to findings: budget, test, search, validation, discovery."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rover_hil.gap.data.problem import Problem, observe
from rover_hil.gap.decision.decide import Candidate, Decision, decide, is_same_law, size_of_fit
from rover_hil.gap.decision.first_answer import first_answer
from rover_hil.gap.decision.structure import structure_of
from rover_hil.gap.evidence.error_budget import ChannelError, error_budget
from rover_hil.gap.evidence.evidence import MachineFit
from rover_hil.gap.evidence.gap_tests import gap_p
from rover_hil.gap.evidence.localise import ResidualLocation, localise_residuals
from rover_hil.gap.evidence.score import Score
from rover_hil.gap.evidence.sizes import Size, size_of
from rover_hil.gap.evidence.wrong_unit import wrong_unit
from rover_hil.gap.fit.base_parameters import far_parameters
from rover_hil.gap.fit.called_machine import CalledMachine
from rover_hil.gap.fit.descent import residual_of
from rover_hil.gap.fit.holdout import Holdout, hold_out
from rover_hil.gap.fit.machine_fit import MachineFits
from rover_hil.gap.fit.released_fit import released_fit
from rover_hil.gap.fit.run_scatter import RunScatter, run_scatter
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.search.drafts import DraftTerm, confirmed_drafts, missing_terms
from rover_hil.gap.search.free_terms import FittedTerm
from rover_hil.gap.search.orders import other_orders
from rover_hil.gap.search.output_terms import equal_terms, equations_of, term_scores
from rover_hil.gap.search.residual_equations import Equation
from rover_hil.gap.search.search import EffectEvidence, Found, MachineSearch, score_effects
from rover_hil.gap.search.tracking import Tracked, track
from sim_backends.models.interface import Machine, Run
from sim_backends.models.parameter_key import ParameterKey
from sim_backends.state_model.model import StateModel, has_ports


@dataclass(frozen=True, slots=True, kw_only=True)
class MachineFindings:
    """Results on the runs of a machine.

    Attributes:
        machine: The model, with integration steps that are small enough.
        problem: The runs of the search.
        locked: The runs of the validation.
        base: The fit without effects.
        budget_before: Error budget of it.
        p_gap: Probability of its misfit if only the sensors err.
        scores: First-order score of every effect at the base fit, at each of its shapes.
        found: Result of the search; None where there is no gap.
        best: The explanation after validation; the base where there is none.
        budget_after: Error budget with it.
        p_remaining: Probability of what it leaves if only the sensors err.
        scatter: What base parameters of each run's own explain of the misfit of the best explanation.
        structure: Structure in the errors of the best explanation, over the tolerance; see `structure_of`.
        p_within_runs: Probability of what these leave if only the sensors err; 1 where effects are named.
        holdout: Result on the locked runs; None without explanation.
        base_holdout: Result of the model itself on the locked runs, where there is no gap on the others.
        evidence: Of each effect of the explanation.
        decision: Between all explanations; None without a gap.
        rival_terms: Terms at outputs that explain what an effect explains, of a machine without equations.
        drafts: Terms that are missing beside the effects of the explanation.
        drafts_alone: The same without effects; empty where the explanation has none.
        draft_failure: Why missing terms were not searched to the end; empty where they were.
        unit_error: Which channel has a wrong unit; nothing else was searched then.
        equations: Terms of the outputs instead of drafts, for a machine that has no equations.
        locations: Where the outputs of such a machine differ most at the base fit.
        tracked: The machine on its runs, with the force that keeps it there; None without a gap, without
            ports, or where no such force is found.
        other_weighting: Sizes of the effects by the other weighting, random forces at the ports.
    """

    machine: Machine
    problem: Problem
    locked: tuple[Run, ...] = ()
    base: MachineFit
    budget_before: tuple[ChannelError, ...]
    p_gap: float
    scores: tuple[Score, ...]
    found: Found | None = None
    best: MachineFit
    budget_after: tuple[ChannelError, ...]
    p_remaining: float = 1.0
    scatter: RunScatter
    structure: float = 0.0
    p_within_runs: float = 1.0
    holdout: Holdout | None = None
    base_holdout: Holdout | None = None
    evidence: tuple[EffectEvidence, ...] = ()
    decision: Decision | None = None
    rival_terms: tuple[str, ...] = ()
    drafts: tuple[DraftTerm, ...] = ()
    drafts_alone: tuple[DraftTerm, ...] = ()
    draft_failure: str = ""
    unit_error: str = ""
    equations: tuple[Equation, ...] = ()
    locations: tuple[ResidualLocation, ...] = ()
    tracked: Tracked | None = None
    other_weighting: Mapping[ParameterKey, float] = field(default_factory=dict)

    @property
    def share(self) -> float:
        """Share of the excess error that the explanation takes away on left-out runs."""
        return self.best.explained(self.base)[0] if self.best.names else 0.0

    @property
    def is_tolerable(self) -> bool:
        """True where the base model errs less than its tolerance, and its parameters are as its priors."""
        if not self.base.evidence.has_budget or self.base.evidence.is_learned:
            return False
        return all(one.is_good_enough for one in self.budget_before) and not far_parameters(self.base.fit)

    def size(self, effect: str, parameter: str) -> Size:
        """Return a size of the explanation with its interval."""
        return size_of(self.best, ParameterKey(effect=effect, name=parameter))


def analyse_machine(
    machine: Machine,
    runs: Sequence[Run],
    locked: Sequence[Run],
    seed: int,
    advance: Callable[[str], None],
    announce: Callable[[str], None] = lambda _: None,
) -> MachineFindings:
    """Find where a machine and its runs disagree, and which effects are missing.

    The locked runs are read only once an explanation is chosen, or the others show no gap.
    """
    rng = np.random.default_rng(seed)
    problem = Problem(machine, observe(machine, runs))
    fits = MachineFits(problem, machine.effects)
    advance("fitting the base model")
    base = fits.base()
    search = MachineSearch(fits, advance)
    scatter = run_scatter(fits, base)
    budget = _budget(problem, base, scatter)
    findings = MachineFindings(
        machine=machine,
        problem=problem,
        locked=tuple(locked),
        base=base,
        budget_before=budget,
        p_gap=gap_p(base, problem, search.scores(base), rng, _free_scores(problem, base)),
        scores=tuple(search.scores(base)),
        best=base,
        budget_after=budget,
        scatter=scatter,
    )
    announce(first_answer(findings.p_gap, budget, findings.scores))
    if findings.p_gap > MACHINES.tests.alpha or findings.is_tolerable:
        return _with_base_holdout(_with_scatter(findings, fits, rng), rng)
    unit_error = wrong_unit(problem, base.fit.point)
    if unit_error:
        return replace(findings, unit_error=unit_error)
    found = search.run()
    advance("comparing with free-form terms")
    listed = search.candidates()
    terms = missing_terms(machine, problem, base) if has_ports(machine) else []
    candidates = [*_listed(findings, listed), *_unlisted(machine, terms, listed, base)]
    decision = decide(problem, candidates, found.best)
    findings = replace(findings, found=found, decision=decision, locations=_locations(problem, base))
    chosen = decision.chosen
    if chosen.is_listed and chosen.machine is not machine:
        findings, fits = _in_order(findings, chosen.machine)
        machine, problem, search = chosen.machine, findings.problem, MachineSearch(fits, advance)
    findings = _with_best(findings, fits, chosen.fit if chosen.is_listed else base)
    if findings.best.names:
        advance("opening the locked runs")
        findings = _validated(findings, fits, locked, rng)
    if not findings.best.names:
        findings, fits = _without_wrong_priors(findings, fits, rng)
        findings, problem = _with_scatter(findings, fits, rng), findings.problem
        if findings.p_gap > MACHINES.tests.alpha or findings.is_tolerable:
            return _with_base_holdout(findings, rng)
    left = _free_scores(problem, findings.best)
    findings = replace(
        findings,
        p_remaining=gap_p(findings.best, problem, [], rng, left),
        structure=structure_of(problem, findings.best),
    )
    advance("estimating the unknown forces")
    findings = _followed(findings, fits)
    if findings.p_remaining <= MACHINES.tests.alpha:
        advance("searching a missing term")
        findings = _with_any_drafts(findings, fits, locked, rng, terms)
    if findings.best.names:
        evidence, rivals = search.evidence(findings.best), _rivals_at_outputs(findings, fits)
        findings = replace(findings, evidence=tuple(evidence), rival_terms=rivals)
        best, problem = released_fit(problem, findings.best)
        findings = replace(findings, best=best, problem=problem)
    return findings


def _with_scatter(findings: MachineFindings, fits: MachineFits, rng: np.random.Generator) -> MachineFindings:
    """Return what a gap is if parameters may differ between runs, where there is one."""
    if findings.p_gap > MACHINES.tests.alpha:
        return findings
    own = findings.scatter.fit
    return replace(findings, p_within_runs=gap_p(own, findings.problem, score_effects(fits, own), rng))


def _with_base_holdout(findings: MachineFindings, rng: np.random.Generator) -> MachineFindings:
    """Open the locked runs where the others show no gap: what is missing may act in one of them alone."""
    if not findings.locked:
        return findings
    base = findings.base
    return replace(findings, base_holdout=hold_out(findings.machine, findings.locked, base, base, rng))


def _listed(findings: MachineFindings, fits: Sequence[MachineFit]) -> list[Candidate]:
    """Return explanations by effects of the model, with their effects in any order."""
    machine = findings.machine
    options: list[tuple[Machine, MachineFit]] = [(machine, one) for one in fits]
    if isinstance(machine, StateModel):
        options += other_orders(machine, findings.problem, fits)
    return [Candidate(names=one.names, machine=own, fit=one, is_listed=True) for own, one in options]


def _in_order(findings: MachineFindings, machine: Machine) -> tuple[MachineFindings, MachineFits]:
    """Return what was found as of a model whose effects act in another order."""
    before = findings.problem
    problem = Problem(machine, before.observations, before.held, before.released)
    return replace(findings, machine=machine, problem=problem), MachineFits(problem, machine.effects)


def _unlisted(
    machine: Machine, terms: Sequence[FittedTerm], listed: Sequence[MachineFit], base: MachineFit
) -> list[Candidate]:
    """Return the terms that are in no list.

    One that is the same law as an explanation of the list, and needs no fewer causes, is this explanation:
    copies of a law in the draws would make it more probable.
    """
    if not has_ports(machine):
        return []
    found = [
        one
        for one in terms
        if not any(
            size_of_fit(other) <= size_of_fit(one.fit) and is_same_law(one.fit, other, base)
            for other in listed
        )
    ]
    return [
        Candidate(
            names=one.fit.names,
            machine=machine.with_effects([*machine.port_effects, one.term.effect]),
            fit=one.fit,
            is_listed=False,
            tried=len(found),
        )
        for one in found
    ]


def _without_wrong_priors(
    findings: MachineFindings, unreleased: MachineFits, rng: np.random.Generator
) -> tuple[MachineFindings, MachineFits]:
    """Judge what is left without the priors that the runs contradict, where these values alone explain them.

    Where a gap remains, the values may have taken a part of what is missing on themselves.
    """
    base, problem = released_fit(findings.problem, findings.base)
    if base is findings.base:
        return findings, unreleased
    fits = MachineFits(problem, findings.machine.effects)
    scatter, scores = run_scatter(fits, base), score_effects(fits, base)
    budget = _budget(problem, base, scatter)
    p_gap = gap_p(base, problem, scores, rng, _free_scores(problem, base))
    if p_gap <= MACHINES.tests.alpha and not all(one.is_good_enough for one in budget):
        return findings, unreleased
    findings = replace(findings, problem=problem, base=base, best=base, scatter=scatter, p_gap=p_gap)
    return replace(findings, budget_before=budget, budget_after=budget, scores=tuple(scores)), fits


def _budget(problem: Problem, found: MachineFit, scatter: RunScatter) -> tuple[ChannelError, ...]:
    residual = residual_of(problem.observations, problem.predict(found.fit.point))
    return error_budget(problem.observations, residual, len(found.fit.free), scatter.channel_rms)


def _with_best(findings: MachineFindings, fits: MachineFits, best: MachineFit) -> MachineFindings:
    scatter = run_scatter(fits, best)
    return replace(
        findings, best=best, scatter=scatter, budget_after=_budget(findings.problem, best, scatter)
    )


def _validated(
    findings: MachineFindings, fits: MachineFits, locked: Sequence[Run], rng: np.random.Generator
) -> MachineFindings:
    is_called = isinstance(findings.machine, CalledMachine)
    holdout = hold_out(findings.machine, locked, findings.base, findings.best, rng, is_nominal=is_called)
    is_contradicted = findings.best.evidence.is_contradicted(holdout.improved, holdout.closure, holdout.lean)
    best = findings.base if is_contradicted else findings.best
    return _with_best(replace(findings, holdout=holdout), fits, best)


def _locations(problem: Problem, base: MachineFit) -> tuple[ResidualLocation, ...]:
    machine = problem.model
    if not isinstance(machine, CalledMachine):
        return ()
    return tuple(localise_residuals(problem, base.noise, base.fit.point, machine.input_units))


def _free_scores(problem: Problem, at: MachineFit) -> list[Score]:
    """Return the scores of free-form terms where these act on the outputs."""
    machine = problem.model
    return term_scores(machine, problem, at) if isinstance(machine, CalledMachine) else []


def _rivals_at_outputs(findings: MachineFindings, fits: MachineFits) -> tuple[str, ...]:
    machine, best = findings.machine, findings.best
    if findings.problem.observations.is_steady or not isinstance(machine, CalledMachine):
        return ()
    found: list[str] = []
    for name in best.names:
        part = fits.tried.get(tuple(one for one in best.names if one != name))
        if part is not None:
            found += equal_terms(machine, findings.problem, part, best)[:1]
    return tuple(found)


def _followed(findings: MachineFindings, fits: MachineFits) -> MachineFindings:
    machine = findings.machine
    if not has_ports(machine):
        return findings
    best = findings.best
    free = fits.free(best.names, {})
    tracked = track(findings.problem, machine, free, best.fit.point)
    if tracked is None:
        return findings
    moved = {
        item.key: item.mean + item.sd * float(pull)
        for item, pull in zip(tracked.free, tracked.pulls, strict=True)
        if item.key.is_of_effect
    }
    return replace(findings, tracked=tracked, other_weighting=moved)


def _with_any_drafts(
    findings: MachineFindings,
    fits: MachineFits,
    locked: Sequence[Run],
    rng: np.random.Generator,
    of_base: Sequence[FittedTerm],
) -> MachineFindings:
    """Search the terms that explain what is left; what is known before is kept, however that search ends.

    `of_base` are the terms that explain what the model leaves without effects.
    """
    try:
        return _with_drafts(findings, fits, locked, rng, of_base)
    except KeyboardInterrupt:
        return replace(findings, draft_failure="interrupted by ctrl-C")
    except MemoryError:
        raise
    except Exception as error:  # noqa: BLE001 (equations that diverge fail in many ways)
        return replace(findings, draft_failure=f"{type(error).__name__}: {error}")


def _with_drafts(
    findings: MachineFindings,
    fits: MachineFits,
    locked: Sequence[Run],
    rng: np.random.Generator,
    of_base: Sequence[FittedTerm],
) -> MachineFindings:
    machine, best = findings.machine, findings.best
    if isinstance(machine, CalledMachine):
        return replace(findings, equations=equations_of(machine, findings.problem, fits, locked, best, rng))
    if not has_ports(machine):
        return findings
    if not best.names:
        return replace(findings, drafts=confirmed_drafts(machine, locked, best, of_base, rng))
    terms = missing_terms(machine, findings.problem, best)
    findings = replace(findings, drafts=confirmed_drafts(machine, locked, best, terms, rng))
    return replace(findings, drafts_alone=confirmed_drafts(machine, locked, findings.base, of_base, rng))
