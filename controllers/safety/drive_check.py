"""The stop rules on a drive that somebody else controls: findings are reported and inflate the covariance."""

from collections.abc import Sequence

from controllers.fault import Cause, Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle
from controllers.safety.rule_set import RuleSet
from controllers.safety.settings import SafetySettings, make_drive_rules
from drivers.clock import nanoseconds
from drivers.record import record
from drivers.samples import Sample

OF_HEALTHY_ROVERS = (Severity.UNCERTAIN, Severity.RECOVERABLE)

AGAINST_WHEELS = (
    Cause.GYRO_BEYOND_WHEELS,
    Cause.GYRO_DOES_NOT_FOLLOW,
    Cause.MISSED_TURN,
    Cause.DEAD_GYRO,
    Cause.TURN,
)
"""What a comparison of the gyro with the wheels finds: a wheel that is measured wrongly explains it, too."""

EXPLAINED_NS = nanoseconds(3.0)
"""So long after a fault of the wheels the comparisons still contain their wrong angles; chosen by hand."""


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
    """Asks the rules that do not depend on setpoints, and says what they find when it begins.

    While the wheels are known to be measured wrongly, and shortly after, the gyro is not blamed for what a
    comparison with them finds.

    Args:
        settings: Thresholds.
        roles: Which device is what.
        wheel_count: Number of wheels.
        heading_lag_s: Time constant of the heading devices.

    Attributes:
        findings: That begin in this cycle.
        unconfirmed: What inflates the covariance in this cycle although it is no finding; empty for nothing.
        faults: What inflates the covariance in this cycle.
        is_open: Whether a rule has found that the motion itself may have been measured wrongly. Nothing of
            the drive before or after is then known but how far the wheels have turned.
    """

    def __init__(
        self, settings: SafetySettings, roles: DeviceRoles, wheel_count: int, heading_lag_s: float
    ) -> None:
        self._rules = RuleSet(make_drive_rules(settings, roles, wheel_count, heading_lag_s))
        self._wheels = roles.wheels
        self._wheels_ns: int | None = None
        self._since_ns: dict[tuple[str, Cause], int] = {}
        self._is_past: dict[tuple[str, Cause], bool] = {}
        self.findings: tuple[Finding, ...] = ()
        self.unconfirmed = ""
        self.faults: list[Fault] = []
        self.is_open = False

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take one sample as of `t_ns`."""
        self._rules.observe(sample, t_ns)

    def update(self, cycle: Cycle, estimated: Sequence[Fault] = ()) -> None:
        """Ask the rules about a cycle.

        Args:
            cycle: What they see.
            estimated: Why the wheels may not measure the motion, and what is wrong about the ground, by the
                estimator.
        """
        found = self._rules.faults(cycle)
        recoverable = {fault.key for fault in found if fault.severity in OF_HEALTHY_ROVERS}
        faults = self._unexplained(found, estimated, cycle.now_ns)
        confirmed = [fault for fault in faults if self._is_confirmed(fault)]
        told = [*confirmed, *estimated]
        lasting = [fault._replace(since_ns=self._since_ns.get(fault.key, cycle.now_ns)) for fault in told]
        self._since_ns = {fault.key: fault.since_ns for fault in lasting}
        self.findings = tuple(
            Finding(cause=fault.name, text=fault.text) for fault in lasting if fault.since_ns == cycle.now_ns
        )
        self.faults = [fault for fault in faults if fault.adds_uncertainty]
        unconfirmed = (
            fault.text for fault in faults if fault.severity is Severity.UNCERTAIN and fault not in confirmed
        )
        self.unconfirmed = next(unconfirmed, "")
        self.is_open |= any(fault.bound.is_motion_unknown for fault in confirmed)
        for key in recoverable.union(self._is_past):
            # It is confirmed where it comes again after it had ended.
            self._is_past[key] = self._is_past.get(key, False) or key not in recoverable

    def _unexplained(self, faults: list[Fault], estimated: Sequence[Fault], now_ns: int) -> list[Fault]:
        """Return the faults that a fault of the wheels does not explain."""
        wrong = {(self._wheels, Cause.REPEATS), ("wheels", Cause.STANDING_WHEELS)}
        is_estimated = any(fault.cause is Cause.STUCK_ENCODER for fault in estimated)
        if is_estimated or any(fault.key in wrong for fault in faults):
            self._wheels_ns = now_ns
        if self._wheels_ns is None or now_ns - self._wheels_ns > EXPLAINED_NS:
            return faults
        return [fault for fault in faults if fault.cause not in AGAINST_WHEELS]

    def _is_confirmed(self, fault: Fault) -> bool:
        """Return whether a fault is a finding; a healthy rover may show some once."""
        if fault.severity in OF_HEALTHY_ROVERS:
            return self._is_past.get(fault.key, False)
        return fault.severity is not Severity.SYMPTOM
