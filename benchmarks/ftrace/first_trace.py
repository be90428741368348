"""When `fused` first reports a trace, what it misses after that, and whether a fixed band is taken for one.

    python -m benchmarks.ftrace.first_trace FOLDER [FOLDER ...] [--band 0.6]

A folder is a drive with `truth.csv`, or holds drives, as of `benchmarks.ground_motion.drives`. To render:
`python -m benchmarks.ftrace.ground_drives --drives FOLDER --first-seed 310 --frames 80`. With `--band` a
strip of ground as wide as the wheel, behind it, is darkened to this share of its grey in every frame.

Columns: travel over ground with a trace of 0.20 m in view, until the first angle of any source, and until the
first report of the trace; frames with such a trace, missed of them after that report, and in a row; frames
with less than 0.05 m of trace, and false reports in them; error of the angle, rms, and share of the errors
within two reported standard deviations.
"""

import argparse
import csv
import math
import sys
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.ftrace.ground_drives import found_in, recorded
from benchmarks.ground_motion.drives import drives_in
from controllers.ground_motion.rig import RigGeometry
from drivers.samples import Image

BAND_M = (0.1, 1.2)
"""From behind the contact on."""
LATE_M = 0.2
"""Of travel, for the first report."""
ABSENT_M = 0.05
"""A shorter trace in view is none."""
SOFT_PIXELS = 3.0
"""Of the edges of the band."""


class Score(NamedTuple):
    """Of one drive."""

    angle_m: float
    first_m: float
    present: int
    missed: int
    longest: int
    absent: int
    false: int
    error_deg: float
    within: float


def score(folder: Path, band: float | None) -> Score:
    """Return how a drive is followed."""
    rig, telemetry, images = recorded(folder)
    if band is not None:
        share = _band(rig.geometry(), band)
        images = [np.asarray(image * share, np.uint8) for image in images]
    found = found_in(rig, images, telemetry)
    with (folder / "truth.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    visible_m = np.array([float(row["visible_len_m"]) for row in rows])
    places = np.array([[float(row["x"]), float(row["y"])] for row in rows])
    present, absent = np.array([row["present"] == "1" for row in rows]), visible_m < ABSENT_M
    steps_m = np.r_[0.0, np.hypot(*np.diff(places, axis=0).T)] * (present & np.r_[False, present[:-1]])
    travel_m = np.cumsum(steps_m)
    reports = np.flatnonzero(present & found.detected)
    angles = np.flatnonzero(present & np.isfinite(found.theta_deg))
    first = int(reports[0]) if reports.size else len(rows)
    missed = present & ~found.detected & (np.arange(len(rows)) >= first)
    longest = run = 0
    for is_missed in missed[present]:
        run = run + 1 if is_missed else 0
        longest = max(longest, run)
    error_deg = found.theta_deg - np.array([float(row["theta_t_deg"]) for row in rows])
    known = present & np.isfinite(error_deg)
    return Score(
        angle_m=float(travel_m[angles[0]]) if angles.size else math.nan,
        first_m=float(travel_m[first]) if reports.size else math.nan,
        present=int(present.sum()),
        missed=int(missed.sum()),
        longest=longest,
        absent=int(absent.sum()),
        false=int((found.detected & absent).sum()),
        error_deg=float(np.sqrt((error_deg[known] ** 2).mean())) if known.any() else math.nan,
        within=float((np.abs(error_deg) <= 2.0 * found.theta_sd_deg)[known].mean())
        if known.any()
        else math.nan,
    )


def _band(rig: RigGeometry, grey: float) -> NDArray[np.float32]:
    """Return the share of the light that is left at each pixel."""
    half_m, (near, far) = rig.wheel_width_m / 2, BAND_M
    corners = np.array([[near, -half_m], [near, half_m], [far, half_m], [far, -half_m]])
    cosine, sine = np.cos(rig.steer_rad), np.sin(rig.steer_rad)
    back, left = np.array([cosine, sine, 0.0]), np.array([-sine, cosine, 0.0])
    ground_m = rig.contact_m - corners[:, :1] * back + corners[:, 1:] * left
    ground_m[:, 2] = 0.0
    seen = (ground_m - rig.position_m) @ rig.rotation @ rig.camera_matrix.T
    share: Image = np.full((rig.height, rig.width), 255, np.uint8)
    cv2.fillConvexPoly(share, np.round(seen[:, :2] / seen[:, 2:]).astype(np.int32), 255.0 * grey)
    return np.asarray(cv2.GaussianBlur(share, (0, 0), SOFT_PIXELS), np.float32) / 255.0


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--band", type=float, help="grey of a fixed band over that of the ground")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    heads = (
        "drive",
        "angle, m",
        "trace, m",
        "present",
        "missed",
        "in a row",
        "absent",
        "false",
        "error, deg",
        "within",
    )
    sys.stdout.write(f"| {' | '.join(heads)} |\n{'|---' * len(heads)}|\n")
    scores = []
    for folder in drives_in(given.folders):
        one = score(folder, given.band)
        scores.append(one)
        cells = [f"{value:.2f}" if isinstance(value, float) else str(value) for value in one]
        sys.stdout.write(f"| {folder.name} | {' | '.join(cells)} |\n")
        sys.stdout.flush()
    with_trace = [one for one in scores if one.present]
    late = sum(not one.first_m <= LATE_M for one in with_trace)
    without = sum(not one.angle_m <= LATE_M for one in with_trace)
    missed, false = sum(one.missed for one in scores), sum(one.false for one in scores)
    present, absent = sum(one.present for one in scores), sum(one.absent for one in scores)
    sys.stdout.write(
        f"after {LATE_M} m, or never: first angle {without}, first trace {late} of {len(with_trace)} drives; "
        f"missed after it {missed} of {present}; false {false} of {absent}\n"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
