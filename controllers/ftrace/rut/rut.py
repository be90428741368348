"""Cross-sections of the ground: the response of kernels with the width of the wheel's rut.

The rectified ground is divided into blocks across the direction of travel. Kernels respond, for every block
and place, to a floor darker or brighter than its surroundings, to walls lit from the side, to a change of
texture, and to a floor that is smooth but for the prints of grousers. Light and texture of a rut depend on
soil and sun and are estimated. A rut has the same signature in all blocks along one smooth curve through the
contact.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from controllers.ftrace.parameters import SectionParameters
from controllers.ground_motion.ground_patch import RESOLUTION_M, Floats, GroundPatch, Mask, Patch

MEDIAN_STRIDE = 3


Answers = NDArray[np.float32]
Edges = tuple[Floats, Floats]
"""Curves of the trace with the visible right edge, and of the one with the visible left edge."""
EVEN = slice(0, 3, 2)
"""Steps, which are alike on both sides of a rut."""
SURE = slice(3, 5)
"""Kernels with a positive answer in a rut for every direction of the sun."""
PLACING = np.array([0.0, 1.0, 0.0, 1.0, 1.0] * 2)
"""Kernels that locate the rut: the apparent place of a step depends on which wall is in the sun."""


@dataclass(frozen=True, slots=True)
class Roughness:
    """Logarithms of the gradients along the direction of travel (prints of grousers) and across it."""

    bars: Patch
    grain: Patch


@dataclass(frozen=True, slots=True)
class CrossSections:
    """Answers of the kernels in units of their standard deviation over the ground, 0 where not valid.

    Attributes:
        answers: Kernel, block, column.
        sides: The same, ordered by side, block and column, kernel.
    """

    answers: Answers
    sides: Answers


@dataclass(frozen=True, slots=True)
class RutPoints:
    """Places of the rut's centre line in the blocks that show it: behind and left of the contact."""

    s_m: Floats
    y_m: Floats
    sd_m: Floats


