"""docs/reference/soil_keys.md: every key with its true range, and its examples work as they are."""

import json
import re
import tomllib
from pathlib import Path

import pytest
from pydantic import ValidationError

from drivers.settings import Settings
from sim_backends.terramechanics.slope.rover import SlopeRover, paper_rover
from sim_backends.terramechanics.soil.any_angle_wheel import AnyAngleSoil, load_any_angle_soil
from sim_backends.terramechanics.soil.library import (
    BekkerLaw,
    ReeceLaw,
    SoilSettings,
    WheelSettings,
    load_soil,
    load_wheel,
)
from tests.rover_hil.command import Command

PAGE = (Path(__file__).parents[3] / "docs/reference/soil_keys.md").read_text("utf-8")
ROW = re.compile(r"^\| `(\w+)` \| (.*?) \| (.*?) \|", re.MULTILINE)
RANGE = re.compile(r"(-?[\d.e-]+) \.\. (-?[\d.e-]+)$")
BEKKER = load_soil("hit_lss1").pressure
REECE = load_soil("toyoura").pressure
TABLES: dict[str, Settings] = {
    "## Soil\n": load_soil("toyoura"),
    '| `law = "bekker"`': BEKKER,
    '| `law = "reece"`': REECE,
    "## Wheel\n": load_wheel("wh31"),
    "## Rover and test rig\n": paper_rover(),
    "## Soil of `terrain fit`\n": load_any_angle_soil("cmu_sand"),
}


def rows_after(heading: str) -> dict[str, str]:
    """Return the range of each key in the table after a heading."""
    after = PAGE[PAGE.index(heading) :]
    table = re.search(r"(?:^\|.*\n)+", after, re.MULTILINE)
    assert table is not None
    return {key: limits for key, _, limits in ROW.findall(table[0])}


@pytest.mark.parametrize("heading", TABLES)
def test_every_key_is_on_the_page(heading: str) -> None:
    fields = set(type(TABLES[heading]).model_fields) - {"law", "pressure", "wheel"}
    assert set(rows_after(heading)) == fields


@pytest.mark.parametrize("heading", TABLES)
def test_each_range_is_that_of_the_program(heading: str) -> None:
    example = TABLES[heading]
    checked = 0
    for key, limits in rows_after(heading).items():
        found = RANGE.fullmatch(limits)
        if found is None or key == "wheel_positions_m":
            continue
        low, high = float(found[1]), float(found[2])
        reach = 1e-6 * (high - low)
        for value, is_allowed in ((low, True), (high, True), (low - reach, False), (high + reach, False)):
            table = example.model_dump() | {key: value}
            if is_allowed:
                type(example).model_validate(table)
            else:
                with pytest.raises(ValidationError, match=key):
                    type(example).model_validate(table)
        checked += 1
    assert checked >= 3


def test_the_classes_are_all_on_the_page() -> None:
    assert {type(each) for each in TABLES.values()} == {
        SoilSettings, BekkerLaw, ReeceLaw, WheelSettings, SlopeRover, AnyAngleSoil,
    }  # fmt: skip


def test_the_rig_and_the_soil_of_the_page_climb(command: Command, tmp_path: Path) -> None:
    """Three commands from the page alone: each row has a number or a reason."""
    sand, rig = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    (tmp_path / "dry_sand.toml").write_text(sand)
    (tmp_path / "rig.toml").write_text(rig)
    assert tomllib.loads(rig)["mass_kg"] == 17.5
    assert command("terrain", "climb", "--rover", "rig.toml", "--soil", "dry_sand.toml", "--json") == 0
    result = json.loads(command.out)
    limit = result["limits"][0]
    assert 5.0 < limit["climbable_deg"] < limit["descendable_deg"] == pytest.approx(28.0, abs=0.01)
    assert limit["reason"].startswith("up: the slip ratio passes 0.6; down: the slope is steeper")
    for row in (row for rows in result.values() for row in rows):
        assert (None in row.values()) <= (row["reason"] != "")
    (five,) = (row for row in result["slopes"] if row["slope_deg"] == 5.0)
    assert 0.1 < five["slip_up"] < 0.6
    assert command("terrain", "traverse", "--rover", "rig.toml", "--soil", "dry_sand.toml", "--json") == 0
    for row in json.loads(command.out):
        assert row["sinkage_uphill_m"] == row["sinkage_downhill_m"] > 0.0
    assert command("terrain", "climb", "--rover", "rig.toml", "--soil", "dry_sand.toml") == 0
    assert "slope deg 15 and" not in command.out
    assert "slope deg 15, slope deg 20" in command.out
    assert "the soil cannot give the thrust" in command.out
