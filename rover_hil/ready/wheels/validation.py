"""How far the wheels miss the ground truth, with the description and with other numbers."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.drives.arrays import Array
from rover_hil.ready.wheels.geometry import Geometry
from rover_hil.ready.wheels.motion_kinds import KINDS
from rover_hil.ready.wheels.trajectory import Places, RecordedDrive, Trajectory
from rover_hil.ready.wheels.trajectory_fit import Segment, TrajectoryProblem, segments_of

YAW_M = 1.0
"""A yaw error counts as the error after driving on by so much."""
DIFFERS_SD = 1.0
"""Standard errors by which the mean errors of two sets of numbers differ."""
LEAST_CHANGE = 0.02
"""Errors that differ by a smaller share are equal."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveError:
    """What the wheels miss in a drive that was not used in the fit.

    Attributes:
        drive: The drive.
        kind: Of its motion.
        way_m: Length of its path.
        end_m: Distance from the ground truth at the end, from the true pose at the start: with the
            description, and with the numbers of the fit.
        end_rad: The same of the yaw; NaN without a measured yaw.
        missed_m: At the end of each segment, the yaw counted as a distance, (segments, 2).
        numbers: With which the wheels were compared: the description, and those of the fit.
    """

    drive: RecordedDrive
    kind: str
    way_m: float
    end_m: tuple[float, float]
    end_rad: tuple[float, float]
    missed_m: Array
    numbers: tuple[Mapping[str, float], Mapping[str, float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class KindErrors:
    """Errors of all validation drives of one kind of motion, with the description and with the numbers.

    Attributes:
        kind: Of the motion.
        drives: Their number.
        end_m: Mean distance at the end.
        end_rad: Mean yaw error at the end; NaN without a measured yaw.
        missed_m: Mean over segments, the yaw counted as a distance.
        change_sd_m: Standard error of the change of `missed_m`; infinite with one segment.
    """

    kind: str
    drives: int
    end_m: tuple[float, float]
    end_rad: tuple[float, float]
    missed_m: tuple[float, float]
    change_sd_m: float

    @property
    def is_worse(self) -> bool:
        """Whether the numbers are worse than the description."""
        return self._change_m > 0.0 and self._counts

    @property
    def is_better(self) -> bool:
        """Whether the numbers are better than the description."""
        return self._change_m < 0.0 and self._counts

    @property
    def _change_m(self) -> float:
        return self.missed_m[1] - self.missed_m[0]

    @property
    def _counts(self) -> bool:
        least_m = max(DIFFERS_SD * self.change_sd_m, LEAST_CHANGE * self.missed_m[0])
        return abs(self._change_m) > least_m


def drive_error(
    drive: RecordedDrive,
    kind: str,
    geometry: Geometry,
    before: Mapping[str, float],
    after: Mapping[str, float],
) -> DriveError:
    """Return what the wheels miss in a drive with two sets of numbers."""
    problem = TrajectoryProblem([drive], geometry, ())
    truth_m = drive.truth.x_m + 1j * drive.truth.y_m
    whole = Segment(0, 0, len(truth_m))
    ends, missed = [], []
    for values in (before, after):
        (path,) = problem.trajectories(values)
        ends.append(_end(drive, path, truth_m, whole))
        of_segments = [_end(drive, path, truth_m, each) for each in segments_of(drive, 0)]
        missed.append([math.hypot(end_m, YAW_M * np.nan_to_num(end_rad)) for end_m, end_rad in of_segments])
    return DriveError(
        drive=drive,
        kind=kind,
        way_m=float(np.abs(np.diff(truth_m)).sum()),
        end_m=(ends[0][0], ends[1][0]),
        end_rad=(ends[0][1], ends[1][1]),
        missed_m=np.array(missed).T,
        numbers=(before, after),
    )


def trajectories(error: DriveError, geometry: Geometry) -> tuple[Places, Places, Places]:
    """Return the places of the ground truth, and those by the wheels with the description and the numbers."""
    drive = error.drive
    truth_m = drive.truth.x_m + 1j * drive.truth.y_m
    problem = TrajectoryProblem([drive], geometry, ())
    whole = Segment(0, 0, len(truth_m))
    described_m, corrected_m = (
        truth_m[0] + _from_start(drive, path, truth_m, whole)[0]
        for values in error.numbers
        for path in problem.trajectories(values)
    )
    return truth_m, described_m, corrected_m


def by_kind(errors: Sequence[DriveError]) -> list[KindErrors]:
    """Return the errors of each kind of motion."""
    result = []
    for kind in KINDS:
        here = [each for each in errors if each.kind == kind]
        if not here:
            continue
        missed_m = np.concatenate([each.missed_m for each in here])
        change_m = missed_m[:, 1] - missed_m[:, 0]
        count = len(change_m)
        sd_m = float(np.std(change_m, ddof=1)) / math.sqrt(count) if count > 1 else math.inf
        result.append(
            KindErrors(
                kind=kind,
                drives=len(here),
                end_m=_means([each.end_m for each in here]),
                end_rad=_means([each.end_rad for each in here]),
                missed_m=_means(missed_m.tolist()),
                change_sd_m=sd_m,
            )
        )
    return result


def _means(pairs: Sequence[Sequence[float]]) -> tuple[float, float]:
    before, after = np.mean(np.array(pairs), axis=0).tolist()
    return before, after


def _end(drive: RecordedDrive, path: Trajectory, truth_m: Places, part: Segment) -> tuple[float, float]:
    """Return the errors of place and yaw at the end of a part of a drive, from the true pose at its start."""
    own_m, end_rad = _from_start(drive, path, truth_m, part)
    return float(abs(own_m[-1] - truth_m[part.end - 1] + truth_m[part.first])), end_rad


def _from_start(
    drive: RecordedDrive, path: Trajectory, truth_m: Places, part: Segment
) -> tuple[Places, float]:
    """Return the places by the wheels from the true pose at the start of a part, and the last yaw error.

    Without a measured yaw the direction at the start is the one that fits the part best, the yaw error NaN.
    """
    rows = slice(part.first, part.end)
    own_m, true_m = path.place_m[rows] - path.place_m[part.first], truth_m[rows] - truth_m[part.first]
    yaw_rad = drive.truth.yaw_rad
    if yaw_rad is None:
        turn_rad, end_rad = float(np.angle(np.vdot(own_m, true_m))), math.nan
    else:
        apart_rad = yaw_rad[rows] - path.yaw_rad[rows]
        turn_rad, end_rad = float(apart_rad[0]), abs(float(apart_rad[-1] - apart_rad[0]))
    return own_m * np.exp(1j * turn_rad), end_rad
