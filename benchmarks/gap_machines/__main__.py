"""The gap workflow on machines with hidden effects: `python -m benchmarks.gap_machines --results FILE.jsonl`.

One line of JSON per case; a case that the file holds is skipped. `--summary FILE.jsonl` prints the table.
"""

import argparse
import json
import os
import subprocess
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, as_completed
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from benchmarks.cluster_option import add_cluster_option
from benchmarks.gap_machines.models import MODELS
from benchmarks.gap_machines.record import Record, judge_case
from benchmarks.gap_machines.summary import print_summary, read_records
from rover_hil.parallel.executor import open_executor
from tests.nature.machines.make import SHARES, kind_of


def main(arguments: Sequence[str] | None = None) -> int:
    """Run cases or print the table; return the exit code."""
    options = _options(arguments)
    if options.summary is not None:
        print_summary(read_records(options.summary))
        return 0
    if options.results is None:
        print("give --results FILE.jsonl or --summary FILE.jsonl")
        return 2
    version = options.version or _version()
    known = read_records(options.results)
    others = sorted({record["version"] for record in known} - {version})
    if others:
        print(f"{options.results} was made by version {others[0]}, this is {version}: use another file")
        return 2
    unknown = [name for name in options.families.split(",") if name not in MODELS]
    if unknown:
        print(f"no family is called {unknown[0]}; there are {', '.join(MODELS)}")
        return 2
    done = {(record["family"], record["number"]) for record in known}
    cases = [
        (family, number)
        for number in range(options.first, options.first + options.cases)
        for family in options.families.split(",")
        if (family, number) not in done and options.kind in ("", kind_of(family, number))
    ]
    options.results.parent.mkdir(parents=True, exist_ok=True)
    with options.results.open("a", encoding="utf-8") as file:
        for record in _records(cases, version, options.workers, options.cluster):
            file.write(json.dumps(record, allow_nan=False) + "\n")
            file.flush()
            print(_line(record), flush=True)
    return 0


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gap_machines", description=__doc__)
    parser.add_argument("--results", type=Path, help="file to add to")
    parser.add_argument("--summary", type=Path, help="file to print the table of")
    parser.add_argument("--first", type=int, default=0, help="number of the first case of each family")
    parser.add_argument("--cases", type=int, default=10, help="cases of each family")
    parser.add_argument("--families", default=",".join(MODELS), help="separated by commas")
    parser.add_argument("--kind", default="", choices=("", *SHARES), help="only cases of one kind")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--version", default="", help="of the code; by default the commit")
    add_cluster_option(parser)
    return parser.parse_args(arguments)


def _version() -> str:
    folder = Path(__file__).parent
    command = ["git", "rev-parse", "HEAD"]  # the code version is that of the checkout
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout.strip()


def _records(
    cases: Sequence[tuple[str, int]], version: str, workers: int, cluster: str | None
) -> Iterator[Record]:
    if workers <= 1 and cluster is None:
        for family, number in cases:
            yield judge_case(family, number, version)
        return
    with open_executor(cluster, workers) as pool:
        waiting: list[Future[Record]] = [pool.submit(judge_case, *case, version) for case in cases]
        for one in as_completed(waiting):
            yield one.result()


def _line(record: Record) -> str:
    hidden = " and ".join(record["hidden"]) or "-"
    answer = record["error"] or f"{record['verdict']} {' and '.join(record['effects'])}"
    return (
        f"{record['family']} {record['number']} {record['kind']} {hidden} snr {record['snr']:.1f} "
        f"({record['snr_after_refit']:.1f}): {answer} ({record['seconds']:.0f} s)"
    )


if __name__ == "__main__":
    raise SystemExit(main())
