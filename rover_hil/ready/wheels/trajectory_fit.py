"""Least squares over trajectories: numbers of the geometry and of the marker, with honest intervals.

A drive is cut into segments. In each the trajectory by the wheels is moved and turned so that it fits the
ground truth best; what is left depends on the numbers alone. Each segment counts as one observation: errors
within it (slip, calibration of the ground truth) last long. Intervals come from leaving out one unit after
the other, a drive or where there are few drives a segment, from how far the numbers differ from those of
whole drives, and from what the data do not show: each number is known before to its plausible range, and a
number that the data do not show adds that range to those that are confounded with it.
"""

import math
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.stats import t as student

from rover_hil.drives.arrays import Array
from rover_hil.drives.quality.drive_paths import moves_of, rounded_angles
from rover_hil.ready.wheels.geometry import (
    MARKER_YAW,
    STEERING_DELAY,
    Geometry,
    Number,
)
from rover_hil.ready.wheels.trajectory import STEP_S, RecordedDrive, Trajectory, of_marker, wheel_trajectory

CONFIDENCE, NORMAL = 0.95, 1.96
SEGMENT_S = 20.0
"""Longer than slip and the ground stay alike."""
LEAST_DRIVES = 6
"""With fewer drives the units are segments, and"""
FEWEST_DRIVES = 3
"""from so many on, what differs between drives counts, too."""
LEAST_SD = (5e-4, 5e-4)
"""Of places in m and of yaw in rad: no ground truth is better."""
FIRST_SD = (0.05, 0.05)
ROUNDS = 8
SETTLED = 1e-6
"""Greatest step of a number, over its plausible range, of a fit that has settled."""
LEAST_HALF_WIDTH = 1e-4
"""Of any number: trajectories are no better integrated."""
SHOWN = 0.5
"""A number is shown where its interval is narrower than this share of its plausible range."""
NODES = 150
"""Steering angles of one wheel between which the effects of the wheels are interpolated."""
PATHS = 4
"""Trajectories of each drive that are kept: derivatives by the marker need those of the last point only."""
STEP = 1e-4
"""Of a number, over its plausible range, for the derivatives."""


