"""What the motion by wheels or gyro is compared with: poses, positions without yaw, or the gyro.

Each gives a residual: the root of the share of its motion that the compared motion leaves. What a healthy
rover does, too, is left free: a common factor is slip, a factor of the rotations alone is slip in turning,
the place of a marker is unknown.
"""

import cmath
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from rover_hil.drives.arrays import Array, Flags
from rover_hil.drives.channels import Channels
from rover_hil.drives.quality.drive_paths import GROUND_TRUTH, places_of
from rover_hil.drives.quality.motion import LEAST_WINDOWS, Windows

Steps: TypeAlias = NDArray[np.complex128]
"""Places or steps in the plane, the second coordinate as imaginary part."""
Number = TypeVar("Number", np.float64, np.complex128)
LEAST_WAY_M = 1.0
"""A drive that goes less far, and hardly turns, shows the noise of its ground truth."""
LEAST_TURN_RAD2 = 0.01
"""Sum of squares of rotations, so that noise of poses that do not turn is no measure."""
LEAST_TURN_RAD = 1.5
"""Drives that turn less in one sense do not show the sense of a rotation: uneven slip turns a rover, too."""
LEAST_SEGMENT_SD = 10.0
"""A segment of positions extends over so many of their standard deviations."""
LEAST_SEGMENT_WINDOWS = 8
LEAST_EXTENT_M = 0.3
CLEARLY = 0.6
"""Another factor of the rotations, or an arm of the marker, leaves less than this share of the residual, or
there is none."""
TURN_FACTORS = tuple(np.geomspace(0.35, 1.3, 14).tolist())
"""Of the rotations by wheels that slip in turning: see `SCALES` of the judge."""


class Fit(NamedTuple):
    """How well a motion fits.

    Attributes:
        residual: Share of the motion that is left, its root.
        scale: Motion of the reference over the compared one: the factor that is left free.
        distance_scale: The same of the distances alone.
        turn_scale: The same of the rotations alone.
    """

    residual: float
    scale: float
    distance_scale: float = 1.0
    turn_scale: float = 1.0


NO_FIT = Fit(math.inf, 1.0)


class Reference(Protocol):
    """Another measurement of the motion."""

    @property
    def name(self) -> str:
        """What it is, for the user."""
        ...

    def fit(self, moves: Array) -> Fit:
        """Return how well motion in the axes of the rover fits, (n, 3): ahead and left in m, yaw in rad."""
        ...

    def errors(self, moves: Array, like: Array) -> tuple[Array, int]:
        """Return the share of the motion that is left in each part of the drive, and its windows.

        Args:
            moves: As for `fit`.
            like: The motion as measured, which gives what is common to all parts.
        """
        ...

    def turn_factor(self, moves: Array, turn_rad: Array) -> Fit:
        """Return the factor of other rotations, (n,), that fits best along the distances of a motion.

        The factor is the `turn_scale`; any sign and size.
        """
        ...


