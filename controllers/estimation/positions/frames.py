"""Frames of the devices that give fixes: how they are found, and what a fix that does not fit means."""

import cmath
import math
from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from controllers.estimation.filter.guarded_filter import Innovation, Outcome
from controllers.estimation.filter.measurement_model import Measured
from controllers.estimation.filter.motion_history import WayBack
from controllers.estimation.filter.pose_filter import PoseFilter
from controllers.estimation.filter.reader import Situation
from controllers.estimation.filter.state_layout import YAW, X, Y
from controllers.estimation.parameters import ESTIMATION
from controllers.estimation.positions.alignment import PathAlignment
from controllers.estimation.positions.jumps import PositionJumps
from controllers.estimation.positions.pose_fix import PoseFix, has_yaw, place_then
from controllers.estimation.positions.relation import PositionRelation
from controllers.estimation.settings import FilterSettings
from controllers.estimation.slip_prior import UNKNOWN, SlipPrior
from controllers.motion.planar import wrap_angle
from drivers.samples import PoseFixSample, Sample

DISPLACED, TURNED = "displaced", "turned"
"""Quantities of the innovations of a fix that was taken although it contradicted the estimate."""


def _alone_std_m(model: PoseFix) -> float:
    """Return the deviation of one fix alone."""
    alone_std_m = model.fix.position_std_m if model.fix.alone_std_m is None else model.fix.alone_std_m
    return math.sqrt(alone_std_m**2 + model.way_back.position_m2)


