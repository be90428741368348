"""Rules of presence, on made-up evidence."""

import numpy as np
import pytest

from controllers.ftrace.ground.frame import is_usable
from controllers.ftrace.parameters import DEFAULTS
from controllers.ftrace.rut.presence import Evidence, Presence
from controllers.ftrace.rut.rut import floor_evidence

START_M, STEP_M, BLOCKS = 0.3, 0.016, 14
LEAST_BLOCKS = DEFAULTS.sections.least_blocks
SIGNATURE = np.array([-2.0, 1.0, -2.0, 3.0, 3.0, -2.0, -1.0, -2.0, 3.0, 3.0]) / np.sqrt(54.0)


def evidence(strength: float, blocks: int = BLOCKS, around: float = 15.0) -> Evidence:
    """Return the evidence of a rut that fills the nearest `blocks` of the view."""
    answers = np.zeros((10, BLOCKS))
    answers[:, :blocks] = np.sqrt(strength / BLOCKS) * SIGNATURE[:, None] * BLOCKS / blocks
    sums = answers.sum(axis=1) / np.sqrt(BLOCKS)
    return Evidence(
        sums=sums,
        strength=float(sums @ sums),
        neighbours=around,
        floor=floor_evidence(answers, LEAST_BLOCKS),
        answers=answers,
    )


def presence_from(start_m: float) -> Presence:
    return Presence(start_m, DEFAULTS.presence, DEFAULTS.sections)


NOTHING = evidence(0.01)
WEAK, CLEAR, STRONG = evidence(80.0), evidence(120.0), evidence(300.0)


def after(presence: Presence, shown: Evidence, frames: int) -> bool:
    return [presence.update(shown, STEP_M) for _ in range(frames)][-1]


def test_a_trace_is_accepted_after_some_frames_of_it() -> None:
    presence = presence_from(START_M)
    after(presence, NOTHING, 30)

    assert not presence.update(WEAK, STEP_M)
    assert after(presence, WEAK, 12)


def test_a_trace_in_view_when_the_drive_begins_is_accepted_with_the_second_frame() -> None:
    presence = presence_from(START_M)

    assert not presence.update(CLEAR, 0.0)
    assert presence.update(CLEAR, STEP_M)


def test_an_unmistakable_one_is_accepted_with_the_first_frame() -> None:
    presence = presence_from(START_M)

    assert presence.update(STRONG, 0.0)


def test_while_the_rover_stands_only_an_unmistakable_trace_is_accepted() -> None:
    presence = presence_from(START_M)

    assert not any(presence.update(CLEAR, 0.0) for _ in range(20))


def test_a_band_of_tone_at_the_start_may_be_a_shadow_until_light_is_known() -> None:
    presence = presence_from(START_M)

    assert not after(presence, with_floor(CLEAR, 1.0), 3)
    assert after(presence, with_floor(CLEAR, 1.0), 3)


@pytest.mark.parametrize(
    ("shown", "frames_before"), [(evidence(300.0, blocks=8), 0), (evidence(30.0), 0), (CLEAR, 1)]
)
def test_before_there_can_be_a_trace_one_that_ends_in_view_is_faint_or_comes_later_is_not_accepted(
    shown: Evidence, frames_before: int
) -> None:
    presence = presence_from(START_M)
    after(presence, NOTHING, frames_before + 1)

    assert not after(presence, shown, 15)


def with_floor(shown: Evidence, floor: float) -> Evidence:
    return Evidence(
        sums=shown.sums,
        strength=shown.strength,
        neighbours=shown.neighbours,
        floor=floor,
        answers=shown.answers,
    )


def one_sided(shown: Evidence) -> Evidence:
    """Return evidence of which the right side is gone."""
    answers = shown.answers.copy()
    answers[:5] = 0.0
    sums = answers.sum(axis=1) / np.sqrt(BLOCKS)
    strength = float(sums @ sums)
    return Evidence(
        sums=sums,
        strength=strength,
        neighbours=shown.neighbours,
        floor=floor_evidence(answers, LEAST_BLOCKS),
        answers=answers,
    )


def test_a_shadow_s_edge_is_not_accepted_however_long() -> None:
    presence = presence_from(START_M)
    after(presence, NOTHING, 30)

    assert not after(presence, one_sided(evidence(150.0)), 200)