@dataclass(frozen=True, slots=True)
class PoseReference:
    """Poses with yaw: rotations and distances of each window count alike.

    The axes of a marker may be turned against those of the rover: one angle is common to all distances.

    Attributes:
        name: What they are.
        is_used: Windows that are compared, (n,).
        turn_rad: (n,).
        step_m: In the axes of the marker, left as imaginary part, (n,).
        yaw_rad: In the middle of each window, (n,).
        wheels_turn: Whether the wheels report rotations that show their sense.
    """

    name: str
    is_used: Flags
    turn_rad: Array
    step_m: Steps
    yaw_rad: Array
    wheels_turn: bool

    def at_origin(self, moves: Array) -> "PoseReference":
        """Return the poses without the arm of their marker, where that explains what a motion leaves.

        A marker beside the origin goes 2 sin(rotation / 2) times its arm, across it.
        """
        if not self.turns:
            return self
        across = 2j * np.sin(0.5 * self.turn_rad)
        steps = np.column_stack((moves[:, 0] + 1j * moves[:, 1], across))[self.is_used]
        arm_m = np.linalg.lstsq(steps, self.step_m[self.is_used], rcond=1e-6)[0][1]
        other = replace(self, step_m=self.step_m - arm_m * across)
        return other if other.fit_there(moves).residual < CLEARLY * self.fit_there(moves).residual else self

    def arm_growth(self, moves: Array) -> float:
        """Return by how much an unknown arm makes the factor of distances less certain.

        On a circle the arm of a marker and a factor of the distance do the same: the root of the variance
        inflation factor of both.
        """
        steps = (moves[:, 0] + 1j * moves[:, 1])[self.is_used]
        across = 2j * np.sin(0.5 * self.turn_rad[self.is_used])
        sizes = float(np.linalg.norm(steps) * np.linalg.norm(across))
        alike = abs(complex(np.vdot(steps, across))) / max(sizes, 1e-30)
        return float(max(1.0 - alike**2, 1e-12) ** -0.5)

    def fit(self, moves: Array) -> Fit:
        """See `Reference`. One factor is common to rotations and distances."""
        return self.at_origin(moves).fit_there(moves)

    def fit_there(self, moves: Array) -> Fit:
        """Return the fit with the marker at the origin."""
        own, seen = self._weighted(moves, moves)
        scale = max(0.0, _factor(own.ravel(), seen.ravel()))
        residual = math.sqrt(float(np.sum((seen - scale * own) ** 2) / max(float(np.sum(seen**2)), 1e-30)))
        distance = _factor(own[:, 1:].ravel(), seen[:, 1:].ravel())
        return Fit(residual, scale, distance, _factor(own[:, 0], seen[:, 0]))

    def errors(self, moves: Array, like: Array) -> tuple[Array, int]:
        """See `Reference`. All parts have the axes and the arm of the marker in common."""
        errors = np.zeros(len(moves))
        errors[self.is_used] = self.at_origin(like).errors_there(moves, like)
        return errors, 1

    def errors_there(self, moves: Array, like: Array) -> Array:
        """Return the errors of windows in use with the marker at the origin."""
        own, seen = self._weighted(moves, like)
        errors: Array = np.sum((seen - own) ** 2, axis=1) / max(float(np.sum(seen**2)), 1e-30)
        return errors

    def turn_factor(self, moves: Array, turn_rad: Array) -> Fit:
        """See `Reference`."""
        if not self.turns:
            return NO_FIT
        return _turns_alone(turn_rad[self.is_used], self.turn_rad[self.is_used])

    def mirrored(self) -> "PoseReference":
        """Return poses with y of the opposite sign, which is x and y exchanged in axes that are turned."""
        return replace(self, step_m=self.step_m.conjugate() * np.exp(-2j * self.yaw_rad))

    def reversed_yaw(self) -> "PoseReference":
        """Return poses with a yaw of the opposite sign."""
        step_m = self.step_m * np.exp(2j * self.yaw_rad)
        return replace(self, step_m=step_m, turn_rad=-self.turn_rad, yaw_rad=-self.yaw_rad)

    def aside_rad(self, moves: Array) -> float:
        """Return by how much the axes of the marker are turned against those of the motion."""
        steps = moves[self.is_used, 0] + 1j * moves[self.is_used, 1]
        return cmath.phase(complex(np.vdot(steps, self.step_m[self.is_used])))

    @property
    def turns(self) -> bool:
        """Whether the rover turns so far that the sense of its rotation is shown."""
        return bool(np.ptp(np.cumsum(self.turn_rad)) >= LEAST_TURN_RAD)

    @property
    def goes(self) -> bool:
        """Whether the rover goes so far that its distances are shown."""
        return bool(np.abs(self.step_m[self.is_used]).sum() >= LEAST_WAY_M)

    def _weighted(self, moves: Array, like: Array) -> tuple[Array, Array]:
        """Return rotations and distances of a motion and of the poses, both counted alike, (used, 3)."""
        steps = (moves[:, 0] + 1j * moves[:, 1]) * np.exp(1j * self.aside_rad(like))
        own = np.column_stack((moves[:, 2], steps.real, steps.imag))[self.is_used]
        seen = np.column_stack((self.turn_rad, self.step_m.real, self.step_m.imag))[self.is_used]
        turns, distances = float(np.sum(seen[:, 0] ** 2)), float(np.sum(seen[:, 1:] ** 2))
        # A drive that does not turn is judged by its distances, and one on the spot by its rotations. Wheels
        # that report rotations which the poses do not have contradict them, too.
        turns_count = self.turns or self.wheels_turn
        along = distances**-0.5 if self.goes else 0.0
        weights = np.array([max(turns, LEAST_TURN_RAD2) ** -0.5 if turns_count else 0.0, along, along])
        return own * weights, seen * weights