class PositionFrames:
    """Corrects a filter by fixes of the pose.

    Args:
        pose_filter: With states for the origin of each device.
        settings: Gate of consistent fixes.
        unknown: Slip that is expected at most.
    """

    kind: ClassVar[type[Sample]] = PoseFixSample

    def __init__(
        self, pose_filter: PoseFilter, settings: FilterSettings, unknown: SlipPrior = UNKNOWN
    ) -> None:
        self._poses, self._filter = pose_filter, pose_filter.kalman
        self._origins = pose_filter.layout.origins
        # The chance of two normal deviates beyond this distance is that of the gate.
        gate_sd = math.sqrt(-2.0 * math.log1p(-settings.gate_probability))
        self._jumps = {device: PositionJumps(gate_sd) for device in self._origins}
        self._relations = {device: PositionRelation(settings, gate_sd, unknown) for device in self._origins}
        self._taken: set[str] = set()
        self._reckoned_m = 0j
        self._rejections: dict[str, int] = {}
        self._unoriented: dict[str, PathAlignment] = {}

    @property
    def jumped_m(self) -> dict[str, complex]:
        """By how much the places of each device have jumped, in the local frame; see `PositionJumps`."""
        return {device: jumps.offset_m for device, jumps in self._jumps.items() if jumps.offset_m}

    @property
    def doubted_m(self) -> dict[str, complex]:
        """By how much the places of each device may be wrong, in the local frame; see `PositionRelation`."""
        return {device: each.doubted_m for device, each in self._relations.items() if each.doubted_m}

    @property
    def unexpected_m(self) -> dict[str, complex]:
        """These of the devices whose places differ by more than the expected slip from dead reckoning."""
        doubted_m = self.doubted_m.items()
        return {device: each_m for device, each_m in doubted_m if self._relations[device].is_unexpected}

    def drive(self, way_m: complex, turn_rad: float) -> None:
        """Take a motion of the body by wheels and gyro, before the pose is corrected."""
        yaw_rad = self._filter.value(YAW) - 0.5 * turn_rad
        self._reckoned_m += way_m * cmath.rect(1.0, yaw_rad)

    def compare(self, prior: SlipPrior) -> Iterator[tuple[str, float, float]]:
        """Yield each device with new positions, and how far its travel is off that of the wheels.

        See `PositionRelation.compare`.
        """
        for device in sorted(self._taken):
            yield device, *self._relations[device].compare(prior)
        self._taken.clear()

    def inflate_origins(self) -> None:
        """Make the frames as uncertain as positions and wheels differ: a wrong slip moved them, too."""
        for device, origin in self._origins.items():
            apart_m, path_m = self._relations[device].apart_m, self._relations[device].apart_path_m
            if path_m:
                self._filter.add_variance(origin + X, apart_m**2)
                self._filter.add_variance(origin + Y, apart_m**2)
                self._filter.add_variance(origin + YAW, (apart_m / path_m) ** 2)

    def source(self, sample: PoseFixSample) -> str | None:
        """Return the device; None for one whose frame is no state."""
        return sample.device if sample.device in self._origins else None

    def measured_ns(self, sample: PoseFixSample, t_ns: int) -> int:
        """Return when the exposure was."""
        return min(sample.t_capture_ns, t_ns)

    def correct(self, sample: PoseFixSample, now: Situation) -> tuple[Innovation, ...]:
        """Correct by a measured position or pose, see `take`."""
        return self.take(sample, now.way_back)

    def miss(self, sample: PoseFixSample) -> None:
        """Nothing: the next position is as good."""

    def take(self, fix: PoseFixSample, way_back: WayBack) -> tuple[Innovation, ...]:
        """Correct by a fix of the pose; `way_back` leads from the present pose to that at exposure.

        A fix is accepted or rejected as a whole. After two rejections in a row the rover has been moved, or
        has slipped more than the noise allows: the uncertainty of the pose then becomes its difference from
        the next fix, which is reported as displaced.

        Places without a yaw that have jumped move neither pose nor its uncertainty: the origin takes the
        jump, so that they go on to hold the pose where it is, and `jumped_m` says how far off it may be.
        """
        origin = self._origins[fix.device]
        if fix.device not in self._rejections and not has_yaw(fix):
            if not self._orient(origin, fix, way_back):
                return ()
        elif fix.device not in self._rejections and math.isfinite(fix.x_m + fix.y_m + fix.yaw_rad):
            self._rejections[fix.device] = 0
            self._assign_origin(origin, fix, way_back)
        model = PoseFix(fix=fix, way_back=way_back, origin_index=origin)
        std_m, residual_m = _alone_std_m(model), self._residual(model)
        self._relate(model, std_m)
        has_jumped = not has_yaw(fix) and self._has_jumped(model, residual_m, std_m)
        if has_jumped:
            innovations: tuple[Innovation, ...] = tuple(
                Innovation(
                    measured=Measured(fix.device, part), outcome=Outcome.CONTRADICTING, residual=apart_m
                )
                for part, apart_m in (("x", residual_m.real), ("y", residual_m.imag))
            )
        else:
            self._expect_motion(fix)
            innovations = self._filter.correct(model, model.measured)
        if innovations[0].accepted:
            self._rejections[fix.device] = 0
            self._agree(model, std_m)
            return innovations
        residuals = [innovation.residual for innovation in innovations if innovation.residual is not None]
        if len(residuals) < len(innovations):
            return innovations
        self._rejections[fix.device] += 1
        if self._rejections[fix.device] <= ESTIMATION.pose.most_rejections:
            return innovations
        self._rejections[fix.device] = 0
        if has_jumped:
            return self._take_jump(model)
        # The axes of the floor are not those of the local frame: inflate both by the distance.
        distance_m2 = residuals[X] ** 2 + residuals[Y] ** 2
        turned_rad = residuals[YAW] if has_yaw(fix) else 0.0
        for index, variance in ((X, distance_m2), (Y, distance_m2), (YAW, turned_rad**2)):
            self._filter.add_variance(index, variance)
        report = (
            _taken(fix, DISPLACED, math.sqrt(distance_m2)),
            _taken(fix, TURNED, abs(turned_rad)),
        )
        corrected = self._filter.correct(model, model.measured)
        self._agree(model, std_m)
        return (*corrected, *report[: len(innovations) - 1])

    def _agree(self, model: PoseFix, std_m: float) -> None:
        """Compare later fixes with one that was used."""
        self._jumps[model.fix.device].agree(self._residual(model), std_m, self._poses.path_m)
        self._relations[model.fix.device].keep()

    def _expect_motion(self, fix: PoseFixSample) -> None:
        """Inflate the place by what positions without a yaw have moved farther than the wheels.

        Else the filter would explain it by the axes of the device, which are known the worst.
        """
        grown_m2 = self._relations[fix.device].grown_m2
        if grown_m2:
            self._filter.add_variance(X, grown_m2)
            self._filter.add_variance(Y, grown_m2)

    def _has_jumped(self, model: PoseFix, residual_m: complex, std_m: float) -> bool:
        """Return whether a fix without a yaw is farther off those before than the wheels rolled."""
        device, path_m = model.fix.device, self._poses.path_m
        return self._jumps[device].is_off(residual_m, std_m, path_m) or bool(
            self._relations[device].impossible_m
        )

    def _relate(self, model: PoseFix, std_m: float) -> None:
        """Compare a fix with dead reckoning."""
        fix, state = model.fix, self._filter.state
        self._taken.add(fix.device)
        reckoned = np.array([self._reckoned_m.real, self._reckoned_m.imag, state[YAW]])
        then_m, _ = place_then(reckoned, fix, model.way_back)
        relation, covariance = self._relations[fix.device], self._filter.covariance
        yaw_index = model.origin_index + YAW
        yaw_rad2 = covariance[YAW][YAW] + covariance[yaw_index][yaw_index] + 2.0 * covariance[YAW][yaw_index]
        relation.take(
            complex(fix.x_m, fix.y_m),
            then_m,
            std_m,
            self._poses.path_m,
            axes=cmath.rect(1.0, -state[yaw_index]),
            yaw_sd_rad=math.sqrt(max(0.0, yaw_rad2)),
            has_yaw=has_yaw(fix),
        )

    def _take_jump(self, model: PoseFix) -> tuple[Innovation, ...]:
        """Let the origin take the jump of the places, as certain as one fix is."""
        fix, origin, state = model.fix, model.origin_index, self._filter.state
        residual_m, std_m, jumps = self._residual(model), _alone_std_m(model), self._jumps[model.fix.device]
        axes, relation = cmath.rect(1.0, -state[origin + YAW]), self._relations[fix.device]
        jumped_m = relation.impossible_m or residual_m * axes
        jumps.jump(jumped_m, std_m)
        relation.jump(jumped_m, axes)
        for index, part_m in ((origin + X, residual_m.real), (origin + Y, residual_m.imag)):
            self._filter.assign(index, state[index] + part_m)
            self._filter.add_variance(index, std_m**2)
        corrected = self._filter.correct(model, model.measured)
        jumps.agree(self._residual(model), std_m, self._poses.path_m)
        return (*corrected, _taken(fix, "jumped", abs(residual_m)))

    def _residual(self, model: PoseFix) -> complex:
        """Return the place by the fix less the expected one, in the frame of the floor."""
        expected_m = model.predict(np.array(self._filter.state)).value
        return complex(model.fix.x_m - expected_m[X], model.fix.y_m - expected_m[Y])

    def _assign_origin(self, origin: int, fix: PoseFixSample, way_back: WayBack) -> None:
        """Set the unknown origin by the first fix."""
        then_m, then_rad = place_then(np.array(self._filter.state), fix, way_back)
        origin_rad = wrap_angle(fix.yaw_rad - then_rad)
        origin_m = complex(fix.x_m, fix.y_m) - then_m * cmath.rect(1.0, origin_rad)
        for index, value in zip((X, Y, YAW), (origin_m.real, origin_m.imag, origin_rad), strict=True):
            self._filter.assign(origin + index, value)

    def _orient(self, origin: int, fix: PoseFixSample, way_back: WayBack) -> bool:
        """Set the unknown origin by positions without yaw that lie far apart; returns whether it is set.

        The axes of the floor are turned by the angle that brings the path of the rover onto the positions. So
        it does not matter whether the rover drives ahead, back or aside.
        """
        then_m, _ = place_then(np.array(self._filter.state), fix, way_back)
        place_m = complex(fix.x_m, fix.y_m)
        if not cmath.isfinite(place_m) or not 0.0 < fix.position_std_m < math.inf:
            return False
        alignment = self._unoriented.setdefault(fix.device, PathAlignment())
        alignment.take(place_m, then_m, fix.position_std_m)
        if not alignment.is_known:
            return False
        origin_rad, origin_m = alignment.turned_rad, alignment.origin_m
        for index, value in zip((X, Y, YAW), (origin_m.real, origin_m.imag, origin_rad), strict=True):
            self._filter.assign(origin + index, value)
        self._rejections[fix.device] = 0
        return True


def _taken(fix: PoseFixSample, quantity: str, residual: float) -> Innovation:
    """Return by how much a measurement contradicted the estimate that took it nevertheless."""
    return Innovation(measured=Measured(fix.device, quantity), outcome=Outcome.ACCEPTED, residual=residual)
