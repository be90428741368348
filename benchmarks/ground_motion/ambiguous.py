"""Ground motion on pictures that more than one motion explains: how often is it wrong with confidence?

    python -m benchmarks.ground_motion.ambiguous FOLDER [--only tiles] [--processes 2] [--markdown FILE]

FOLDER holds the drives of `python -m tests.nature.ambiguous_ground FOLDER`. Of each case, pooled:

- valid: share of the pairs that are valid;
- wrong: share of the valid pairs whose travel is wrong by more than four standard deviations, with that of
  the scale, and by more than a tenth of the wheels' travel;
- within 2 sd: share of the valid pairs, along the travel of the wheels;
- slip rms: error over windows of 0.5 m of the wheels that are valid in 80 % of their travel;
- standing: drives in which a pair that moves by more than 2 mm is reported as standing, valid;
- reported after: travel of the wheels after which a finding about the rig is first reported, and the number
  of drives with one;
- stuck after: the same, after the rover is stuck for the rest of the drive with spinning wheels, until a
  valid pair shows it, or "no motion confirmed" is stated.
"""

import argparse
import sys
from collections import defaultdict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import cv2
import numpy as np

from benchmarks.ground_motion.drives import drives_in
from benchmarks.ground_motion.measured import Pairs, measure
from benchmarks.ground_motion.scores import windows
from drivers.errors import ConfigError

CONFIDENT_SD, WRONG_SHARE = 4.0, 0.1
MOVES_M, STANDS_SHARE = 0.002, 0.2
NO_MOTION = "no motion confirmed"
COLUMNS = (
    "case | drives | pairs | valid % | wrong % | within 2 sd % | slip rms | standing | reported | after m | "
    "stuck | after m"
)


def _measure(folder: Path) -> Pairs | None:
    """Return the pairs of a drive; None where its camera does not see the ground behind its wheel."""
    cv2.setNumThreads(1)
    try:
        return measure(folder)
    except ConfigError as error:
        print(f"{folder.name} left out: {error}", file=sys.stderr)
        return None


def is_wrong(pairs: Pairs) -> np.ndarray:
    """Return which valid pairs are wrong with confidence."""
    error = np.hypot(*(pairs.found - pairs.true)[:, :2].T)
    wheel = np.abs(pairs.wheel_m)
    sd = np.hypot(np.hypot(pairs.sd[:, 0], pairs.sd[:, 1]), pairs.scale_sd * np.hypot(*pairs.found[:, :2].T))
    return np.asarray(pairs.valid & (error > CONFIDENT_SD * sd) & (error > WRONG_SHARE * wheel), np.bool_)


def row(name: str, drives: Sequence[Pairs]) -> str:
    """Return the row of a case."""
    valid = np.concatenate([each.valid for each in drives])
    wrong = np.concatenate([is_wrong(each) for each in drives])
    inside = np.concatenate(
        [
            np.abs(each.found[:, 0] - each.true[:, 0])
            <= 2.0 * np.hypot(each.sd[:, 0], each.scale_sd * each.found[:, 0])
            for each in drives
        ]
    )[valid]
    errors = [windows(each) for each in drives]
    error = np.concatenate([each.error[each.valid] for each in errors])
    standing = sum(
        bool(
            np.any(
                each.valid
                & (np.hypot(*each.true[:, :2].T) > MOVES_M)
                & (np.hypot(*each.found[:, :2].T) < STANDS_SHARE * np.hypot(*each.true[:, :2].T))
            )
        )
        for each in drives
    )
    after = [first for each in drives if (first := reported_m(each)) is not None]
    stuck = [first for each in drives if (first := stuck_m(each)) is not None]
    cells = [
        name,
        f"{len(drives)}",
        f"{len(valid)}",
        f"{100 * valid.mean():.0f}",
        f"{100 * wrong.sum() / max(valid.sum(), 1):.1f}",
        f"{100 * inside.mean():.0f}" if len(inside) else "-",
        f"{np.sqrt(np.mean(error**2)):.3f}" if len(error) else "-",
        f"{standing}",
        f"{len(after)}",
        f"{max(after):.2f}" if after else "-",
        f"{len(stuck)}",
        f"{max(stuck):.2f}" if stuck else "-",
    ]
    return "| " + " | ".join(cells) + " |"


def reported_m(pairs: Pairs) -> float | None:
    """Return the travel of the wheels until the first finding about the rig; None without one."""
    found = [number for number, text in enumerate(pairs.reasons) if "check" in text]
    return float(np.abs(pairs.wheel_m[: found[0] + 1]).sum()) if found else None


def stuck_m(pairs: Pairs) -> float | None:
    """Return the wheels' travel from where the rover is stuck until that is shown; None where it is not."""
    wheel_m = np.abs(pairs.wheel_m)
    moves = np.flatnonzero(np.hypot(*pairs.true[:, :2].T) >= STANDS_SHARE * wheel_m)
    begin = int(moves[-1]) + 1 if len(moves) else 0
    stands = pairs.valid & (np.hypot(*pairs.found[:, :2].T) < STANDS_SHARE * wheel_m)
    shown = stands | np.array([NO_MOTION in text for text in pairs.reasons])
    found = np.flatnonzero(shown[begin:])
    return float(wheel_m[begin : begin + found[0] + 1].sum()) if len(found) else None


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="", help="cases whose name contains this; several with commas")
    parser.add_argument("--draws", default="", help="like 0-4: draws of these numbers only")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--markdown", type=Path)
    given = parser.parse_args()
    first, last = (int(each) for each in (given.draws or "0-999999").split("-"))
    cases: defaultdict[str, list[Path]] = defaultdict(list)
    for folder in drives_in([given.folder]):
        case, _, draw = folder.name.rpartition("_")
        if any(each in case for each in given.only.split(",")) and first <= int(draw) <= last:
            cases[case].append(folder)
    rows = []
    with ProcessPoolExecutor(given.processes) as pool:
        for case, folders in cases.items():
            drives = [each for each in pool.map(_measure, folders) if each is not None]
            rows.append(row(case, drives))
            print(rows[-1], flush=True)
    if given.markdown is not None:
        head = f"| {COLUMNS} |\n" + "|---" * (COLUMNS.count("|") + 1) + "|\n"
        given.markdown.write_text(head + "\n".join(rows) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
