"""The only account of added uncertainty: what it inflates the covariance by, and for which cause."""

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace
from enum import Enum, auto
from typing import NamedTuple

from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.pose_estimate import PoseEstimate
from controllers.estimation.wheels.bounds import WheelBounds
from controllers.fault import NO_ERROR, Bound, Fault, Severity
from controllers.motion.body_motion import BodyMotion


class Category(Enum):
    """How added uncertainty is counted.

    UNOBSERVED: Motion that was not measured; too much of it keeps the rover stopped.
    UNDECIDED: Yaw while gyro and wheels exclude each other and nothing decides.
    OTHER: Not counted.
    """

    UNOBSERVED = auto()
    UNDECIDED = auto()
    OTHER = auto()


class UncertaintyEvidence(NamedTuple):
    """What the account of added uncertainty offers the stop rules as evidence.

    Attributes:
        unobserved_m: Standard deviation of the position by motion that was not measured.
        unobserved_rad: The same of the yaw.
        undecided_rad: Standard deviation of the yaw while gyro and wheels exclude each other and nothing
            decides, before the corrections of this cycle; these reduce it.
    """

    unobserved_m: float = 0.0
    unobserved_rad: float = 0.0
    undecided_rad: float = 0.0


class ErrorBudget:
    """Inflates the covariance by the greatest errors of each cause, and counts what was added.

    A bound is raised: of a greater one only the difference in quadrature is added, as variances add up. What
    measurements have removed from the covariance is no longer counted.

    A gyro that was wrong has also misled the slip compensation: a gyro without a signal looks like wheels
    that slip wholly. So an error of the gyro also inflates the covariance by the travel that compensation has
    removed, and resets the states of slip; the compensator forgets what it has learned from the gyro.

    Args:
        pose_filter: Its covariance is inflated.
        bounds: Motion of the body by angles of the wheels.
        forget_gyro: Lets the slip estimator forget what it has learned from the gyro; None without one.
    """

    def __init__(
        self, pose_filter: PoseFilter, bounds: WheelBounds, forget_gyro: Callable[[], None] | None = None
    ) -> None:
        self._filter, self._bounds, self._forget_gyro = pose_filter, bounds, forget_gyro
        self._greatest: dict[Hashable, Bound] = {}
        self._by_rules: set[Hashable] = set()
        self._symptom_rad = 0.0
        self._unobserved_m2 = self._unobserved_rad2 = self._undecided_rad2 = 0.0
        self._compensated_m = (0.0, 0.0)
        self._path_end_m = self._before_rad = 0.0

    def begin_cycle(self) -> None:
        """Keep what is undecided before the corrections of a cycle."""
        self._before_rad = math.sqrt(self._undecided_rad2)

    @property
    def evidence(self) -> UncertaintyEvidence:
        """What the stop rules see of it in this cycle."""
        return UncertaintyEvidence(
            math.sqrt(self._unobserved_m2), math.sqrt(self._unobserved_rad2), self._before_rad
        )

    def greatest(self, cause: Hashable) -> Bound:
        """Return the greatest errors by a cause since it began."""
        return self._greatest.get(cause, NO_ERROR)

    def raise_to(
        self,
        cause: Hashable,
        bound: Bound,
        category: Category = Category.OTHER,
        driven_m: float = 0.0,
    ) -> None:
        """Inflate the covariance to the bound of a cause.

        Args:
            cause: Whose errors they are.
            bound: Its greatest errors; a wheel without one is measured rightly again.
            category: How they are counted.
            driven_m: Distance driven since the start, for a bound with a path.
        """
        before = self.greatest(cause)
        wheel_rad, added_rad = before.wheel_rad, NO_ERROR.wheel_rad
        if bound.wheel_rad:
            before_rad = before.wheel_rad or (0.0,) * len(bound.wheel_rad)
            pairs = list(zip(bound.wheel_rad, before_rad, strict=True))
            wheel_rad = tuple(math.copysign(max(abs(a), abs(b)), a) if a else 0.0 for a, b in pairs)
            added_rad = tuple(
                math.copysign(_excess(a, b), a) for a, (_, b) in zip(wheel_rad, pairs, strict=True)
            )
        after = bound._replace(
            wheel_rad=wheel_rad,
            gyro_rad=max(bound.gyro_rad, before.gyro_rad),
            position_m=max(bound.position_m, before.position_m),
            yaw_rad=max(bound.yaw_rad, before.yaw_rad),
        )
        self._greatest[cause] = after
        self._inflate(
            after._replace(
                wheel_rad=added_rad,
                gyro_rad=_excess(after.gyro_rad, before.gyro_rad),
                position_m=_excess(after.position_m, before.position_m),
                yaw_rad=_excess(after.yaw_rad, before.yaw_rad),
            ),
            category,
            driven_m,
        )

    def clear(self, cause: Hashable) -> None:
        """Forget the bound of a cause that is gone; what it has added stays until it is measured."""
        self._greatest.pop(cause, None)

    def take(self, faults: Sequence[Fault], driven_m: float) -> None:
        """Raise the bounds of the faults that stop rules have found in a cycle; clear those of all others.

        What began in this cycle also adds the errors of the wheels and the path before it. A symptom only
        counts for the estimate of this cycle, see `with_symptoms`.
        """
        if not (faults or self._by_rules):
            self._symptom_rad = 0.0
            return
        symptoms_rad = (fault.bound.gyro_rad for fault in faults if fault.severity is Severity.SYMPTOM)
        self._symptom_rad = max(symptoms_rad, default=0.0)
        adding = [fault for fault in faults if fault.adds_uncertainty]
        before, self._by_rules = self._by_rules, {fault.key for fault in adding}
        for cause in before - self._by_rules:
            self.clear(cause)
        for fault in adding:
            bound = fault.bound
            if fault.key in self._greatest:
                bound = bound._replace(wheel_rad=(), path_m=0.0)
            is_undecided = fault.severity in (Severity.UNCERTAIN, Severity.RECOVERABLE)
            category = Category.UNDECIDED if is_undecided else Category.UNOBSERVED
            self.raise_to(fault.key, bound, category, driven_m)

    def with_symptoms(self, estimate: PoseEstimate) -> PoseEstimate:
        """Return an estimate whose yaw is as uncertain as the symptoms of this cycle may make it."""
        if not self._symptom_rad:
            return estimate
        xx, xy, x_yaw, yy, y_yaw, yaw_rad2 = estimate.covariance
        yaw_rad2 += self._symptom_rad**2 / 3.0
        return replace(estimate, covariance=(xx, xy, x_yaw, yy, y_yaw, yaw_rad2))

    def add(self, greatest: BodyMotion, category: Category = Category.OTHER) -> None:
        """Inflate the covariance once by the greatest errors of a motion: x, y in m and yaw in rad."""
        if not any(greatest):
            return
        if category is Category.UNDECIDED:
            # No yaw is more uncertain than one that may be any.
            left_rad2 = max(0.0, math.pi**2 / 3.0 - self._undecided_rad2)
            added_rad2 = min(greatest[2] ** 2 / 3.0, left_rad2)
            self._filter.inflate(*greatest[:2], math.sqrt(3.0 * added_rad2))
            self._undecided_rad2 += added_rad2
            return
        position_m2, yaw_rad2 = self._variances()
        self._filter.inflate(*greatest)
        if category is Category.UNOBSERVED:
            inflated_m2, inflated_rad2 = self._variances()
            self.count(inflated_m2 - position_m2, inflated_rad2 - yaw_rad2)

    def count(self, position_m2: float, yaw_rad2: float) -> None:
        """Count variances that the filter already holds as those of motion that was not measured."""
        self._unobserved_m2 += position_m2
        self._unobserved_rad2 += yaw_rad2

    def limit(self) -> None:
        """Count no more than the filter has left after the corrections of a cycle."""
        if not (self._unobserved_m2 or self._unobserved_rad2 or self._undecided_rad2):
            return
        position_m2, yaw_rad2 = self._variances()
        self._unobserved_m2 = min(self._unobserved_m2, position_m2)
        self._unobserved_rad2 = min(self._unobserved_rad2, yaw_rad2)
        self._undecided_rad2 = min(self._undecided_rad2, yaw_rad2)

    def note_compensation(self, duration_s: float, removed_x_m: float, removed_y_m: float) -> None:
        """Add up the travel that slip compensation has removed, with a fading memory."""
        kept = math.exp(-duration_s / ESTIMATION.pose.misled_slip_s)
        x_m, y_m = self._compensated_m
        self._compensated_m = (kept * x_m + removed_x_m, kept * y_m + removed_y_m)

    def _inflate(self, added: Bound, category: Category, driven_m: float) -> None:
        x_m, y_m, yaw_rad = self._bounds.beside_gyro(added.wheel_rad) if added.wheel_rad else (0.0, 0.0, 0.0)
        # A rover that may be anywhere may also be at the end of its travel.
        position_m = (math.sqrt(3.0) if added.is_motion_unknown else 1.0) * added.position_m
        x_m, y_m = x_m + position_m, y_m + position_m
        if added.gyro_rad:
            x_m, y_m = x_m + abs(self._compensated_m[0]), y_m + abs(self._compensated_m[1])
            self._compensated_m = (0.0, 0.0)  # added once
            self._filter.reset_slip_variances()
            if self._forget_gyro is not None:
                self._forget_gyro()
        if added.path_m:
            chord_m = min(added.path_m, driven_m - self._path_end_m)  # the path before has been added
            chord_m *= 2.0 * math.sin(0.5 * min(added.gyro_rad, math.pi))
            x_m, y_m, self._path_end_m = x_m + chord_m, y_m + chord_m, driven_m
        self.add((x_m, y_m, added.gyro_rad + yaw_rad + added.yaw_rad), category)

    def _variances(self) -> tuple[float, float]:
        xx, _, _, yy, _, yaw_yaw = self._filter.covariance
        return xx + yy, yaw_yaw


def _excess(now: float, before: float) -> float:
    """Return what is to be added to an uncertainty to reach a greater one: variances add up."""
    return math.sqrt(max(0.0, now**2 - before**2))
