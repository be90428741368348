"""Hidden effects on a side slope, named blind, with a table of what was asked and reached.

`python -m benchmarks.gap.battery_side_slope --results battery.jsonl [--first N] [--cases N]`

Cases hold no effect in white, autocorrelated, heavy-tailed and quantised noise, single effects, pairs, and
effects outside the catalogue. Each is written to the results file as it ends; after an interruption the same
command goes on where it stopped. Cases from 10000 on are those the configuration was chosen with.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import track

from benchmarks.gap.battery_table import tables
from benchmarks.gap.cases import Case, cases, make_runs
from benchmarks.gap.outcome import Outcome, code_hash, keep, read_outcomes
from rover_hil.gap.workflow import analyse
from sim_backends.models.side_slope.model import make_model

FRESH = 320


def run(case: Case) -> Outcome:
    """Make the data of a case and ask for its verdict."""
    model = make_model()
    nature, runs = make_runs(case)
    return keep(case, nature, analyse(model, runs, seed=case.seed))


def run_all(wanted: Sequence[Case], path: Path) -> list[Outcome]:
    """Run the cases that the file does not hold yet.

    Raises:
        SystemExit: The file holds cases of other code.
    """
    outcomes = read_outcomes(path)
    if any(one.code != code_hash() for one in outcomes):
        raise SystemExit(f"{path} holds cases of other code: give another file")
    done = {one.number for one in outcomes}
    # A line that was cut off goes.
    path.write_text("".join(f"{one.model_dump_json()}\n" for one in outcomes), "utf-8")
    missing = [case for case in wanted if case.seed not in done]
    with path.open("a", encoding="utf-8") as file:
        for case in track(missing, description="cases", console=Console(stderr=True)):
            outcome = run(case)
            outcomes.append(outcome)
            file.write(f"{outcome.model_dump_json()}\n")
            file.flush()
            print(_line(outcome), flush=True)
    numbers = {case.seed for case in wanted}
    return [one for one in outcomes if one.number in numbers]


def _line(one: Outcome) -> str:
    sets = " | ".join("+".join(names) for names in one.confidence_set)
    hidden = "+".join(one.names) or "-"
    head = f"{one.number:5} {hidden:32} SNR {one.snr:<3g} {one.noise:9}"
    return f"{head} {one.verdict:16} {sets} ({one.seconds:.0f} s)"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--cases", type=int, default=FRESH)
    arguments = parser.parse_args()
    try:
        outcomes = run_all(cases(arguments.first, arguments.cases), arguments.results)
    except KeyboardInterrupt:
        outcomes = read_outcomes(arguments.results)
        print("interrupted; the same command goes on from here")
    print(f"\n{len(outcomes)} cases, code {code_hash()}\n")
    print("\n".join(tables(outcomes)))


if __name__ == "__main__":
    main()
