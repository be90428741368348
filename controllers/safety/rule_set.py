"""Stop rules together: who sees which samples, and what their reasons add to the doubt in the estimate."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from controllers.safety.reasons import Cycle, Severity, StopReason, StopRule
from drivers.samples import Sample


class Doubt(NamedTuple):
    """What a stop adds to the doubt in the estimate.

    Attributes:
        wheel_rad: Greatest error of the angle of each wheel, signed; empty for none.
        yaw_rad: Greatest error of the yaw.
        is_unseen: Whether it may keep the rover stopped, as motion that was not measured.
        path_m: Distance driven before, on which the yaw may have become wrong.
    """

    wheel_rad: tuple[float, ...]
    yaw_rad: float
    is_unseen: bool
    path_m: float = 0.0


class RuleSet:
    """Asks stop rules in their order.

    Args:
        rules: The likelier cause first.
    """

    def __init__(self, rules: Sequence[StopRule]) -> None:
        self._rules = rules
        self._observers: dict[type[Sample], list[StopRule]] = {}
        self._doubted_rad: dict[str, float] = {}

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

    def reasons(self, cycle: Cycle) -> list[StopReason]:
        """Return the reasons of this cycle."""
        return [reason for rule in self._rules for reason in rule.check(cycle)]

    def doubts(self, reasons: Sequence[StopReason]) -> Iterator[Doubt]:
        """Yield the doubt of each reason when it begins, and what is added to the yaw's while it lasts.

        Signs and suspicions are no doubt.
        """
        before, self._doubted_rad = self._doubted_rad, {}
        for stop in reasons:
            if stop.severity in (Severity.SIGN, Severity.SUSPICION):
                continue
            known = {**before, **self._doubted_rad}
            before_rad = known.get(stop.cause, 0.0)
            self._doubted_rad[stop.cause] = max(before_rad, stop.yaw_rad)
            # Variances add up.
            added_rad = math.sqrt(max(0.0, stop.yaw_rad**2 - before_rad**2))
            wheel_rad, path_m = ((), 0.0) if stop.cause in known else (stop.wheel_rad, stop.path_m)
            is_unseen = stop.severity not in (Severity.DOUBT, Severity.RECOVERABLE)
            yield Doubt(wheel_rad, added_rad, is_unseen, path_m)


def stops_of(reasons: Sequence[StopReason]) -> list[StopReason]:
    """Return the reasons that stop a mission."""
    stops_nothing = (Severity.SIGN, Severity.SUSPICION, Severity.DOUBT)
    return [reason for reason in reasons if reason.severity not in stops_nothing]
