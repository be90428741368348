"""Looks for the rut: in one image, with memory of the path, or with the ground's motion as well."""

import cv2
import numpy as np
from numpy.typing import NDArray

from controllers.ftrace.ground.flow import GroundFlow, Motion
from controllers.ftrace.ground.frame import Frame, Reading
from controllers.ftrace.ground.matching import GroundMatch
from controllers.ftrace.ground.static_shading import StandingLight
from controllers.ftrace.rig_geometry import RESOLUTION_M, Floats, GroundPatch, Patch
from controllers.ftrace.rut.confidence import RutMethod, Signs, confidence
from controllers.ftrace.rut.front_wheel_trace import LeadTrace
from controllers.ftrace.rut.path_filter import PathMemory
from controllers.ftrace.rut.presence import LEAST_LENGTH_M, Evidence, Presence
from controllers.ftrace.rut.rut import (
    BLOCK_M,
    LEAST_BLOCKS,
    CrossSections,
    Edges,
    RutFinder,
    floor_evidence,
    two_sided,
)
from drivers.samples import Image

LIT_SHARE, ROUGH_SHARE = 0.75, 0.5
"""Shadows darken: the bright places of a line are lit. Their edges are rough, half of a line is."""
GREY_FLOOR = 12.0
LOG_GREY = np.log(np.arange(256, dtype=np.float32) + GREY_FLOOR)
FLOW_CONTRAST = 160.0
FLOW_REACH_M = 0.12
"""Frames further apart than this share too little ground for optical flow."""
LEAST_SHARE = 0.3
SLIP_GUESS = 0.15
"""Share of the wheel's way that is guessed to be slip where the ground's motion is not seen."""
FLOW_SD_M = 0.0002
OFFSET_SD_M = 0.002
"""What all points of a frame err together: with memory the lasting part is a state of the path's filter."""
SLOPE_SD = 0.01
POINT_SD_FACTOR = 2.5
"""Points of one rut err together, and from frame to frame: the more frames count, the less each may."""
OUTLIER_SD = 1.5
CANDIDATE_SD_M = 0.006
CURVE_STEP_M = 0.006
SPREAD_SD = 2.2
MOST_STEPS = (22, 5, 2)
NEAR_BLOCKS = 9
BESIDE_M = (0.28, 0.016)
MOST_BESIDE = 0.5
"""A trace that lies this many widths beside the path is not the wheel's own."""
OTHER_WIDTHS = 1.0
"""Curves this near to the trace of the wheel ahead say nothing about the ground beside."""
BACKWARDS_SHARE = 0.3
BACKWARDS_GAIN = 0.05
MOST_BACKWARDS = 0.04
"""Share of the last frames in which the ground moved the wrong way, as in frames that are upside down."""
LEAST_SCORE = -1e6
BOTH_PENALTY = 3.0
"""By this two traces that overlap must look better than one alone."""
TEMPER = 16.0
"""Answers along neighbouring curves, and of kernels and blocks, err together: this many count as one."""
CURVE_SD: dict[RutMethod, tuple[float, float, float]] = {
    "rut": (0.006, 0.008, 0.01),
    "memory": (0.012, 0.004, 0.02),
}
"""Of the curve of a single image: of each place, and of what all err together in place (m) and in slope."""
BEND_M = np.arange(0.08, 0.5, 0.02)


