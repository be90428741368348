"""The proposal of the next run in words and numbers."""

from collections.abc import Mapping, Sequence

from rover_hil.gap.next_run.decision import Outcome
from rover_hil.gap.next_run.proposal import NextRun, Proposal, unseparated

MOST_PAIRS = 1
"""Pairs that the sentence names; `next_runs` in `verdict.json` has all."""

Value = str | float | bool | Mapping[str, float] | Sequence[Mapping[str, str | float]]


def proposal_sentence(proposal: Proposal) -> str:
    """Return what to do, and how probable a right verdict is after it."""
    best = proposal.options[0]
    pairs = unseparated(proposal)
    count = len(proposal.named)
    if proposal.times == 0 or (pairs and len(pairs) == count * (count - 1) // 2):
        return (
            f"no allowed run separates {_pairs(pairs) or _all(proposal)}: the best would be "
            f"{best.planned.words}{_after(best.outcome, 1)}; "
            "allow other inputs, larger amplitudes or other starts"
        )
    times = "" if proposal.times == 1 else f", {proposal.times} times"
    but = f"; it does not separate {_pairs(pairs)}" if pairs else ""
    return f"{best.planned.words}{times}: {_aim(proposal)}{_after(proposal.after_times, proposal.times)}{but}"


def _aim(proposal: Proposal) -> str:
    names = [one.name for one in proposal.named]
    if len(names) == 1:
        return f"it tests {names[0]} against any other cause"
    distance = float(proposal.options[0].separation.distances[0, 1])
    text = f"it separates {names[0]} from {names[1]} by {distance:.2g} standard deviations"
    return text if len(names) == 2 else f"{text}, and from {' and '.join(names[2:])}"


def _after(outcome: Outcome, times: int) -> str:
    which = "it" if times == 1 else "them"
    return f"; the verdict after {which} is right with a probability of about {outcome.right:.0%}"


def _pairs(pairs: Sequence[tuple[str, str]]) -> str:
    texts = [f"{one} from {other}" for one, other in pairs[:MOST_PAIRS]]
    more = len(pairs) - MOST_PAIRS
    if more > 0:
        texts.append(f"{more} other pair{'s' if more > 1 else ''} of explanations")
    return ", and ".join(texts)


def _all(proposal: Proposal) -> str:
    names = [one.name for one in proposal.hypotheses]
    return f"{', '.join(names[:-1])} and {names[-1]}"


def option_table(proposal: Proposal, option: NextRun, rank: int) -> dict[str, Value]:
    """Return a run of the proposal as a table for `verdict.json`."""
    outcome, planned = option.outcome, option.planned
    hypotheses: list[Mapping[str, str | float]] = [
        {"name": one.name, "weight": one.weight, "probability_right": right}
        for one, right in zip(proposal.hypotheses, outcome.by_hypothesis, strict=True)
    ]
    pairs: list[Mapping[str, str | float]] = [
        {
            "one": proposal.hypotheses[one].name,
            "other": proposal.hypotheses[other].name,
            "distance_sd": float(option.separation.distances[one, other]),
        }
        for one in range(len(hypotheses))
        for other in range(one + 1, len(hypotheses))
    ]
    return {
        "run": planned.words,
        "shape": planned.shape,
        "like": planned.like,
        "is_repeat": planned.is_repeat,
        "duration_s": planned.step_s * planned.times_s.size,
        "starts": dict(planned.starts),
        "conditions": dict(planned.run.conditions),
        "times": float(proposal.times) if rank == 0 else 1.0,
        "votes": option.separation.votes,
        "divergence": option.separation.divergence,
        "probability_right": outcome.right,
        "probability_wrong": outcome.wrong,
        "probability_error": outcome.error,
        "probability_right_before": proposal.before.right,
        "explanations": hypotheses,
        "pairs": pairs,
    }
