"""Evidence of a trace in strips of ground that are seen in many frames."""

import numpy as np
import pytest

from controllers.ftrace.parameters import DEFAULTS
from controllers.ftrace.rut.strips import KERNELS, Stretch, TraceStrips
from controllers.ground_motion.ground_patch import Floats

BLOCK_M, BLOCKS, STEP_M = 0.04, 14, 0.016
S_M: Floats = np.asarray((np.arange(BLOCKS) + 0.5) * BLOCK_M, np.float64)
ALL = np.ones(BLOCKS, np.bool_)
TRACE: Floats = np.tile([0.2, 0.1, -0.3, 1.2, 1.2], 2)
"""Answers of the kernels on a plain trace."""


def drive(
    distance_m: float,
    *,
    bare_from_m: float = 1e9,
    image: Floats | None = None,
    seed: int = 1,
    may_overlap: bool = False,
    trace: Floats = TRACE,
) -> tuple[TraceStrips, Stretch]:
    """Drive over ground with a trace from 0 m to `bare_from_m`; `image` is added to each frame."""
    rng = np.random.default_rng(seed)
    strips = TraceStrips(S_M, may_overlap, DEFAULTS.strips)
    noise = rng.normal(0, DEFAULTS.strips.strip_sd, (400, 2 * KERNELS))
    for travelled_m in np.arange(0, distance_m, STEP_M):
        place_m = travelled_m - S_M
        grain = noise[np.floor(place_m / BLOCK_M).astype(int) + 100]
        laid = (place_m > 0) & (place_m < bare_from_m)
        answers = grain + laid[:, None] * trace + (0 if image is None else image)
        strips.update(answers[None], ALL, 0.0 if travelled_m == 0 else STEP_M)
    return strips, strips.stretch(ALL, ALL)


def test_evidence_grows_with_the_length_of_the_trace_and_bare_ground_speaks_against_it() -> None:
    short, long = (drive(length_m)[1] for length_m in (0.25, 0.5))
    bare = [drive(1.0, bare_from_m=0.0, seed=seed)[1].log_odds for seed in range(20)]

    assert DEFAULTS.presence.lock_odds < short.log_odds < long.log_odds
    assert max(bare) < DEFAULTS.presence.keep_odds


def test_more_views_of_the_same_ground_are_not_more_evidence() -> None:
    strips, once = drive(0.5)
    for _ in range(50):
        strips.update(np.zeros((1, BLOCKS, 2 * KERNELS)), ALL, 0.0)

    assert strips.stretch(ALL, ALL).log_odds == once.log_odds


def test_a_shadow_fixed_to_a_part_of_the_view_is_not_a_trace() -> None:
    """Each strip of ground is seen outside of the shadow more often than in it."""
    shadow = np.zeros((BLOCKS, 2 * KERNELS))
    shadow[5:8] = 2 * TRACE

    assert drive(1.5, bare_from_m=0.0, image=shadow)[1].log_odds < DEFAULTS.presence.keep_odds


def test_the_end_of_the_trace() -> None:
    strips, whole = drive(1.0)
    _, ending = drive(1.0, bare_from_m=0.8)

    assert whole.fills_view
    assert abs(whole.length_m - (BLOCKS - 1) * BLOCK_M) < 2 * BLOCK_M
    assert ending.length_m < whole.length_m
    assert not strips.stretch(ALL, S_M < 0.3).fills_view


def test_a_single_frame_of_a_searched_curve_counts_less() -> None:
    answers = np.tile(TRACE, (1, BLOCKS, 1))
    strips, _ = drive(1.0)

    found = strips.stretch_at_once(answers, ALL)

    assert found.log_odds > DEFAULTS.presence.lock_odds
    assert round(found.length_m / BLOCK_M) == BLOCKS
    assert strips.stretch_at_once(answers, S_M < 0.1).log_odds == -np.inf


@pytest.mark.parametrize("hidden", [0, 1])
def test_an_edge_may_lie_in_the_imprint_of_the_front_wheel(hidden: int) -> None:
    """The other edge alone is that of a trace; without a wheel ahead it may as well be that of a shadow."""
    one_edge = TRACE * np.repeat([hidden == 1, hidden == 0], KERNELS)
    seeds = range(10)
    found = [drive(1.0, trace=one_edge, may_overlap=True, seed=seed)[1] for seed in seeds]
    alone = [drive(1.0, trace=one_edge, may_overlap=False, seed=seed)[1] for seed in seeds]
    bare = [drive(1.0, bare_from_m=0.0, may_overlap=True, seed=seed)[1].log_odds for seed in seeds]

    assert [stretch.hidden for stretch in found].count(hidden) >= 9
    assert all(stretch.hidden is None for stretch in alone)
    gain = np.median([stretch.log_odds for stretch in found]) - np.median([s.log_odds for s in alone])
    assert gain > 1.0
    assert max(bare) < DEFAULTS.presence.keep_odds


def test_both_edges_of_a_plain_trace_are_visible_also_where_a_wheel_runs_ahead() -> None:
    assert drive(1.0, may_overlap=True)[1].hidden is None
