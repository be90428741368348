"""The stop rules on a drive that somebody else controls: what they find is told, and widens the estimate."""

from controllers.estimation.suspicion import Suspicion
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, Severity, StopReason
from controllers.safety.rule_set import Doubt, RuleSet
from controllers.safety.settings import SafetySettings, make_drive_rules
from drivers.record import record
from drivers.samples import Sample

SUSPICION = "wheels contradicted"
"""Cause of a finding of the estimator."""

OF_HEALTHY_ROVERS = (Severity.DOUBT, Severity.RECOVERABLE)


@record(frozen=True, slots=True, kw_only=True)
class Finding:
    """What a rule has found.

    Attributes:
        cause: Its name, the same each time.
        text: What, where, with the numbers, and what would explain it.
    """

    cause: str
    text: str


class DriveCheck:
    """Asks the rules that do not depend on set-points, and says what they find when it begins.

    Args:
        settings: Thresholds.
        roles: Which device is what.
        wheel_count: Number of wheels.
        heading_lag_s: Time constant of the heading devices.

    Attributes:
        findings: That begin in this cycle.
        doubt: What widens the estimate in this cycle although it is no finding; empty for nothing.
        doubts: What the findings of this cycle add to the doubt in the estimate.
        is_open: Whether a rule has found that the motion itself may have been measured wrongly. Nothing of
            the drive before or after is then known but how far the wheels have turned.
    """

    def __init__(
        self, settings: SafetySettings, roles: DeviceRoles, wheel_count: int, heading_lag_s: float
    ) -> None:
        self._rules = RuleSet(make_drive_rules(settings, roles, wheel_count, heading_lag_s))
        self._lasting: set[str] = set()
        self._suspicion: Suspicion | None = None
        self._suspected: dict[str, bool] = {}
        self.findings: tuple[Finding, ...] = ()
        self.doubt = ""
        self.doubts: list[Doubt] = []
        self.is_open = False

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take one sample as of `t_ns`."""
        self._rules.observe(sample, t_ns)

    def update(self, cycle: Cycle, suspicion: Suspicion | None = None) -> None:
        """Ask the rules about a cycle.

        Args:
            cycle: What they see.
            suspicion: Why the wheels may not measure the motion, by the estimator; None for no such reason.
        """
        reasons = self._rules.reasons(cycle)
        confirmed_reasons = [reason for reason in reasons if self._is_found(reason)]
        self.findings = tuple(
            Finding(cause=reason.cause, text=reason.text)
            for reason in confirmed_reasons
            if reason.cause not in self._lasting
        )
        if suspicion is not None and suspicion != self._suspicion:
            self.findings += (Finding(cause=SUSPICION, text=suspicion.text),)
        self._suspicion = suspicion
        self._lasting = {reason.cause for reason in confirmed_reasons}
        self.doubts = list(self._rules.doubts(reasons))
        unfound = (
            each.text for each in reasons if each.severity is Severity.DOUBT and each not in confirmed_reasons
        )
        self.doubt = next(unfound, "")
        self.is_open |= any(reason.leaves_motion_open for reason in confirmed_reasons)
        recoverable = {reason.cause for reason in reasons if reason.severity in OF_HEALTHY_ROVERS}
        for cause in recoverable.union(self._suspected):
            # It is found where it comes again after it had ended.
            self._suspected[cause] = self._suspected.get(cause, False) or cause not in recoverable

    def _is_found(self, reason: StopReason) -> bool:
        """Return whether a reason is a finding; a healthy rover may show some once."""
        if reason.severity in OF_HEALTHY_ROVERS:
            return self._suspected.get(reason.cause, False)
        return reason.severity is not Severity.SIGN
