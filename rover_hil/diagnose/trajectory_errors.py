"""Errors of a trajectory as `evo` defines them: ATE after alignment, and RPE.

S. Umeyama: Least-squares estimation of transformation parameters between two point patterns. IEEE
Transactions on Pattern Analysis and Machine Intelligence 13 (1991) 376-380; in the plane, without scale and
without reflection. M. Grupp: evo, github.com/MichaelGrupp/evo: consecutive pairs by the estimated one.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rover_hil.drives.arrays import Array, Times, wrap_angles

Places = NDArray[np.complex128]
"""Places in the plane, m; the second coordinate as imaginary part."""


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Poses of n times.

    Attributes:
        place_m: (n,).
        yaw_rad: Unwrapped, (n,); None where it is not known.
    """

    place_m: Places
    yaw_rad: Array | None


@dataclass(frozen=True, slots=True, kw_only=True)
class RelativeErrors:
    """Errors of the motion between pairs of poses, k of them.

    Attributes:
        first, end: Numbers of the poses of each pair, (k,).
        place_m: Translation of the error in the frame of the first pose, (k,); without a known yaw the
            difference of the distances instead, as `point_distance` of `evo`.
        yaw_rad: Estimated minus true yaw change, (k,); None without a known yaw.
    """

    first: Times
    end: Times
    place_m: Places
    yaw_rad: Array | None


def aligned(own_m: Places, true_m: Places) -> Places:
    """Return places moved and turned so that they fit the true ones best."""
    own, towards = own_m - own_m.mean(), true_m - true_m.mean()
    turn_rad = float(np.angle(np.vdot(own, towards)))
    moved: Places = true_m.mean() + own * complex(math.cos(turn_rad), math.sin(turn_rad))
    return moved


def absolute_errors(own_m: Places, true_m: Places) -> Array:
    """Return the distance of each place from the true one after alignment; the ATE is their rms."""
    return np.abs(aligned(own_m, true_m) - true_m)


def pairs_by(steps: Array, size: float) -> tuple[Times, Times]:
    """Return first and last pose of consecutive pairs between which the steps reach a size.

    Args:
        steps: Not negative, between n poses, (n - 1,).
        size: Of the sum, at least; the pose that reaches it begins the next pair.
    """
    edges, total = [0], 0.0
    for place, step in enumerate(steps.tolist(), start=1):
        total += step
        if total >= size:
            edges.append(place)
            total = 0.0
    places = np.array(edges, np.int64)
    return places[:-1], places[1:]


def pairs_by_distance(own: Trajectory, distance_m: float) -> tuple[Times, Times]:
    """Return pairs of poses between which a trajectory is at least so long."""
    return pairs_by(np.abs(np.diff(own.place_m)), distance_m)


def pairs_by_rotation(own: Trajectory, rotation_rad: float) -> tuple[Times, Times]:
    """Return pairs between which the yaw changes by at least so much, back and forth added."""
    steps = np.zeros(0) if own.yaw_rad is None else np.abs(wrap_angles(np.diff(own.yaw_rad)))
    return pairs_by(steps, rotation_rad)


def relative_errors(own: Trajectory, true: Trajectory, pairs: tuple[Times, Times]) -> RelativeErrors:
    """Return the errors of the motion of each pair."""
    first, end = pairs
    if own.yaw_rad is None or true.yaw_rad is None:
        lengths = [np.abs(each.place_m[end] - each.place_m[first]) for each in (own, true)]
        return RelativeErrors(first=first, end=end, place_m=lengths[0] - lengths[1] + 0j, yaw_rad=None)
    own_m, true_m = motions(own, pairs), motions(true, pairs)
    turned = true.yaw_rad[end] - true.yaw_rad[first]
    error_rad = own.yaw_rad[end] - own.yaw_rad[first] - turned
    return RelativeErrors(
        first=first,
        end=end,
        place_m=(own_m - true_m) * np.exp(-1j * turned),
        yaw_rad=error_rad,
    )


def motions(path: Trajectory, pairs: tuple[Times, Times]) -> Places:
    """Return the motion of each pair in the frame of its first pose; of a trajectory with yaw."""
    first, end = pairs
    assert path.yaw_rad is not None  # noqa: S101 the callers have checked it
    moved: Places = (path.place_m[end] - path.place_m[first]) * np.exp(-1j * path.yaw_rad[first])
    return moved
