"""What must not get worse, in one command: floors that nobody fitted, field figures, faults.

    make gates                                            # compares with benchmarks/results/gates.md
    python -m benchmarks.gates --only Floors --write      # writes what was measured into that page
    make gates-full                                       # 60 other floors and all versions; prints the table

Every figure is of fixed seeds: two runs on one computer give the same. Exit code 1 where a row has fallen.
"""

import argparse
import statistics
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from typing import TypeVar

from rich.console import Console
from rich.progress import track

from benchmarks.cluster_option import add_cluster_option
from benchmarks.gates import drives, fields, floors, published
from benchmarks.gates.published import CAMERA_FLOORS, DRIVES, FAULTS, FIELDS, FLOORS, Table
from benchmarks.safety.faults.cases import all_cases
from benchmarks.safety.faults.measures import measure
from rover_hil.parallel.executor import open_executor

GATES_FLOORS, FIXED_FLOORS, CAMERA_GATES_FLOORS, FULL_FLOORS = 20, 10, 10, 60
SCREEN = Console(stderr=True)
Found = TypeVar("Found")


def measure_floors(pool: Executor, *, is_full: bool) -> Table:
    """Return the table of the floors."""
    cells = list(floors.cells(floors.VERSIONS if is_full else floors.VERSIONS[:2]))
    counts = [FULL_FLOORS if is_full else FIXED_FLOORS if cell.has_fixes else GATES_FLOORS for cell in cells]
    return _measure_cells(pool, cells, counts, is_full=is_full)


def measure_camera_floors(pool: Executor, *, is_full: bool) -> Table:
    """Return the table of the floors with a ground camera."""
    cells = list(floors.camera_cells(is_full=is_full))
    counts = [FULL_FLOORS if is_full else CAMERA_GATES_FLOORS] * len(cells)
    return _measure_cells(pool, cells, counts, is_full=is_full)


def _measure_cells(
    pool: Executor, cells: Sequence[floors.Cell], counts: Sequence[int], *, is_full: bool
) -> Table:
    first = floors.FIRST_FULL_FLOOR if is_full else floors.FIRST_FLOOR
    jobs = [
        (cell, first + number) for cell, count in zip(cells, counts, strict=True) for number in range(count)
    ]
    ways = dict(zip(jobs, _run(pool, floors.drive_floor, jobs, FLOORS), strict=True))
    return {
        cell.title: _words(floors.row_of([ways[cell, first + number] for number in range(count)]))
        for cell, count in zip(cells, counts, strict=True)
    }


def measure_fields(pool: Executor) -> Table:
    """Return the table of the field figures: median, least and greatest over the seeds."""
    jobs = [(field, seed) for field in fields.FIELDS for seed in range(fields.SEEDS)]
    by_field: dict[str, list[float]] = {}
    for figures in _run(pool, fields.measure_field, jobs, FIELDS):
        for name, value in figures.items():
            by_field.setdefault(name, []).append(value)
    return {
        name: {
            "median": f"{statistics.median(values):.3f}",
            "least": f"{min(values):.3f}",
            "greatest": f"{max(values):.3f}",
        }
        for name, values in by_field.items()
    }


def measure_faults(pool: Executor) -> Table:
    """Return the verdict of each fault; those of the Robotino with the yaw excitation and without."""
    jobs = [
        (case.title, is_excited)
        for case in all_cases()
        for is_excited in ((True, False) if case.rover == "robotino" else (True,))
    ]
    rows = _run(pool, measure, jobs, FAULTS)
    return {
        title if is_excited else f"{title}, no excitation": {"verdict": row.verdict, "outcome": row.outcome}
        for (title, is_excited), row in zip(jobs, rows, strict=True)
    }


def measure_drives(pool: Executor) -> Table:
    """Return the table of the recorded drives."""
    figures = _run(pool, drives.measure_drive, [(name,) for name in drives.DRIVES], DRIVES)
    return {
        name: {key: f"{value:.2f}" for key, value in row.items()}
        for name, row in zip(drives.DRIVES, figures, strict=True)
    }


def _run(
    pool: Executor, function: Callable[..., Found], jobs: Sequence[tuple[object, ...]], what: str
) -> Iterable[Found]:
    results = pool.map(function, *zip(*jobs, strict=True))
    return track(results, what, total=len(jobs), console=SCREEN)


def _words(figures: dict[str, float]) -> dict[str, str]:
    return {name: f"{value:g}" for name, value in figures.items()}


def main() -> int:
    """Measure, then compare, print or write; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", choices=(FLOORS, CAMERA_FLOORS, FIELDS, DRIVES, FAULTS))
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--full", action="store_true", help="60 other floors, all versions; compares nothing")
    what.add_argument("--write", action="store_true", help="replace the published tables; compares nothing")
    add_cluster_option(parser)
    arguments = parser.parse_args()
    page = published.PAGE.read_text(encoding="utf-8")
    tables = published.read_tables(page)
    fallen = 0
    with open_executor(arguments.cluster) as pool:
        measures = {
            FLOORS: lambda: measure_floors(pool, is_full=arguments.full),
            CAMERA_FLOORS: lambda: measure_camera_floors(pool, is_full=arguments.full),
            FIELDS: lambda: measure_fields(pool),
            DRIVES: lambda: measure_drives(pool),
            FAULTS: lambda: measure_faults(pool),
        }
        headings = (FLOORS, CAMERA_FLOORS) if arguments.full else tuple(measures)
        for heading in (arguments.only,) if arguments.only else headings:
            if heading == DRIVES and drives.missing():
                print(f"{DRIVES}: skipped: {drives.missing()}", flush=True)
                continue
            table = measures[heading]()
            if arguments.full:
                print("\n".join(published.markdown(table)))
            elif arguments.write:
                page = published.write_table(page, heading, table)
                published.PAGE.write_text(page, encoding="utf-8")
            else:
                for sentence in published.falls(heading, tables[heading], table):
                    fallen += 1
                    print(sentence, flush=True)
    if not (arguments.full or arguments.write):
        print(f"{fallen} figures have fallen" if fallen else "nothing has fallen")
    return 1 if fallen else 0


if __name__ == "__main__":
    sys.exit(main())
