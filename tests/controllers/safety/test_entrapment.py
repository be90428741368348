"""Wheels that turn and do not move the rover."""

import pytest

from controllers.safety.entrapment import EntrapmentRule, EntrapmentSettings
from controllers.safety.reasons import Cycle, Severity, StopReason


class Travel:
    """A rule that is fed with travel of the wheels and slip."""

    def __init__(self) -> None:
        self.rule = EntrapmentRule(EntrapmentSettings())

    def go(self, distance_m: float, slip: float | None) -> list[StopReason]:
        return list(self.rule.check(Cycle(now_ns=0, distance_m=distance_m, slip=slip)))


def test_half_a_metre_of_travel_at_a_slip_near_1_stops_for_good() -> None:
    travel = Travel()
    assert travel.go(0.499, 0.85) == []
    (reason,) = travel.go(0.001, 0.85)
    assert reason.severity is Severity.FINAL
    assert reason.cause == "entrapment"
    assert reason.text == (
        "rover: entrapped, its wheels travelled 0.5 m at a slip of at least 0.85: free it and restart"
    )


def test_smaller_slip_clears() -> None:
    travel = Travel()
    travel.go(0.4, 0.9)
    assert travel.go(0.1, 0.849) == []
    assert travel.go(0.4, 0.9) == []
    assert travel.go(0.1, 0.9) != []


@pytest.mark.parametrize("slip", [None, 0.5])
def test_without_valid_slip_near_1_travel_does_not_count(slip: float | None) -> None:
    assert Travel().go(10.0, slip) == []


def test_unknown_slip_in_between_does_not_clear() -> None:
    travel = Travel()
    travel.go(0.4, 1.0)
    assert travel.go(5.0, None) == []
    assert travel.go(0.1, 1.0) != []
