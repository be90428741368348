"""Verdicts of `gap` on machines and rovers by somebody who has not seen the engine.

    python -m benchmarks.gap.hidden_machines --seed 1 --first 200 --out DIR
    python -m benchmarks.gap.hidden_machines --seed 1 --first 40 --variants 5 --out DIR

Draws cases from tests/nature/hidden_machines, runs the documented command in the folder of each, and
compares its output with the answer, which is not in that folder. `DIR/results.jsonl` holds a line per
finished run: a command that was stopped goes on with the next. Use a new folder for another version of the
program.
"""

import argparse
import json
import resource
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from benchmarks.gap.hidden_judgement import Outcome, outcome_of
from benchmarks.gap.hidden_table import table
from tests.nature.hidden_machines import cases
from tests.nature.hidden_machines.draw import CLASSES

RESULTS, CASES, GAP = "results.jsonl", "cases", "gap"
MOST_S = 900.0
"""Real time after which a run is given up; two shared cores may double what a run needs."""

Job = tuple[int, cases.Key, int]
"""Seed, class and number, and variant."""


def command() -> str:
    """Return the program next to this Python."""
    found = shutil.which("rover-hil", path=str(Path(sys.executable).parent))
    if found is None:
        raise SystemExit(f"no rover-hil next to {sys.executable}: install the project there")
    return found


def run_gap(folder: Path) -> tuple[dict[str, object], float, int, str]:
    """Return `verdict.json`, processor time in s, exit code and the last line on standard error."""
    arguments = tomllib.loads((folder / "case.toml").read_text("utf-8"))["arguments"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    try:
        done = subprocess.run(
            [command(), *arguments, "--out", GAP, "--force"],
            cwd=folder, capture_output=True, text=True, timeout=MOST_S, check=False,
        )  # fmt: skip
        code, said = done.returncode, done.stderr.strip().splitlines()[-1:] or [""]
    except subprocess.TimeoutExpired:
        code, said = -1, [f"not finished after {MOST_S:.0f} s"]
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    path = folder / GAP / "verdict.json"
    verdict = json.loads(path.read_text("utf-8")) if path.is_file() and code == 0 else {}
    return verdict, used, code, said[0]


def run_job(job: Job, folder: Path, is_kept: bool) -> Outcome:
    """Write a variant of a case, run the command and compare with the answer."""
    seed, key, variant = job
    answer = cases.write(seed, key, folder / CASES, range(variant, variant + 1))
    case = folder / CASES / cases.name_of(seed, key, variant)
    verdict, used, code, said = run_gap(case)
    if not is_kept:
        shutil.rmtree(case)
    return outcome_of(answer, variant, verdict, used, code, said)


def jobs_of(kinds: list[str], first: int, seed: int, variants: int) -> Iterator[Job]:
    """Yield the runs of the first cases of each class."""
    for kind in kinds:
        for key in cases.keys(kind, first):
            for variant in range(variants):
                yield seed, key, variant


def read_results(path: Path) -> dict[tuple[str, int], Outcome]:
    """Return what was finished before."""
    if not path.is_file():
        return {}
    done = [Outcome(**json.loads(line)) for line in path.read_text("utf-8").splitlines()]
    return {(outcome.case, outcome.variant): outcome for outcome in done}


def finish(jobs: list[Job], folder: Path, processes: int, is_kept: bool) -> list[Outcome]:
    """Run what is not finished, and return all."""
    path = folder / RESULTS
    done = read_results(path)
    left = [job for job in jobs if (cases.case_of(job[0], job[1]), job[2]) not in done]
    work = partial(run_job, folder=folder, is_kept=is_kept)
    pool = ProcessPoolExecutor(processes) if processes > 1 else None
    with path.open("a", encoding="utf-8") as file:
        for outcome in pool.map(work, left) if pool else map(work, left):
            done[outcome.case, outcome.variant] = outcome
            file.write(json.dumps(vars(outcome), sort_keys=True) + "\n")
            file.flush()
            print(outcome.line(), flush=True)
    return [done[cases.case_of(job[0], job[1]), job[2]] for job in jobs]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--class", dest="kinds", action="append", choices=("all", *CLASSES))
    parser.add_argument("--first", type=int, default=200, help="cases of each class, or of all in turn")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--variants", type=int, default=1, help="noise drawn anew and runs permuted")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--keep", action="store_true", help="keep the folders of the cases")
    parser.add_argument("--out", type=Path, required=True)
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    jobs = list(jobs_of(chosen.kinds or ["all"], chosen.first, chosen.seed, chosen.variants))
    text = table(finish(jobs, chosen.out, chosen.jobs, chosen.keep))
    (chosen.out / "table.md").write_text(text, "utf-8")
    print(text)


if __name__ == "__main__":
    main()