class RutTracker:
    """Follows the rut of one rig's wheel.

    Args:
        ground: The rectified ground.
        method: `rut`, single images; `memory`, with the path travelled by wheel speed and gyro; `fused`, with
            optical flow as well.
    """

    def __init__(self, ground: GroundPatch, method: RutMethod) -> None:
        self._ground = ground
        self._method = method
        self._finder = RutFinder(ground)
        self._flow = GroundFlow(ground)
        self._match = GroundMatch(ground)
        self._light = StandingLight(ground.visible.astype(np.float32), ground.centre, LIT_SHARE)
        self._texture = StandingLight(self._finder.inner, ground.centre, ROUGH_SHARE)
        self._lead = LeadTrace(ground.rig, BLOCK_M)
        self._memory = PathMemory(ground.rig.behind_m)
        self._any_path = PathMemory(ground.rig.behind_m)
        hidden_m = float(np.argmax(ground.visible[:, ground.centre])) * RESOLUTION_M
        self._presence = Presence(hidden_m + LEAST_LENGTH_M, is_light_known=method == "fused")
        self._before: Image | None = None
        self._offset_m = 0.0
        self._signs: Signs | None = None
        self._backwards = 0.0
        width_m = ground.rig.wheel_width_m
        beside = np.arange(1.5 * width_m, max(BESIDE_M[0], 2 * width_m), BESIDE_M[1])
        self._beside: Floats = np.concatenate([-beside, beside])

    def track(self, frame: Frame) -> Reading:
        """Return what the next frame shows."""
        log_grey = np.asarray(cv2.LUT(frame.patch, LOG_GREY), np.float32)
        seen = log_grey
        if self._method == "fused":
            seen = log_grey - self._light.field
        detail = self._finder.detail(seen)
        motion = self._motion(frame, detail) if self._method == "fused" else None
        moved_m, goes_back = self._advance(frame, motion)
        found = False
        if frame.usable:
            rough = self._finder.roughness(detail)
            if self._method == "fused":
                self._light.update(log_grey, motion)
                self._texture.update(rough.mean, motion)
                rough = rough.without(self._texture.field)
            found = not goes_back and self._look(self._finder.cross_sections(detail, rough), moved_m)
        s = self._finder.s_m
        curve = self._memory.curve(s)
        return Reading(
            found=found,
            theta_rad=self._memory.theta_rad,
            offset_m=self._offset_m,
            confidence=confidence(self._signs, self._method) if found and self._signs else 0.0,
            path_m=np.stack([s, curve], axis=1),
        )

    def lose(self) -> None:
        """Forget that there was a trace."""
        self._presence.forget()

    def _advance(self, frame: Frame, motion: Motion | None) -> tuple[float, bool]:
        """Carry the path on to this frame; return the distance moved, and whether that was backwards."""
        if frame.is_first or self._method == "rut":
            self._memory.reset()
        moved_m = frame.distance_m * (1 - SLIP_GUESS)
        turn, turn_sd = frame.turn_rad[2], frame.turn_sd_rad[2]
        if motion is not None:
            moved_m = float(np.hypot(motion.forward_m, motion.left_m))
            turn, turn_sd = motion.turn_rad, motion.turn_sd_rad
            backwards = motion.forward_m < -BACKWARDS_SHARE * frame.distance_m < 0
            self._backwards += BACKWARDS_GAIN * (backwards - self._backwards)
            if backwards:
                return moved_m, True
        if self._method != "rut" and moved_m > 0:
            self._memory.advance(moved_m, turn, turn_sd)
            if motion is not None and motion.forward_m > 0:
                self._memory.observe_motion(
                    motion.forward_m, -motion.left_m, max(motion.left_sd_m, FLOW_SD_M)
                )
        return moved_m, self._backwards > MOST_BACKWARDS

    def _motion(self, frame: Frame, detail: Patch) -> Motion | None:
        """Return the motion since the frame before, where the two share enough ground."""
        before = self._before
        grey = np.clip(128 + FLOW_CONTRAST * detail, 0, 255).astype(np.uint8)
        self._before = grey if frame.usable else None
        if before is None or not frame.usable:
            return None
        slope, _ = self._memory.slope_and_curvature
        guesses = [
            (forward, -slope * forward)
            for forward in (np.array([1.0 - SLIP_GUESS, 0.0, SLIP_GUESS - 1.0]) * frame.distance_m).tolist()
        ]
        if frame.distance_m > FLOW_REACH_M:
            match = self._match.measure(before, grey, frame.distance_m, frame.turn_rad[2])
            guesses = [] if match is None else [match]
        for guess in guesses:
            motion = self._flow.measure(before, grey, guess, frame)
            if motion is not None and motion.share >= LEAST_SHARE:
                return motion
        return None

    def _look(self, sections: CrossSections, moved_m: float) -> bool:
        """Look for the rut near the path; learn from it; return whether it is there."""
        curve, edges, spread_m, evidence = self._best(sections)
        if not self._presence.judge(evidence, moved_m):
            return False
        look = self._presence.look + evidence.sums / np.sqrt(evidence.strength)
        points = self._finder.points(sections, curve, edges, look / np.linalg.norm(look))
        if len(points.s_m) < LEAST_BLOCKS:
            return False
        if self._method == "fused":
            beside_m = float(np.mean(points.y_m - self._memory.curve(points.s_m)))
            if abs(beside_m) > MOST_BESIDE * self._ground.rig.wheel_width_m:
                return False
            sd = self._without_outliers(points.s_m, points.y_m, points.sd_m * POINT_SD_FACTOR)
            self._memory.observe_trace(points.s_m, points.y_m, sd, OFFSET_SD_M, SLOPE_SD)
        else:
            sd = points.sd_m
            self._observe_curve(curve)
        fitted = self._memory.curve(np.r_[BEND_M, points.s_m])
        off = points.y_m - fitted[len(BEND_M) :]
        self._offset_m = float(np.average(off, weights=1 / sd**2))
        residual_m = float(np.sqrt(np.average((off - self._offset_m) ** 2, weights=1 / sd**2)))
        bend = float(np.ptp(np.diff(fitted[: len(BEND_M)])) / (BEND_M[1] - BEND_M[0]))
        self._signs = Signs(spread_m=spread_m, residual_m=residual_m, bend_rad=bend)
        return True

    def _observe_curve(self, curve_m: Floats) -> None:
        """Take in the curve of a single image where the ground can be seen."""
        seen = self._finder.valid[:, self._ground.centre]
        sd, offset_sd, slope_sd = CURVE_SD[self._method]
        self._memory.observe_trace(
            self._finder.s_m[seen], curve_m[seen], np.full(int(seen.sum()), sd), offset_sd, slope_sd
        )

    def _without_outliers(self, s_m: Floats, y_m: Floats, sd_m: Floats) -> Floats:
        """Return deviations that are greater for points that lie far off, others and the path considered."""
        mean, covariance = self._memory.trace(s_m)
        off = y_m - mean
        off -= np.median(off)
        usual = OUTLIER_SD * np.sqrt(sd_m**2 + np.diag(covariance))
        return np.asarray(sd_m * np.maximum(1.0, np.abs(off) / usual) ** 2)

    def _best(self, sections: CrossSections) -> tuple[Floats, Edges, float, Evidence]:
        """Return the likely curve, its edges, how far others that may be it lie from it, and the evidence.

        The evidence is that along the best curve. Where the path is known from the ground's motion that is
        the likely one; otherwise the likely one is the mean of all, each with its weight. Each may be that of
        a trace alone, or together with that of the wheel ahead.
        """
        curves, penalty = self._candidates()
        kinds = [(curves, curves), self._lead.edges(curves)][: 1 + self._lead.exists]
        reaches = (self._finder.blocks, NEAR_BLOCKS)
        found = [
            (edges, reach, *along)
            for edges in kinds
            for reach, along in zip(reaches, self._finder.along(sections, edges, *reaches), strict=True)
        ]
        scores = np.stack([self._scores(sums, count) for *_, sums, count in found])
        scores[len(reaches) :] -= BOTH_PENALTY
        which, place = np.unravel_index(int(np.argmax(scores - penalty)), scores.shape)
        weight = scores.max(axis=0) / TEMPER - penalty
        weight = np.exp(weight - weight.max())
        weight /= weight.sum()
        mean = weight @ curves
        spread_m = float(np.sqrt(weight @ ((curves - mean) ** 2).mean(axis=1)))
        (right, left), reach, sums, _ = found[which]
        edges = (right[place], left[place])
        evidence = self._evidence(sections, curves[place], edges, sums[place], reach)
        if self._method == "fused":
            return curves[place], edges, spread_m, evidence
        aside = mean - curves[place]
        return mean, (edges[0] + aside, edges[1] + aside), spread_m, evidence

    def _scores(self, sums: Floats, count: NDArray[np.int_]) -> Floats:
        score = two_sided(sums)
        if self._presence.locked:
            score = (score + np.maximum(sums @ self._presence.look, 0) ** 2) / 2
        return np.where(count >= LEAST_BLOCKS, score, LEAST_SCORE)

    def _evidence(
        self, sections: CrossSections, curve: Floats, edges: Edges, sums: Floats, reach: int
    ) -> Evidence:
        beside = curve + self._beside[:, None]
        ((others, count),) = self._finder.along(sections, (beside, beside), reach)
        other = np.median(self._lead.beside(curve[None]))
        counts = count >= LEAST_BLOCKS
        apart = counts & (np.abs(self._beside - other) > OTHER_WIDTHS * self._ground.rig.wheel_width_m)
        counts = apart if apart.any() else counts
        around = (others**2).sum(axis=1)[counts]
        answers = self._finder.answers_on(sections, edges)
        return Evidence(
            sums=sums,
            strength=float(sums @ sums),
            around=float(np.percentile(around, 90)) if around.size else 0.0,
            floor=floor_evidence(answers),
            answers=answers,
        )

    def _candidates(self) -> tuple[Floats, Floats]:
        """Return curves that the path may have, and how unlikely each is.

        They vary along the three main directions of the path's covariance, in steps of a few millimetres.
        Without optical flow any path may be: a curve found wrong would draw the next ones to itself.
        """
        path = self._memory if self._method == "fused" else self._any_path
        mean, covariance = path.trace(self._finder.s_m)
        values, vectors = np.linalg.eigh(covariance + CANDIDATE_SD_M**2)
        values, vectors = np.sqrt(np.maximum(values[:-4:-1], 1e-12)), vectors[:, :-4:-1]
        grids = []
        for sd, vector, most in zip(values, vectors.T, MOST_STEPS, strict=True):
            steps = min(int(np.ceil(SPREAD_SD * sd * np.abs(vector).max() / CURVE_STEP_M)), most)
            grids.append(np.linspace(-SPREAD_SD, SPREAD_SD, 2 * steps + 1) if steps else np.zeros(1))
        grid = np.stack(np.meshgrid(*grids, indexing="ij"), axis=-1).reshape(-1, 3)
        return mean + (grid * values) @ vectors.T, (grid**2).sum(axis=1)
