"""The rule about the area, alone, in the supervisor and in the loop."""

import math

import numpy as np
import pytest

from controllers.control_loop import ControlLoop, StepOutput
from controllers.fault import ClearedBy, Fault, Severity
from controllers.motion.body_motion import BodyMotion
from controllers.motion.settings import ByHandMission, MissionSettings, WaypointsMission
from controllers.operator import OperatorInput
from controllers.roles import DeviceRoles
from controllers.safety.area import Area, CircleArea, PolygonArea
from controllers.safety.area_rule import AreaRule
from controllers.safety.reasons import Cycle
from controllers.safety.settings import SafetySettings
from controllers.safety.supervisor import Mode, SafetySupervisor
from drivers.errors import ConfigError
from tests.controllers.safety.cycles import changed, make_cycle
from tests.controllers.simulated import PERIOD_NS, ROLES, SimulatedRover, make_settings, omni_rover

MOVES = (1.0,)
BODY_M = math.hypot(0.125, 0.04)
"""Outermost point of the wheels of the simulated rover."""


def cycle(over_m: float, *, is_confirmed: bool = False, is_led_out: bool = False) -> Cycle:
    return make_cycle(
        now_ns=0,
        motion_ns=0,
        commanded_rad_s=MOVES,
        measured_rad_s=MOVES,
        over_border_m=over_m,
        x_m=1.0,
        y_m=-2.0,
        is_confirmed=is_confirmed,
        is_led_out=is_led_out,
    )


def only(rule: AreaRule, seen: Cycle) -> Fault | None:
    reasons = list(rule.check(seen))
    assert len(reasons) <= 1
    return reasons[0] if reasons else None


def crossed() -> AreaRule:
    rule = AreaRule()
    assert only(rule, cycle(-0.1)) is None
    assert only(rule, cycle(0.0)) is None  # it touches the border
    reason = only(rule, cycle(0.02))
    assert reason is not None
    assert reason.severity is Severity.STOP
    assert reason.cleared_by is ClearedBy.OPERATOR
    assert "crossed the border of safety.area, estimated position 1.00, -2.00 m" in reason.text
    assert "`rover-hil bench`" in reason.text
    return rule


def waits(reason: Fault | None) -> bool:
    return reason is not None and reason.severity is Severity.STOP and reason.cleared_by is ClearedBy.OPERATOR


def test_a_stop_holds_until_the_operator_confirms_also_where_the_region_is_inside_again() -> None:
    rule = crossed()
    assert waits(only(rule, cycle(0.05)))
    assert waits(only(rule, cycle(-0.05)))
    assert only(rule, cycle(-0.05, is_confirmed=True)) is None
    assert waits(only(rule, cycle(0.01)))


def test_a_confirmation_before_the_stop_or_with_it_does_not_count() -> None:
    rule = AreaRule()
    assert only(rule, cycle(-0.1, is_confirmed=True)) is None
    assert waits(only(rule, cycle(0.01, is_confirmed=True)))
    assert waits(only(rule, cycle(0.01)))


def test_after_a_confirmation_the_greatest_excess_must_not_grow() -> None:
    rule = crossed()
    assert waits(only(rule, cycle(0.05)))
    back = only(rule, cycle(0.04, is_confirmed=True))
    assert back is not None
    assert back.severity is Severity.WARNING
    assert back.cleared_by is not ClearedBy.OPERATOR
    for over_m in (0.05, 0.03, 0.05):  # as far as it has been
        assert not waits(only(rule, cycle(over_m)))
    assert waits(only(rule, cycle(0.0501)))
    assert waits(only(rule, cycle(0.03)))
    assert not waits(only(rule, cycle(0.03, is_confirmed=True)))
    assert only(rule, cycle(0.0)) is None
    assert only(rule, cycle(-0.01)) is None
    assert waits(only(rule, cycle(0.01)))
    assert not waits(only(rule, cycle(0.01, is_confirmed=True)))
    assert waits(only(rule, cycle(0.0101)))  # that of before is forgotten


def test_a_mission_that_leads_out_stops_again() -> None:
    rule = crossed()
    assert not waits(only(rule, cycle(0.01, is_confirmed=True)))
    assert waits(only(rule, cycle(0.005, is_led_out=True)))
    assert waits(only(rule, cycle(0.005)))