@dataclass(frozen=True, slots=True)
class Segment:
    """A part of a drive: the poses `first` to `end` of its ground truth."""

    drive: int
    first: int
    end: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A number after the fit.

    Attributes:
        value: Difference from the description; 0 where the data do not show it.
        half_width: Of the 95 % interval; where it is not shown, that of a fit in which it is free.
        is_shown: Whether it is part of the result.
    """

    number: Number
    value: float
    half_width: float
    is_shown: bool

    @property
    def differs(self) -> bool:
        """Whether the interval of a number that is shown does not contain the description."""
        return self.is_shown and abs(self.value) > self.half_width


@dataclass(frozen=True, slots=True, kw_only=True)
class TrajectoryFit:
    """What came out.

    Attributes:
        estimates: Of all numbers.
        sd: Standard deviation of what is left, of places in m and of yaw in rad.
        units: Number of units that the intervals are from.
        without: Numbers by name without each drive in turn, of those that were fitted.
    """

    estimates: Sequence[Estimate]
    sd: tuple[float, float]
    units: int
    without: Sequence[Mapping[str, float]]

    @property
    def values(self) -> dict[str, float]:
        """The numbers by name."""
        return {each.number.name: each.value for each in self.estimates if each.is_shown}


@dataclass(frozen=True, slots=True)
class Solution:
    """A minimum.

    Attributes:
        values: Numbers by name, in the order of the derivatives.
        scale: Their plausible standard deviations, by which the derivatives are.
        residuals: Of each segment.
        slopes: Derivatives of the residuals of each segment, (rows, numbers).
        sd: Standard deviations of places in m and of yaw in rad.
    """

    values: Mapping[str, float]
    scale: Array
    residuals: Sequence[Array]
    slopes: Sequence[Array]
    sd: tuple[float, float]


class TrajectoryProblem:
    """Segments of drives, and the numbers that may differ.

    Args:
        drives: The drives.
        geometry: Of their rover.
        numbers: That may differ.
        by_kind: The number that has a value of its own for each kind of motion, "" for none, and the kind of
            each drive. Its names are then those of `named`.
        segment_s: About the length of a segment.

    Attributes:
        segments: Of all drives.
    """

    def __init__(
        self,
        drives: Sequence[RecordedDrive],
        geometry: Geometry,
        numbers: Sequence[Number],
        by_kind: tuple[str, Sequence[str]] = ("", ()),
        segment_s: float = SEGMENT_S,
    ) -> None:
        self.drives, self.geometry = drives, geometry
        self._by_kind, self._kinds = by_kind
        self.numbers = [
            replace(number, name=name)
            for number in numbers
            for name in (
                [named(number.name, kind) for kind in dict.fromkeys(self._kinds)]
                if number.name == self._by_kind
                else [number.name]
            )
        ]
        self.segments = [
            each for place, drive in enumerate(drives) for each in segments_of(drive, place, segment_s)
        ]
        self._plausible = {number.name: number.plausible for number in self.numbers}
        self._paths: dict[tuple[int, tuple[float, ...]], Trajectory] = {}
        self._nodes = _SteeringNodes(drives)
        self._effects: dict[tuple[float, ...], Array] = {}

    def of_whole_drives(self) -> "TrajectoryProblem":
        """Return the same problem, each drive of which is one segment."""
        whole = copy(self)
        whole.segments = [Segment(place, 0, len(drive.truth.t_s)) for place, drive in enumerate(self.drives)]
        return whole

    def values_of(self, drive: int, values: Mapping[str, float]) -> Mapping[str, float]:
        """Return the numbers of a drive, those of its kind of motion under their plain name."""
        if not self._by_kind:
            return values
        return {**values, self._by_kind: values.get(named(self._by_kind, self._kinds[drive]), 0.0)}

    def trajectories(self, values: Mapping[str, float]) -> list[Trajectory]:
        """Return where the marker is in each drive at the times of its ground truth."""
        paths: list[Trajectory] = []
        for place, drive in enumerate(self.drives):
            of_drive = self.values_of(place, values)
            paths.append(of_marker(drive, self._path(place, of_drive), of_drive))
        return paths

    def _path(self, drive: int, values: Mapping[str, float]) -> Trajectory:
        """Return the trajectory of the rover in a drive; derivatives by the marker need none of their own."""
        wheels = tuple(values.get(number.name, 0.0) for number in self.geometry.numbers)
        if (drive, wheels) not in self._paths:
            if len(self._paths) > PATHS * len(self.drives):
                self._paths.clear()
                self._effects.clear()
            moves = self._moves(drive, wheels, values)
            self._paths[drive, wheels] = wheel_trajectory(moves)
        return self._paths[drive, wheels]

    def moves(self, values: Mapping[str, float]) -> list[Array]:
        """Return the motion of each drive by its wheels: ahead and left in m, yaw in rad, (n, 3)."""
        wheels = tuple(values.get(number.name, 0.0) for number in self.geometry.numbers)
        return [self._moves(drive, wheels, values) for drive in range(len(self.drives))]

    def _moves(self, drive: int, wheels: tuple[float, ...], values: Mapping[str, float]) -> Array:
        if wheels not in self._effects:
            self._effects[wheels] = self.geometry.effects(values, self._nodes.angles_rad)
        late_s = values.get(STEERING_DELAY, 0.0)
        effects = self._nodes.of_steps(drive, self._effects[wheels], late_s)
        return moves_of(self.drives[drive].turned_rad, effects)

    def residuals(self, values: Mapping[str, float], sd: tuple[float, float]) -> list[Array]:
        """Return what the best move and rotation leave of each segment, over the standard deviations.

        Each segment counts as one observation of the places, and one of the yaw.
        """
        paths = self.trajectories(values)
        left = []
        for segment in self.segments:
            truth, path = self.drives[segment.drive].truth, paths[segment.drive]
            part = slice(segment.first, segment.end)
            own_m, true_m = path.place_m[part], truth.x_m[part] + 1j * truth.y_m[part]
            own_m, true_m = own_m - own_m.mean(), true_m - true_m.mean()
            apart_rad = None if truth.yaw_rad is None else truth.yaw_rad[part] - path.yaw_rad[part]
            size = math.sqrt(segment.end - segment.first)
            turn_rad = _best_rotation(own_m, true_m, apart_rad, sd)
            rest_m = (true_m - own_m * np.exp(1j * turn_rad)) / (sd[0] * size)
            rows = [rest_m.real, rest_m.imag]
            if apart_rad is not None:
                rows.append((apart_rad - turn_rad) / (sd[1] * size))
            left.append(np.concatenate(rows))
        return left

    def deviations(self, values: Mapping[str, float], sd: tuple[float, float]) -> tuple[float, float]:
        """Return the standard deviations of places and yaw that are left."""
        squares = np.zeros((len(self.segments), 2))
        for place, (segment, rest) in enumerate(zip(self.segments, self.residuals(values, sd), strict=True)):
            count = segment.end - segment.first
            squares[place] = (
                float(rest[: 2 * count] @ rest[: 2 * count]) / 2.0,
                float(rest[2 * count :] @ rest[2 * count :]),
            )
        mean = np.sqrt(squares.mean(axis=0)) * np.array(sd)
        return max(float(mean[0]), LEAST_SD[0]), max(float(mean[1]), LEAST_SD[1])

    def solve(
        self, names: Sequence[str], start: Mapping[str, float], sd: tuple[float, float] | None = None
    ) -> Solution:
        """Return the minimum over some numbers, the others as at the start.

        Args:
            names: Of the numbers.
            start: All that are not 0.
            sd: Standard deviations of places and yaw; those that are left without it.
        """
        values = dict(start)
        scale = np.array([0.5 * self._plausible[name] for name in names])
        weights = self.deviations(values, FIRST_SD) if sd is None else sd
        for _ in range(ROUNDS):
            rest, slopes = self._linearised(names, scale, values, weights)
            point = np.array([values.get(name, 0.0) for name in names]) / scale
            hessian = sum((each.T @ each for each in slopes), np.eye(len(names)))
            gradient = sum((each.T @ r for each, r in zip(slopes, rest, strict=True)), point)
            step = -np.linalg.solve(hessian, gradient)
            values |= dict(zip(names, (scale * (point + step)).tolist(), strict=True))
            weights = self.deviations(values, weights) if sd is None else sd
            if np.abs(step).max(initial=0.0) < SETTLED:
                break
        rest, slopes = self._linearised(names, scale, values, weights)
        return Solution({name: values.get(name, 0.0) for name in names}, scale, rest, slopes, weights)

    def _linearised(
        self, names: Sequence[str], scale: Array, values: Mapping[str, float], sd: tuple[float, float]
    ) -> tuple[list[Array], list[Array]]:
        """Return residuals of each segment and their derivatives by numbers over their standard deviation."""
        rest = self.residuals(values, sd)
        columns = []
        for name, size in zip(names, scale.tolist(), strict=True):
            moved = self.residuals({**values, name: values.get(name, 0.0) + STEP * size}, sd)
            columns.append([(one - other) / STEP for one, other in zip(moved, rest, strict=True)])
        if not columns:
            return rest, [np.zeros((len(each), 0)) for each in rest]
        return rest, [np.column_stack([column[place] for column in columns]) for place in range(len(rest))]

    def start(self) -> dict[str, float]:
        """Return the yaw of the marker as straights show it, which may be any."""
        if MARKER_YAW not in self._plausible:
            return {}
        paths = self.trajectories({})
        total = 0j
        for segment in self.segments:
            truth, path = self.drives[segment.drive].truth, paths[segment.drive]
            part = slice(segment.first, segment.end)
            assert truth.yaw_rad is not None  # noqa: S101 the numbers say so
            steps = np.diff(path.place_m[part]) * np.exp(1j * (truth.yaw_rad[part] - path.yaw_rad[part])[:-1])
            total += complex(np.vdot(np.diff(truth.x_m[part] + 1j * truth.y_m[part]), steps))
        return {MARKER_YAW: float(np.angle(total))} if total else {}


def named(number: str, kind: str) -> str:
    """Return the name of a number that has a value of its own for a kind of motion."""
    return f"{number}, {kind}"


class _SteeringNodes:
    """Steering angles at which the effects of the wheels are computed, and where each step lies among them.

    Of a rover with one steering wheel they are evenly spaced, and effects between them are interpolated; else
    they are the rounded angles.

    Args:
        drives: The drives.

    Attributes:
        angles_rad: (nodes, wheels); None where no wheel steers.
    """

    def __init__(self, drives: Sequence[RecordedDrive]) -> None:
        angles = [drive.steering_rad for drive in drives if drive.steering_rad is not None]
        self.angles_rad: Array | None = None
        if not angles:
            return
        together = np.concatenate(angles)
        steering = np.flatnonzero(together.any(axis=0))
        if len(steering) == 1:
            values = together[:, steering[0]]
            nodes = np.linspace(values.min(), values.max(), NODES)
            self.angles_rad = np.zeros((NODES, together.shape[1]))
            self.angles_rad[:, steering[0]] = nodes
            places = np.interp(values, nodes, np.arange(NODES, dtype=np.float64))
        else:
            self.angles_rad, rows = np.unique(rounded_angles(together), axis=0, return_inverse=True)
            places = rows.ravel().astype(np.float64)
        self._places = np.split(places, np.cumsum([len(each) for each in angles])[:-1])

    def of_steps(self, drive: int, effects: Array, late_s: float) -> Array:
        """Return the effects of the wheels in each step of a drive.

        Args:
            drive: Its place.
            effects: At the nodes.
            late_s: Delay of the angles; 0 where more than one wheel steers.
        """
        if self.angles_rad is None:
            return effects
        places = self._places[drive]
        if late_s:
            steps = np.arange(len(places), dtype=np.float64)
            places = np.interp(steps + late_s / STEP_S, steps, places)
        first = np.floor(places).astype(np.intp)
        share = (places - first)[:, np.newaxis, np.newaxis]
        behind = np.minimum(first + 1, len(effects) - 1)
        return np.asarray((1.0 - share) * effects[first] + share * effects[behind])


def segments_of(drive: RecordedDrive, place: int, segment_s: float = SEGMENT_S) -> list[Segment]:
    """Return parts of about `segment_s` of a drive; `place` is its number."""
    truth_s = drive.truth.t_s
    count = max(1, round((truth_s[-1] - truth_s[0]) / segment_s))
    edges = np.searchsorted(truth_s, np.linspace(truth_s[0], truth_s[-1], count + 1)[1:-1]).tolist()
    bounds = [0, *edges, len(truth_s)]
    return [Segment(place, first, end) for first, end in pairwise(bounds) if end - first > 3]


def fit_trajectories(problem: TrajectoryProblem, fixed: Sequence[str] = ()) -> TrajectoryFit:
    """Return the numbers that the drives show.

    Args:
        problem: The drives.
        fixed: Numbers that stay as described.
    """
    start, units = problem.start(), _units_of(problem)
    free = [number for number in problem.numbers if number.name not in fixed]
    everything = solution = problem.solve([number.name for number in free], start)
    half = half_widths(everything, units, variance_of_unknown(everything, {}))
    shown, unshown_sd = free, dict[str, float]()
    while wide := [each for each in shown if half[each.name] > SHOWN * each.plausible]:
        # Those that remain are wrong by what the others, which stay as described, may differ.
        unshown_sd |= {each.name: 0.5 * each.plausible for each in wide}
        shown = [each for each in shown if each not in wide]
        solution = problem.solve([each.name for each in shown], start)
        half |= half_widths(solution, units, variance_of_unknown(everything, unshown_sd))
    needed = [each for each in shown if _is_needed(each, solution, half)]
    if len(needed) < len(shown):
        unshown_sd |= {each.name: half[each.name] / NORMAL for each in shown if each not in needed}
        solution = problem.solve([each.name for each in needed], start)
        half |= half_widths(solution, units, variance_of_unknown(everything, unshown_sd))
    half = _with_whole_drives(problem, solution, half)
    estimates = [
        Estimate(
            number=number,
            value=solution.values.get(number.name, 0.0),
            half_width=half.get(number.name, math.inf),
            is_shown=number in needed,
        )
        for number in problem.numbers
    ]
    point = np.array(list(solution.values.values()))
    without = [
        dict(zip(solution.values, (point + row).tolist(), strict=True))
        for row in moved_without(solution, _drives_of(problem))
    ]
    return TrajectoryFit(estimates=estimates, sd=solution.sd, units=len(units[0]), without=without)


def _with_whole_drives(
    problem: TrajectoryProblem, solution: Solution, half: Mapping[str, float]
) -> dict[str, float]:
    """Return half widths of intervals that reach to the end of those of whole drives.

    What depends on how the drives are cut is no noise: it adds to what differs between them.
    """
    whole_drives = problem.of_whole_drives()
    whole = whole_drives.solve(list(solution.values), solution.values)
    drives = len(problem.drives)
    pulls = moved_without(whole, [[place] for place in range(drives)], is_left_out=False)
    sd = drives / max(drives - 1, 1) * deviation(pulls)
    wider = {
        name: max(half[name], NORMAL * own) + abs(whole.values[name] - value)
        for (name, value), own in zip(solution.values.items(), sd.tolist(), strict=True)
    }
    return {**half, **wider}


def moved_without(solution: Solution, units: Sequence[Sequence[int]], *, is_left_out: bool = True) -> Array:
    """Return by how much the numbers move without the pull of each unit, (units, numbers).

    Args:
        solution: The minimum.
        units: Segments of each.
        is_left_out: What the unit shows is left out as well.
    """
    hessians = [each.T @ each for each in solution.slopes]
    gradients = [each.T @ rest for each, rest in zip(solution.slopes, solution.residuals, strict=True)]
    count = len(solution.scale)
    total = sum(hessians, np.eye(count))
    moved = np.zeros((len(units), count))
    for place, unit in enumerate(units):
        own = sum((hessians[each] for each in unit), np.zeros_like(total))
        without = total - own if is_left_out else total
        gradient = sum((gradients[each] for each in unit), np.zeros(count))
        moved[place] = solution.scale * np.linalg.solve(without, gradient)
    return moved


def _drives_of(problem: TrajectoryProblem) -> list[list[int]]:
    """Return the segments of each drive."""
    return [
        [place for place, each in enumerate(problem.segments) if each.drive == drive]
        for drive in range(len(problem.drives))
    ]


def _units_of(problem: TrajectoryProblem) -> list[list[list[int]]]:
    """Return the segments of the units that are left out one after the other, the first way the main one."""
    drives, segments = _drives_of(problem), [[place] for place in range(len(problem.segments))]
    if len(drives) >= LEAST_DRIVES:
        return [drives]
    return [segments, drives] if len(drives) >= FEWEST_DRIVES else [segments]


def _is_needed(number: Number, solution: Solution, half: Mapping[str, float]) -> bool:
    """Return whether a number predicts better than its description does: from one standard deviation on."""
    return not number.is_optional or abs(solution.values[number.name]) > half[number.name] / NORMAL


def variance_of_unknown(everything: Solution, fixed_sd: Mapping[str, float]) -> dict[str, float]:
    """Return the variance of each number by what the data do not show.

    Args:
        everything: With all numbers free.
        fixed_sd: Standard deviations of numbers that stay as described, by name.
    """
    free = [name for name in everything.values if name not in fixed_sd]
    variance = np.diag(covariance_of_unknown(everything, fixed_sd))
    return dict(zip(free, variance.tolist(), strict=True))


def covariance_of_unknown(everything: Solution, fixed_sd: Mapping[str, float]) -> Array:
    """Return the covariance of those numbers that are not fixed; see `variance_of_unknown`."""
    curvature = sum((each.T @ each for each in everything.slopes), np.zeros((len(everything.scale),) * 2))
    names = list(everything.values)
    fixed = [names.index(name) for name in fixed_sd]
    free = [place for place in range(len(names)) if place not in fixed]
    inverse = np.linalg.inv(curvature[np.ix_(free, free)] + np.eye(len(free)))
    pull = curvature[np.ix_(free, fixed)] * (np.array(list(fixed_sd.values())) / everything.scale[fixed])
    covariance = inverse @ (np.eye(len(free)) + pull @ pull.T) @ inverse
    scale = everything.scale[free]
    return np.asarray(scale[:, np.newaxis] * covariance * scale, np.float64)


def half_widths(
    solution: Solution, units: Sequence[Sequence[Sequence[int]]], unknown: Mapping[str, float]
) -> dict[str, float]:
    """Return half of the 95 % interval of each number.

    Args:
        solution: The minimum.
        units: Segments that are left out together; of several such ways the widest interval counts, and the
            degrees of freedom are those of the first.
        unknown: Variance of each number by what the data do not show.
    """
    if len(units[0]) < 2:
        return dict.fromkeys(solution.values, math.inf)
    sd = deviation(moved_without(solution, units[0]))
    for other in units[1:]:
        # A drive that alone shows a number must not be left out: what each drive pulls at counts.
        pulls = moved_without(solution, other, is_left_out=False)
        sd = np.maximum(sd, len(other) / max(len(other) - 1, 1) * deviation(pulls))
    quantiles = student.ppf(0.5 + 0.5 * CONFIDENCE, freedom(solution, units[0]))
    return {
        name: math.hypot(own, NORMAL * math.sqrt(unknown[name]), LEAST_HALF_WIDTH)
        for name, own in zip(solution.values, (quantiles * sd).tolist(), strict=True)
    }


def deviation(moved: Array) -> Array:
    """Return the standard deviation of numbers that move by so much without each unit, (units, numbers)."""
    count = len(moved)
    apart = moved - moved.mean(axis=0)
    return np.asarray(np.sqrt((count - 1) / count * np.sum(apart**2, axis=0)), np.float64)


def freedom(solution: Solution, units: Sequence[Sequence[int]]) -> Array:
    """Return the degrees of freedom of the interval of each number, at least 1.

    That is how many units show the number, in effect, less 1: of a delay that only the first and the last
    segment show it is 1, however long the drive.
    """
    hessians = [each.T @ each for each in solution.slopes]
    inverse = np.linalg.inv(sum(hessians, np.eye(len(solution.scale))))
    shares = np.array(
        [
            np.diag(inverse @ sum((hessians[each] for each in unit), np.zeros_like(inverse)) @ inverse)
            for unit in units
        ]
    )
    support = shares.sum(axis=0) ** 2 / np.maximum((shares**2).sum(axis=0), 1e-300)
    return np.asarray(np.maximum(support - 1.0, 1.0), np.float64)


def _best_rotation(own_m: Array, true_m: Array, apart_rad: Array | None, sd: tuple[float, float]) -> float:
    """Return the rotation of a path that fits places, and the mean difference of yaw, best."""
    product = complex(np.vdot(own_m, true_m))
    by_places_rad = float(np.angle(product))
    if apart_rad is None:
        return by_places_rad
    by_yaw_rad = float(apart_rad.mean())
    pull_places = abs(product) / sd[0] ** 2
    pull_yaw = len(apart_rad) / sd[1] ** 2
    aside_rad = math.remainder(by_places_rad - by_yaw_rad, math.tau)
    turn_rad = pull_places * aside_rad / (pull_places + pull_yaw)
    for _ in range(20):
        slope = pull_places * math.sin(turn_rad - aside_rad) + pull_yaw * turn_rad
        curve = pull_places * math.cos(turn_rad - aside_rad) + pull_yaw
        step = slope / curve if curve > 0.0 else 0.0
        turn_rad -= step
        if abs(step) < 1e-12:
            break
    return by_yaw_rad + turn_rad
