"""Looks for the rut: in one image, with memory of the path, or with the ground's motion as well."""

from typing import Literal

import cv2
import numpy as np

from controllers.ftrace.frame import Frame, Reading
from controllers.ftrace.geometry import RESOLUTION_M, Floats, GroundPatch, Patch
from controllers.ftrace.ground_flow import GroundFlow, Motion
from controllers.ftrace.ground_match import GroundMatch
from controllers.ftrace.path_memory import PathMemory
from controllers.ftrace.presence import LEAST_LENGTH_M, Evidence, Presence
from controllers.ftrace.rut import (
    EVEN_KERNELS,
    LEAST_BLOCKS,
    SURE_KERNELS,
    CrossSections,
    RutFinder,
    floor_evidence,
)
from controllers.ftrace.standing_light import StandingLight
from drivers.samples import Image

RutMethod = Literal["rut", "memory", "fused"]

GREY_FLOOR = 12.0
FLOW_CONTRAST = 160.0
FLOW_REACH_M = 0.12
"""Frames further apart than this share too little ground for optical flow."""
LEAST_SHARE = 0.3
SLIP_GUESS = 0.15
"""Share of the wheel's way that is guessed to be slip where the ground's motion is not seen."""
FLOW_SD_M = 0.0002
OFFSET_SD_M = {"rut": 0.008, "memory": 0.002, "fused": 0.002}
"""What all points of a frame err together: with memory the lasting part is a state of the path's filter."""
SLOPE_SD = 0.01
POINT_SD_FACTORS = {"rut": 1.5, "memory": 5.0, "fused": 2.5}
"""Points of one rut err together, and from frame to frame: the more frames count, the less each may."""
OUTLIER_SD = 1.5
CANDIDATE_SD_M = 0.006
CURVE_STEP_M = 0.006
SPREAD_SD = 2.2
MOST_STEPS = (22, 5, 2)
NEAR_BLOCKS = 9
BESIDE_M = (0.28, 0.016)
ONE_SIDED_SHARE = 0.3
BACKWARDS_SHARE = 0.3
BACKWARDS_GAIN = 0.05
MOST_BACKWARDS = 0.04
"""Share of the last frames in which the ground moved the wrong way, as in frames that are upside down."""
LEAST_SCORE = -1e6
RIGHT_WITHIN_RAD = np.radians(5.0)


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
        self._light = StandingLight(ground)
        self._memory = PathMemory(ground.rig.behind_m)
        hidden_m = float(np.argmax(ground.visible[:, ground.centre])) * RESOLUTION_M
        self._presence = Presence(hidden_m + LEAST_LENGTH_M)
        self._before: Image | None = None
        self._offset_m = 0.0
        self._backwards = 0.0
        width_m = ground.rig.wheel_width_m
        beside = np.arange(1.5 * width_m, max(BESIDE_M[0], 2 * width_m), BESIDE_M[1])
        self._beside: Floats = np.concatenate([-beside, beside])

    def track(self, frame: Frame) -> Reading:
        """Return what the next frame shows."""
        log_grey = np.log(frame.patch.astype(np.float32) + GREY_FLOOR)
        seen = log_grey
        if self._method == "fused":
            seen = log_grey - cv2.GaussianBlur(self._light.field, (0, 0), 2.0)
        moved_m, goes_back = self._advance(frame, seen, log_grey)
        found, strength = False, 0.0
        if frame.usable and not goes_back:
            found, strength = self._look(self._finder.cross_sections(seen), moved_m)
        s = self._finder.s_m
        curve = self._memory.curve(s)
        return Reading(
            found=found,
            theta_rad=self._memory.theta_rad,
            offset_m=self._offset_m,
            confidence=self._confidence(strength) if found else 0.0,
            path_m=np.stack([s, curve], axis=1),
        )

    def lose(self) -> None:
        """Forget that there was a trace."""
        self._presence.forget()

    def _advance(self, frame: Frame, seen: Patch, log_grey: Patch) -> tuple[float, bool]:
        """Carry the path on to this frame; return the distance moved, and whether that was backwards."""
        if frame.is_first or self._method == "rut":
            self._memory.reset()
        motion = None
        if self._method == "fused":
            motion = self._motion(frame, seen)
            if frame.usable:
                self._light.update(log_grey, motion)
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

    def _motion(self, frame: Frame, seen: Patch) -> Motion | None:
        """Return the motion since the frame before, where the two share enough ground."""
        before = self._before
        detail = self._finder.without_light(seen)
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

    def _look(self, sections: CrossSections, moved_m: float) -> tuple[bool, float]:
        """Look for the rut near the path; learn from it; return whether it is there and how strong."""
        curve, evidence = self._best(sections)
        if not self._presence.judge(evidence, moved_m):
            return False, evidence.strength
        look = self._presence.look + evidence.sums / np.sqrt(evidence.strength)
        points = self._finder.points(sections, curve, look / np.linalg.norm(look))
        if len(points.s_m) < LEAST_BLOCKS:
            return False, evidence.strength
        sd = self._without_outliers(points.s_m, points.y_m, points.sd_m * POINT_SD_FACTORS[self._method])
        self._memory.observe_trace(points.s_m, points.y_m, sd, OFFSET_SD_M[self._method], SLOPE_SD)
        fitted = self._memory.curve(points.s_m)
        self._offset_m = float(np.average(points.y_m - fitted, weights=1 / sd**2))
        return True, evidence.strength

    def _without_outliers(self, s_m: Floats, y_m: Floats, sd_m: Floats) -> Floats:
        """Return deviations that are greater for points that lie far off, others and the path considered."""
        mean, covariance = self._memory.trace(s_m)
        off = y_m - mean
        off -= np.median(off)
        usual = OUTLIER_SD * np.sqrt(sd_m**2 + np.diag(covariance))
        return np.asarray(sd_m * np.maximum(1.0, np.abs(off) / usual) ** 2)

    def _best(self, sections: CrossSections) -> tuple[Floats, Evidence]:
        """Return the best curve near the path and the evidence along it."""
        curves, penalty = self._candidates()
        look = self._presence.look if self._presence.locked else None
        best_score, place, reach, sums = -np.inf, 0, self._finder.blocks, np.zeros(0)
        for blocks in (self._finder.blocks, NEAR_BLOCKS):
            along, count = self._finder.along(sections, curves, blocks)
            score = _two_sided(along)
            if look is not None:
                score = (score + np.maximum(along @ look, 0) ** 2) / 2
            score = np.where(count >= LEAST_BLOCKS, score - penalty, LEAST_SCORE)
            if score.max() > best_score:
                place = int(score.argmax())
                best_score, reach, sums = float(score[place]), blocks, along[place]
        curve = curves[place]
        beside, count = self._finder.along(sections, curve + self._beside[:, None], reach)
        around = (beside**2).sum(axis=1)[count >= LEAST_BLOCKS]
        answers = self._finder.answers_on(sections, curve)
        return curve, Evidence(
            sums=sums,
            strength=float(sums @ sums),
            around=float(np.percentile(around, 90)) if around.size else 0.0,
            floor=floor_evidence(answers),
            answers=answers,
        )

    def _candidates(self) -> tuple[Floats, Floats]:
        """Return curves that the path may have, and how unlikely each is.

        They vary along the three main directions of the path's covariance, in steps of a few millimetres.
        """
        mean, covariance = self._memory.trace(self._finder.s_m)
        values, vectors = np.linalg.eigh(covariance + CANDIDATE_SD_M**2)
        values, vectors = np.sqrt(np.maximum(values[:-4:-1], 1e-12)), vectors[:, :-4:-1]
        grids = []
        for sd, vector, most in zip(values, vectors.T, MOST_STEPS, strict=True):
            steps = min(int(np.ceil(SPREAD_SD * sd * np.abs(vector).max() / CURVE_STEP_M)), most)
            grids.append(np.linspace(-SPREAD_SD, SPREAD_SD, 2 * steps + 1) if steps else np.zeros(1))
        grid = np.stack(np.meshgrid(*grids, indexing="ij"), axis=-1).reshape(-1, 3)
        return mean + (grid * values) @ vectors.T, (grid**2).sum(axis=1)

    def _confidence(self, strength: float) -> float:
        """Return a probability-like number: of a trace at all, times of an error below 5 deg."""
        seen = strength / (strength + 40.0)
        ratio = RIGHT_WITHIN_RAD / max(2.0 * self._memory.theta_sd_rad, 1e-6)
        return float(seen * np.tanh(ratio))


def _two_sided(sums: Floats) -> Floats:
    """Return how strongly both sides of a rut answer, kernel by kernel the weaker side counting.

    Floor and texture differ from the ground on both sides alike; walls may be lit from one side.
    """
    right, left = (side.copy() for side in np.split(sums, 2, axis=1))
    for side in (right, left):
        side[:, SURE_KERNELS] = np.maximum(side[:, SURE_KERNELS], 0.0)
    both = 2 * np.minimum(np.abs(right), np.abs(left)) ** 2
    both[:, EVEN_KERNELS] *= right[:, EVEN_KERNELS] * left[:, EVEN_KERNELS] > 0
    return np.asarray((both + ONE_SIDED_SHARE * (right**2 + left**2)).sum(axis=1))
