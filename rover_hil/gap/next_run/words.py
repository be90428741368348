"""The proposal of the next run in words and numbers."""

from collections.abc import Mapping, Sequence

from rover_hil.gap.next_run.proposal import NextRun, Proposal, unseparated

MOST_PAIRS = 1
"""Pairs that the sentence names; `next_runs` in `verdict.json` has all."""

Value = str | float | bool | Mapping[str, float] | Sequence[Mapping[str, str | float]]


def proposal_sentence(proposal: Proposal) -> str:
    """Return what to do, and by how much it raises the probability of a right verdict."""
    best = proposal.options[0]
    pairs = unseparated(proposal)
    times = "" if proposal.times == 1 else f", {proposal.times} times"
    but = f"; it does not separate {_pairs(pairs)}" if pairs else ""
    right = f"from about {proposal.before:.0%} to {proposal.after_times.right:.0%}"
    what = f"{best.planned.words}{times}: {_aim(proposal)}"
    return f"{what}; it makes a right verdict more probable, {right}{but}"


def _aim(proposal: Proposal) -> str:
    names = [one.name for one in proposal.named]
    if len(names) == 1:
        return f"it tests {names[0]} against any other cause"
    distance = float(proposal.options[0].separation.distances[0, 1])
    text = f"it separates {names[0]} from {names[1]} by {distance:.2g} standard deviations"
    return text if len(names) == 2 else f"{text}, and from {' and '.join(names[2:])}"


def _pairs(pairs: Sequence[tuple[str, str]]) -> str:
    texts = [f"{one} from {other}" for one, other in pairs[:MOST_PAIRS]]
    more = len(pairs) - MOST_PAIRS
    if more > 0:
        texts.append(f"{more} other pair{'s' if more > 1 else ''} of explanations")
    return ", and ".join(texts)


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
        "probability_right_before": proposal.before,
        "explanations": hypotheses,
        "pairs": pairs,
    }
