"""A receiver whose position stays while the rover drives."""

import itertools

import pytest

from controllers.fault import Bound, Cause, ClearedBy, Fault
from controllers.roles import DeviceRoles
from controllers.safety.frozen_position_rule import FrozenPositionRule
from controllers.safety.reasons import Operation
from drivers.clock import nanoseconds
from drivers.samples import PoseFixSample
from tests.cases import first_often
from tests.controllers.safety.cycles import make_cycle

ROLES = DeviceRoles(wheels="wheels", required={}, fixes=("gnss",))


CLOCK = itertools.count(1)


def driven(
    rule: FrozenPositionRule,
    places_m: list[float],
    *,
    is_still: bool = False,
    device: str = "gnss",
    is_new: bool = True,
) -> list[list[Fault]]:
    """Return the faults after each position, five a second, 2 cm apart by the wheels."""
    found = []
    for x_m in places_m:
        t_ns = nanoseconds(0.2 * next(CLOCK))
        rule.observe(
            PoseFixSample(
                device=device, t_ns=t_ns, x_m=x_m, y_m=1.0, yaw_rad=0.0, position_std_m=0.02,
                yaw_std_rad=10.0, t_capture_ns=t_ns if is_new else 0,
            ),
            t_ns,
        )  # fmt: skip
        distance_m = 0.0 if is_still else 0.02
        found.append(list(rule.check(make_cycle(now_ns=t_ns, is_still=is_still, distance_m=distance_m))))
    return found


@pytest.mark.parametrize(("different", "most"), first_often([(80, 6), (20, 9), (0, 34)]))
def test_a_receiver_whose_position_stays_is_named(different: int, most: int) -> None:
    rule = FrozenPositionRule(ROLES)
    driven(rule, [-0.02])  # the first is taken at standstill
    assert not any(driven(rule, [0.02 * index for index in range(different)]))
    faults = driven(rule, [0.02 * different] * (most + 2))
    first = next(index for index, each in enumerate(faults) if each)
    assert first <= most
    (fault,) = faults[-1]
    assert (fault.source, fault.cause) == ("gnss", Cause.FROZEN_POSITION)
    assert fault.cleared_by is ClearedBy.OPERATOR
    assert fault.text.startswith(f"gnss: the same position {most + 1} times while the wheels rolled 0.")
    assert fault.bound.position_m == pytest.approx(0.02 * (most + 2))
    assert fault.bound == Bound(position_m=fault.bound.position_m)
    # While the rover waits the fault stays; another position ends it.
    assert driven(rule, [0.02 * different] * 5, is_still=True)[-1]
    rule.check(make_cycle(now_ns=0, distance_m=0.0))
    assert not any(driven(rule, [5.1]))


def test_an_operator_may_confirm_that_the_rover_moves_on() -> None:
    rule = FrozenPositionRule(ROLES)
    driven(rule, [0.02 * index for index in range(80)])
    assert any(driven(rule, [5.0] * 10))
    assert not [*rule.check(make_cycle(now_ns=0)._replace(operation=Operation(is_confirmed=True)))]
    assert any(driven(rule, [5.0] * 10))


def test_a_receiver_that_creeps_within_its_noise_may_be_right() -> None:
    rule = FrozenPositionRule(ROLES)
    driven(rule, [0.02 * index for index in range(80)])
    assert not any(driven(rule, [5.0] * 3))
    # Six more are too many for chance, and no path.
    for _ in range(6):
        assert not any(driven(rule, [5.0], is_still=True))


def test_a_position_that_is_sent_again_with_its_old_time_is_none() -> None:
    rule = FrozenPositionRule(ROLES)
    driven(rule, [0.02 * index for index in range(80)])
    assert not any(driven(rule, [5.0] * 50, is_new=False))


def test_at_standstill_a_position_may_stay() -> None:
    rule = FrozenPositionRule(ROLES)
    driven(rule, [0.02 * index for index in range(80)])
    rule.check(make_cycle(now_ns=0, is_still=True))
    assert not any(driven(rule, [5.0] * 500, is_still=True))


def test_positions_that_are_often_equal_may_be_equal() -> None:
    """A receiver with coarse digits on a slow rover: two in three are as the one before."""
    rule = FrozenPositionRule(ROLES)
    assert not any(driven(rule, [float(index // 3) for index in range(300)]))
    assert not any(driven(rule, [500.0] * 30))


def test_other_devices_are_not_judged() -> None:
    rule = FrozenPositionRule(ROLES)
    driven(rule, [0.02 * index for index in range(80)])
    assert not any(driven(rule, [5.0] * 50, device="tracker"))
