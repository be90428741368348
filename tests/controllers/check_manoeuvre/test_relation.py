"""The relation of two sources: intervals that hold the true slope, and verdicts that slip does not change."""

import math

import numpy as np
import pytest

from controllers.check_manoeuvre.relation import Array, Interval, Places, relate, relate_places
from controllers.check_manoeuvre.verdict import (
    WITH_SKIDDING_WHEELS,
    WITH_WHEELS,
    WITHOUT_WHEELS,
    Verdict,
    judge,
    judge_places,
)

TRIALS = 400
TURNED = np.concatenate((np.linspace(0, 0.35, 30), np.linspace(0.35, -0.35, 60), np.linspace(-0.35, 0, 30)))
"""Yaw of a rover that rotates to both sides, rad."""


def covered(slopes: list[Interval], true: float) -> float:
    return sum(slope.low <= true <= slope.high for slope in slopes) / len(slopes)


def slopes_of(
    true: float, x_sd: float, y_sd: float, *, memory: float = 0.0, drift_rad_s: float = 0.0
) -> list[Interval]:
    """Return the slopes of seeded trials; errors of y keep `memory` of the one before."""
    found = []
    for seed in range(TRIALS):
        rng = np.random.default_rng(seed)
        noise = rng.normal(0.0, y_sd, len(TURNED))
        for step in range(1, len(noise)):
            noise[step] = memory * noise[step - 1] + math.sqrt(1.0 - memory**2) * noise[step]
        time_s: Array = 0.1 * np.arange(len(TURNED), dtype=np.float64)
        y = 0.7 + true * TURNED + drift_rad_s * time_s + noise
        x = TURNED + rng.normal(0.0, x_sd, len(TURNED))
        relation = relate(x, y, x_sd=x_sd, y_sd=0.0, time_s=time_s if drift_rad_s else None)
        assert relation is not None
        found.append(relation.slope)
    return found


@pytest.mark.parametrize("true", [1.0, 0.5, -1.0, 0.0])
@pytest.mark.parametrize(
    ("x_sd", "y_sd", "drift_rad_s"), [(0.0, 0.05, 0.0), (0.0, 0.02, 0.05), (0.03, 0.05, 0.0)]
)
def test_the_interval_holds_the_true_slope_in_95_percent(
    true: float, x_sd: float, y_sd: float, drift_rad_s: float
) -> None:
    assert 0.92 <= covered(slopes_of(true, x_sd, y_sd, drift_rad_s=drift_rad_s), true) <= 0.98


def test_errors_that_last_make_the_interval_wider() -> None:
    slow, quick = slopes_of(1.0, 0.0, 0.05, memory=0.8), slopes_of(1.0, 0.0, 0.05)
    assert covered(slow, 1.0) >= 0.9
    assert np.mean([each.high - each.low for each in slow]) > 2.0 * np.mean(
        [each.high - each.low for each in quick]
    )


def test_known_noise_is_the_least_that_the_interval_allows_for() -> None:
    exact = relate(TURNED, TURNED, y_sd=0.05)
    assert exact is not None
    assert exact.slope.value == pytest.approx(1.0)
    assert exact.slope.high - exact.slope.low == pytest.approx(
        3.96 * 0.05 / math.sqrt(np.var(TURNED) * 120), rel=0.02
    )
    assert exact.correlation.value == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("x", "y"),
    [([0.0, 1.0, 2.0], [0.0, 1.0, 2.0]), ([1.0] * 20, list(range(20))), ([math.nan] * 20, [1.0] * 20)],
    ids=["few", "no motion", "not finite"],
)
def test_without_a_motion_there_is_no_relation(x: list[float], y: list[float]) -> None:
    assert relate(x, y) is None


def test_a_source_whose_noise_is_its_motion_has_no_relation() -> None:
    assert relate(TURNED, TURNED, x_sd=0.3) is None


def test_the_correlation_has_an_interval() -> None:
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(TRIALS):
        x = rng.normal(size=50)
        relation = relate(x, 0.5 * x + math.sqrt(0.75) * rng.normal(size=50))
        assert relation is not None
        held += relation.correlation.low <= 0.5 <= relation.correlation.high
    assert 0.91 <= held / TRIALS <= 0.98


