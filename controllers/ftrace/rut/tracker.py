"""Search for the rut near the path travelled, which the motion of the ground predicts."""

import math
from copy import deepcopy

import numpy as np
from numpy.typing import NDArray

from controllers.ftrace.frame import Frame, Reading
from controllers.ftrace.matching import GroundMatch
from controllers.ftrace.parameters import FTraceParameters
from controllers.ftrace.rut.confidence import confidence, within
from controllers.ftrace.rut.fixed_picture import FixedPicture
from controllers.ftrace.rut.front_wheel_trace import FrontWheelTrace
from controllers.ftrace.rut.path_filter import PathFilter
from controllers.ftrace.rut.presence import Presence
from controllers.ftrace.rut.rut import CrossSections, Edges, RutFinder, RutPoints, two_sided
from controllers.ftrace.rut.strips import Stretch, TraceStrips
from controllers.ftrace.static_shading import StaticShading
from controllers.ground_motion.flow import GroundFlow, PatchMotion
from controllers.ground_motion.ground_patch import RESOLUTION_M, Floats, Mask, Patch
from controllers.ground_motion.ground_view import GroundView
from controllers.ground_motion.heading_drifts import HeadingDrifts
from controllers.ground_motion.pair_sum import PairSum
from controllers.ground_motion.prior import MotionPrior
from controllers.ground_motion.reference_frames import rotated
from controllers.ground_motion.rig_tolerance import RigTolerance
from drivers.samples import Image

RIGHT_WITHIN_RAD = math.radians(5.0)
"""An angle with a smaller error is right."""
SIGNIFICANT_SD = 2.0
"""A difference of more deviations is significant, in 95 of 100 cases."""
LEAST_SCORE = -1e6
"""Score of a curve with too few blocks in view."""


