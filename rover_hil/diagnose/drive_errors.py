"""Errors of odometry and estimate against the ground truth: of each drive, and of all together."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rover_hil.diagnose.intervals import Interval, mean_of
from rover_hil.diagnose.replayed_drive import Replay, ReplayedDrive
from rover_hil.diagnose.trajectory_errors import (
    Places,
    RelativeErrors,
    Trajectory,
    absolute_errors,
    motions,
    pairs_by_distance,
    pairs_by_rotation,
    relative_errors,
)
from rover_hil.drives.arrays import Array, rms
from rover_hil.drives.quality.learned_ground import LEAST_LEGS
from rover_hil.ready.wheels.geometry import DELAY, MARKER_X, MARKER_Y, MARKER_YAW

LEAST_POSES = 3
LEG_M = 1.0
LEGS_M = (1.0, 0.5, 0.25)
PARTS_M = (50.0, 20.0, 10.0, 5.0, 2.0, 1.0)
"""Length of the parts of a drive whose errors are taken per 100 m: the longest of which there are enough."""
PARTS_RAD = (math.tau, math.pi, 0.5 * math.pi)
LEAST_PARTS = 8
ESTIMATE, ODOMETRY = "estimate", "odometry"
TRACKS = (ODOMETRY, ESTIMATE)
LEFT, RIGHT = "left", "right"
ONE_WAY = 0.5
"""Share of the angle of a part by which it must turn to one side."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Compared:
    """Tracks of a drive at the times of its known places, m of them.

    Attributes:
        t_s: Times since the start of the log, (m,).
        true: Known places, at the origin of the rover where their yaw is known.
        tracks: Odometry and estimate by name, where the known places are measured.
    """

    t_s: Array
    true: Trajectory
    tracks: Mapping[str, Trajectory]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackErrors:
    """Errors of a track of one drive.

    Attributes:
        ate_m: Root mean square distance after alignment, as `evo_ape --align`.
        rpe_m: Root mean square error of the motion over a metre, as `evo_rpe --delta 1 --delta_unit m`;
            without yaw that of its length, as with `--pose_relation point_distance`. NaN for none.
        rpe_rad: The same of the yaw change over the angle of `per_rotation`; NaN without yaw.
    """

    ate_m: float
    rpe_m: float
    rpe_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """Errors of all drives with known places.

    Attributes:
        of_drives: By name of the drive, then of the track.
        together: By name of the track, over all drives.
        part_m: Length of the parts behind `per_100_m`.
        per_100_m: Mean error of the place at the end of such a part, for 100 m, by name of the track.
        part_rad: Angle of the parts behind `per_rotation`.
        per_rotation_rad: Mean yaw error of such a part, for one rotation, in its direction: positive where
            the track turns too far. Parts that turn back and forth count only where all do.
        per_rotation_to_rad: The same of the rotations to the `LEFT` and to the `RIGHT`, by name of the track;
            none of parts that turn back and forth.
    """

    of_drives: Mapping[str, Mapping[str, TrackErrors]]
    together: Mapping[str, TrackErrors]
    part_m: float
    per_100_m: Mapping[str, Interval]
    part_rad: float
    per_rotation_rad: Mapping[str, Interval]
    per_rotation_to_rad: Mapping[str, Mapping[str, Interval]]


def compare(each: ReplayedDrive, replay: Replay, marker: Mapping[str, float]) -> Compared | None:
    """Return the tracks of a drive at the times of its known places; None for too few of these.

    Args:
        each: The drive.
        replay: Its tracks.
        marker: Where on the rover the known places are, beyond what the drive says; see
            `rover_hil.ready.wheels.geometry`.
    """
    truth = each.truth
    if truth is None:
        return None
    at_s = truth.t_s - marker.get(DELAY, 0.0)
    inside = (at_s >= replay.t_s[0]) & (at_s <= replay.t_s[-1])
    if inside.sum() < LEAST_POSES:
        return None
    place_m = (truth.x_m + 1j * truth.y_m)[inside]
    lever_m = complex(marker.get(MARKER_X, 0.0), marker.get(MARKER_Y, 0.0)) + truth.arm_m
    tracks = {name: replay.at(at_s[inside], getattr(replay, name)) for name in TRACKS}
    if truth.yaw_rad is None:
        tracks = {name: _at_lever(track, lever_m) for name, track in tracks.items()}
        return Compared(t_s=at_s[inside], true=Trajectory(place_m, None), tracks=tracks)
    yaw_rad = truth.yaw_rad[inside] - marker.get(MARKER_YAW, 0.0)
    true = Trajectory(place_m - lever_m * np.exp(1j * yaw_rad), yaw_rad)
    return Compared(t_s=at_s[inside], true=true, tracks=tracks)


def _at_lever(track: Trajectory, lever_m: complex) -> Trajectory:
    assert track.yaw_rad is not None  # noqa: S101 tracks of a replay have one
    return Trajectory(track.place_m + lever_m * np.exp(1j * track.yaw_rad), track.yaw_rad)


