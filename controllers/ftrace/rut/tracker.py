"""Search for the rut near the path travelled, which the motion of the ground predicts."""

import cv2
import numpy as np
from numpy.typing import NDArray

from controllers.ftrace.ground.flow import GroundFlow, Motion
from controllers.ftrace.ground.frame import Frame, Reading
from controllers.ftrace.ground.matching import GroundMatch
from controllers.ftrace.ground.static_shading import StaticShading
from controllers.ftrace.parameters import FTraceParameters
from controllers.ftrace.rig_geometry import RESOLUTION_M, Floats, GroundPatch, Patch
from controllers.ftrace.rut.confidence import CurveQuality, confidence
from controllers.ftrace.rut.front_wheel_trace import FrontWheelTrace
from controllers.ftrace.rut.path_filter import PathFilter
from controllers.ftrace.rut.presence import Evidence, Presence
from controllers.ftrace.rut.rut import (
    CrossSections,
    Edges,
    RutFinder,
    floor_evidence,
    two_sided,
)
from drivers.samples import Image

LEAST_SCORE = -1e6
"""Score of a curve with too few blocks in view."""
BEND_M = np.arange(0.08, 0.5, 0.02)
"""Places behind the contact at which the bend of a curve is measured."""


class RutTracker:
    """Follows the rut of one rig's wheel.

    Args:
        ground: The rectified ground.
        parameters: Tuned numbers.
    """

    def __init__(self, ground: GroundPatch, parameters: FTraceParameters) -> None:
        self._ground = ground
        self._numbers, self._search = parameters, parameters.search
        sections, shading = parameters.sections, parameters.shading
        visible = ground.visible.astype(np.float32)
        width_m, behind_m = ground.rig.wheel_width_m, ground.rig.behind_m
        self._log_grey = np.log(np.arange(256, dtype=np.float32) + sections.grey_floor)
        self._finder = RutFinder(ground, sections)
        self._flow = GroundFlow(ground, parameters.flow)
        self._match = GroundMatch(ground, parameters.matching)
        self._light = StaticShading(visible, ground.centre, shading.lit_share, shading)
        self._texture = StaticShading(self._finder.inner, ground.centre, shading.rough_share, shading)
        self._front = FrontWheelTrace(ground.rig, self._finder.block_m, self._search.touching_widths)
        self._path = PathFilter(behind_m, parameters.path)
        hidden_m = float(np.argmax(ground.visible[:, ground.centre])) * RESOLUTION_M
        start_m = hidden_m + parameters.presence.least_length_m
        self._presence = Presence(start_m, parameters.presence, sections)
        self._previous: Image | None = None
        self._offset_m = 0.0
        self._quality: CurveQuality | None = None
        self._backwards = 0.0
        reach_m, step_m = self._search.surround_m
        aside = np.arange(1.5 * width_m, max(reach_m, 2 * width_m), step_m)
        self._aside_m: Floats = np.concatenate([-aside, aside])

    def track(self, frame: Frame) -> Reading:
        """Return the trace in the next frame."""
        log_grey = np.asarray(cv2.LUT(frame.patch, self._log_grey), np.float32)
        detail = self._finder.detail(log_grey - self._light.field)
        motion = self._motion(frame, detail)
        moved_m, goes_back = self._advance(frame, motion)
        found = False
        if frame.usable:
            rough = self._finder.roughness(detail)
            self._light.update(log_grey, motion)
            self._texture.update(rough.mean, motion)
            rough = rough.without(self._texture.field)
            found = not goes_back and self._find(self._finder.cross_sections(detail, rough), moved_m)
        s = self._finder.s_m
        curve = self._path.curve(s)
        return Reading(
            found=found,
            theta_rad=self._path.theta_rad,
            offset_m=self._offset_m,
            confidence=confidence(self._quality, self._numbers.confidence)
            if found and self._quality
            else 0.0,
            path_m=np.stack([s, curve], axis=1),
        )

    def lose(self) -> None:
        """Set the trace to absent."""
        self._presence.forget()

    def _advance(self, frame: Frame, motion: Motion | None) -> tuple[float, bool]:
        """Predict the path to this frame; return the distance moved, and whether it is backwards."""
        numbers = self._numbers.flow
        if frame.is_first:
            self._path.reset()
        moved_m = frame.distance_m * (1 - numbers.slip_guess)
        turn, turn_sd = frame.turn_rad[2], frame.turn_sd_rad[2]
        if motion is not None:
            moved_m = float(np.hypot(motion.forward_m, motion.left_m))
            turn, turn_sd = motion.turn_rad, motion.turn_sd_rad
            backwards = motion.forward_m < -numbers.backwards_share * frame.distance_m < 0
            self._backwards += numbers.backwards_gain * (backwards - self._backwards)
            if backwards:
                return moved_m, True
        if moved_m > 0:
            self._path.advance(moved_m, turn, turn_sd)
            if motion is not None and motion.forward_m > 0:
                self._path.observe_motion(
                    motion.forward_m, -motion.left_m, max(motion.left_sd_m, numbers.motion_sd_m)
                )
        return moved_m, self._backwards > numbers.most_backwards

    def _motion(self, frame: Frame, detail: Patch) -> Motion | None:
        """Return the motion since the frame before, where the two share enough ground."""
        numbers = self._numbers.flow
        previous = self._previous
        grey = np.clip(128 + numbers.contrast * detail, 0, 255).astype(np.uint8)
        self._previous = grey if frame.usable else None
        if previous is None or not frame.usable:
            return None
        rolling = 1.0 - numbers.slip_guess
        forwards_m = (np.array([rolling, 0.0, -rolling]) * frame.distance_m).tolist()
        guesses = [(forward_m, -self._path.slope * forward_m) for forward_m in forwards_m]
        if frame.distance_m > numbers.reach_m:
            match = self._match.measure(previous, grey, frame.distance_m, frame.turn_rad[2])
            guesses = [] if match is None else [match]
        for guess in guesses:
            motion = self._flow.measure(previous, grey, guess, frame)
            if motion is not None and motion.share >= numbers.least_share:
                return motion
        return None

    def _find(self, sections: CrossSections, moved_m: float) -> bool:
        """Find the rut near the path and correct the path by it; return whether the trace is present."""
        curve, edges, spread_m, evidence = self._best(sections)
        if not self._presence.update(evidence, moved_m):
            return False
        signature = self._presence.signature + evidence.sums / np.sqrt(evidence.strength)
        points = self._finder.points(sections, curve, edges, signature / np.linalg.norm(signature))
        if len(points.s_m) < self._numbers.sections.least_blocks:
            return False
        aside_m = float(np.mean(points.y_m - self._path.curve(points.s_m)))
        if abs(aside_m) > self._search.most_beside * self._ground.rig.wheel_width_m:
            return False
        sd = self._without_outliers(points.s_m, points.y_m, points.sd_m * self._search.point_sd_factor)
        self._path.observe_trace(points.s_m, points.y_m, sd, self._search.offset_sd_m, self._search.slope_sd)
        fitted = self._path.curve(np.r_[BEND_M, points.s_m])
        residuals = points.y_m - fitted[len(BEND_M) :]
        self._offset_m = float(np.average(residuals, weights=1 / sd**2))
        residual_m = float(np.sqrt(np.average((residuals - self._offset_m) ** 2, weights=1 / sd**2)))
        bend = float(np.ptp(np.diff(fitted[: len(BEND_M)])) / (BEND_M[1] - BEND_M[0]))
        self._quality = CurveQuality(spread_m=spread_m, residual_m=residual_m, bend_rad=bend)
        return True

    def _without_outliers(self, s_m: Floats, y_m: Floats, sd_m: Floats) -> Floats:
        """Return standard deviations that are increased for points far from the path and from the others."""
        mean, covariance = self._path.trace(s_m)
        residuals = y_m - mean
        residuals -= np.median(residuals)
        usual = self._search.outlier_sd * np.sqrt(sd_m**2 + np.diag(covariance))
        return np.asarray(sd_m * np.maximum(1.0, np.abs(residuals) / usual) ** 2)

    def _best(self, sections: CrossSections) -> tuple[Floats, Edges, float, Evidence]:
        """Return the best curve, its edges, the spread of all curves by their weights, and the evidence.

        A curve may be that of a trace alone, or of one that overlaps with that of the front wheel.
        """
        curves, penalty = self._candidates()
        kinds = [(curves, curves), self._front.edges(curves)][: 1 + self._front.exists]
        reaches = (self._finder.blocks, self._search.near_blocks)
        found = [
            (edges, reach, *along)
            for edges in kinds
            for reach, along in zip(reaches, self._finder.along(sections, edges, *reaches), strict=True)
        ]
        scores = np.stack([self._scores(sums, count) for *_, sums, count in found])
        scores[len(reaches) :] -= self._search.both_penalty
        which, place = np.unravel_index(int(np.argmax(scores - penalty)), scores.shape)
        weight = scores.max(axis=0) / self._search.temper - penalty
        weight = np.exp(weight - weight.max())
        weight /= weight.sum()
        mean = weight @ curves
        spread_m = float(np.sqrt(weight @ ((curves - mean) ** 2).mean(axis=1)))
        (right, left), reach, sums, _ = found[which]
        edges = (right[place], left[place])
        evidence = self._evidence(sections, curves[place], edges, sums[place], reach)
        return curves[place], edges, spread_m, evidence

    def _scores(self, sums: Floats, count: NDArray[np.int_]) -> Floats:
        score = two_sided(sums, self._numbers.sections.one_sided_share)
        if self._presence.locked:
            score = (score + np.maximum(sums @ self._presence.signature, 0) ** 2) / 2
        return np.where(count >= self._numbers.sections.least_blocks, score, LEAST_SCORE)

    def _evidence(
        self, sections: CrossSections, curve: Floats, edges: Edges, sums: Floats, reach: int
    ) -> Evidence:
        least_blocks = self._numbers.sections.least_blocks
        neighbours = curve + self._aside_m[:, None]
        ((others, count),) = self._finder.along(sections, (neighbours, neighbours), reach)
        front_m = np.median(self._front.offsets(curve[None]))
        counts = count >= least_blocks
        least_m = self._search.surround_widths * self._ground.rig.wheel_width_m
        apart = counts & (np.abs(self._aside_m - front_m) > least_m)
        counts = apart if apart.any() else counts
        strengths = (others**2).sum(axis=1)[counts]
        answers = self._finder.answers_on(sections, edges)
        return Evidence(
            sums=sums,
            strength=float(sums @ sums),
            neighbours=float(np.percentile(strengths, 90)) if strengths.size else 0.0,
            floor=floor_evidence(answers, least_blocks),
            answers=answers,
        )

    def _candidates(self) -> tuple[Floats, Floats]:
        """Return candidate curves of the path, and the squared Mahalanobis distance of each.

        They vary along the three main directions of the path's covariance, in steps of a few millimetres.
        """
        mean, covariance = self._path.trace(self._finder.s_m)
        values, vectors = np.linalg.eigh(covariance + self._search.candidate_sd_m**2)
        values, vectors = np.sqrt(np.maximum(values[:-4:-1], 1e-12)), vectors[:, :-4:-1]
        grids, spread = [], self._search.spread_sd
        for sd, vector, most in zip(values, vectors.T, self._search.most_steps, strict=True):
            reach_m = spread * sd * np.abs(vector).max()
            steps = min(int(np.ceil(reach_m / self._search.curve_step_m)), most)
            grids.append(np.linspace(-spread, spread, 2 * steps + 1) if steps else np.zeros(1))
        grid = np.stack(np.meshgrid(*grids, indexing="ij"), axis=-1).reshape(-1, 3)
        return mean + (grid * values) @ vectors.T, (grid**2).sum(axis=1)
