"""The reference page on safety names tests, settings and rules that exist."""

import re
from pathlib import Path

import pytest
from annotated_types import Ge, Le

from controllers.roles import DeviceRoles
from controllers.safety.reasons import StopRule
from controllers.safety.settings import SafetySettings, make_drive_rules, make_rules

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs/reference/safety.md").read_text(encoding="utf-8")
TESTS = sorted(set(re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", PAGE)))
ROWS = {
    cells[1].strip().strip("`"): [cell.strip() for cell in cells[2:4]]
    for cells in (line.split("|") for line in PAGE.splitlines())
    if len(cells) == 6
}


def test_the_page_names_tests() -> None:
    assert len(TESTS) > 30
    assert PAGE.count("::") == len(re.findall(r"`tests/[\w/]+\.py::\w+`", PAGE))


@pytest.mark.parametrize(("file", "name"), TESTS)
def test_every_test_that_the_page_names_exists(file: str, name: str) -> None:
    assert re.search(rf"^def {name}\(", (ROOT / file).read_text(encoding="utf-8"), re.MULTILINE)


@pytest.mark.parametrize("key", SafetySettings.model_fields)
def test_every_setting_is_on_the_page_with_its_range_and_default(key: str) -> None:
    field = SafetySettings.model_fields[key]
    bounds = {type(item): item for item in field.metadata}
    expected = "true, false"
    if key == "area":
        expected = "polygon or circle"
    elif field.annotation is not bool:
        low, high = bounds[Ge], bounds[Le]
        assert isinstance(low, Ge)
        assert isinstance(high, Le)
        expected = f"{low.ge:g} to {high.le:g}"
    assert ROWS[key] == [expected, str(field.default).lower()]


def test_every_rule_is_registered() -> None:
    arguments = (SafetySettings(), DeviceRoles(wheels="wheels", gyro="imu", required={}), 1, 0.0)
    rules = make_rules(*arguments)
    drive_rules = [rule for rule in make_drive_rules(*arguments) if not rule.is_for_missions]
    written = [rule for rule in StopRule.__subclasses__() if rule.__module__.startswith("controllers.")]
    assert {type(rule) for rule in (*rules, *drive_rules)} == set(written)  # tests have rules of their own
    assert len(rules) + len(drive_rules) == len(written)
    assert all(rule.is_for_missions for rule in rules)
