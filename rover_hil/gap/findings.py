"""Content of a report."""

from dataclasses import dataclass

from rover_hil.gap.decision.analysis import MachineFindings
from rover_hil.gap.next_run.proposal import Proposal
from rover_hil.gap.plan import Plan
from rover_hil.gap.verdict import Verdict
from sim_backends.models.interface import Model, Run


@dataclass(frozen=True, slots=True, kw_only=True)
class Analysis:
    """Content of a report.

    Attributes:
        model: That was analysed.
        verdict: On it.
        runs: All measured runs.
        plan: None where the runs could not be split.
        machine: Findings; None where the data could not be used.
        proposal: The next run; None where nothing is open.
    """

    model: Model
    verdict: Verdict
    runs: tuple[Run, ...]
    plan: Plan | None
    machine: MachineFindings | None = None
    proposal: Proposal | None = None
