"""Write cases and, apart from them, their answers: `python -m tests.nature.hidden_machines --out DIR`."""

import argparse
import sys
from pathlib import Path

from tests.nature.hidden_machines.cases import answer_line, answer_of, digest, keys, write
from tests.nature.hidden_machines.draw import CLASSES

ANSWERS, CASES = "answers.jsonl", "cases"


def main() -> None:
    """Write the first cases of a class, or only print the digest of their answers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--class", dest="kind", choices=("all", *CLASSES), default="all")
    parser.add_argument("--first", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--variants", type=int, default=1)
    parser.add_argument("--out", type=Path, help="folder of cases and answers; without it, only the digest")
    chosen = parser.parse_args()
    lines = []
    for key in keys(chosen.kind, chosen.first):
        if chosen.out:
            entry = write(chosen.seed, key, chosen.out / CASES, range(chosen.variants))
        else:
            entry = answer_of(chosen.seed, key)
        lines.append(answer_line(entry))
    if chosen.out:
        (chosen.out / ANSWERS).write_text("".join(f"{line}\n" for line in lines), "utf-8")
    sys.stdout.write(f"{digest(lines)}  {len(lines)} answers of {chosen.kind}, seed {chosen.seed}\n")


if __name__ == "__main__":
    main()
