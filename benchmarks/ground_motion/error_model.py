"""Errors of the model of a ground camera that long batteries drive with, beside those of rendered drives.

    python -m benchmarks.ground_motion.error_model FOLDER [FOLDER ...] [--every 1] [--draws 20]

A folder is a drive, or holds drives, as of `benchmarks.ground_motion.drives`. The model of
`tests/nature/ground_camera.py` sees the true poses of each drive, `--draws` times with other errors. Prints
both, of all drives together:

- bias: error of the travel of a drive over itself, rms of the drives;
- error over 0.1 and 0.5 m of the way, rms, over the way; and of a pair, rms, mm;
- correlation of the errors of neighbouring pairs, the bias included;
- share of the pairs that are valid, and the longest run without one.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import cv2
import numpy as np

from benchmarks.ground_motion.drives import drives_in
from benchmarks.ground_motion.measured import Floats, Pairs, measure
from benchmarks.ground_motion.scores import parts
from drivers.clock import nanoseconds
from tests.nature.ground_camera import CameraErrors, GroundCamera

LEAST_TRAVEL_M = 0.3
"""A drive that goes less far has no bias."""


@dataclass(frozen=True, kw_only=True)
class ErrorFigures:
    """What the errors forward are like; shares of the travel, but for correlation and run."""

    bias: float
    over_01_m: float
    over_05_m: float
    pair_mm: float
    correlation: float
    valid: float
    longest_run: float


def figures(drives: Sequence[Pairs]) -> ErrorFigures:
    """Return the figures of drives, pooled."""
    biases, products, squares, pair_m = [], [], [], []
    for pairs in drives:
        error_m = pairs.found[:, 0] - pairs.true[:, 0]
        true_m = float(np.abs(pairs.true[pairs.valid, 0]).sum())
        if true_m > LEAST_TRAVEL_M:
            biases.append(float(error_m[pairs.valid].sum()) / true_m)
        both = pairs.valid[1:] & pairs.valid[:-1]
        products.append(float((error_m[1:] * error_m[:-1])[both].sum()))
        squares.append(float(((error_m[1:] ** 2 + error_m[:-1] ** 2) / 2)[both].sum()))
        pair_m += error_m[pairs.valid].tolist()
    valid = np.concatenate([pairs.valid for pairs in drives])
    runs = [len(list(run)) for pairs in drives for seen, run in groupby(pairs.valid.tolist()) if not seen]
    return ErrorFigures(
        bias=_rms(biases),
        over_01_m=_rms([e for pairs in drives for e in _over(pairs, 0.1)]),
        over_05_m=_rms([e for pairs in drives for e in _over(pairs, 0.5)]),
        pair_mm=1e3 * _rms(pair_m),
        correlation=sum(products) / sum(squares),
        valid=float(valid.mean()),
        longest_run=max(runs, default=0),
    )


def modelled(pairs: Pairs, seed: int, errors: CameraErrors | None = None) -> Pairs:
    """Return the pairs of a drive as the model of a camera measures them.

    Args:
        pairs: What is true of the drive.
        seed: Of the errors.
        errors: How the camera errs.
    """
    errors = replace(errors or CameraErrors(), period_ns=1, delay_ns=0)
    rover = _Replayed(pairs.true)
    camera = GroundCamera(rover, np.random.default_rng(seed), errors, point_m=(0.0, 0.0))
    velocities, sd, valid, reasons = [], [], [], []
    for number in range(len(pairs.true) + 1):
        rover.number = number
        t_ns = nanoseconds(1.0 + number)
        (frame,) = camera.frames(t_ns)
        motion = camera.measure(frame, t_ns, None)
        if motion is not None:
            velocities.append([motion.forward_m, motion.left_m, motion.turn_rad])
            sd.append([motion.forward_sd_m, motion.left_sd_m, motion.turn_sd_rad])
            valid.append(motion.is_valid)
            reasons.append(motion.invalid_because)
    return replace(pairs, found=np.array(velocities), sd=np.array(sd), valid=np.array(valid), reasons=reasons)


@dataclass(frozen=True, slots=True)
class _Place:
    x_m: float
    y_m: float
    yaw_rad: float


class _Replayed:
    """A rover that is where a drive was.

    Args:
        true: Forward, left, turn of each pair, in the axes of its later frame.
    """

    def __init__(self, true: Floats) -> None:
        yaw_rad = np.r_[0.0, np.cumsum(true[:, 2])]
        place_m = np.r_[0.0, np.cumsum((true[:, 0] + 1j * true[:, 1]) * np.exp(1j * yaw_rad[1:]))]
        self._places = [
            _Place(place.real, place.imag, yaw)
            for place, yaw in zip(place_m.tolist(), yaw_rad.tolist(), strict=True)
        ]
        self.number = 0

    def truth(self) -> _Place:
        """Return the place at the frame."""
        return self._places[self.number]


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--every", type=int, default=1, help="use only every so many frames")
    parser.add_argument("--draws", type=int, default=20, help="of the model's errors, for each drive")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    drives = [measure(folder, every=given.every) for folder in drives_in(given.folders)]
    model = [
        modelled(pairs, given.draws * number + draw)
        for number, pairs in enumerate(drives)
        for draw in range(given.draws)
    ]
    sys.stdout.write("| | rendered | model |\n|---|---|---|\n")
    rows = zip(vars(figures(drives)).items(), vars(figures(model)).values(), strict=True)
    for (name, rendered), of_model in rows:
        sys.stdout.write(f"| {name} | {rendered:.4f} | {of_model:.4f} |\n")
    return 0


def _over(pairs: Pairs, length_m: float) -> list[float]:
    """Return errors of the travel over stretches of a length, as shares of it."""
    errors = []
    for part in parts(np.abs(pairs.true[:, 0]), length_m):
        valid = pairs.valid[part]
        true_m = float(np.abs(pairs.true[part, 0][valid]).sum())
        if valid.any() and true_m > length_m / 2:
            errors.append(float((pairs.found[part, 0] - pairs.true[part, 0])[valid].sum()) / true_m)
    return errors


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")


if __name__ == "__main__":
    sys.exit(main())
