"""Results that the steps of the workflow pass on."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from rover_hil.gap.explain.gap_test import GapTest
from rover_hil.gap.explain.holdout_validation import Validation
from rover_hil.gap.explain.localise_residuals import ResidualLocation
from rover_hil.gap.explain.naming import Naming
from rover_hil.gap.explain.prepare import Prepared
from rover_hil.gap.explain.residual_equations import Equation
from rover_hil.gap.explain.search import Explanation
from rover_hil.gap.machines.analysis import MachineFindings
from rover_hil.gap.machines.next_run.proposal import Proposal
from rover_hil.gap.plan import Plan
from rover_hil.gap.verdict import Verdict
from sim_backends.models.interface import Model, Run


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """Results of the steps; None for steps that were not reached.

    Attributes:
        prepared: The base model fitted to the runs to learn from.
        gap: Whether there is a gap.
        locations: Where model and data differ, at the fitted base model.
        naming: Which effects explain it.
        best: The chosen explanation, with derivatives at its fit.
        remaining_gap: Test for a gap that remains with it.
        alternatives: Its effects that a free-form term equals, and the term.
        equations: Equations for the remaining gap.
        validation: Result on the locked runs.
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
    """Content of a report.

    Attributes:
        machine: Findings on a machine, in place of `findings`.
        proposal: The next run of a machine; None where nothing is open.
    """

    model: Model
    verdict: Verdict
    runs: tuple[Run, ...]
    plan: Plan | None
    findings: Findings | None
    machine: MachineFindings | None = None
    proposal: Proposal | None = None
