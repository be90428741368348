"""What the rooms of the workflow hand on."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from rover_hil.gap.explain.gap_test import GapTest
from rover_hil.gap.explain.holdout_validation import Validation
from rover_hil.gap.explain.localise_residuals import ResidualLocation
from rover_hil.gap.explain.naming import Naming
from rover_hil.gap.explain.prepare import Prepared
from rover_hil.gap.explain.residual_equations import Equation
from rover_hil.gap.explain.search import Explanation
from rover_hil.gap.plan import Plan
from rover_hil.gap.verdict import Verdict
from sim_backends.models.interface import Model, Run


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """What the rooms found; later ones are None where an earlier one ended it.

    Attributes:
        prepared: The base model fitted to the runs to learn from.
        gap: Whether there is a gap.
        locations: Where, at the fitted base model.
        naming: Which effects explain it.
        best: The chosen explanation, with derivatives at its fit.
        remaining_gap: Whether a gap is left with it.
        alternatives: Its effects that a term without a name does as well as, and the term.
        equations: What is left, as equations.
        validation: What the locked runs say.
    """

    prepared: Prepared
    gap: GapTest
    locations: tuple[ResidualLocation, ...]
    naming: Naming
    best: Explanation | None = None
    remaining_gap: GapTest | None = None
    alternatives: Mapping[str, str] = field(default_factory=dict)
    equations: tuple[Equation, ...] = ()
    validation: Validation | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Analysis:
    """Everything a report is made of."""

    model: Model
    verdict: Verdict
    runs: tuple[Run, ...]
    plan: Plan | None
    findings: Findings | None