def test_a_plain_band_without_a_floor_is_accepted_when_it_was_clear_for_a_while() -> None:
    presence = presence_from(START_M)
    after(presence, NOTHING, 30)
    band = with_floor(STRONG, 1.0)

    assert not after(presence, band, 4)
    assert after(presence, band, 14)


def frames_until_accepted(presence: Presence, shown: Evidence) -> int:
    return next(frame for frame in range(1000) if presence.update(shown, STEP_M))


def test_what_was_seen_before_there_could_be_a_trace_is_accepted_much_later_than_what_is_new() -> None:
    shadow = with_floor(evidence(60.0, blocks=9), 1.0)
    other = Evidence(
        sums=-shadow.sums, strength=shadow.strength, neighbours=15.0, floor=1.0, answers=-shadow.answers
    )
    before, new = (presence_from(START_M) for _ in range(2))
    first = round(START_M / STEP_M) + 1
    for presence, seen in ((before, shadow), (new, other)):
        after(presence, seen, 6)
        after(presence, NOTHING, first)

    assert frames_until_accepted(before, shadow) > 1.5 * frames_until_accepted(new, shadow)


def test_a_plain_band_as_clear_as_others_beside_is_not_accepted() -> None:
    presence = presence_from(START_M)
    after(presence, NOTHING, 30)

    assert not after(presence, with_floor(evidence(150.0, around=300.0), 1.0), 200)


def test_a_floor_for_one_frame_is_not_accepted() -> None:
    presence = presence_from(START_M)
    shown = evidence(80.0, around=200.0)
    after(presence, with_floor(shown, 0.0), 60)

    assert not presence.update(with_floor(shown, 5.0), STEP_M)


def test_the_first_trace_is_accepted_when_the_way_is_long_enough() -> None:
    """Its far end reaches into blocks that it does not fill: measured, it is shorter than it is."""
    presence = presence_from(START_M)
    after(presence, NOTHING, 19)

    assert not presence.update(evidence(200.0, blocks=5), 0.0)
    assert after(presence, evidence(200.0, blocks=5), 8)


def test_less_than_the_length_that_counts_is_not_accepted() -> None:
    presence = presence_from(START_M)
    after(presence, NOTHING, 30)

    assert not after(presence, evidence(200.0, blocks=4), 30)
    assert after(presence, evidence(200.0, blocks=9), 2)


def test_a_trace_that_is_gone_is_lost_at_once_and_comes_back_faster() -> None:
    presence = presence_from(0.0)
    after(presence, STRONG, 20)

    assert not presence.update(NOTHING, STEP_M)
    presence.forget()
    assert presence.update(evidence(80.0, around=120.0), STEP_M)


def test_as_much_beside_does_not_lose_a_trace_that_looks_as_before() -> None:
    presence = presence_from(0.0)
    after(presence, STRONG, 20)

    assert after(presence, evidence(80.0, around=120.0), 20)


def test_a_trace_in_a_shadow_that_looks_as_before_is_kept() -> None:
    presence = presence_from(0.0)
    after(presence, STRONG, 20)

    assert after(presence, with_floor(evidence(70.0, around=150.0), -2.0), 40)


def test_the_weaker_side_of_the_floor_counts() -> None:
    answers = evidence(300.0).answers
    one_sided = answers.copy()
    one_sided[:5] = 0

    assert floor_evidence(answers, LEAST_BLOCKS) > 6
    assert floor_evidence(one_sided, LEAST_BLOCKS) == pytest.approx(0.0)
    assert floor_evidence(answers[:, :2], LEAST_BLOCKS) == 0.0


@pytest.mark.parametrize(
    ("mean", "sd", "usable"), [(120, 10, True), (2, 9, False), (254, 6, False), (120, 0.5, False)]
)
def test_frames_that_show_nothing_are_not_used(mean: float, sd: float, usable: bool) -> None:
    noise = np.random.default_rng(2).normal(mean, sd, (60, 60))
    patch = np.asarray(np.clip(noise, 0, 255), np.uint8)

    assert is_usable(patch, np.ones(patch.shape, np.bool_), DEFAULTS.frame) is usable
