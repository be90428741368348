"""Too much unmeasured motion: when it stops, for how long, and what a stop adds to the doubt."""

from dataclasses import replace

import pytest

from controllers.estimation.filter.guarded_filter import Innovation, Outcome
from controllers.estimation.filter.measurement_model import Measured
from controllers.fault import Cause, Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.estimate_rules import (
    DifferentMotionRule,
    DisplacedFixRule,
    FixJumpRule,
    UnseenMotionRule,
    UnseenSettings,
)
from tests.controllers.safety.cycles import make_cycle

NOTHING = DeviceRoles(wheels="wheels", required={})
COMPASS = replace(NOTHING, headings=("compass",))
CAMERA = replace(NOTHING, fixes=("overhead",))
RESTART = "needs a restart at a known pose"


@pytest.mark.parametrize(
    ("roles", "position", "yaw"),
    [
        (NOTHING, Severity.FINAL, Severity.FINAL),
        (COMPASS, Severity.FINAL, Severity.STOP),
        (CAMERA, Severity.STOP, Severity.STOP),
    ],
)
def test_a_stop_is_final_where_no_device_can_find_the_rover(
    roles: DeviceRoles, position: Severity, yaw: Severity
) -> None:
    rule = UnseenMotionRule(UnseenSettings(), roles)
    assert list(rule.check(make_cycle(now_ns=0, unobserved_m=0.15, unobserved_rad=0.1))) == []
    needs = {Severity.STOP: "needs a fix", Severity.FINAL: RESTART}
    assert list(rule.check(make_cycle(now_ns=0, unobserved_m=0.16, unobserved_rad=0.11))) == [
        Fault(
            "position",
            Cause.UNOBSERVED_MOTION,
            f"pose filter: position uncertain by 0.16 m, motion was not measured: {needs[position]}",
            position,
        ),
        Fault(
            "yaw",
            Cause.UNOBSERVED_MOTION,
            f"pose filter: yaw uncertain by 0.11 rad, motion was not measured: {needs[yaw]}",
            yaw,
        ),
    ]


def innovation(name: str, residual: float | None) -> Innovation:
    return Innovation(
        measured=Measured(*name.split(" ", 1)),
        residual=residual,
        variance=None,
        nis=None,
        outcome=Outcome.ACCEPTED,
    )


def test_a_displaced_fix_that_was_taken_stops_beyond_the_limits_of_unseen_motion() -> None:
    rule = DisplacedFixRule(UnseenSettings(unseen_position_m=0.5, unseen_yaw_rad=1.5))
    allowed = (
        innovation("overhead x", 9.0),
        innovation("overhead displaced", 0.5),
        innovation("overhead turned", 1.5),
        innovation("overhead displaced", None),
    )
    assert list(rule.check(make_cycle(now_ns=0, innovations=allowed))) == []
    beyond = (*allowed, innovation("overhead displaced", 0.51), innovation("overhead turned", 1.51))
    cause = "rover carried, device moved, or wheels slipped more than [filter] expects"
    assert list(rule.check(make_cycle(now_ns=0, innovations=beyond))) == [
        Fault(
            "overhead",
            Cause.DISPLACED_POSITION,
            f"overhead: fixes {by} against the estimate: {cause}",
        )
        for by in ("displaced by 0.51 m", "turned by 1.51 rad")
    ]


def test_the_rule_names_the_device_as_long_as_its_places_are_off() -> None:
    rule = FixJumpRule(UnseenSettings())
    assert not [*rule.check(make_cycle(now_ns=0, jumped_m={"gnss": 0.1 + 0j}))]
    for _ in range(2):
        (reason,) = rule.check(make_cycle(now_ns=0, jumped_m={"gnss": 0.6 - 0.8j}))
        assert reason.text.startswith("gnss: its places jumped by 1.00 m")


def test_positions_that_move_otherwise_than_the_wheels_are_a_warning() -> None:
    rule = DifferentMotionRule()
    assert not [*rule.check(make_cycle(now_ns=0))]
    (warning,) = rule.check(make_cycle(now_ns=0, unexpected_m={"gnss": 0.3 - 0.4j}))
    assert (warning.source, warning.cause, warning.severity) == (
        "gnss",
        Cause.DIFFERENT_MOTION,
        Severity.WARNING,
    )
    assert warning.text.startswith("gnss and the wheels: their ways differ by 0.50 m")
