"""Stop rules together: who sees which samples, and what they find."""

from collections.abc import Sequence

from controllers.fault import Fault, Severity
from controllers.safety.reasons import Cycle, StopRule
from drivers.samples import Sample


class RuleSet:
    """Asks stop rules in their order.

    Args:
        rules: The likelier cause first.
    """

    def __init__(self, rules: Sequence[StopRule]) -> None:
        self._rules = rules
        self._observers: dict[type[Sample], list[StopRule]] = {}

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take one sample as of `t_ns`."""
        kind = type(sample)
        if kind not in self._observers:
            # Most rules need no samples or only some, and there are many samples.
            self._observers[kind] = [
                rule
                for rule in self._rules
                if type(rule).observe is not StopRule.observe
                if issubclass(kind, rule.observes)
            ]
        for rule in self._observers[kind]:
            rule.observe(sample, t_ns)

    def faults(self, cycle: Cycle) -> list[Fault]:
        """Return the faults of this cycle."""
        return [fault for rule in self._rules for fault in rule.check(cycle)]


def stops_of(faults: Sequence[Fault]) -> list[Fault]:
    """Return the faults that stop a mission."""
    stops_nothing = (Severity.SYMPTOM, Severity.WARNING, Severity.UNCERTAIN)
    return [fault for fault in faults if fault.severity not in stops_nothing]