def test_a_position_that_is_not_known_cannot_be_confirmed() -> None:
    rule = AreaRule()
    reason = only(rule, cycle(math.inf))
    assert waits(reason)
    assert reason is not None
    assert "position is not known" in reason.text
    assert waits(only(rule, cycle(math.inf, is_confirmed=True)))
    assert waits(only(rule, cycle(0.2)))
    assert not waits(only(rule, cycle(0.1, is_confirmed=True)))
    assert waits(only(rule, cycle(math.inf)))


def test_before_the_first_motion_the_reason_ends_by_itself() -> None:
    rule = AreaRule()
    at_rest = make_cycle(now_ns=0, commanded_rad_s=(0.0,), over_border_m=0.1)
    reason = only(rule, at_rest)
    assert reason is not None
    assert reason.severity is Severity.STOP
    assert reason.cleared_by is not ClearedBy.OPERATOR
    assert "before it has moved" in reason.text
    assert only(rule, changed(at_rest, over_border_m=-0.1)) is None
    assert AreaRule.observes == ()


def test_stops_that_an_operator_ends_are_never_final_and_a_final_stop_waits_for_nobody() -> None:
    settings = SafetySettings(settle_s=0.0, recover_s=0.0)
    supervisor = SafetySupervisor(settings, DeviceRoles(wheels="wheels", required={}), 1)

    def update(
        over_m: float, *, is_confirmed: bool = False, estimate_is_finite: bool = True
    ) -> tuple[Mode, bool]:
        seen = cycle(over_m, is_confirmed=is_confirmed)
        supervisor.update(seen if estimate_is_finite else changed(seen, x_m=math.inf))
        return supervisor.mode, supervisor.waits_for_operator

    for _ in range(5):
        assert update(-0.1) == (Mode.RUNNING, False)
        assert update(0.1) == (Mode.SAFE_STOP, True)
        assert update(0.1, is_confirmed=True) == (Mode.RUNNING, False)
    assert update(0.2) == (Mode.SAFE_STOP, True)
    for over_m in (-0.1, 0.3):
        assert update(over_m, estimate_is_finite=False) == (Mode.SAFE_STOP, True)
    for _ in range(4):
        update(-0.1, is_confirmed=True)
        update(-0.1, estimate_is_finite=False)
    assert update(0.5) == (Mode.EMERGENCY_STOP, False)


# ---- the loop ----

ROOM = PolygonArea(type="polygon", points_m=((-0.6, -0.6), (0.6, -0.6), (0.6, 0.6), (-0.6, 0.6), (-0.9, 0.0)))
ROUND = CircleArea(type="circle", centre_m=(0.0, 0.0), radius_m=0.6)


def make_loop(area: Area, mission: MissionSettings | None = None) -> ControlLoop:
    by_hand = ByHandMission(type="by_hand", speed_m_s=0.2)
    safety = SafetySettings(settle_s=0.1, recover_s=0.1, area=area)
    return ControlLoop(make_settings(mission=mission or by_hand, safety=safety), ROLES)


def steps(
    loop: ControlLoop,
    rover: SimulatedRover,
    duration_s: float,
    motion: BodyMotion | None = None,
    *,
    is_confirmed: bool = False,
) -> list[StepOutput]:
    """Run the loop while someone drives by hand, and confirm once before."""
    outputs: list[StepOutput] = []
    for _ in range(round(duration_s * 1e9 / PERIOD_NS)):
        samples = rover.advance(rover.t_ns + PERIOD_NS)
        loop.operate(rover.t_ns, OperatorInput(motion=motion, is_confirmed=is_confirmed))
        is_confirmed = False
        outputs.append(loop.step(rover.t_ns, samples))
        rover.set_point_rad_s = np.array(outputs[-1].command.speed_rad_s)
    return outputs


def over_m(output: StepOutput, area: Area) -> float:
    """Return by how far the region of an output is over the border, by the points of its ellipse."""
    xx, xy, _, yy, _, _ = output.estimate.covariance
    values, vectors = np.linalg.eigh([[xx, xy], [xy, yy]])
    angles = np.linspace(0.0, 2.0 * np.pi, 2000)
    sizes = np.sqrt(5.991464547107979 * np.maximum(values, 0.0))
    x, y = vectors @ (sizes[:, None] * np.array([np.cos(angles), np.sin(angles)]))
    x, y = x + output.estimate.x_m, y + output.estimate.y_m
    if isinstance(area, CircleArea):
        return float(np.hypot(x, y).max()) + BODY_M - area.radius_m
    return float(x.max()) + BODY_M - 0.6  # the border that the tests cross


