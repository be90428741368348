"""The stated probability of the next run, tried out: `python -m benchmarks.gap_machines.next_run`.

Small carts with a hidden resistance are measured in runs that are much alike. The proposed run is measured on
the same cart, added to the data, and analysed: is the verdict right? The same is done with a repetition of a
measured run. One line of JSON per case; `--summary FILE` prints the table.
"""

import argparse
import json
import os
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from benchmarks.gap_machines.record import Record, plain
from benchmarks.gap_machines.small_carts import SmallCart, make_cart, make_model
from benchmarks.gap_machines.summary import read_records
from drivers.clock import SystemClock, seconds
from rover_hil.gap.findings import Analysis
from rover_hil.gap.verdict import Answer, Verdict
from rover_hil.gap.workflow import analyse

RANGES = ((0.0, 0.5), (0.5, 0.8), (0.8, 1.0))


def judge(number: int) -> Record:
    """Return the record of one case: verdict before, after the proposed run, and after a repetition."""
    cart = make_cart(number)
    rng = np.random.default_rng([number, 31])
    clock = SystemClock()
    start_ns = clock.now_ns()
    before = analyse(make_model(), cart.runs, allowed=cart.allowed)
    record: Record = {
        "number": number,
        "law": cart.law,
        "before": _told(before, cart),
        "next_run": before.verdict.next_run,
        "seconds": round(seconds(clock.now_ns() - start_ns), 2),
        "options": [],
    }
    options = before.proposal.options if before.proposal is not None else ()
    for rank, option in enumerate(options):
        if rank > 0 and not option.planned.is_repeat:
            continue
        runs = [*cart.runs, cart.made(option.planned, rng)]
        after = analyse(make_model(), runs, confirm=_locked(before))
        record["options"].append(
            {**before.verdict.next_runs[rank], "rank": rank, "after": _told(after, cart)}
        )
    found: Record = plain(record)
    return found


def _locked(analysis: Analysis) -> str:
    names = analysis.plan.confirm if analysis.plan is not None else ()
    return " or ".join(f'run == "{name}"' for name in names)


def _told(analysis: Analysis, cart: SmallCart) -> dict[str, object]:
    verdict = analysis.verdict
    return {
        "verdict": str(verdict.verdict),
        "confidence_set": [sorted(names) for names in verdict.confidence_set],
        "is_right": _is_right(verdict, cart),
        "is_wrong": verdict.verdict is Answer.NAMED and not _is_right(verdict, cart),
    }


def _is_right(verdict: Verdict, cart: SmallCart) -> bool:
    """Return True where only the truth is named; outside the list where nothing is named for certain."""
    if cart.is_outside:
        return verdict.verdict in (Answer.UNNAMED, Answer.PARTLY_NAMED)
    return [list(names) for names in verdict.confidence_set] == [[cart.law]]


def print_table(records: Sequence[Record]) -> None:
    """Print the stated probabilities and how often the verdict was right."""
    right = sum(one["before"]["is_right"] for one in records)
    print(f"{len(records)} cases; the verdict was right before in {right}")
    print(f"{'':26}{'runs':>6}{'stated right':>14}{'right':>8}{'stated wrong':>14}{'wrong':>8}")
    for label, is_repeat in (("proposed run", False), ("repetition", True)):
        chosen = [
            one
            for record in records
            for one in record["options"]
            if (one["is_repeat"] if is_repeat else one["rank"] == 0)
        ]
        _print_row(label, chosen)
        for low, high in RANGES:
            part = [one for one in chosen if low <= one["probability_right"] < high]
            _print_row(f"  stated {low:.0%} to {high:.0%}", part)


def _print_row(label: str, options: Sequence[Record]) -> None:
    if not options:
        return
    stated = float(np.mean([one["probability_right"] for one in options]))
    wrong = float(np.mean([one["probability_wrong"] for one in options]))
    right = sum(one["after"]["is_right"] for one in options)
    mistaken = sum(one["after"]["is_wrong"] for one in options)
    print(f"{label:26}{len(options):6}{stated:14.0%}{right:8}{wrong:14.0%}{mistaken:8}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run cases or print the table; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gap_machines.next_run", description=__doc__)
    parser.add_argument("--results", type=Path, help="file to add to")
    parser.add_argument("--summary", type=Path, help="file to print the table of")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--cases", type=int, default=30)
    options = parser.parse_args(arguments)
    if options.summary is not None:
        print_table(read_records(options.summary))
        return 0
    if options.results is None:
        print("give --results FILE.jsonl or --summary FILE.jsonl")
        return 2
    done = {one["number"] for one in read_records(options.results)}
    with options.results.open("a", encoding="utf-8") as file:
        for number in range(options.first, options.first + options.cases):
            if number in done:
                continue
            record = judge(number)
            file.write(json.dumps(record, allow_nan=False) + "\n")
            file.flush()
            print(_line(record), flush=True)
    print_table(read_records(options.results))
    return 0


def _line(record: Record) -> str:
    parts = [
        f"{one['run']} ({one['probability_right']:.0%}): {one['after']['verdict']} "
        f"{one['after']['confidence_set']} {'right' if one['after']['is_right'] else 'not right'}"
        for one in record["options"]
    ]
    before = f"{record['before']['verdict']} {record['before']['confidence_set']}"
    return f"{record['number']} {record['law']}: {before} -> {'; '.join(parts)}"


if __name__ == "__main__":
    raise SystemExit(main())
