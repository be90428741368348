"""What is known before anything is searched: the error of the base model, and effects to first order."""

from collections.abc import Sequence

from rover_hil.gap.evidence.error_budget import ChannelError
from rover_hil.gap.evidence.score import Score, one_sided_z
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.search.search import ranked_scores


def first_answer(p_gap: float, budget: Sequence[ChannelError], scores: Sequence[Score]) -> str:
    """Return the first answer in words."""
    largest = max(budget, key=lambda one: one.model_error / one.sensor_noise)
    if p_gap > MACHINES.tests.alpha:
        return f"First answer: no gap found (p = {p_gap:.2g}). {largest.sentence()}"
    ranked = ranked_scores(scores)
    candidates = [
        one for one in ranked[: MACHINES.first.candidates] if one_sided_z(one) >= MACHINES.first.least_z
    ]
    words = ", ".join(
        f"{one.direction.name} (about {one.strength:.2g} {one.direction.unit})" for one in candidates
    )
    return (
        f"First answer: there is a gap. {largest.sentence()}. Candidates by linearisation, not yet fitted or "
        f"validated: {words or 'none of the effects'}"
    )