@pytest.mark.parametrize("area", [ROOM, ROUND], ids=["polygon", "circle"])
def test_the_set_points_are_zero_in_the_cycle_in_which_the_region_crosses(area: Area) -> None:
    loop, rover = make_loop(area), omni_rover()
    outputs = steps(loop, rover, 3.5, (0.2, 0.0, 0.0))
    first = next(number for number, output in enumerate(outputs) if over_m(output, area) > 1e-6)
    assert over_m(outputs[first - 1], area) <= 1e-6
    assert any(outputs[first - 1].command.speed_rad_s)
    for output in outputs[first:]:
        assert output.mode is Mode.SAFE_STOP
        assert not any(output.command.speed_rad_s)
        assert output.waits_for_operator
        assert "safety.area" in output.reason
    assert not any(output.waits_for_operator for output in outputs[:first])
    assert rover.place.real < 0.6 - BODY_M + 0.02


def test_by_hand_only_motion_back_inside_is_possible_after_the_confirmation() -> None:
    loop, rover = make_loop(ROOM), omni_rover()
    steps(loop, rover, 3.5, (0.2, 0.0, 0.0))
    stopped_at = rover.place
    outward = steps(loop, rover, 0.5, (0.2, 0.1, 0.0), is_confirmed=True)
    assert outward[-1].mode is Mode.RUNNING
    assert "back inside" in outward[-1].suspicion
    assert not any(any(output.command.speed_rad_s) for output in outward)
    assert abs(rover.place - stopped_at) < 1e-6
    turning = steps(loop, rover, 0.4, (0.0, 0.0, 0.3))
    assert any(turning[-1].command.speed_rad_s)  # the place stays
    steps(loop, rover, 0.4, (0.0, 0.0, -0.3))
    inward = steps(loop, rover, 1.0, (-0.1, 0.0, 0.0))
    assert inward[-1].mode is Mode.RUNNING
    assert not inward[-1].suspicion
    assert over_m(inward[-1], ROOM) < 0.0
    again = steps(loop, rover, 2.0, (0.2, 0.0, 0.0))
    assert again[-1].mode is Mode.SAFE_STOP
    assert again[-1].waits_for_operator


def test_a_mission_that_goes_on_outward_stops_again_and_does_not_move() -> None:
    """The way is inside: the region of a slipping rover is not."""
    mission = WaypointsMission(type="waypoints", points=((0.0, 0.46),), speed_m_s=0.2)
    loop, rover = make_loop(ROOM, mission), omni_rover()
    outputs = steps(loop, rover, 3.5)
    assert outputs[-1].waits_for_operator
    place = rover.place
    again = steps(loop, rover, 1.0, is_confirmed=True)
    assert again[-1].waits_for_operator
    assert Mode.RUNNING in {output.mode for output in again}
    assert not any(any(output.command.speed_rad_s) for output in again)
    assert abs(rover.place - place) < 1e-6


@pytest.mark.parametrize(
    ("points", "area", "words"),
    [
        (
            ((0.5, 0.0),),
            ROOM,
            "^mission: on the line from 0, 0 to 0.5, 0 m the body of 0.131 m radius is outs",
        ),
        (((0.3, 0.0), (0.3, 0.2), (0.5, 0.0)), ROUND, "^mission: on the line from 0.3, 0.2 to 0.5, 0 m"),
        (
            ((0.1, 0.0),),
            CircleArea(type="circle", centre_m=(1.0, 0.0), radius_m=1.0),
            "^safety.area: the rover starts at 0, 0 m, and its body of 0.131 m",
        ),
    ],
)
def test_a_plan_that_leaves_the_area_is_refused(
    points: tuple[tuple[float, float], ...], area: Area, words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        make_loop(area, WaypointsMission(type="waypoints", points=points))


def test_a_plan_along_the_border_is_possible() -> None:
    place = 0.6 - BODY_M
    make_loop(ROOM, WaypointsMission(type="waypoints", points=((place, 0.0), (place, place))))


def test_without_an_area_nothing_is_watched() -> None:
    loop, rover = ControlLoop(make_settings(mission=ByHandMission(type="by_hand")), ROLES), omni_rover()
    outputs = steps(loop, rover, 2.0, (0.2, 0.0, 0.0))
    assert outputs[-1].mode is Mode.RUNNING
    assert not outputs[-1].waits_for_operator
