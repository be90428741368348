"""Ground motion on drives with truth: slip, distance, validity, and how honest the deviations are.

    python -m benchmarks.ground_motion.drives FOLDER [FOLDER ...] [--looks clean,dirt] [--every 1]
        [--sinkage-mm 0]

A folder is a drive (`rig.json`, `telemetry.csv`, `truth.csv`, `frames/`) or holds drives. A drive whose
`scene.json` names a `look` counts under that look. `--looks` changes clean frames. Definitions:
`benchmarks/ground_motion/scores.py`. About 1 s of a core per drive of 100 frames and look.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from benchmarks.ground_motion.looks import LOOKS
from benchmarks.ground_motion.measured import Pairs, measure
from benchmarks.ground_motion.scores import (
    WRONG_SLIP,
    band_shares,
    distance_errors,
    normalised_errors,
    sideways_errors,
    standing,
    windows,
)
from controllers.ground_motion.rig_tolerance import RigTolerance

COLUMNS = (
    "windows | valid % | slip rms | bias | p95 | max | distance % | sideways mm | pairs % | above 0.1 | "
    "ms | p95 ms"
)
LENGTHS_M = (0.1, 0.5, 2.0)


def main() -> int:
    """Measure all; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--looks", default="clean", help=f"of {', '.join(LOOKS)}; with commas between")
    parser.add_argument("--every", type=int, default=1, help="use only every so many frames")
    parser.add_argument("--sinkage-mm", type=float, default=0.0, help="setting of the rig's tolerance")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    tolerance = RigTolerance(sinkage_m=given.sinkage_mm / 1000)
    for look in given.looks.split(","):
        drives = [measure(folder, LOOKS[look], given.every, tolerance) for folder in drives_in(given.folders)]
        _write(f"\n## {look}\n\n| drive | {COLUMNS} |\n" + "|---" * 13 + "|\n")
        for pairs in drives:
            name = f"{pairs.name} ({pairs.look})" if pairs.look else pairs.name
            _write(f"| {name} | {_row([pairs])} |\n")
        looks = sorted({pairs.look for pairs in drives} - {""})
        for name in looks:
            _write(f"| look {name} | {_row([pairs for pairs in drives if pairs.look == name])} |\n")
        _write(f"| **all** | {_row(drives)} |\n")
        _summary(drives)
    return 0


def drives_in(folders: Sequence[Path]) -> Iterator[Path]:
    """Yield the drives that folders are or hold."""
    for folder in folders:
        if (folder / "rig.json").exists():
            yield folder
        else:
            yield from sorted(path.parent for path in folder.glob("*/rig.json"))


def _row(drives: Sequence[Pairs]) -> str:
    """Return the cells of drives, pooled."""
    parts = [windows(pairs) for pairs in drives]
    valid = np.concatenate([part.valid for part in parts])
    error = np.concatenate([part.error for part in parts])[valid]
    biases = [float(part.error[part.valid].mean()) for part in parts if part.valid.any()]
    bias = max(biases, key=abs, default=np.nan)
    distance = np.array([e for pairs in drives for e in distance_errors(pairs)])
    sideways = np.array([e for pairs in drives for e in sideways_errors(pairs)])
    spent_ms = np.concatenate([pairs.spent_ms for pairs in drives])
    measured = np.concatenate([pairs.valid for pairs in drives])
    cells = [
        f"{len(valid)}",
        f"{100 * valid.mean():.0f}" if len(valid) else "-",
        _number(_rms(error)),
        _number(bias, "+.3f"),
        _number(np.percentile(np.abs(error), 95) if len(error) else np.nan),
        _number(np.abs(error).max() if len(error) else np.nan),
        _number(100 * _rms(distance), ".1f"),
        _number(1000 * _rms(sideways), ".1f"),
        f"{100 * measured.mean():.1f}",
        f"{int((error > WRONG_SLIP).sum())}",
        f"{np.median(spent_ms):.1f}",
        f"{np.percentile(spent_ms, 95):.1f}",
    ]
    return " | ".join(cells)


def _summary(drives: Sequence[Pairs]) -> None:
    parts = [windows(pairs) for pairs in drives]
    _write("\n| true slip | windows | valid % |\n|---|---|---|\n")
    names = ("below 0.3", "0.3 to 0.55", "0.55 to 0.9", "above 0.9")
    for name, (count, share) in zip(names, band_shares(parts), strict=True):
        _write(f"| {name} | {count} | {_number(100 * share, '.1f')} |\n")
    error = np.concatenate([part.error[part.valid] for part in parts])
    above = float((error > WRONG_SLIP).mean()) if len(error) else np.nan
    off = float((np.abs(error) > WRONG_SLIP).mean()) if len(error) else np.nan
    _write(
        f"\nreported slip more than {WRONG_SLIP:g} above the truth: {100 * above:.2f} % of valid windows; "
        f"either way: {100 * off:.2f} %\n"
    )
    still, valid, moving = (sum(counts) for counts in zip(*map(standing, drives), strict=True))
    _write(f"standing: {still} pairs, {valid} valid, {moving} reported as moving\n")
    for length_m in LENGTHS_M:
        ratios = np.abs([e for pairs in drives for e in normalised_errors(pairs, length_m)])
        if len(ratios):
            _write(
                f"within two deviations over {length_m:g} m: {100 * (ratios < 2).mean():.1f} % of "
                f"{len(ratios)}, rms {_rms(ratios):.2f}\n"
            )
    reasons = Counter(reason for pairs in drives for reason in pairs.reasons if reason)
    for reason, count in reasons.most_common():
        _write(f"- {count} pairs: {reason}\n")


def _number(value: float, form: str = ".3f") -> str:
    return "-" if np.isnan(value) else format(value, form)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else np.nan


def _write(text: str) -> None:
    sys.stdout.write(text)
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