def errors_of(compared: Mapping[str, Compared]) -> Errors | None:
    """Return the errors of drives by name; None without a drive."""
    if not compared:
        return None
    part_m, part_rad = _part_m(compared.values()), _part_rad(compared.values())
    together: dict[str, TrackErrors] = {}
    of_drives: dict[str, dict[str, TrackErrors]] = {name: {} for name in compared}
    per_100_m: dict[str, Interval] = {}
    per_rotation: dict[str, Interval] = {}
    to_sides: dict[str, dict[str, Interval]] = {}
    for name in TRACKS:
        absolute, legs_m, turns_rad = [], [], []
        of_100_m, of_rotation, turned_rad = [], list[Array](), list[Array]()
        for drive, each in compared.items():
            own, true, odometry = each.tracks[name], each.true, each.tracks[ODOMETRY]
            absolute.append(absolute_errors(own.place_m, true.place_m))
            legs_m.append(np.abs(relative_errors(own, true, pairs_by_distance(own, LEG_M)).place_m))
            turns = _rotations(own, true, pairs_by_rotation(own, part_rad))
            turns_rad.append(turns)
            of_drives[drive][name] = TrackErrors(
                ate_m=rms(absolute[-1]), rpe_m=_rms(legs_m[-1]), rpe_rad=_rms(turns)
            )
            pairs = pairs_by_distance(odometry, part_m)
            parts_m = np.abs(relative_errors(own, true, pairs).place_m)
            of_100_m.append((100.0 / part_m * parts_m).tolist())
            pairs = pairs_by_rotation(odometry, part_rad)
            of_rotation.append(_rotations(own, true, pairs))
            turned_rad.append(_turned(own, pairs) if of_rotation[-1].size else np.zeros(0))
        together[name] = TrackErrors(
            ate_m=rms(np.concatenate(absolute)),
            rpe_m=_rms(np.concatenate(legs_m)),
            rpe_rad=_rms(np.concatenate(turns_rad)),
        )
        per_100_m[name] = mean_of(of_100_m, 0.0)
        to_left, to_right = (
            _one_way(of_rotation, [sign * each for each in turned_rad], part_rad) for sign in (1.0, -1.0)
        )
        to_sides[name] = {LEFT: mean_of(to_left), RIGHT: mean_of(to_right)}
        both = [left + right for left, right in zip(to_left, to_right, strict=True)]
        per_rotation[name] = mean_of(
            both if any(both) else [(math.tau / part_rad * each).tolist() for each in of_rotation]
        )
    return Errors(
        of_drives=of_drives,
        together=together,
        part_m=part_m,
        per_100_m=per_100_m,
        part_rad=part_rad,
        per_rotation_rad=per_rotation,
        per_rotation_to_rad=to_sides,
    )


def travel_shares(compared: Compared, leg_m: float) -> Places:
    """Return the true travel of each leg over that of the wheels, left as imaginary part; none without yaw.

    Each travel is in the frame of its own first pose.
    """
    wheels = compared.tracks[ODOMETRY]
    if compared.true.yaw_rad is None:
        return np.zeros(0, np.complex128)
    pairs = pairs_by_distance(wheels, leg_m)
    rolled_m = motions(wheels, pairs)
    goes = np.abs(rolled_m) > 0.5 * leg_m  # in a tight bend the chord is short, and its share uncertain
    shares: Places = motions(compared.true, pairs)[goes] / rolled_m[goes]
    return shares


def leg_m(compared: Collection[Compared]) -> float:
    """Return the length of legs that show slip: a metre, less where there would be too few of them."""
    return next((size for size in LEGS_M if _count(compared, size) >= LEAST_LEGS), LEGS_M[-1])


def _count(compared: Collection[Compared], size_m: float) -> int:
    return sum(len(pairs_by_distance(each.tracks[ODOMETRY], size_m)[0]) for each in compared)


def _rotations(own: Trajectory, true: Trajectory, pairs: tuple[np.ndarray, np.ndarray]) -> Array:
    """Return the yaw error of each pair, positive where the rotation is too large; none without yaw."""
    errors: RelativeErrors = relative_errors(own, true, pairs)
    if errors.yaw_rad is None or own.yaw_rad is None:
        return np.zeros(0)
    return errors.yaw_rad * np.sign(_turned(own, pairs))


def _one_way(errors_rad: Sequence[Array], turned_rad: Sequence[Array], part_rad: float) -> list[list[float]]:
    """Return the errors of the parts of each drive that turn one way, the positive one, for one rotation."""
    found = []
    for errors, turned in zip(errors_rad, turned_rad, strict=True):
        is_one_way = turned > ONE_WAY * part_rad
        found.append((math.tau * errors[is_one_way] / turned[is_one_way]).tolist())
    return found


def _turned(own: Trajectory, pairs: tuple[np.ndarray, np.ndarray]) -> Array:
    """Return the yaw change of each pair."""
    first, end = pairs
    assert own.yaw_rad is not None  # noqa: S101 the callers have checked it
    return np.asarray(own.yaw_rad[end] - own.yaw_rad[first])


def _rms(values: Array) -> float:
    return rms(values) if values.size else math.nan


def _part_m(compared: Collection[Compared]) -> float:
    return next((size for size in PARTS_M if _count(compared, size) >= LEAST_PARTS), PARTS_M[-1])


def _part_rad(compared: Collection[Compared]) -> float:
    for size in PARTS_RAD:
        if sum(len(pairs_by_rotation(each.tracks[ODOMETRY], size)[0]) for each in compared) >= LEAST_PARTS:
            return size
    return PARTS_RAD[-1]
