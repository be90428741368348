"""Geometry of the wheels from recorded drives with ground truth or positions: one function, one result."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from controllers.motion.rover_geometry import RoverSettings, wheels_reach_m
from drivers.errors import LogError
from rover_hil.drives.arrays import Array
from rover_hil.ready.wheels.geometry import (
    BASE,
    BASES,
    MARKER,
    RADIUS,
    RADIUS_OF,
    STEERING_RATIO,
    TRACK,
    Geometry,
    Number,
    geometry_of,
    marker_numbers,
)
from rover_hil.ready.wheels.gyro_scale import GyroFit, fit_gyro
from rover_hil.ready.wheels.motion_kinds import ON_THE_SPOT, SQUARE, kind_of
from rover_hil.ready.wheels.trajectory import RecordedDrive
from rover_hil.ready.wheels.trajectory_fit import (
    SHOWN,
    Estimate,
    Solution,
    TrajectoryFit,
    TrajectoryProblem,
    covariance_of_unknown,
    deviation,
    fit_trajectories,
    freedom,
    moved_without,
    named,
)
from rover_hil.ready.wheels.validation import DriveError, KindErrors, by_kind, drive_error

COMPARED_S = 10.0
"""Length of a segment where kinds of motion are compared: short drives have enough of them."""
LEAST_SEGMENTS = 3
"""A kind of motion with fewer is not compared."""
DIFFERS = 0.01
"""Probability that one of all comparisons of kinds differs by chance."""
LEAST_DIFFERENCE = 0.003
"""Numbers that differ by less hold for all kinds; of an angle in rad."""
MOST_LOST = 0.05
"""Share of the gain on validation drives that may be lost where numbers that do not differ are held."""
WRONG_TOGETHER = "the described numbers of the wheels are wrong together"
LEAST_GAIN = 0.2
"""Share of what is left of a kind of motion that a number of its own explains, where it matters."""


AS_MUCH = 0.1
"""Numbers whose gains differ by less explain as much."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KindDifference:
    """A number that differs between kinds of motion.

    Attributes:
        number: The number.
        values: Of each kind: difference from the description, and half of its 95 % interval.
        gain: Share of all that is left which these numbers explain.
    """

    number: Number
    values: Mapping[str, tuple[float, float]]
    gain: float

    @property
    def points_to(self) -> str:
        """What such a difference comes from."""
        name = self.number.name
        rotating = [kind for kind in self.values if kind in (ON_THE_SPOT, SQUARE)]
        others = [kind for kind in self.values if kind not in (ON_THE_SPOT, SQUARE)]
        if name in BASES and rotating and others:
            more = max(self.values[kind][0] for kind in rotating)
            if more > max(self.values[kind][0] for kind in others):
                return "slip in rotations: the wheels roll farther than the rotation needs"
        if name in (TRACK, BASE):
            return "slip that depends on how the rover rotates"
        if name == RADIUS:
            return "slip along the path, or a load of the tyres that differs"
        if name.startswith(RADIUS_OF):
            return "load or slip that differs between wheels, as on a slope or in bends"
        return "side slip in bends, or play or a delay of the steering"