@pytest.mark.parametrize("slip", [0.0, 0.1, 0.3])
@pytest.mark.parametrize("y_sd", [0.005, 0.05])
def test_sound_sources_are_never_blamed_for_slip(slip: float, y_sd: float) -> None:
    verdicts = {judge(slope, WITH_WHEELS) for slope in slopes_of(1.0 - slip, 0.0, y_sd)}
    assert verdicts == {Verdict.AGREES}


@pytest.mark.parametrize(
    ("true", "verdict"),
    [(-1.0, Verdict.OPPOSITE), (0.0, Verdict.DOES_NOT_FOLLOW), (0.5, Verdict.SCALE), (2.0, Verdict.SCALE)],
)
def test_a_wrong_source_is_found_in_nearly_every_trial(true: float, verdict: Verdict) -> None:
    verdicts = [judge(slope, WITH_WHEELS) for slope in slopes_of(true, 0.0, 0.01)]
    assert sum(each is verdict for each in verdicts) >= 0.99 * TRIALS


def test_noise_that_hides_the_sign_decides_nothing() -> None:
    assert judge(Interval(0.4, -0.2, 1.0), WITH_WHEELS) is Verdict.NOT_COMPARED
    assert judge(None, WITH_WHEELS) is Verdict.NOT_COMPARED
    assert judge(Interval(math.nan, math.nan, math.nan), WITH_WHEELS) is Verdict.NOT_COMPARED


def test_the_ranges_are_those_that_are_documented() -> None:
    ranges = [*WITH_WHEELS, *WITHOUT_WHEELS, *WITH_SKIDDING_WHEELS]
    assert ranges == pytest.approx([0.595, 1.38, 0.7, 1.3, 0.17, 1.38])


def forth_and_back() -> Places:
    """Return positions on lines of 0.3 m at +20 and -20 deg."""
    line = np.concatenate((np.linspace(0, 0.3, 12), np.linspace(0.3, 0, 12)))
    return np.concatenate([line * np.exp(1j * angle) for angle in (0.35, -0.35)])


@pytest.mark.parametrize("turned_rad", [0.0, 1.0, 3.0])
@pytest.mark.parametrize(
    ("scale", "verdict"), [(1.0, Verdict.AGREES), (0.7, Verdict.AGREES), (0.3, Verdict.SCALE)]
)
def test_positions_in_axes_of_any_direction_agree(turned_rad: float, scale: float, verdict: Verdict) -> None:
    for seed in range(50):
        rng = np.random.default_rng(seed)
        places = forth_and_back()
        noise = rng.normal(0, 0.01, len(places)) + 1j * rng.normal(0, 0.01, len(places))
        relation = relate_places(places, 5.0 + scale * places * np.exp(1j * turned_rad) + noise, 0.01)
        assert relation is not None
        expected = {verdict, Verdict.NOT_COMPARED} if verdict is Verdict.SCALE else {verdict}
        assert judge_places(relation, math.nan, WITH_WHEELS) in expected


@pytest.mark.parametrize(
    "mirror", [np.conj, lambda places: -np.conj(places), lambda places: 1j * np.conj(places)]
)
def test_mirrored_positions_are_found(mirror: object) -> None:
    assert callable(mirror)
    for seed in range(50):
        rng = np.random.default_rng(seed)
        places = forth_and_back()
        noise = rng.normal(0, 0.01, len(places)) + 1j * rng.normal(0, 0.01, len(places))
        relation = relate_places(places, mirror(places) + noise, 0.01)
        assert judge_places(relation, math.nan, WITH_WHEELS) is Verdict.MIRRORED


def test_on_one_line_nothing_shows_whether_axes_are_mirrored() -> None:
    line: Places = np.linspace(0.0, 0.6, 30).astype(np.complex128)
    relation = relate_places(line, np.conj(line), 0.01)
    assert relation is not None
    assert judge_places(relation, math.nan, WITH_WHEELS) is Verdict.NOT_COMPARED


def test_the_direction_of_travel_is_compared_where_the_source_measures_its_yaw() -> None:
    places = forth_and_back()
    relation = relate_places(places, -places, 0.01)
    assert judge_places(relation, 0.0, WITH_WHEELS) is Verdict.DIRECTION
    assert judge_places(relation, 3.0, WITH_WHEELS) is Verdict.AGREES
    assert relate_places(places[:3], places[:3], 0.01) is None
    assert judge_places(None, 0.0, WITH_WHEELS) is Verdict.NOT_COMPARED
