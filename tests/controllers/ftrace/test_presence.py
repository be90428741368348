"""Rules of presence, on made-up evidence."""

import numpy as np
import pytest

from controllers.ftrace.frame import is_usable
from controllers.ftrace.presence import Evidence, Presence
from controllers.ftrace.rut import floor_evidence

START_M, STEP_M, BLOCKS = 0.3, 0.016, 14
LOOK = np.array([-2.0, 1.0, -2.0, 3.0, 3.0, -2.0, -1.0, -2.0, 3.0, 3.0]) / np.sqrt(54.0)


def evidence(strength: float, blocks: int = BLOCKS, around: float = 15.0) -> Evidence:
    """Return the evidence of a rut that fills the nearest `blocks` of the view."""
    answers = np.zeros((10, BLOCKS))
    answers[:, :blocks] = np.sqrt(strength / BLOCKS) * LOOK[:, None] * BLOCKS / blocks
    sums = answers.sum(axis=1) / np.sqrt(BLOCKS)
    return Evidence(
        sums=sums,
        strength=float(sums @ sums),
        around=around,
        floor=floor_evidence(answers),
        answers=answers,
    )


NOTHING = evidence(0.01)
WEAK, STRONG = evidence(80.0), evidence(300.0)


def after(presence: Presence, shown: Evidence, frames: int) -> bool:
    return [presence.judge(shown, STEP_M) for _ in range(frames)][-1]


def test_a_trace_is_believed_after_some_frames_of_it() -> None:
    presence = Presence(START_M)
    after(presence, NOTHING, 30)

    assert not presence.judge(WEAK, STEP_M)
    assert after(presence, WEAK, 12)


def test_before_there_can_be_a_trace_only_an_unmistakable_one_is_believed() -> None:
    assert not after(Presence(START_M), WEAK, 15)
    assert after(Presence(START_M), STRONG, 1)


def with_floor(shown: Evidence, floor: float) -> Evidence:
    return Evidence(
        sums=shown.sums, strength=shown.strength, around=shown.around, floor=floor, answers=shown.answers
    )


def test_a_shadow_s_edge_is_not_believed_however_strong() -> None:
    presence = Presence(START_M)
    after(presence, NOTHING, 30)

    assert not after(presence, with_floor(STRONG, 3.0), 60)
    assert after(presence, with_floor(STRONG, 4.0), 1)


def test_a_floor_for_one_frame_is_not_believed() -> None:
    presence = Presence(START_M)
    after(presence, with_floor(WEAK, 0.0), 60)

    assert not presence.judge(with_floor(WEAK, 5.0), STEP_M)


def test_less_than_the_length_that_counts_is_not_believed() -> None:
    presence = Presence(START_M)
    after(presence, NOTHING, 30)

    assert not after(presence, evidence(200.0, blocks=4), 30)
    assert after(presence, evidence(200.0, blocks=9), 2)


def test_a_trace_that_is_gone_is_lost_at_once_and_comes_back_faster() -> None:
    presence = Presence(0.0)
    after(presence, STRONG, 20)

    assert not presence.judge(NOTHING, STEP_M)
    presence.forget()
    assert presence.judge(evidence(80.0, around=120.0), STEP_M)


def test_as_much_beside_does_not_lose_a_trace_that_looks_as_before() -> None:
    presence = Presence(0.0)
    after(presence, STRONG, 20)

    assert after(presence, evidence(80.0, around=120.0), 20)


def test_the_weaker_side_of_the_floor_counts() -> None:
    answers = evidence(300.0).answers
    one_sided = answers.copy()
    one_sided[:5] = 0

    assert floor_evidence(answers) > 6
    assert floor_evidence(one_sided) == pytest.approx(0.0)
    assert floor_evidence(answers[:, :2]) == 0.0


@pytest.mark.parametrize(
    ("mean", "sd", "usable"), [(120, 10, True), (2, 9, False), (254, 6, False), (120, 0.5, False)]
)
def test_frames_that_show_nothing_are_not_used(mean: float, sd: float, usable: bool) -> None:
    noise = np.random.default_rng(2).normal(mean, sd, (60, 60))
    patch = np.asarray(np.clip(noise, 0, 255), np.uint8)

    assert is_usable(patch, np.ones(patch.shape, np.bool_)) is usable
