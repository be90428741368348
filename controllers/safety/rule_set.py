"""Stop rules together: who sees which samples, and what their reasons add to the doubt in the estimate."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from controllers.fault import Cause, Fault, Severity
from controllers.safety.reasons import Cycle, StopRule
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
        self._doubted_rad: dict[tuple[str, Cause], float] = {}

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

    def reasons(self, cycle: Cycle) -> list[Fault]:
        """Return the reasons of this cycle."""
        return [reason for rule in self._rules for reason in rule.check(cycle)]

    def doubts(self, reasons: Sequence[Fault]) -> Iterator[Doubt]:
        """Yield the doubt of each reason when it begins, and what is added to the yaw's while it lasts.

        Signs and suspicions are no doubt.
        """
        before, self._doubted_rad = self._doubted_rad, {}
        for stop in reasons:
            if not stop.adds_uncertainty:
                continue
            known = {**before, **self._doubted_rad}
            before_rad = known.get(stop.key, 0.0)
            self._doubted_rad[stop.key] = max(before_rad, stop.bound.gyro_rad)
            # Variances add up.
            added_rad = math.sqrt(max(0.0, stop.bound.gyro_rad**2 - before_rad**2))
            wheel_rad, path_m = ((), 0.0) if stop.key in known else (stop.bound.wheel_rad, stop.bound.path_m)
            is_unseen = stop.severity not in (Severity.UNCERTAIN, Severity.RECOVERABLE)
            yield Doubt(wheel_rad, added_rad, is_unseen, path_m)


def stops_of(reasons: Sequence[Fault]) -> list[Fault]:
    """Return the reasons that stop a mission."""
    stops_nothing = (Severity.SYMPTOM, Severity.WARNING, Severity.UNCERTAIN)
    return [reason for reason in reasons if reason.severity not in stops_nothing]