@dataclass(frozen=True, slots=True, kw_only=True)
class GeometryResult:
    """What drives show of the wheels.

    Attributes:
        geometry: Of the rover as described.
        drives: That the numbers are from.
        kinds: Of their motion.
        fit: The numbers.
        entered: The same fit with those numbers held as described that do not differ, see `_entered`.
        described: Numbers of the marker where those of the wheels stay as described.
        errors: Of the validation drives, with the numbers that are entered.
        differences: Numbers that differ between kinds of motion, the one that explains most first.
        gyro: Its scale and bias; None without one.
    """

    geometry: Geometry
    drives: Sequence[RecordedDrive]
    kinds: Sequence[str]
    fit: TrajectoryFit
    entered: TrajectoryFit
    described: Mapping[str, float]
    errors: Sequence[DriveError]
    differences: Sequence[KindDifference]
    gyro: GyroFit | None

    @property
    def by_kind(self) -> list[KindErrors]:
        """The errors of the validation drives by kind of motion."""
        return by_kind(self.errors)

    @property
    def shown(self) -> list[Estimate]:
        """The numbers of the wheels that the drives show."""
        return [each for each in self.fit.estimates if each.is_shown and each.number.is_geometry]

    @property
    def not_shown(self) -> list[Estimate]:
        """The numbers of the wheels that stay as described, because the drives do not show them."""
        return [each for each in self.fit.estimates if each.number.is_geometry and _is_unknown(each)]

    @property
    def corrected(self) -> RoverSettings:
        """The description of the rover with the numbers that are entered."""
        return self.geometry.corrected(self.entered.values)

    @property
    def is_shared(self) -> bool:
        """Whether validation drives are better with the numbers, of which none differs by itself."""
        kinds = self.by_kind
        return (
            not self.differences
            and not any(each.differs for each in self.shown)
            and any(each.is_better for each in kinds)
            and not any(each.is_worse for each in kinds)
        )

    @property
    def problem(self) -> str:
        """Why the numbers must not be used; empty where they may."""
        if not self.shown and not self.differences:
            wanted = dict.fromkeys(each.number.shown_by for each in self.not_shown)
            return f"these drives show no number of the wheels: drive {'; '.join(wanted)}"
        for each in self.shown:
            if abs(each.value) > each.number.plausible:
                factor, unit = (100.0, "%") if not each.number.unit else (math.degrees(1.0), "deg")
                return (
                    f"the {each.number.name} differs by {factor * each.value:+.0f} {unit}: correct ticks, "
                    "gear ratio, sign or units first"
                )
        if self.differences:
            first = self.differences[0]
            return (
                f"no single {first.number.name} fits all kinds of motion, which points to {first.points_to}"
            )
        if not self.errors:
            return "there is no drive to validate them on: give two or more drives"
        is_better = any(each.is_better for each in self.by_kind)
        if not is_better and not any(each.differs for each in self.shown):
            return "the described numbers are confirmed: none differs from them by more than its interval"
        worse = [each.kind for each in self.by_kind if each.is_worse]
        if worse:
            counts = [self.kinds.count(kind) for kind in worse]
            more = "; give two or more drives of each kind" if min(counts) < 2 else ""
            kinds = ", ".join(worse)
            return f"the described numbers are better in validation drives of this kind: {kinds}{more}"
        if not is_better:
            return "the described numbers are as good in validation drives"
        if self.is_shared:
            wanted = dict.fromkeys(each.number.shown_by for each in (*self.shown, *self.not_shown))
            return f"{WRONG_TOGETHER}, but these drives do not show which of them: drive {'; '.join(wanted)}"
        return ""


def geometry_from_drives(
    drives: Sequence[RecordedDrive],
    validation: Sequence[RecordedDrive] = (),
    rover: RoverSettings | None = None,
) -> GeometryResult:
    """Return what drives show of the wheels, of the marker and of the gyro.

    Args:
        drives: That the numbers are fitted to, one or more.
        validation: Drives that are not used in the fit. Without them each drive is validated with numbers
            that are fitted without it.
        rover: The description; that of the first drive without it.

    Raises:
        LogError: The drives are of different rovers.
    """
    everything = [*drives, *validation]
    rover = drives[0].rover if rover is None else rover
    for drive in everything:
        if drive.turned_rad.shape[1] != drives[0].turned_rad.shape[1] or drive.rover != drives[0].rover:
            raise LogError(
                f"{drive.path} and {drives[0].path} have different [rover]: use logs of one geometry"
            )
    has_yaw = all(drive.truth.yaw_rad is not None for drive in everything)
    geometry = geometry_of(rover)
    numbers = (*geometry.numbers, *marker_numbers(rover, has_yaw=has_yaw))
    problem = TrajectoryProblem(drives, geometry, numbers)
    fit = fit_trajectories(problem)
    common = TrajectoryProblem(everything, geometry, numbers, segment_s=COMPARED_S)
    size_m = wheels_reach_m(rover)
    # By the corrected wheels: wrong ones bend straights.
    kinds = [kind_of(moves, size_m) for moves in common.moves(fit.values)]
    described = fit_trajectories(problem, fixed=[each.name for each in numbers if each.is_geometry])

    def validated(before: TrajectoryFit, after: TrajectoryFit) -> list[DriveError]:
        return _errors(drives, validation, kinds, geometry, (before, after))

    entered = _entered(problem, described, fit, validated)
    return GeometryResult(
        geometry=geometry,
        drives=drives,
        kinds=kinds[: len(drives)],
        fit=fit,
        entered=entered,
        described=described.values,
        errors=validated(described, entered),
        differences=_differences(common, numbers, kinds, fit),
        gyro=fit_gyro(problem, fit),
    )


