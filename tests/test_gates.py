"""The published tables of `make gates`: what counts as fallen, and that the page holds what is measured."""

import pytest

from benchmarks.gates import fields, floors, published
from benchmarks.gates.published import (
    CAMERA_FLOORS,
    FAULTS,
    FIELDS,
    FLOORS,
    PageError,
    falls,
    read_tables,
    write_table,
)
from benchmarks.safety.faults.cases import all_cases
from controllers.slip.effort.parameters import EFFORT
from rover_hil.config import Config

FLOOR = {"floors": "20", "within": "12", "finished": "20", "path mm": "40", "closure mm": "50"}


TABLE = "| | a |\n|---|---|\n| old | 1 |\n"


def fallen(heading: str, before: dict[str, str], after: dict[str, str]) -> list[str]:
    return list(falls(heading, {"row": before}, {"row": after}))


@pytest.mark.parametrize("column", ["within", "finished"])
def test_a_row_may_lose_three_of_twenty_floors(column: str) -> None:
    count = int(FLOOR[column])
    assert fallen(FLOORS, FLOOR, FLOOR | {column: str(count - 3)}) == []
    (sentence,) = fallen(FLOORS, FLOOR, FLOOR | {column: str(count - 4)})
    assert sentence == f"row: {count - 4} floors {column}, were {count}"


def test_of_ten_floors_a_row_may_lose_one() -> None:
    ten = FLOOR | {"floors": "10", "finished": "10", "within": "6"}
    assert fallen(FLOORS, ten, ten | {"within": "5"}) == []
    assert len(fallen(FLOORS, ten, ten | {"within": "4"})) == 1


@pytest.mark.parametrize(("path", "count"), [("44", 0), ("45", 1), ("4", 0)])
def test_a_median_may_grow_by_a_tenth(path: str, count: int) -> None:
    assert len(fallen(FLOORS, FLOOR, FLOOR | {"path mm": path})) == count


def test_small_figures_may_change_by_what_another_processor_changes() -> None:
    assert fallen(FIELDS, {"median": "0.010"}, {"median": "0.0149"}) == []
    assert fallen(FIELDS, {"median": "0.010"}, {"median": "0.0151"}) == ["row: median 0.0151, was 0.01"]


def test_a_fault_that_loses_its_verdict_has_fallen() -> None:
    well, missed = {"verdict": "ok"}, {"verdict": "not honest"}
    assert fallen(FAULTS, well, missed) == ["row: verdict not honest, was ok"]
    assert fallen(FAULTS, missed, missed) == fallen(FAULTS, missed, well) == []


def test_a_row_that_is_not_there_has_fallen() -> None:
    assert list(falls(FAULTS, {"a": {"verdict": "ok"}}, {})) == ["a: not measured"]
    assert list(falls(FAULTS, {}, {"a": {"verdict": "ok"}})) == ["a: not published"]


def test_a_table_is_written_into_its_section_and_read_again() -> None:
    page = f"# Page\n\n## Floors\n\nWords.\n\n{TABLE}\nMore.\n\n## Faults\n\n{TABLE}"
    written = write_table(page, FLOORS, {"new": {"a": "3", "d": "4"}, "newer": {"a": "5", "d": "6"}})
    assert read_tables(written) == {
        FLOORS: {"new": {"a": "3", "d": "4"}, "newer": {"a": "5", "d": "6"}},
        FAULTS: {"old": {"a": "1"}},
    }
    assert written.startswith("# Page\n\n## Floors\n\nWords.\n\n|")
    assert "\n\nMore.\n\n## Faults\n" in written


@pytest.mark.parametrize("page", ["# Page\n", f"\n## Floors\n\nWords.\n\n## Faults\n\n{TABLE}"])
def test_without_a_table_nothing_is_written(page: str) -> None:
    with pytest.raises(PageError, match="no table below 'Floors'"):
        write_table(page, FLOORS, {"new": {"a": "3"}})


def test_a_damaged_table_is_named() -> None:
    with pytest.raises(PageError, match="a row of 'Floors' has another number of cells"):
        read_tables("# Page\n\n## Floors\n\n| | a |\n|---|---|\n| c |\n")


def test_the_page_holds_every_row() -> None:
    tables = read_tables(published.PAGE.read_text(encoding="utf-8"))
    assert set(tables[FLOORS]) == {cell.title for cell in floors.cells(floors.VERSIONS[:2])}
    assert set(tables[CAMERA_FLOORS]) == {cell.title for cell in floors.camera_cells(is_full=False)}
    titles = {case.title for case in all_cases()}
    without = {f"{title}, no excitation" for title in titles if title.startswith("robotino/")}
    assert set(tables[FAULTS]) == titles | without
    assert {name.split()[0] for name in tables[FIELDS]} == {name.split()[0] for name in fields.FIELDS}


@pytest.mark.parametrize(("version", "weight"), [("secant", 0.0), ("calibrated gyro", EFFORT.bracket.weight)])
def test_the_secant_is_a_version_for_as_long_as_it_drives(
    monkeypatch: pytest.MonkeyPatch, version: str, weight: float
) -> None:
    seen: list[tuple[float, bool]] = []

    def drive(config: Config, *_: object, **__: object) -> list[None]:
        assert config.slip is not None
        seen.append((EFFORT.bracket.weight, config.slip.gyro_response is not None))
        return [None]

    monkeypatch.setattr(floors, "drive_config", drive)
    floors.drive_floor(floors.Cell(nature="bristle", version=version, has_fixes=False), 1)
    assert seen == [(weight, True)]
    assert EFFORT.bracket.weight == 0.5
