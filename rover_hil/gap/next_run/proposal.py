"""The proposal of the next run."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from rover_hil.gap.decision.analysis import MachineFindings
from rover_hil.gap.next_run.allowed import Allowed
from rover_hil.gap.next_run.criterion import Separation, separation_of
from rover_hil.gap.next_run.decision import Outcome, simulate_repeats, simulate_runs
from rover_hil.gap.next_run.hypotheses import Hypothesis, hypotheses_of, starts_of
from rover_hil.gap.next_run.planned import PlannedRun, planned_runs, with_names
from rover_hil.gap.next_run.prediction import Planning, Prediction
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.verdict import Answer
from sim_backends.models.interface import Array
from sim_backends.state_model.model import StateModel


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """How many runs are looked at.

    Attributes:
        planned: Runs that are simulated.
        linearised: Of them, those whose predictions are linearised.
        repeated: Of these, repetitions of measured runs.
        is_nonlinear: The machine is simulated with each draw of its parameters.
    """

    planned: int
    linearised: int
    repeated: int
    is_nonlinear: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NextRun:
    """A run that could be made next, judged.

    Attributes:
        planned: What to do.
        predictions: Of each explanation.
        separation: Of the explanations.
        outcome: Of the verdict after it.
    """

    planned: PlannedRun
    predictions: tuple[Prediction, ...]
    separation: Separation
    outcome: Outcome


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Proposal:
    """The proposal of the next run.

    Attributes:
        hypotheses: The explanations that are left; the last is "something else".
        options: The best run, the runner-up, and the best repetition of a measured run, where there are any.
        before: Probability that the verdict without a further run is right.
        times: How often to make the best run: until the verdict is probably right, at most eight times.
        after_times: Probabilities after so many.
    """

    hypotheses: tuple[Hypothesis, ...]
    options: tuple[NextRun, ...]
    before: float
    times: int
    after_times: Outcome

    @property
    def named(self) -> tuple[Hypothesis, ...]:
        """The explanations with a name."""
        return tuple(one for one in self.hypotheses if not one.is_else)


def propose_run(
    findings: MachineFindings,
    answer: Answer,
    allowed: Allowed,
    seed: int,
    advance: Callable[[str], None] = lambda _: None,
) -> Proposal | None:
    """Return the run that separates the explanations that are left best.

    Returns:
        The proposal; None where nothing is open, no run may be made, or none makes a right verdict more
        probable.
    """
    if answer in (Answer.NO_GAP, Answer.NAMED, Answer.BAD_DATA):
        return None
    advance("designing the next run")
    hypotheses, basis = hypotheses_of(findings)
    effort = _effort(is_nonlinear=isinstance(findings.machine, StateModel))
    planned = with_names(
        planned_runs(
            findings.machine,
            findings.problem.sites,
            starts_of(findings.best),
            allowed,
            most=effort.planned,
            seed=seed,
        )
    )
    shortened = _most_different(Planning(hypotheses, planned, basis), allowed, effort) if planned else []
    if not shortened:
        return None
    weights = [one.weight for one in hypotheses]
    planning = Planning(hypotheses, shortened, basis)
    predictions = planning.predictions()
    separations = [separation_of(one, weights) for one in predictions]
    chosen = _shortlist(shortened, separations)
    rng = np.random.default_rng(seed)
    runs = [shortened[one] for one in chosen]
    options = _judged(Planning(hypotheses, runs, basis), effort, rng)
    best, *others = sorted(options, key=lambda one: (one.outcome.right, one.separation.votes), reverse=True)
    repeated = [one for one in others if one.planned.is_repeat][:1]
    more = others[:1] if not others or others[0] in repeated else [*others[:1], *repeated]
    times, after = _times(best, hypotheses, rng)
    # Nothing is named yet: the verdict is right where the cause is something else.
    before = hypotheses[-1].weight
    if after.right - before < MACHINES.proposal.least_gain:
        return None
    return Proposal(
        hypotheses=tuple(hypotheses),
        options=(best, *more),
        before=before,
        times=times,
        after_times=after,
    )


def _most_different(planning: Planning, allowed: Allowed, effort: Effort) -> list[PlannedRun]:
    """Return the runs whose predictions differ most in units of noise, among them some repetitions."""
    means = planning.means()
    pairs = list(combinations(range(len(means)), 2))
    found: list[tuple[float, PlannedRun]] = []
    for site, one in enumerate(planning.planned):
        if not _is_allowed(planning, site, means, allowed):
            continue
        blocks = planning.blocks[site]
        vectors = [blocks.of(mean) for mean in means]
        score = sum(
            planning.hypotheses[a].weight
            * planning.hypotheses[b].weight
            * math.log1p(float(np.sum((vectors[a] - vectors[b]) ** 2)))
            for a, b in pairs
        )
        found.append((score, one))
    found.sort(key=lambda pair: -pair[0])
    repeated = [one for _, one in found if one.is_repeat][: effort.repeated]
    changed = [one for _, one in found if not one.is_repeat][: effort.linearised - len(repeated)]
    return [*repeated, *changed]


def _is_allowed(planning: Planning, site: int, means: Sequence[Array], allowed: Allowed) -> bool:
    """Return True where every explanation has a prediction, inside the allowed ranges of the channels."""
    here = planning.observations.site == site
    for mean in means:
        if not np.isfinite(mean[here]).all():
            return False
        for index, channel in enumerate(planning.observations.channels):
            values = mean[here & (planning.observations.channel == index)]
            if channel.name in allowed.channels and not allowed.channels[channel.name].holds(values):
                return False
    return True


def _shortlist(planned: Sequence[PlannedRun], separations: Sequence[Separation]) -> list[int]:
    ranked = sorted(range(len(planned)), key=lambda index: -separations[index].votes)
    changed = [index for index in ranked if not planned[index].is_repeat][: MACHINES.proposal.most_simulated]
    return [*changed, *(index for index in ranked if planned[index].is_repeat)]


def _judged(planning: Planning, effort: Effort, rng: np.random.Generator) -> list[NextRun]:
    predictions = planning.predictions()
    weights = [one.weight for one in planning.hypotheses]
    if effort.is_nonlinear:
        outcomes = simulate_runs(planning, predictions, rng)
    else:
        outcomes = [simulate_repeats(planning.hypotheses, own, 1, rng) for own in predictions]
    return [
        NextRun(
            planned=one,
            predictions=tuple(own),
            separation=separation_of(own, weights),
            outcome=outcome,
        )
        for one, own, outcome in zip(planning.planned, predictions, outcomes, strict=True)
    ]


def _times(best: NextRun, hypotheses: Sequence[Hypothesis], rng: np.random.Generator) -> tuple[int, Outcome]:
    """Return how often to make a run, and the probabilities after so many."""
    weights = [one.weight for one in hypotheses]
    if _is_settled(best.outcome, weights):
        return 1, best.outcome
    after = best.outcome
    for times in MACHINES.proposal.repeats:
        after = simulate_repeats(hypotheses, best.predictions, times, rng)
        if _is_settled(after, weights):
            return times, after
    return MACHINES.proposal.repeats[-1], after


def _effort(*, is_nonlinear: bool) -> Effort:
    numbers = MACHINES.proposal.equations_effort if is_nonlinear else MACHINES.proposal.unit_effort
    planned, linearised, repeated = numbers
    return Effort(planned=planned, linearised=linearised, repeated=repeated, is_nonlinear=is_nonlinear)


def _is_settled(outcome: Outcome, weights: Sequence[float]) -> bool:
    """Return True where the verdict is probably right, if the cause is in the list."""
    named = sum(weights[:-1])
    right = sum(weight * one for weight, one in zip(weights[:-1], outcome.by_hypothesis[:-1], strict=True))
    return right >= MACHINES.proposal.settled * named


def unseparated(proposal: Proposal) -> list[tuple[str, str]]:
    """Return the pairs of named explanations that the best run does not separate."""
    distances = proposal.options[0].separation.distances
    return [
        (proposal.hypotheses[one].name, proposal.hypotheses[other].name)
        for one, other in combinations(range(len(proposal.named)), 2)
        if distances[one, other] < MACHINES.proposal.pair_apart
    ]