def _entered(
    problem: TrajectoryProblem,
    described: TrajectoryFit,
    fit: TrajectoryFit,
    validated: Callable[[TrajectoryFit, TrajectoryFit], Sequence[DriveError]],
) -> TrajectoryFit:
    """Return a fit in which the numbers that do not differ from the description are held there.

    Numbers have errors in common, so that several may be needed although none differs by itself: where
    validation drives show it with all of them held, the one that differs most is fitted again, and so on.

    Args:
        problem: The drives.
        described: Fit of the marker alone.
        fit: Of all numbers.
        validated: Returns the errors of the validation drives with two fits.
    """
    if not any(each.differs for each in fit.estimates if each.number.is_geometry):
        return fit
    unshown = [each.number.name for each in fit.estimates if not each.is_shown]
    held = [
        each
        for each in fit.estimates
        if each.is_shown and not each.differs and (each.number.is_geometry or each.number.name in MARKER)
    ]
    held.sort(key=lambda each: abs(each.value) / each.half_width)
    before_m, best_m = _missed_m(validated(described, fit))
    while held:
        restricted = fit_trajectories(problem, fixed=[*unshown, *(each.number.name for each in held)])
        left_m = _missed_m(validated(fit, restricted))[1]
        if left_m - best_m <= MOST_LOST * (before_m - best_m):
            return restricted
        held.pop()
    return fit


def _missed_m(errors: Sequence[DriveError]) -> tuple[float, float]:
    """Return the mean error at the end of all segments, before and after; 0 without drives."""
    if not errors:
        return 0.0, 0.0
    before_m, after_m = np.concatenate([each.missed_m for each in errors]).mean(axis=0).tolist()
    return before_m, after_m


def _is_unknown(estimate: Estimate) -> bool:
    """Return whether the drives do not show a number."""
    return not estimate.half_width <= SHOWN * estimate.number.plausible


def _errors(
    drives: Sequence[RecordedDrive],
    validation: Sequence[RecordedDrive],
    kinds: Sequence[str],
    geometry: Geometry,
    fits: tuple[TrajectoryFit, TrajectoryFit],
) -> list[DriveError]:
    """Return the errors of the validation drives, with the description and with the numbers."""
    described, fit = fits
    if validation:
        return [
            drive_error(drive, kind, geometry, described.values, fit.values)
            for drive, kind in zip(validation, kinds[len(drives) :], strict=True)
        ]
    if len(drives) < 2:
        return []
    return [
        drive_error(drive, kind, geometry, *without)
        for drive, kind, *without in zip(drives, kinds, described.without, fit.without, strict=True)
    ]


