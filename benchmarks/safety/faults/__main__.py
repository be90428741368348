"""The fault matrix: device x fault x rover, run and judged.

    python -m benchmarks.safety.faults [--only robotino/imu] [--json faults.json]
    python -m benchmarks.safety.faults --markdown benchmarks/results/faults.md
    python -m benchmarks.safety.faults --two-processes --markdown benchmarks/results/faults_two_processes.md

Every case is one run of a shipped rover with one fault between an emulator and its driver, three seconds
after the rover first moves, on simulated time with fixed seeds; `--two-processes` runs the cases that make
sense in real time, over pseudo-terminals and slcan. Exit code 1 where a bar is missed.
"""

import argparse
import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from rich.console import Console

from benchmarks.cluster_option import add_cluster_option
from benchmarks.safety.faults.cases import Case, all_cases
from benchmarks.safety.faults.measures import Row, measure
from benchmarks.safety.faults.process_cases import real_time_cases
from benchmarks.safety.faults.processes import measure_processes
from rover_hil.parallel.executor import open_executor

COLUMNS = (
    "rover | device | fault | must | detectable s | zero ms after | stop s | driven m | invented | error m | "
    "error deg | NEES then | NEES later | sigma m | sigma deg | unseen m | added/unseen m | unseen deg | "
    "added/unseen deg | outcome | replay | verdict"
)
TITLES = {False: "Faults, simulated time", True: "Faults, two processes in real time"}
ABOUT = (
    "Each case is one run with one fault, three seconds after the rover first moves; the columns are those "
    "of `Row` in `benchmarks/safety/faults/measures.py`, and `--json` has the messages."
)


def page(rows: Sequence[Row], *, is_real_time: bool) -> str:
    """Return the page of recorded results."""
    return f"# {TITLES[is_real_time]}\n\n{ABOUT}\n\n{markdown(rows)}"


def markdown(rows: Sequence[Row]) -> str:
    """Return the rows as a table, with one number in a cell at most."""
    lines = [f"| {COLUMNS} |", "|" + "---|" * (COLUMNS.count("|") + 1)]
    lines += [f"| {' | '.join(_cells(row))} |" for row in rows]
    return "\n".join(lines) + "\n"


def _cells(row: Row) -> Iterable[str]:
    numbers = (row.detectable_s, row.zero_ms, row.stop_s, row.driven_m, row.invented)
    errors = (row.error_m, row.error_deg, row.nees_again, row.nees_later, row.sigma_m, row.sigma_deg)
    widths = (row.unseen_m, row.wider_m, row.unseen_deg, row.wider_deg)
    yield from (row.rover, row.device, row.fault, row.duty)
    yield from ("-" if number is None else f"{number:g}" for number in (*numbers, *errors, *widths))
    replay = {True: "identical", False: "DIFFERS", None: "-"}[row.replays]
    yield from (row.outcome, replay, "MISSED" if row.failures else row.verdict)


def run_virtual_cases(cases: Sequence[Case], processes: int, cluster: str | None) -> Iterator[Row]:
    """Run cases in several processes, and yield each row as it is done."""
    with open_executor(cluster, processes) as pool:
        yield from pool.map(measure, [case.title for case in cases])


def main() -> int:
    """Print the table; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--only", action="append", help="cases whose title rover/device/fault contains this; may be repeated"
    )
    parser.add_argument("--two-processes", action="store_true")
    parser.add_argument("--runs", type=int, default=1, help="of each case, with --two-processes")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--markdown", type=Path)
    add_cluster_option(parser)
    arguments = parser.parse_args()
    console = Console(stderr=True)
    every = real_time_cases() if arguments.two_processes else all_cases()
    cases = [case for part in arguments.only or [""] for case in every if part in case.title]
    if arguments.two_processes:
        cases = [case for case in cases for _ in range(arguments.runs)]
        measured: Iterable[Row] = map(measure_processes, cases)
    else:
        measured = run_virtual_cases(cases, arguments.processes, arguments.cluster)
    rows: list[Row] = []
    for row in measured:
        rows.append(row)
        title = f"{len(rows):3}/{len(cases)} {row.rover}/{row.device}/{row.fault}"
        console.print(f"{title}: {row.verdict}", soft_wrap=True, highlight=False)
        if arguments.json is not None:  # after each, so that a run that is ended has a result
            arguments.json.write_text(json.dumps([row.as_json() for row in rows], indent=1))
    if arguments.markdown is not None:
        arguments.markdown.write_text(page(rows, is_real_time=arguments.two_processes), encoding="utf-8")
    print(markdown(rows))
    missed = sum(bool(row.failures) for row in rows)
    refused = sum(row.is_refused for row in rows)
    console.print(f"{refused} of {len(rows)} logs refused by their own readers")
    console.print(f"{missed} of {len(rows)} cases miss a bar")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
