"""Free-form terms that explain series as well as a named effect, whose name is then not certain."""

from collections.abc import Mapping

import numpy as np

from rover_hil.gap.explain.naming import Naming, set_reach
from rover_hil.gap.explain.parameters import EXPLAIN
from rover_hil.gap.explain.prepare import Prepared
from rover_hil.gap.explain.search import Explanation
from rover_hil.gap.explain.terms import directions
from rover_hil.gap.statistics.fit import Fit
from rover_hil.gap.statistics.score import Projection, one_sided_z, score_all
from sim_backends.models.interface import Array


def find_alternative_terms(prepared: Prepared, naming: Naming, best: Explanation) -> Mapping[str, str]:
    """Return effects of an explanation that a free-form term equals, and the term.

    A term with nearly the same change is the effect as an equation; it is an alternative only where it
    explains more, as another law of that shape.

    Args:
        prepared: Observations and terms; steady experiments give no alternatives.
        naming: For the explanations without one of the effects; those not fitted are skipped.
        best: The explanation.
    """
    if prepared.problem.observations.is_steady:
        return {}
    found = {}
    for name in best.names:
        others = tuple(other for other in best.names if other != name)
        part = naming.tried.get(others)
        if part is None and others:
            continue
        cost = part.cost if part is not None else prepared.start.cost
        start = part.fit if part is not None else prepared.start
        term = equal_term(prepared, start, best.fit, cost - best.cost)
        if term:
            found[name] = term
    return found


def equal_term(
    prepared: Prepared, part: Fit, best: Fit, gain: float, *, is_alike_counted: bool = True
) -> str:
    """Return the best term for the residual of a part of an explanation, if it explains enough.

    Args:
        prepared: Observations and terms.
        part: The fit without what the term would replace.
        best: The fit with it.
        gain: What it explains.
        is_alike_counted: A term of the same shape counts where it explains more; else never.
    """
    noise, observations = prepared.noise, prepared.problem.observations
    effect = _change(prepared, part, best)
    reach = set_reach(noise.freedom)
    enough = {}
    for score in score_all(part, noise, directions(observations, noise, prepared.terms), is_steady=True):
        is_alike = abs(float(score.projected @ effect)) >= EXPLAIN.naming.alike
        if is_alike and not is_alike_counted:
            continue
        explained = one_sided_z(score) ** 2
        if explained >= gain + (reach if is_alike else -reach):
            enough[score.direction.name] = explained
    return max(enough, key=lambda name: enough[name], default="")


def _change(prepared: Prepared, part: Fit, best: Fit) -> Array:
    """Return the change by the effect, whitened and projected, of unit length."""
    problem = prepared.problem
    change = problem.predict(best.point) - problem.predict(part.point)
    projected = Projection(part).apply(prepared.noise.whiten(np.where(np.isfinite(change), change, 0.0)))
    return projected / max(float(np.linalg.norm(projected)), 1e-300)