class RutFinder:
    """Cross-sections of one rig's ground.

    Args:
        ground: The rectified ground.
        parameters: Tuned numbers.
    """

    def __init__(self, ground: GroundPatch, parameters: SectionParameters) -> None:
        self._parameters = parameters
        rows = round(parameters.block_m / RESOLUTION_M)
        self.block_m = rows * RESOLUTION_M
        along, across = (round(length_m / RESOLUTION_M) for length_m in parameters.texture_m)
        self._texture_window = along, across
        self._centre = ground.centre
        self._columns = ground.shape[1]
        self.blocks = ground.shape[0] // rows
        self.s_m: Floats = np.asarray((np.arange(self.blocks) + 0.5) * self.block_m, np.float64)
        self._rows = self.blocks * rows
        self.shape = (self._rows, self._columns)
        self._visible = ground.visible[: self._rows].astype(np.float32)
        window = 2 * round(self._parameters.light_m / 2 / RESOLUTION_M) + 1
        self._window = (window, window)
        self._share: Patch = np.asarray(np.maximum(cv2.blur(self._visible, self._window), 1e-3), np.float32)
        self.inner: Patch = np.asarray(
            cv2.erode(self._visible, np.ones((5, 5), np.uint8), borderValue=0), np.float32
        )
        self._kernels = _kernels(ground.rig.wheel_width_m, parameters)
        self._size = (self._columns, self.blocks)
        self._weight = np.maximum(self._to_blocks(self._visible), 0.1)
        self._inner_weight = np.maximum(self._to_blocks(self.inner), 0.1)
        self.valid = self._valid_places()
        self._flat_valid = self.valid.ravel()
        self._sample = np.flatnonzero(self._flat_valid)[::MEDIAN_STRIDE]
        self._block = np.arange(self.blocks)

    def roughness(self, structure: Patch) -> Roughness:
        """Return the roughness along and across the direction of travel, from the fine structure."""
        smooth = cv2.GaussianBlur(structure[: self._rows], (5, 5), 1.0)
        along = cv2.blur(np.abs(cv2.Sobel(smooth, cv2.CV_32F, 0, 1)), self._texture_window)
        across = cv2.blur(np.abs(cv2.Sobel(smooth, cv2.CV_32F, 1, 0)), self._texture_window)
        floor = self._parameters.energy_floor
        bars, grain = (np.asarray(cv2.log(e + floor), np.float32) for e in (along, across))
        return Roughness(bars, grain)

    def cross_sections(self, detail: Patch, rough: Roughness) -> CrossSections:
        """Return the answers to a rectified frame, given as its detail and the roughness of that."""
        pairs = (rough.bars, rough.grain)
        barred, grainy = (self._to_blocks(e * self.inner) / self._inner_weight for e in pairs)
        grey = self._to_blocks(detail) / self._weight
        pictures = (grey, grey, barred + grainy, grainy, barred - grainy)
        answers: Answers = np.stack(
            [
                np.asarray(cv2.filter2D(picture, -1, kernel), np.float32)
                for kernels in self._kernels
                for picture, kernel in zip(pictures, kernels, strict=True)
            ]
        )
        some = answers.reshape(len(answers), -1)[:, self._sample]
        spread = 1.4826 * np.median(np.abs(some), axis=1)
        answers /= np.maximum(spread, 1e-4)[:, None, None]
        answers /= np.sqrt(1 + (answers / self._parameters.clip) ** 2)
        answers *= self.valid
        flat = answers.reshape(2, len(answers) // 2, -1).transpose(0, 2, 1)
        return CrossSections(answers, np.ascontiguousarray(flat))

    def detail(self, log_grey: Patch) -> Patch:
        """Return the logarithm of grey without what varies slowly, 0 where the camera does not see."""
        seen = log_grey[: self._rows] * self._visible
        return np.asarray((seen - cv2.blur(seen, self._window) / self._share) * self._visible, np.float32)

    def along(
        self, sections: CrossSections, edges_m: Edges, *reaches: int
    ) -> list[tuple[Floats, NDArray[np.int_]]]:
        """Return sums of the answers along curves over root of the number of blocks, and that number.

        Args:
            sections: Answers.
            edges_m: Places to the left at `s_m` (curve, block) of the trace with the visible right edge, and
                of the one with the visible left edge: equal but where two traces overlap.
            reaches: Numbers of blocks to sum, from the contact on.

        Returns:
            For each reach the sums (curve, kernel), in ground without a rut of variance about 1, and the
            numbers (curve).
        """
        answers, valid = self._answers(sections, edges_m)
        within = (self._block < np.array(reaches)[:, None]).astype(np.float32)
        # One matrix product adds up blocks for every reach, many times faster than sums along an axis.
        sums = (within @ answers.reshape(self.blocks, -1)).reshape(len(reaches), *answers.shape[1:])
        counts = np.rint(within @ valid).astype(np.int_)
        return [
            (part / np.sqrt(np.maximum(count, 1))[:, None], count)
            for part, count in zip(sums, counts, strict=True)
        ]

    def answers_on(self, sections: CrossSections, edges_m: Edges) -> tuple[Floats, Mask]:
        """Return the answers block by block along curves (curve, block, kernel), and the blocks in view."""
        answers, valid = self._answers(sections, edges_m)
        return answers.swapaxes(0, 1), np.asarray(valid.all(axis=1))

    def points(
        self, sections: CrossSections, curve_m: Floats, edges_m: Edges, signature: Floats
    ) -> RutPoints:
        """Return the place in each block near a curve that best matches `signature`, a weight per kernel."""
        numbers = self._parameters
        span, here = self._matched(sections, curve_m, edges_m, signature, numbers.near_m)
        best = 1 + here[:, 1:-1].argmax(axis=1)
        before, peak, after = (here[self._block, best + step] for step in (-1, 0, 1))
        bend = np.maximum(2 * peak - before - after, 1e-3)
        place = span[self._block, best] - self._centre + np.clip((after - before) / (2 * bend), -0.5, 0.5)
        strong = peak > max(numbers.alike * float(np.percentile(peak, 75)), numbers.least_peak)
        strong &= self._in_view(curve_m, *edges_m)
        sd = numbers.point_sd_m * np.clip(
            numbers.usual_peak / np.maximum(peak, numbers.faintest_peak), *numbers.point_sd_range
        )
        return RutPoints(self.s_m[strong], place[strong] * RESOLUTION_M, sd[strong])

    def aside(
        self, sections: CrossSections, edges_m: Edges, signature: Floats, blocks: Mask, reach_m: float
    ) -> tuple[float, float]:
        """Return how far left of a curve these blocks match `signature` best, and by how much better.

        Args:
            sections: Answers.
            edges_m: Right and left edge of the trace on the curve, as in `along`.
            signature: A weight per kernel.
            blocks: Blocks to sum.
            reach_m: Greatest distance to either side.

        Returns:
            The distance, m, and the logarithm of the ratio of likelihoods there and on the curve; zeros
            without a block in view.
        """
        curve_m = np.asarray((edges_m[0] + edges_m[1]) / 2)
        _, here = self._matched(sections, curve_m, edges_m, signature, reach_m)
        used = blocks & self._in_view(curve_m, *edges_m)
        if not used.any():
            return 0.0, 0.0
        sums = np.maximum(here[used].sum(axis=0), 0.0)
        best, middle = int(sums.argmax()), len(sums) // 2
        gain = float(sums[best] ** 2 - sums[middle] ** 2) / (2 * int(used.sum()))
        return (best - middle) * RESOLUTION_M, gain

    def _matched(
        self, sections: CrossSections, curve_m: Floats, edges_m: Edges, signature: Floats, near_m: float
    ) -> tuple[NDArray[np.intp], Floats]:
        """Return columns near a curve (block, place), and how well they match `signature`."""
        near = round(near_m / RESOLUTION_M)
        columns = self._column(curve_m)
        span = columns[:, None] + np.arange(-near - 1, near + 2)
        here = np.zeros(span.shape)
        for weights, answers, edge in zip(
            np.split(_placing(signature), 2), np.split(sections.answers, 2), edges_m, strict=True
        ):
            matched = np.tensordot(weights, answers, 1)
            there = span + (self._column(edge) - columns)[:, None]
            here += matched[self._block[:, None], np.clip(there, 0, self._columns - 1)]
        return span, here

    def _in_view(self, *curves_m: Floats) -> Mask:
        """Return the blocks at which all these curves are in view."""
        inside: Mask = np.ones(self.blocks, np.bool_)
        for curve_m in curves_m:
            inside &= self.valid[self._block, np.clip(self._column(curve_m), 0, self._columns - 1)]
        return inside

    def _column(self, place_m: Floats) -> NDArray[np.intp]:
        columns: NDArray[np.intp] = np.round(place_m / RESOLUTION_M).astype(np.intp) + self._centre
        return columns

    def _answers(self, sections: CrossSections, edges_m: Edges) -> tuple[Floats, Mask]:
        """Return answers along edges (block, curve, kernel), 0 out of view; and where they are valid."""
        sides = []
        valid: Mask = np.ones(np.shape(edges_m[0])[::-1], np.bool_)
        for answers, edge_m in zip(sections.sides, edges_m, strict=True):
            columns = np.ascontiguousarray(self._column(edge_m).T)
            columns[(columns < 0) | (columns >= self._columns)] = 0
            places = self._block[:, None] * self._columns + columns
            valid &= self._flat_valid[places]
            sides.append(answers[places])
        return np.concatenate(sides, axis=-1) * valid[..., None], valid

    def _to_blocks(self, patch: Patch) -> Patch:
        return np.asarray(
            cv2.resize(patch[: self._rows], self._size, interpolation=cv2.INTER_AREA), np.float32
        )

    def _valid_places(self) -> Mask:
        """Return the places with enough ground in view on both sides."""
        reach = int(0.8 * (self._kernels[0][0].shape[1] // 2))
        thin = (self._to_blocks(self._visible) < self._parameters.least_weight).astype(np.float32)
        near = cv2.filter2D(thin, -1, np.ones((1, 2 * reach + 1), np.float32), borderType=cv2.BORDER_CONSTANT)
        valid = near < self._parameters.least_weight
        valid[:, :reach] = valid[:, -reach:] = False
        return valid


def two_sided(sums: Floats, one_sided_share: float) -> Floats:
    """Return the strength of both sides of a rut, for each kernel that of the weaker side.

    Floor and texture differ from the ground on both sides; walls may be lit from one side, so evidence on one
    side counts with `one_sided_share`.
    """
    sides = sums.reshape(len(sums), 2, -1).copy()
    sides[:, :, SURE] = np.maximum(sides[:, :, SURE], 0.0)
    squares = sides**2
    both = 2 * squares.min(axis=1)
    both[:, EVEN] *= sides[:, 0, EVEN] * sides[:, 1, EVEN] > 0
    return np.asarray(both.sum(axis=1) + one_sided_share * squares.sum(axis=(1, 2)))


def _placing(signature: Floats) -> Floats:
    """Return the kernel weights that locate a rut with this signature; sure kernels are made symmetric.

    A side without any weight is hidden, and remains so.
    """
    sides = signature.reshape(2, -1).copy()
    visible: Mask = np.asarray(sides.any(axis=1))
    sides[:, SURE] = np.maximum(sides[visible][:, SURE].mean(axis=0), 0.0) * visible[:, None]
    weights = sides.ravel() * PLACING
    return np.asarray(weights / max(float(np.linalg.norm(weights)), 1e-6))


def _kernels(width_m: float, parameters: SectionParameters) -> list[list[Answers]]:
    """Return kernels of unit norm across the direction of travel, for the right and the left side of the rut.

    They are: step in grey, wall, step in roughness, walls rougher across the direction of travel than the
    floor, floor rougher along it (grouser prints) than the walls.
    """
    half = width_m / 2 / RESOLUTION_M
    reach = int(np.ceil(1.2 * parameters.kernel_reach * half))
    n = np.arange(-reach, reach + 1) / half

    def within(side: int, low: float, high: float) -> Floats:
        place = side * n
        softness = parameters.softness
        window = 1 / (1 + np.exp((low - place) / softness)) / (1 + np.exp((place - high) / softness))
        return np.asarray(window / window.sum())

    kernels = []
    for side in (-1, 1):
        step = within(side, 0.1, 0.85) - within(side, 1.2, 2.1)
        wall = 2 * within(side, 0.85, 1.2) - within(side, 0.3, 0.7) - within(side, 1.4, 1.8)
        floor = within(side, 0.0, 0.7) - within(side, 0.85, 1.3)
        shapes = (step, wall, step, -floor, floor)
        kernels.append([np.asarray(s / np.linalg.norm(s), np.float32)[None, :] for s in shapes])
    return kernels