@dataclass(frozen=True, slots=True)
class GyroReference:
    """The gyro: rotations of each window.

    Attributes:
        name: What it is.
        turn_rad: (n,).
    """

    name: str
    turn_rad: Array

    def fit(self, moves: Array) -> Fit:
        """See `Reference`."""
        return _turns_alone(moves[:, 2], self.turn_rad)

    def errors(self, moves: Array, like: Array) -> tuple[Array, int]:
        """See `Reference`."""
        return (self.turn_rad - moves[:, 2]) ** 2 / max(float(self.turn_rad @ self.turn_rad), 1e-30), 1

    def turn_factor(self, moves: Array, turn_rad: Array) -> Fit:
        """See `Reference`."""
        return _turns_alone(turn_rad, self.turn_rad)


@dataclass(frozen=True, slots=True)
class PositionReference:
    """Positions without yaw: the shape of the path, in segments of unknown direction.

    Attributes:
        name: What they are.
        place_m: At the edges of the windows, ahead as real part, NaN where unknown, (n + 1,).
        segment: Number of windows of each segment.
        arm_m: Where on the rover they are, ahead as real part.
    """

    name: str
    place_m: Steps
    segment: int
    arm_m: complex = 0j

    def fit(self, moves: Array) -> Fit:
        """See `Reference`. Distances and rotations have a factor each."""
        plain = self._best(moves, moves[:, 2], (1.0,))
        if np.abs(moves[:, 2]).sum() < LEAST_TURN_RAD:
            return plain  # a path that hardly bends fits any factor
        best = self._best(moves, moves[:, 2], TURN_FACTORS)
        return best if best.residual < CLEARLY * plain.residual else plain

    def errors(self, moves: Array, like: Array) -> tuple[Array, int]:
        """See `Reference`."""
        products, squares, seen = self._products(moves, moves[:, 2])
        left = seen - products**2 / np.maximum(squares, 1e-30)
        return left / max(float(seen.sum()), 1e-30), self.segment

    def turn_factor(self, moves: Array, turn_rad: Array) -> Fit:
        """See `Reference`."""
        sizes = np.geomspace(1.0 / 80.0, 80.0, 141).tolist()
        coarse = self._best(moves, turn_rad, [sign * size for sign in (1.0, -1.0) for size in (*sizes, 1.0)])
        return self._best(moves, turn_rad, (coarse.turn_scale * np.linspace(0.94, 1.06, 13)).tolist())

    def mirrored(self, stretch: float) -> "PositionReference":
        """Return positions whose coordinates are exchanged, one of them in units that are longer."""
        return replace(self, place_m=self.place_m.imag + 1j * stretch * self.place_m.real)

    def _best(self, moves: Array, turn_rad: Array, factors: Sequence[float]) -> Fit:
        fits = [self._shape(moves, factor * turn_rad)._replace(turn_scale=factor) for factor in factors]
        return min(fits, key=lambda each: each.residual)

    def _shape(self, moves: Array, turn_rad: Array) -> Fit:
        products, squares, seens = self._products(moves, turn_rad)
        both, square, seen = float(products.sum()), float(squares.sum()), float(seens.sum())
        if square <= 0.0 or seen <= 0.0:
            return NO_FIT
        scale = both / square
        return Fit(math.sqrt(max(0.0, 1.0 - both**2 / (square * seen))), scale, scale)

    def _products(self, moves: Array, turn_rad: Array) -> tuple[Array, Array, Array]:
        """Return of each segment the product of both paths at their best direction, and their squares."""
        yaw_rad = np.concatenate(([0.0], np.cumsum(turn_rad)))
        steps = (moves[:, 0] + 1j * moves[:, 1]) * np.exp(0.5j * (yaw_rad[1:] + yaw_rad[:-1]))
        own = _parts(
            np.concatenate(([0j], np.cumsum(steps))) + self.arm_m * np.exp(1j * yaw_rad), self.segment
        )
        true = _parts(self.place_m, self.segment)
        known = np.isfinite(true)
        own, true = _middled(own, known), _middled(true, known)
        products = np.abs((own.conjugate() * true).sum(axis=1))
        return products, (np.abs(own) ** 2).sum(axis=1), (np.abs(true) ** 2).sum(axis=1)


