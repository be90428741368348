"""Numbers of FTrace: the method `fused` on development drives of `tests/rear_scene`.

Figures are the rms of the angle (last one held, deg), missed and false frames (%), as defined in
`benchmarks/ftrace/scores.py`.
"""

from collections.abc import Sequence
from functools import partial

import cv2
import numpy as np

from benchmarks.ftrace.rendered_drives import run
from benchmarks.ftrace.scores import figures, judge, together
from benchmarks.sensitivity.subject import Score, Subject
from controllers.ftrace.parameters import DEFAULTS
from drivers.samples import Image
from tests.rear_scene.sequence import FrameSequence
from tests.rear_scene.sets import SET_NAMES, make_sequence

FIGURES = {"hold_rms_deg": "rms, deg", "missed_pct": "missed, %", "false_pct": "false, %"}

Drive = tuple[FrameSequence, list[Image]]


def prepare(cases: Sequence[str]) -> Score:
    """Return what computes the figures over these drives."""
    cv2.setNumThreads(1)
    drives: list[Drive] = []
    for case in cases:
        name, seed, seconds = case.split(":")
        sequence = make_sequence(
            next(known for known in SET_NAMES if known == name), int(seed), float(seconds)
        )
        frames = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in sequence.frames()]
        drives.append((sequence, [np.asarray(frame, np.uint8) for frame in frames]))
    return partial(score, drives)


def score(drives: Sequence[Drive]) -> dict[str, float]:
    """Return the figures over all drives."""
    parts = []
    for sequence, images in drives:
        angles, _ = run(sequence, images, "fused", DEFAULTS)
        parts.append(judge(angles, sequence.truth, sequence.rig.wheel.width_m))
    results = figures(together(parts))
    return {label: results[key] for key, label in FIGURES.items()}


SUBJECTS = {
    "ftrace": Subject(
        parameters=DEFAULTS,
        cases="curved:1:20,shadow:1:20,overlap:1:20",
        prepare=prepare,
        # the paper's method; the confidence, which no angle depends on; a promise to users
        fixed=("hough", "fuzzy", "confidence", "kept_m"),
    )
}
