"""The reference page of safety has a row for every rule, and its tests, settings and reasons exist."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from annotated_types import Ge, Le

from controllers.roles import DeviceRoles
from controllers.safety.reasons import StopRule
from controllers.safety.settings import SafetySettings, make_drive_rules, make_rules
from docs.generate.safety_page import events, rules, safety_page
from drivers.safety_event import Outcome, SafetyEvent

ROOT = Path(__file__).parents[3]
PAGE = safety_page()
EVENTS = tuple(events())
TESTS = sorted({tuple(test.split("::")) for event in EVENTS for test in event.tests})
PRODUCT = [file for part in ("drivers", "controllers", "rover_hil") for file in (ROOT / part).rglob("*.py")]
ROWS = {
    cells[1].strip().strip("`"): [cell.strip() for cell in cells[2:6]]
    for cells in (line.split("|") for line in PAGE.splitlines())
    if len(cells) == 8
}


def strings_in(node: ast.AST) -> Iterator[str]:
    """Yield the strings of the code except rows; an f-string gives the parts between its values."""
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "SafetyEvent":
        return
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    for child in ast.iter_child_nodes(node):
        yield from strings_in(child)


def test_every_row_in_the_code_is_on_the_page() -> None:
    written = sum(len(re.findall(r"\n +SafetyEvent\(", file.read_text("utf-8"))) for file in PRODUCT)
    assert len(EVENTS) == written
    assert len(set(EVENTS)) == written


def test_every_rule_has_rows_of_its_own() -> None:
    assert [rule for rule in rules() if not vars(rule).get("events")] == []


@pytest.mark.parametrize("event", EVENTS, ids=lambda event: event.event)
def test_every_row_is_complete(event: SafetyEvent) -> None:
    assert event.event.endswith((".", "`"))
    assert event.result
    assert event.tests
    if event.outcome is Outcome.STOPS:
        assert event.within
        assert event.clears


@pytest.mark.parametrize(("file", "name"), TESTS)
def test_every_test_that_a_row_names_exists(file: str, name: str) -> None:
    assert re.search(rf"^def {name}\(", (ROOT / file).read_text(encoding="utf-8"), re.MULTILINE)


def test_the_rows_name_tests() -> None:
    assert len(TESTS) > 80


def test_the_reasons_on_the_page_are_those_of_the_code() -> None:
    trees = [ast.parse(file.read_text("utf-8")) for file in PRODUCT]
    texts = "\n".join(text for tree in trees for text in strings_in(tree))
    quoted = {
        part.strip(" ,-")
        for event in EVENTS
        if event.outcome in (Outcome.STOPS, Outcome.ENDS)
        for reason in re.findall(r"`([^`]+ [^`]+)`", event.result)
        for part in re.split(r"…|[;:(]|[\d.]+(?= )", reason)
    }
    assert len(quoted) > 50
    assert sorted(part for part in quoted if part not in texts) == []


@pytest.mark.parametrize("key", sorted({key for event in EVENTS for key in event.settings if "." in key}))
def test_every_other_key_that_a_row_names_exists(key: str) -> None:
    table, _, name = key.rpartition(".")
    page = (ROOT / "docs/reference/configuration.md").read_text("utf-8")
    sections = re.findall(rf"^## \[{table}\].*?(?=^## |\Z)", page, re.MULTILINE | re.DOTALL)
    assert any(f"\n| `{name}` |" in section for section in sections)


@pytest.mark.parametrize("key", SafetySettings.model_fields)
def test_every_setting_is_on_the_page_with_its_range_and_default(key: str) -> None:
    field = SafetySettings.model_fields[key]
    bounds = {type(item): item for item in field.metadata}
    expected = ""
    if key != "area" and field.annotation is not bool:
        low, high = bounds[Ge], bounds[Le]
        assert isinstance(low, Ge)
        assert isinstance(high, Le)
        expected = f"{low.ge:g} to {high.le:g}"
    assert ROWS[key][2:] == [expected, str(field.default).lower().removesuffix(".0")]


def test_every_setting_is_named_by_a_row() -> None:
    named = {key for event in EVENTS for key in event.settings if "." not in key}
    assert named == set(SafetySettings.model_fields)


def test_every_rule_is_registered() -> None:
    arguments = (SafetySettings(), DeviceRoles(wheels="wheels", gyro="imu", required={}), 1, 0.0)
    mission_rules = make_rules(*arguments)
    drive_rules = [rule for rule in make_drive_rules(*arguments) if not rule.is_for_missions]
    written = [rule for rule in StopRule.__subclasses__() if rule.__module__.startswith("controllers.")]
    assert {type(rule) for rule in (*mission_rules, *drive_rules)} == set(written)  # tests have rules, too
    assert set(rules()) == set(written)
    assert len(mission_rules) + len(drive_rules) == len(written)
    assert all(rule.is_for_missions for rule in mission_rules)
