"""Too much unmeasured motion: when it stops, for how long, and what a stop adds to the doubt."""

from dataclasses import replace

import pytest

from controllers.estimation.filter.guarded_filter import Innovation
from controllers.estimation.filter.measurement_model import Measured
from controllers.roles import DeviceRoles
from controllers.safety import SafetySupervisor
from controllers.safety.estimate_rules import DisplacedFixRule, FixJumpRule, UnseenMotionRule, UnseenSettings
from controllers.safety.reasons import Cycle, Severity, StopReason
from controllers.safety.rule_set import RuleSet
from controllers.safety.settings import SafetySettings

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
    assert list(rule.check(Cycle(now_ns=0, unseen_m=0.15, unseen_rad=0.1))) == []
    needs = {Severity.STOP: "needs a fix", Severity.FINAL: RESTART}
    assert list(rule.check(Cycle(now_ns=0, unseen_m=0.16, unseen_rad=0.11))) == [
        StopReason(
            "unseen position",
            f"pose filter: position uncertain by 0.16 m, motion was not measured: {needs[position]}",
            position,
        ),
        StopReason(
            "unseen yaw",
            f"pose filter: yaw uncertain by 0.11 rad, motion was not measured: {needs[yaw]}",
            yaw,
        ),
    ]


def test_a_stop_adds_the_doubt_of_its_wheels_once_and_that_of_the_yaw_as_it_grows() -> None:
    rules = RuleSet([])

    def doubts(*stops: StopReason) -> list[tuple[tuple[float, ...], float]]:
        return [(doubt.wheel_rad, round(doubt.yaw_rad, 9)) for doubt in rules.doubts(stops)]

    first = StopReason("stall", "", wheel_rad=(1.0, 2.0), yaw_rad=0.3)
    assert doubts(first, first) == [((1.0, 2.0), 0.3), ((), 0.0)]
    # 0.5 squared less 0.3 squared: variances add up.
    assert doubts(first._replace(yaw_rad=0.5)) == [((), 0.4)]
    assert doubts(first._replace(yaw_rad=0.4)) == [((), 0.0)]
    assert doubts(first._replace(yaw_rad=0.5)) == [((), 0.0)]
    assert doubts() == []
    assert doubts(first) == [((1.0, 2.0), 0.3)]


def test_a_stop_of_a_cycle_is_in_its_doubts() -> None:
    supervisor = SafetySupervisor(SafetySettings(bumper_stops=False), NOTHING, 1)
    assert supervisor.doubts == []
    for index in range(60):
        supervisor.update(
            Cycle(
                now_ns=index * 20_000_000,
                motion_ns=index * 20_000_000,
                commanded_rad_s=(2.0,),
                measured_rad_s=(0.0,),
            )
        )
        if supervisor.doubts:
            break
    (doubt,) = supervisor.doubts
    assert doubt.wheel_rad == pytest.approx((2.0,))
    assert doubt.yaw_rad == doubt.path_m == 0.0
    assert doubt.is_unseen


def test_the_path_on_which_the_yaw_became_wrong_is_told_once() -> None:
    rules = RuleSet([])
    doubt = StopReason("gyro", "", Severity.DOUBT, yaw_rad=0.3, path_m=2.0)
    assert [each.path_m for each in rules.doubts([doubt])] == [2.0]
    assert [each.path_m for each in rules.doubts([doubt._replace(path_m=3.0)])] == [0.0]


def innovation(name: str, residual: float | None) -> Innovation:
    return Innovation(
        measured=Measured(*name.split(" ", 1)), residual=residual, variance=None, nis=None, accepted=True
    )


def test_a_displaced_fix_that_was_taken_stops_beyond_the_limits_of_unseen_motion() -> None:
    rule = DisplacedFixRule(UnseenSettings(unseen_position_m=0.5, unseen_yaw_rad=1.5))
    allowed = (
        innovation("overhead x", 9.0),
        innovation("overhead displaced", 0.5),
        innovation("overhead turned", 1.5),
        innovation("overhead displaced", None),
    )
    assert list(rule.check(Cycle(now_ns=0, innovations=allowed))) == []
    beyond = (*allowed, innovation("overhead displaced", 0.51), innovation("overhead turned", 1.51))
    cause = "rover carried, device moved, or wheels slipped more than [filter] expects"
    assert list(rule.check(Cycle(now_ns=0, innovations=beyond))) == [
        StopReason(
            "overhead displaced",
            f"overhead: fixes {by} against the estimate: {cause}",
        )
        for by in ("displaced by 0.51 m", "turned by 1.51 rad")
    ]


def test_the_rule_names_the_device_as_long_as_its_places_are_off() -> None:
    rule = FixJumpRule(UnseenSettings())
    assert not [*rule.check(Cycle(now_ns=0, jumped_m={"gnss": 0.1 + 0j}))]
    for _ in range(2):
        (reason,) = rule.check(Cycle(now_ns=0, jumped_m={"gnss": 0.6 - 0.8j}))
        assert reason.text.startswith("gnss: its places jumped by 1.00 m")
