"""The judgement of a run of `gap` on a hidden machine: names, sets, sizes, drafts, probabilities."""

from dataclasses import replace
from typing import Any

import pytest

from benchmarks.gap.hidden_judgement import Outcome, draft_place, outcome_of, read_draft
from benchmarks.gap.hidden_table import band, table

ANSWER: dict[str, Any] = {
    "case": "catalogue-1-0",
    "class": "catalogue",
    "machine": "axis",
    "runs": 8,
    "ratio": 4.0,
    "ratio_with_best_other": 2.0,
    "effects": [{"name": "friction", "parameter": "level", "size": 0.5, "is_listed": True}],
    "terms": [],
    "expected": "NAMED",
    "accepted": ["NAMED", "NAMED_SET"],
}


def verdict(name: str, *sets: list[str], verdict: str = "NAMED") -> dict[str, Any]:
    level = {"value": 0.45, "unit": "N", "ci95": [0.4, 0.49]}
    return {
        "verdict": verdict,
        "effects": [{"name": name, "parameters": {"level": level}}],
        "confidence_set": list(sets) or [[name]],
        "base_parameters": [],
    }


def judged(given: dict[str, Any], answer: dict[str, Any] = ANSWER) -> Outcome:
    return outcome_of(answer, 0, given, 3.0, 0, "")


def test_the_hidden_effect_is_right_and_its_size_is_kept() -> None:
    outcome = judged(verdict("friction"))
    assert outcome.is_named_right
    assert outcome.is_in_set
    assert not outcome.is_wrong
    assert outcome.sizes == [{"name": "friction", "size": 0.5, "value": 0.45, "low": 0.4, "high": 0.49}]


def test_another_name_is_wrong_and_so_is_one_too_many() -> None:
    assert judged(verdict("drag")).is_wrong
    both = verdict("friction")
    both["effects"].append({"name": "drag", "parameters": {}})
    assert judged(both).is_wrong
    assert not judged(both).is_named_right


def test_a_set_is_right_with_the_hidden_effect_and_wrong_without() -> None:
    right = judged(verdict("drag", ["drag"], ["friction"], verdict="NAMED_SET"))
    assert (right.is_in_set, right.is_named_right, right.is_wrong) == (True, False, False)
    assert judged(verdict("drag", ["drag"], ["offset"], verdict="NAMED_SET")).is_wrong


def test_a_part_of_what_is_hidden_is_neither_right_nor_wrong() -> None:
    two = [*ANSWER["effects"], {"name": "lag", "parameter": "time", "size": 0.1, "is_listed": True}]
    outcome = judged(verdict("friction"), {**ANSWER, "class": "order", "effects": two})
    assert (outcome.is_in_set, outcome.is_wrong) == (False, False)


@pytest.mark.parametrize("kind", ["outside", "none"])
def test_every_name_is_wrong_where_nothing_of_the_list_is_hidden(kind: str) -> None:
    answer = {**ANSWER, "class": kind, "effects": []}
    assert judged(verdict("friction"), answer).is_wrong
    assert not judged(verdict("friction", verdict="PARTLY_NAMED"), answer).is_wrong


def test_a_base_parameter_that_is_proven_wrong_is_a_name() -> None:
    effect = {"name": "wrong_mass", "parameter": "error", "size": 0.5, "is_listed": True}
    number = {"name": "mass", "nominal": 2.0, "value": 2.45, "ci95": [2.4, 2.6], "is_named": True}
    given = {**verdict("x"), "effects": [], "base_parameters": [number], "confidence_set": [["mass"]]}
    outcome = judged(given, {**ANSWER, "effects": [effect]})
    assert outcome.is_named_right
    assert outcome.sets == [["wrong_mass"]]
    assert outcome.sizes[0]["low"] == pytest.approx(0.4)


def test_drafts_are_read_as_the_documents_write_them() -> None:
    sign = 'effects.term("torque", source="speed", form="sign", size=0.0101, scale=9.54, name="a")'
    product = 'effects.product("torque", sources=("speed", "angle"), size=0.1)'
    beyond = 'effects.threshold("net", source="level", place=0.4, size=0.1)'
    assert read_draft(sign) == ("torque", ["speed"], "sign")
    assert read_draft(product) == ("torque", ["speed", "angle"], "product")
    assert read_draft(beyond) == ("net", ["level"], "threshold")
    terms = [{"port": "torque", "sources": ["angle", "speed"], "forms": ["product"]}]
    assert draft_place(terms, [sign, product]) == 2
    assert draft_place(terms, [sign, beyond]) == 0


def test_nothing_written_is_bad_data_or_a_crash() -> None:
    assert outcome_of(ANSWER, 0, {}, 1.0, 1, "too few").verdict == "BAD_DATA"
    assert outcome_of(ANSWER, 0, {}, 1.0, 2, "line 7").verdict == "CRASH"


def unsure(*names: str) -> list[dict[str, Any]]:
    return [
        {"effects": list(names), "probability": 0.7},
        {"effects": ["none of these"], "probability": 0.3},
    ]


def test_an_explanation_is_right_as_the_hidden_effect_as_its_equation_or_where_nothing_shows() -> None:
    assert judged({**verdict("friction"), "probabilities": unsure("friction")}).probabilities == [
        (["friction"], 0.7)
    ]
    listed = judged(verdict("friction"))
    assert (listed.is_right(["friction"]), listed.is_right(["drag"]), listed.is_right([])) == (
        True,
        False,
        False,
    )
    terms = [
        {"port": "net", "sources": ["speed"], "forms": ["cube"]},
        {"port": "net", "sources": ["angle", "speed"], "forms": ["product"]},
    ]
    outside = judged(verdict("drag"), {**ANSWER, "effects": [], "terms": terms})
    right = [["net += c speed^3"], ["net += c speed angle"]]
    assert [outside.is_right(one) for one in right] == [True, True]
    assert not outside.is_right(["net += c speed |speed|"])
    assert judged(verdict("drag"), {**ANSWER, "ratio": 0.6}).is_right([])


def test_the_table_counts_names_sizes_and_sameness() -> None:
    right = judged(verdict("friction"))
    other = replace(judged(verdict("drag")), variant=1)
    likely = replace(
        judged({**verdict("friction"), "probabilities": unsure("friction")}), case="catalogue-1-1"
    )
    text = table([right, other, likely])
    assert "| wrong NAMED or NAMED_SET | 3 | 33 %" in text
    assert "| in the catalogue: NAMED | 3 | 67 %" in text
    assert f"| intervals that contain the true size | 2 | 0 | {band(2, 0.95)} |" in text
    assert "| cases with two different names | 1 | 1 | 1 |" in text
    assert f"| probability 0.5 to 0.9 (mean 0.70): right | 1 | 1 | {band(1, 0.7)} |" in text