class RutTracker:
    """Follows the rut of one rig's wheel.

    Args:
        view: The ground in the frames.
        parameters: Tuned numbers.
        tolerance: What is not known about the rig.
        pairs: The motion over the ground that somebody else measures in the frames before they are tracked;
            None to measure it here.
    """

    def __init__(
        self,
        view: GroundView,
        parameters: FTraceParameters,
        tolerance: RigTolerance,
        pairs: PairSum | None = None,
    ) -> None:
        ground = view.ground
        self._ground = ground
        self._numbers, self._search = parameters, parameters.search
        sections, shading = parameters.sections, parameters.shading
        visible = ground.visible.astype(np.float32)
        self._finder = RutFinder(ground, sections)
        self._structure = view.structure
        self._flow = GroundFlow(ground, parameters.ground_motion.flow)
        self._measures = pairs is None
        # Where the rover rotates about is not known by one wheel.
        self._pairs = pairs or PairSum(view, tolerance, parameters.ground_motion, rotates_about_origin=False)
        self._yaw = HeadingDrifts(tolerance.yaw_sd_deg, parameters.ground_motion.mounting)
        self._match = GroundMatch(ground, parameters.matching)
        self._light = StaticShading(visible, ground.centre, shading.lit_share, shading)
        self._fixed = FixedPicture(view.structure, ground.shape, self._finder.shape, parameters.fixed)
        self._front = FrontWheelTrace(ground.rig, self._finder.block_m, self._search.touching_widths)
        self._path = PathFilter(ground.rig.behind_m, parameters.path)
        self._odometry = PathFilter(ground.rig.behind_m, parameters.path)
        hidden_m = float(np.argmax(ground.visible[:, ground.centre])) * RESOLUTION_M
        self._strips = TraceStrips(self._finder.s_m, self._front.exists, parameters.strips)
        self._presence = Presence(
            hidden_m + parameters.presence.least_length_m, parameters.fixed.known_m, parameters.presence
        )
        self._previous: Image | None = None
        self._offset_m = 0.0
        self._backwards = 0.0
        self._confidence = 0.0
        self._noise_ratio, self._ratios = 1.0, 1
        self._agrees = True
        self._apart_rad = 0.0
        self._aside_m: float | None = None

    def track(self, frame: Frame) -> Reading:
        """Return the trace in the next frame."""
        log_grey, structure = frame.ground.log_grey, frame.ground.structure
        motion = self._motion(frame, structure)
        self._watch_yaw(frame, motion)
        moved_m, goes_back = self._advance(frame, motion)
        found, self._confidence, self._apart_rad = False, 0.0, 0.0
        if frame.usable:
            self._light.update(log_grey, motion)
            detail = self._finder.detail(log_grey - self._light.field)
            if motion is not None and moved_m > 0.0:
                self._fixed.update(detail, log_grey, moved_m)
            detail, structure = self._fixed.without(detail, log_grey, structure)
            sections = self._finder.cross_sections(detail, self._finder.roughness(structure))
            found = not goes_back and self._find(sections, moved_m)
        if not found:
            self._path = deepcopy(self._odometry)
        s = self._finder.s_m
        sd_rad, most_sd_rad = self._theta_sd_rad(self._path), self._numbers.direction.most_direction_sd_rad
        is_measured = self._is_moving(motion) and self._agrees and not goes_back
        return Reading(
            found=found,
            theta_rad=self._path.theta_rad,
            theta_sd_rad=sd_rad,
            by_motion=is_measured and sd_rad < most_sd_rad,
            offset_m=self._offset_m,
            confidence=self._confidence * within(RIGHT_WITHIN_RAD, sd_rad),
            path_m=np.stack([s, self._path.curve(s)], axis=1),
            mounting_sd_rad=self._yaw.sd_rad,
            contradiction=self._pairs.estimator.mounting or self._yaw.text,
        )

    def _watch_yaw(self, frame: Frame, motion: PatchMotion | None) -> None:
        """Take the direction of the ground's motion from the wheel's axis, where the rover drives straight.

        In a curve a wheel before or behind the point about which the rover rotates moves aside.
        """
        if not frame.has_gyro:
            return
        self._yaw.rotate(frame.turn_rad[2])
        if motion is None or not self._is_moving(motion):
            return
        aside_m = abs(frame.turn_rad[2] * complex(*self._ground.rig.point_m))
        if aside_m < self._numbers.direction.straight * motion.forward_m:
            self._yaw.add(complex(motion.forward_m, motion.left_m))

    def _theta_sd_rad(self, path: PathFilter) -> float:
        """Return the standard deviation of the angle.

        The path's covariance times the mean squared innovation over its variance, as that of unit weight of
        an adjustment; the errors that no innovation shows; and at least half of the angle between the trace
        and the motion of the ground, one of which is wrong where they differ.
        """
        assumed_rad = path.theta_sd_rad * math.sqrt(self._noise_ratio)
        return max(math.hypot(assumed_rad, self._numbers.direction.rig_sd_rad), self._apart_rad / 2)

    def lose(self) -> None:
        """Set the trace to absent."""
        self._presence.forget()

    def _is_moving(self, motion: PatchMotion | None) -> bool:
        """Return whether the ground moves enough in this frame to have a direction."""
        return motion is not None and motion.forward_m > self._numbers.direction.least_motion_m

    def _is_across(self, motion: PatchMotion) -> bool:
        """Return whether the motion is further from the wheel's axis than a trace may be."""
        most_m = np.tan(self._ground.rig.max_slip_rad) * abs(motion.forward_m)
        return bool(abs(motion.left_m) > most_m + self._numbers.direction.least_motion_m)

    def _advance(self, frame: Frame, motion: PatchMotion | None) -> tuple[float, bool]:
        """Predict the path to this frame; return the distance moved, and whether it is backwards.

        A motion far from the path is left out. The limit grows with the noise that this drive shows: motions
        that scatter by more than is assumed, or that stay far from the path, are believed after some way.
        """
        numbers = self._numbers.direction
        moved_m = abs(frame.travel_m) * (1 - numbers.slip_guess)
        turn, turn_sd = frame.turn_rad[2], frame.turn_sd_rad[2]
        if motion is not None:
            moved_m = float(np.hypot(motion.forward_m, motion.left_m))
            turn, turn_sd = motion.turn_rad, motion.turn_sd_rad
            backwards = motion.forward_m < -numbers.backwards_share * abs(frame.travel_m) < 0
            self._backwards += numbers.backwards_gain * (backwards - self._backwards)
            if backwards:
                return moved_m, True
        for path in (self._path, self._odometry) if moved_m > 0 else ():
            path.advance(moved_m, turn, turn_sd)
            if motion is not None and motion.forward_m > 0:
                sd_m = max(motion.left_sd_m, numbers.motion_sd_m)
                gate_sd = self._search.contradiction_sd * math.sqrt(max(self._noise_ratio, 1.0))
                ratio = path.observe_motion(motion.forward_m, -motion.left_m, sd_m, gate_sd)
                if path is self._odometry:
                    self._agrees = ratio <= gate_sd**2
                    self._ratios += 1  # the first is the assumption that the noise is as assumed
                    share = max(1 / self._ratios, min(motion.forward_m / self._ground.rig.behind_m, 1.0))
                    self._noise_ratio += share * (ratio - self._noise_ratio)
        return moved_m, self._backwards > numbers.most_backwards

    def _motion(self, frame: Frame, structure: Patch) -> PatchMotion | None:
        """Return the motion since the frame before, where the two share enough ground."""
        if self._measures:
            self._pairs.measure(frame.t_ns, frame.ground, self._prior(frame))
        pair, previous = self._pairs.take(frame.ground), self._previous
        self._previous = self._structure.picture(structure) if frame.usable else None
        if abs(frame.travel_m) <= self._numbers.direction.reach_m:
            return None if pair is None or self._is_across(pair) else pair
        if previous is None or self._previous is None:
            return None
        return self._sparse_motion(frame, previous, self._previous)

    def _prior(self, frame: Frame) -> MotionPrior:
        """Return the motion since the frame before by wheel and gyro, in the direction of the path."""
        travel_m = rotated(
            np.array([frame.travel_m, -self._path.slope * frame.travel_m]), self._ground.rig.steer_rad
        )
        return MotionPrior(
            forward_m=float(travel_m[0]),
            left_m=float(travel_m[1]),
            turn_rad=frame.turn_rad,
            turn_sd_rad=frame.turn_sd_rad,
            has_gyro=frame.has_gyro,
        )

    def _sparse_motion(self, frame: Frame, before: Image, after: Image) -> PatchMotion | None:
        """Return the motion between frames that share too little ground to be followed everywhere."""
        distance_m = abs(frame.travel_m)
        match = self._match.measure(before, after, distance_m, frame.turn_rad[2])
        if match is None:
            return None
        starts_m = np.array([match])
        motion = self._flow.follow(
            before, after, starts_m, frame.turn_rad, frame.turn_sd_rad, 1.5 * distance_m
        ).moving
        if motion is None or motion.share < self._numbers.direction.least_share:
            return None
        return motion

    def _find(self, sections: CrossSections, moved_m: float) -> bool:
        """Find the rut near the path and correct the path by it; return whether the trace is present."""
        curve, covariance = self._path.trace(self._finder.s_m)
        known = np.sqrt(np.diag(covariance)) < self._search.known_m
        edges, answers, valid = self._readings(sections, curve)
        self._strips.update(answers, valid & known, moved_m)
        stretch = self._strips.stretch(valid, known)
        if not known.all():
            searched = self._best(sections, curve, covariance)
            other_edges, answers, valid = self._readings(sections, searched)
            at_once = self._strips.stretch_at_once(answers, valid)
            if at_once.log_odds > stretch.log_odds:
                curve, edges, stretch = searched, other_edges, at_once
        self._confidence = confidence(stretch.log_odds, self._numbers.confidence)
        if not self._presence.update(stretch, moved_m):
            self._confidence = min(self._confidence, self._numbers.confidence.most_in_doubt)
            return False
        signature = _visible(self._presence.signature, stretch)
        self._apart_rad = self._apart(sections, signature, stretch.reading, moved_m)
        best = edges[0][stretch.reading], edges[1][stretch.reading]
        points = self._finder.points(sections, curve, best, signature)
        if len(points.s_m) < self._numbers.sections.least_blocks:
            return True
        aside_m = float(np.mean(points.y_m - self._path.curve(points.s_m)))
        if abs(aside_m) > self._search.most_beside * self._ground.rig.wheel_width_m:
            return False
        sd = self._without_outliers(points.s_m, points.y_m, points.sd_m * self._search.point_sd_factor)
        if self._contradicts_motion(points, sd):
            return False
        self._path.observe_trace(points.s_m, points.y_m, sd, self._search.offset_sd_m, self._search.slope_sd)
        residuals = points.y_m - self._path.curve(points.s_m)
        self._offset_m = float(np.average(residuals, weights=1 / sd**2))
        return True

    def _apart(self, sections: CrossSections, signature: Floats, reading: int, moved_m: float) -> float:
        """Return the angle between the near trace and the path by the motion alone; 0 where they agree.

        The imprint begins at the contact, and so does the path, but for a constant distance: one wall is seen
        better than the other, and the calibration has an error. A direction that has been wrong for some way
        puts the path further beside the imprint than it was over the last length of the view.
        """
        s = self._finder.s_m
        mean, covariance = self._odometry.trace(s)
        sides = self._front.edges(mean[None]) if reading else (mean[None], mean[None])
        near = np.arange(len(s)) < self._search.near_blocks
        reach_m = self._search.most_beside * self._ground.rig.wheel_width_m
        edges = np.asarray(sides[0][0]), np.asarray(sides[1][0])
        aside_m, gain = self._finder.aside(sections, edges, signature, near, reach_m)
        at = near & self._finder.valid[:, self._ground.centre]
        if not at.any():
            return 0.0
        usual_m = aside_m if self._aside_m is None else self._aside_m
        share = min(moved_m / self._ground.rig.behind_m, 1.0)
        self._aside_m = usual_m + share * (aside_m - usual_m)
        further_m = abs(aside_m - usual_m)
        variance = float(covariance[np.ix_(at, at)].mean()) + self._search.offset_sd_m**2
        is_apart = further_m > SIGNIFICANT_SD * math.sqrt(variance)
        if not is_apart or gain < self._numbers.presence.lock_odds:
            return 0.0
        return math.atan2(further_m, float(s[at].mean()))

    def _contradicts_motion(self, points: RutPoints, sd_m: Floats) -> bool:
        """Return True for points whose direction contradicts the motion of the ground and the gyro."""
        mean, covariance = self._odometry.trace(points.s_m)
        weight = 1 / sd_m**2
        place = points.s_m - np.average(points.s_m, weights=weight)
        slope = weight * place / (weight @ place**2)
        error = float(slope @ (points.y_m - mean))
        variance = slope @ (covariance + np.diag(sd_m**2)) @ slope + self._search.slope_sd**2
        if abs(error) > SIGNIFICANT_SD * np.sqrt(variance):
            self._apart_rad = max(self._apart_rad, abs(error))
        return bool(abs(error) > self._search.contradiction_sd * np.sqrt(variance))

    def _without_outliers(self, s_m: Floats, y_m: Floats, sd_m: Floats) -> Floats:
        """Return standard deviations that are increased for points far from the path and from the others."""
        mean, covariance = self._path.trace(s_m)
        residuals = y_m - mean
        residuals -= np.median(residuals)
        usual = self._search.outlier_sd * np.sqrt(sd_m**2 + np.diag(covariance))
        return np.asarray(sd_m * np.maximum(1.0, np.abs(residuals) / usual) ** 2)

    def _readings(self, sections: CrossSections, curve: Floats) -> tuple[Edges, Floats, Mask]:
        """Return edges and answers along a curve: of a trace alone, and with that of the front wheel."""
        right, left = self._front.edges(curve[None])
        edges = np.stack([curve, right[0]]), np.stack([curve, left[0]])
        return edges, *self._finder.answers_on(sections, edges)

    def _best(self, sections: CrossSections, mean: Floats, covariance: Floats) -> Floats:
        """Return the best curve where the path is uncertain."""
        curves, penalty = self._candidates(mean, covariance)
        reaches = (self._finder.blocks, self._search.near_blocks)
        scores = [
            self._scores(sums, count) - self._search.both_penalty * is_both
            for is_both, edges in enumerate(
                [(curves, curves), self._front.edges(curves)][: 1 + self._front.exists]
            )
            for sums, count in self._finder.along(sections, edges, *reaches)
        ]
        best = (np.stack(scores) - penalty).max(axis=0).argmax()
        return np.asarray(curves[best])

    def _scores(self, sums: Floats, count: NDArray[np.int_]) -> Floats:
        score = two_sided(sums, self._numbers.sections.one_sided_share)
        if self._presence.locked:
            score = (score + np.maximum(sums @ self._presence.signature, 0) ** 2) / 2
        return np.where(count >= self._numbers.sections.least_blocks, score, LEAST_SCORE)

    def _candidates(self, mean: Floats, covariance: Floats) -> tuple[Floats, Floats]:
        """Return candidate curves of the path, and the squared Mahalanobis distance of each.

        They vary along the three main directions of the path's covariance, in steps of a few millimetres.
        """
        values, vectors = np.linalg.eigh(covariance + self._search.candidate_sd_m**2)
        values, vectors = np.sqrt(np.maximum(values[:-4:-1], 1e-12)), vectors[:, :-4:-1]
        grids, spread = [], self._search.spread_sd
        for sd, vector, most in zip(values, vectors.T, self._search.most_steps, strict=True):
            reach_m = spread * sd * np.abs(vector).max()
            steps = min(int(np.ceil(reach_m / self._search.curve_step_m)), most)
            grids.append(np.linspace(-spread, spread, 2 * steps + 1) if steps else np.zeros(1))
        grid = np.stack(np.meshgrid(*grids, indexing="ij"), axis=-1).reshape(-1, 3)
        return mean + (grid * values) @ vectors.T, (grid**2).sum(axis=1)


def _visible(signature: Floats, stretch: Stretch) -> Floats:
    """Return the signature without the side on which the edge of the stretch is hidden."""
    seen = signature.copy()
    if stretch.hidden is not None:
        seen.reshape(2, -1)[stretch.hidden] = 0.0
    return seen