def references_of(rows: Channels, windows: Windows, turn_rad: Array) -> Iterator[Reference]:
    """Yield what the motion of windows can be compared with, the ground truth first.

    Args:
        rows: The drive.
        windows: Of it.
        turn_rad: By the wheels, (n,).
    """
    for name, places in places_of(rows):
        inside = (windows.edges_s >= places.t_s[0]) & (windows.edges_s <= places.t_s[-1])
        x_m, y_m = (np.interp(windows.edges_s, places.t_s, values) for values in (places.x_m, places.y_m))
        place_m = np.where(inside, x_m + 1j * y_m, math.nan)
        if places.yaw_rad is not None and name == GROUND_TRUTH:
            yaw_rad = np.interp(windows.edges_s, places.t_s, places.yaw_rad)
            is_used = windows.is_moving & inside[1:] & inside[:-1]
            middle_rad = 0.5 * (yaw_rad[1:] + yaw_rad[:-1])
            steps_m = np.diff(x_m + 1j * y_m) * np.exp(-1j * middle_rad)
            wheels_turn = bool(np.ptp(np.cumsum(turn_rad)) >= LEAST_TURN_RAD)
            reference = PoseReference(
                name, is_used, np.diff(yaw_rad), steps_m, middle_rad, wheels_turn=wheels_turn
            )
            if is_used.sum() >= LEAST_WINDOWS and (reference.goes or reference.turns):
                yield reference
        elif segment := _segment(place_m, places.sd_m, turn_rad):
            yield PositionReference(name, place_m, segment, places.arm_m)


def _segment(place_m: Steps, sd_m: float, turn_rad: Array) -> int:
    """Return how many windows make a segment that extends and turns far enough; 0 where none does.

    A rover that hardly turns is judged by the longest ones.
    """
    known = place_m[np.isfinite(place_m)]
    way_m = np.abs(np.diff(known)).sum() if len(known) > 1 else 0.0
    yaw_rad = np.concatenate(([0.0], np.cumsum(turn_rad)))
    segment, extends = LEAST_SEGMENT_WINDOWS, 0
    while way_m >= LEAST_WAY_M and segment < len(place_m):
        parts = _parts(place_m, segment)
        extent_m = np.sqrt(np.mean(np.abs(_middled(parts, np.isfinite(parts))) ** 2, axis=1))
        if np.quantile(extent_m, 0.75) >= max(LEAST_EXTENT_M, LEAST_SEGMENT_SD * sd_m):
            extends = segment
            if np.median(np.ptp(_parts(yaw_rad, segment), axis=1)) >= LEAST_TURN_RAD:
                return segment
        segment *= 2
    return extends


def _parts(values: NDArray[Number], segment: int) -> NDArray[Number]:
    """Return values at the edges of windows in segments, both ends with it, (segments, windows + 1)."""
    starts = np.arange(0, len(values) - segment, segment)
    result: NDArray[Number] = values[starts[:, np.newaxis] + np.arange(segment + 1)]
    return result


def _middled(places: Steps, known: Flags) -> Steps:
    count = np.maximum(known.sum(axis=1, keepdims=True), 1)
    middle = np.where(known, places, 0.0).sum(axis=1, keepdims=True) / count
    result: Steps = np.where(known, places - middle, 0.0)
    return result


def _turns_alone(own_rad: Array, true_rad: Array) -> Fit:
    factor = _factor(own_rad, true_rad)
    left = float(np.sum((true_rad - factor * own_rad) ** 2) / max(float(true_rad @ true_rad), 1e-30))
    return Fit(math.sqrt(left), factor, turn_scale=factor)


def _factor(own: Array, true: Array) -> float:
    square = float(own @ own)
    return float(own @ true) / square if square > 0.0 else 0.0
