"""Answers along the edges of curves."""

import numpy as np

from controllers.ftrace.parameters import DEFAULTS
from controllers.ftrace.rut.rut import CrossSections, RutFinder
from controllers.ground_motion.ground_patch import GroundPatch
from tests.controllers.ftrace.rigs import geometry


def made_up() -> tuple[RutFinder, CrossSections]:
    ground = GroundPatch(geometry())
    finder = RutFinder(ground, DEFAULTS.sections)
    detail = np.random.default_rng(3).normal(0, 0.1, finder.inner.shape).astype(np.float32)
    return finder, finder.cross_sections(detail, finder.roughness(detail))


def test_a_block_of_which_one_edge_is_out_of_view_counts_for_nothing() -> None:
    finder, sections = made_up()
    here, outside = np.zeros((1, finder.blocks)), np.full((1, finder.blocks), 5.0)

    ((whole, count),) = finder.along(sections, (here, here), finder.blocks)
    ((half, none),) = finder.along(sections, (here, outside), finder.blocks)

    assert count[0] >= 6
    assert np.abs(whole).max() > 0.0
    assert none[0] == 0
    assert not half.any()
    assert not finder.answers_on(sections, (here, outside))[1].any()


def test_each_edge_is_answered_by_its_own_side() -> None:
    finder, sections = made_up()
    here, aside = np.zeros((1, finder.blocks)), np.full((1, finder.blocks), 0.04)

    both, other, mixed = (
        finder.along(sections, edges, finder.blocks)[0][0][0]
        for edges in ((here, here), (aside, aside), (here, aside))
    )

    assert np.allclose(mixed[:5], both[:5])
    assert np.allclose(mixed[5:], other[5:])
    assert not np.allclose(both, other)


def test_a_hidden_edge_has_no_part_in_the_place_of_the_trace() -> None:
    finder, sections = made_up()
    here, far = np.zeros(finder.blocks), np.full(finder.blocks, 0.06)
    seen = np.repeat([1.0, 0.0], 5)

    one, other = (finder.points(sections, here, (here, left), seen) for left in (here, far))

    assert len(one.s_m) >= 3
    assert np.array_equal(one.y_m, other.y_m)
