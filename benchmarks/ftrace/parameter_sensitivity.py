"""How much FTrace's result changes when each of its tuned numbers is varied by 20 %.

    python -m benchmarks.ftrace.parameter_sensitivity [--sets curved,shadow,overlap] [--seed 1] [--seconds 20]
                                               [--group presence]

Runs `fused` on development drives of `tests/rear_scene` with each number at 0.8 and at 1.2 of its
value (whole numbers change by at least 1). Prints as Markdown the changes of the rms of the angle (last one
held, deg), of missed and of false frames (%), as defined in `benchmarks/ftrace/scores.py`. Three drives take
about half an hour on one core.
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

import cv2
import numpy as np

from benchmarks.ftrace.rendered_drives import run
from benchmarks.ftrace.scores import figures, judge, together
from benchmarks.sensitivity import FACTORS, varied
from controllers.ftrace.parameters import DEFAULTS, FTraceParameters
from drivers.samples import Image
from tests.rear_scene.sequence import FrameSequence
from tests.rear_scene.sets import make_sequence

NOT_VARIED = ("hough", "fuzzy", "confidence", "most_misses")
"""The paper's method; the confidence, which no angle depends on; a promise to users."""
FIGURES = {"hold_rms_deg": "rms, deg", "missed_pct": "missed, %", "false_pct": "false, %"}

Drive = tuple[FrameSequence, list[Image]]


def numbers(group: str | None) -> Iterator[tuple[str, str, Any]]:
    """Yield group, name and value of every number that is used."""
    for part in fields(DEFAULTS):
        if part.name not in NOT_VARIED and group in (None, part.name):
            settings = getattr(DEFAULTS, part.name)
            for number in fields(settings):
                yield part.name, number.name, getattr(settings, number.name)


def score(drives: list[Drive], parameters: FTraceParameters) -> dict[str, float]:
    """Return the figures over all drives."""
    parts = []
    for sequence, images in drives:
        found, _ = run(sequence, images, "fused", parameters)
        parts.append(judge(found, sequence.truth, sequence.rig.wheel.width_m))
    return figures(together(parts))


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--sets", default="curved,shadow,overlap")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--group")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    drives: list[Drive] = []
    for name in given.sets.split(","):
        sequence = make_sequence(name, given.seed, given.seconds)
        frames = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in sequence.frames()]
        drives.append((sequence, [np.asarray(frame, np.uint8) for frame in frames]))
    usual = score(drives, DEFAULTS)
    print("default: " + ", ".join(f"{label} {usual[key]:.2f}" for key, label in FIGURES.items()))
    print("\n| number | value | " + " | ".join(FIGURES.values()) + " |\n" + "|---" * 5 + "|")
    for group, name, value in numbers(given.group):
        results = []
        for factor in FACTORS:
            settings = replace(getattr(DEFAULTS, group), **{name: varied(value, factor)})
            results.append(score(drives, replace(DEFAULTS, **{group: settings})))
        cells = [" / ".join(f"{result[key] - usual[key]:+.2f}" for result in results) for key in FIGURES]
        print(f"| {group}.{name} | {value} | {' | '.join(cells)} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
