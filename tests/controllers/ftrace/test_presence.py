"""When a trace is reported."""

from dataclasses import replace

import numpy as np
import pytest

from controllers.ftrace.parameters import DEFAULTS
from controllers.ftrace.rut.presence import Presence
from controllers.ftrace.rut.strips import KERNELS, Stretch

NUMBERS = DEFAULTS.presence
START_M, KNOWN_M, STEP_M = 0.3, 0.06, 0.016
CLEAR = Stretch(
    log_odds=20.0,
    length_m=0.4,
    fills_view=True,
    is_followed=False,
    reading=0,
    hidden=None,
    sums=np.ones(2 * KERNELS),
)
NOTHING = replace(CLEAR, log_odds=-6.0)


def odds(log_odds: float) -> Stretch:
    return replace(CLEAR, log_odds=log_odds)


def under_way() -> Presence:
    """Return the presence of a trace on a rover that has left enough of it."""
    presence = Presence(START_M, KNOWN_M, NUMBERS)
    presence.update(NOTHING, START_M + 0.1)
    return presence


def test_a_trace_that_was_present_needs_less_evidence_than_one_that_appears() -> None:
    between = odds((NUMBERS.keep_odds + NUMBERS.lock_odds) / 2)
    presence = under_way()

    assert not presence.update(between, STEP_M)
    assert presence.update(CLEAR, STEP_M)
    assert presence.update(between, STEP_M)
    assert not presence.update(NOTHING, STEP_M)
    assert not presence.update(between, STEP_M)


def test_a_trace_that_was_present_is_not_lost_for_a_part_of_it_at_the_wheel() -> None:
    part = replace(CLEAR, length_m=0.16, fills_view=False)
    end = replace(part, fills_view=True)
    presence = under_way()

    assert not presence.update(part, STEP_M)
    assert presence.update(CLEAR, STEP_M)
    assert presence.update(part, STEP_M)
    assert not presence.update(end, STEP_M)


def test_before_the_wheel_can_have_left_a_trace_only_one_that_persists_and_fills_the_view_is_accepted() -> (
    None
):
    beginning = replace(CLEAR, fills_view=False)
    for shown, expected in ((beginning, False), (CLEAR, True)):
        presence = Presence(START_M, KNOWN_M, NUMBERS)
        found = [presence.update(shown, STEP_M) for _ in range(12)]

        assert found[-1] is expected
        assert not any(found[: int((KNOWN_M + NUMBERS.persists_m) / STEP_M)])


def test_a_trace_begun_before_the_drive_is_accepted_once_its_ground_was_followed() -> None:
    for length_m, expected in ((0.2, True), (0.16, False)):
        begun = replace(CLEAR, fills_view=False, is_followed=True, length_m=length_m)
        presence = Presence(START_M, KNOWN_M, NUMBERS)
        found = [presence.update(begun, STEP_M) for _ in range(12)]

        assert found[-1] is expected


def test_what_is_fixed_in_the_picture_shows_no_trace_before_it_is_known() -> None:
    presence = Presence(START_M, KNOWN_M, NUMBERS)
    for _ in range(int(KNOWN_M / STEP_M)):
        presence.update(CLEAR, STEP_M)
    faint = odds(NUMBERS.lock_odds - 1.0)

    assert not any(presence.update(shown, STEP_M) for shown in (faint, faint, faint, faint, CLEAR, CLEAR))


def test_evidence_that_has_ended_shows_no_trace() -> None:
    presence = Presence(START_M, KNOWN_M, NUMBERS)
    strong = [presence.update(CLEAR, STEP_M) for _ in range(int((KNOWN_M + NUMBERS.persists_m) / STEP_M))]

    assert not any(strong)
    assert not any(presence.update(odds(0.0), STEP_M) for _ in range(10))


def test_what_was_seen_before_the_trace_was_present_bridges_nothing() -> None:
    presence = Presence(START_M, KNOWN_M, NUMBERS)
    for _ in range(12):
        presence.update(replace(CLEAR, fills_view=False), STEP_M)
    assert presence.update(odds(NUMBERS.bridged_odds), STEP_M)

    assert not presence.update(odds((NUMBERS.bridge_odds + NUMBERS.keep_odds) / 2), STEP_M)


def test_standing_still_no_trace_appears() -> None:
    presence = Presence(START_M, KNOWN_M, NUMBERS)

    assert not any(presence.update(CLEAR, 0.0) for _ in range(50))


def test_the_signature_follows_the_trace_and_outlasts_it() -> None:
    presence = under_way()
    presence.update(CLEAR, STEP_M)
    presence.forget()

    assert not presence.locked
    assert np.allclose(presence.signature, 1 / np.sqrt(2 * KERNELS))


def test_a_shadow_over_the_trace_is_bridged_but_not_for_ever() -> None:
    shaded = odds((NUMBERS.bridge_odds + NUMBERS.keep_odds) / 2)
    presence = under_way()
    presence.update(CLEAR, STEP_M)
    found = [presence.update(shaded, STEP_M) for _ in range(40)]

    assert sum(found) == pytest.approx(NUMBERS.bridged_m / STEP_M, abs=1)
    assert not any(found[sum(found) :])
    assert presence.update(CLEAR, STEP_M)
    assert presence.update(shaded, STEP_M)
