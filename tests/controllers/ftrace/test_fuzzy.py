import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.ftrace.hough.fuzzy import Candidate, confidence, falls
from controllers.ftrace.parameters import DEFAULTS

WIDTH_M = 0.1
MOST_RAD = math.radians(35)
BEST = Candidate(theta_rad=0.0, offset_m=0.0, width_m=WIDTH_M, support=1.0)


def match(candidate: Candidate, last: Candidate | None = BEST) -> float:
    return confidence(candidate, WIDTH_M, MOST_RAD, last, DEFAULTS.fuzzy)


def test_a_perfect_candidate() -> None:
    assert match(BEST) == pytest.approx(1.0)


@pytest.mark.parametrize(
    "worse",
    [
        Candidate(theta_rad=1.1 * MOST_RAD, offset_m=0.0, width_m=WIDTH_M, support=1.0),
        Candidate(theta_rad=0.0, offset_m=0.06, width_m=WIDTH_M, support=1.0),
        Candidate(theta_rad=0.0, offset_m=0.0, width_m=1.4 * WIDTH_M, support=1.0),
        Candidate(theta_rad=0.0, offset_m=0.0, width_m=None, support=1.0),
        Candidate(theta_rad=0.0, offset_m=0.0, width_m=WIDTH_M, support=0.2),
    ],
    ids=["angle", "contact", "width", "single edge", "support"],
)
def test_each_difference_costs_confidence(worse: Candidate) -> None:
    assert match(worse, None) < 0.9


def test_continuity_counts_only_after_the_first_trace() -> None:
    turned = Candidate(theta_rad=math.radians(15), offset_m=0.0, width_m=WIDTH_M, support=1.0)

    assert match(turned) < 0.05
    assert match(turned, None) == pytest.approx(1.0)


def test_steeper_than_the_rig_allows() -> None:
    steep = Candidate(theta_rad=1.3 * MOST_RAD, offset_m=0.0, width_m=WIDTH_M, support=1.0)

    assert match(steep, None) < 0.05


@given(st.floats(-10, 10))
def test_membership_stays_between_0_and_1(value: float) -> None:
    assert 0.0 <= falls(value, 1.0, 2.0) <= 1.0
