"""A verdict on a measured set against its expectation: verdict, names, sizes, first draft, tolerance."""

from typing import Any

import pytest

from benchmarks.gap.measured_expectations import Expectation, differences, read_expectations

EXPECTED = Expectation(
    reason="",
    verdicts=["PARTLY_NAMED", "NAMED_SET"],
    must=["friction"],
    names=["friction", "offset", "mass"],
    sizes={"level": (20.0, 20.4)},
)


def verdict(*members: list[str], **changes: Any) -> dict[str, Any]:
    return {
        "verdict": "NAMED_SET" if len(members) > 1 else "PARTLY_NAMED",
        "sentence": "",
        "effects": [{"name": "friction", "parameters": {"level": {"ci95": [19.0, 21.0]}}}],
        "confidence_set": list(members),
        "base_parameters": [{"name": "mass", "is_named": False, "pull": 0.1}],
        "error_budget": {"force": {"model_error_before": 2.0, "tolerance": 1.0}},
        "gap": {"force": {"before": 0.7, "noise_floor": 0.6}},
        "draft": [{"term": "a"}, {"term": "b"}],
        **changes,
    }


def test_what_is_expected_has_no_difference() -> None:
    assert differences(EXPECTED, verdict(["friction"])) == []
    assert differences(EXPECTED, verdict(["friction"], ["friction", "offset"])) == []


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (verdict(["friction"], verdict="NAMED"), ["not PARTLY_NAMED or NAMED_SET"]),
        (verdict(["offset"]), ["friction is not named"]),
        (verdict(["friction"], ["friction", "drag"]), ["drag is named"]),
        (
            verdict(["friction"], error_budget={"force": {"model_error_before": 0.9, "tolerance": 1.0}}),
            ["a name below the tolerance"],
        ),
        (
            verdict(["friction"], base_parameters=[{"name": "track", "is_named": True, "pull": 4.0}]),
            ["track is named"],
        ),
        (
            verdict(["friction"], effects=[{"name": "x", "parameters": {"level": {"ci95": [10.0, 19.0]}}}]),
            ["level of x is outside 20.0 to 20.4"],
        ),
    ],
)
def test_each_difference_is_stated(given: dict[str, Any], words: list[str]) -> None:
    assert differences(EXPECTED, given) == words


def test_a_base_parameter_that_took_the_gap_on_itself_is_no_name_below_the_tolerance() -> None:
    small = {"force": {"model_error_before": 0.9, "tolerance": 1.0}}
    far = [{"name": "mass", "is_named": True, "pull": -8.0}]
    assert differences(EXPECTED, verdict(["friction"], error_budget=small, base_parameters=far)) == []


def test_a_learned_noise_contains_the_gap_that_the_test_runs_show() -> None:
    small = {"force": {"model_error_before": 0.0, "tolerance": 1.0}}
    shown = {"force": {"before": 2.0, "noise_floor": 1.0}}
    assert differences(EXPECTED, verdict(["friction"], error_budget=small, gap=shown)) == []


def test_the_first_draft_and_words_of_the_sentence_are_compared() -> None:
    expected = Expectation(reason="", verdicts=["UNNAMED"], draft="a", says="57.3")
    nothing = verdict(verdict="UNNAMED", effects=[], sentence="it is 57.3 times as large")
    assert differences(expected, nothing) == []
    other = {**nothing, "draft": [{"term": "b"}], "sentence": ""}
    assert differences(expected, other) == [
        "the first draft is b, not a",
        "the sentence does not say 57.3",
    ]


def test_every_expectation_has_verdicts_and_a_reason() -> None:
    for expected in read_expectations().values():
        assert expected.verdicts
        assert expected.reason
        assert set(expected.must) <= set(expected.names)