def _differences(
    common: TrajectoryProblem, numbers: Sequence[Number], kinds: Sequence[str], fit: TrajectoryFit
) -> list[KindDifference]:
    """Return the numbers that differ between kinds of motion, the one that explains most first.

    Args:
        common: All drives.
        numbers: That may differ from the description.
        kinds: Of the motion of each drive.
        fit: The numbers.
    """
    of_segments = [kinds[each.drive] for each in common.segments]
    compared = [kind for kind in dict.fromkeys(kinds) if of_segments.count(kind) >= LEAST_SEGMENTS]
    # Numbers that are not shown, too: it may be because they differ, and they may be what seems to differ.
    # But a ratio of the steering explains slip in bends as well.
    unsure = [
        each.number.name
        for each in fit.estimates
        if each.number.is_geometry and _is_unknown(each) and each.number.name != STEERING_RATIO
    ]
    free = [each.number for each in fit.estimates if each.is_shown or each.number.name in unsure]
    names = [each.name for each in free]
    candidates = [each for each in free if each.is_geometry]
    if len(compared) < 2 or not candidates:
        return []
    solution = common.solve(names, fit.values)
    values = solution.values
    left = _left(solution.residuals, of_segments, compared)
    pairs = len(candidates) * len(compared) * (len(compared) - 1) / 2
    found = []
    for number in candidates:
        own = {kind: named(number.name, kind) for kind in dict.fromkeys(kinds)}
        of_kind = [name for name in names if name != number.name] + list(own.values())
        problem = TrajectoryProblem(common.drives, common.geometry, numbers, (number.name, kinds), COMPARED_S)
        start = {**values, **dict.fromkeys(own.values(), values[number.name])}
        of_kinds = problem.solve(of_kind, start, solution.sd)
        still_left = _left(of_kinds.residuals, of_segments, compared)
        gains = [1.0 - after / before for before, after in zip(left, still_left, strict=True)]
        samples = _samples(number, of_kinds, own, compared)
        if max(gains) >= LEAST_GAIN and _differ(samples, of_kinds, DIFFERS / pairs):
            found.append(
                KindDifference(
                    number=number,
                    values={each.kind: (each.value, each.half_width(0.05)) for each in samples},
                    gain=1.0 - sum(still_left) / sum(left),
                )
            )
    best = max((each.gain for each in found), default=0.0)
    # Of numbers that explain as much the base comes first: with it the distances stay as they are.
    return sorted(
        found, key=lambda each: (each.gain < best - AS_MUCH, each.number.name not in BASES, -each.gain)
    )


def _left(residuals: Sequence[Array], of_segments: Sequence[str], kinds: Sequence[str]) -> list[float]:
    """Return the sum of squares of each kind of motion."""
    return [
        sum(float(rest @ rest) for rest, of in zip(residuals, of_segments, strict=True) if of == kind)
        for kind in kinds
    ]


class _Sample(NamedTuple):
    """A number of a kind of motion.

    Attributes:
        kind: Of the motion.
        value: The number.
        column: Its place in the solution.
        own_sd: Its standard deviation by what differs between segments.
        sd: The same, with what the data do not show.
        freedom: Degrees of freedom of the standard deviation.
    """

    kind: str
    value: float
    column: int
    own_sd: float
    sd: float
    freedom: float

    def half_width(self, probability: float) -> float:
        """Return half of the interval that the number is outside of with a probability."""
        return _half_width(self.sd, self.freedom, probability)


def _half_width(sd: float, degrees: float, probability: float) -> float:
    return float(student.ppf(1.0 - 0.5 * probability, degrees)) * sd


def _samples(
    number: Number, solution: Solution, names: Mapping[str, str], compared: Sequence[str]
) -> list[_Sample]:
    """Return the number of those kinds of motion that show it.

    Args:
        number: The number.
        solution: With a value of its own for each kind.
        names: Of these values.
        compared: Kinds of motion.
    """
    units = [[place] for place in range(len(solution.residuals))]
    own_sd, freedoms = deviation(moved_without(solution, units)), freedom(solution, units)
    unknown = covariance_of_unknown(solution, {})
    columns = list(solution.values)
    samples = []
    for kind in compared:
        name = names[kind]
        column = columns.index(name)
        sd = math.hypot(float(own_sd[column]), math.sqrt(unknown[column, column]))
        own, degrees = float(own_sd[column]), float(freedoms[column])
        sample = _Sample(kind, solution.values[name], column, own, sd, degrees)
        if sample.half_width(0.05) <= SHOWN * number.plausible:
            samples.append(sample)
    return samples


def _differ(samples: Sequence[_Sample], solution: Solution, probability: float) -> bool:
    """Return whether the numbers of two kinds differ beyond their intervals.

    What the data do not show moves both alike, for the most part.
    """
    unknown = covariance_of_unknown(solution, {})
    for one, other in combinations(samples, 2):
        places = [one.column, other.column]
        (first, both), (_, second) = unknown[np.ix_(places, places)].tolist()
        sd = math.sqrt(one.own_sd**2 + other.own_sd**2 + max(first + second - 2.0 * both, 0.0))
        least = _half_width(sd, min(one.freedom, other.freedom), probability)
        if abs(one.value - other.value) > max(least, LEAST_DIFFERENCE):
            return True
    return False
