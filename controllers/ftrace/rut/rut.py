"""Looks for the rut: cross-sections of the ground against what a wheel of this width can leave.

The rectified ground is cut into blocks across the way. Kernels of the wheel's width answer, for every block
and place: a floor darker or brighter than its surroundings, walls lit from the side, a change of texture, a
floor that is smooth across the way but for the prints of grousers. What a rut shows of light and texture
depends on soil and sun and is learned; that it shows the same in all blocks along one smooth curve through
the contact is what makes it a rut.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from controllers.ftrace.rig_geometry import RESOLUTION_M, Floats, GroundPatch, Mask, Patch

BLOCK_ROWS = 10
BLOCK_M = BLOCK_ROWS * RESOLUTION_M
LIGHT_M = 0.5
"""Brightness that varies more slowly than this is light, not rut."""
KERNEL_REACH = 2.0
"""Kernels reach this many half widths to either side."""
LEAST_WEIGHT = 0.5
CLIP = 2.5
"""Answers are limited to about this many standard deviations, so that no stone decides alone."""
MEDIAN_STRIDE = 3
ENERGY_FLOOR = 0.02
TEXTURE_WINDOW = (3, 11)
SOFTNESS = 0.12
NEAR_M = 0.016
ALIKE, LEAST_PEAK = 0.45, 1.3
"""A block shows the rut when it answers with this share of what the better ones do, and beyond chance."""
LEAST_BLOCKS = 4
ONE_SIDED_SHARE = 0.3


Answers = NDArray[np.float32]
Edges = tuple[Floats, Floats]
"""Curves of the trace whose right edge is seen, and of the one whose left edge is."""
EVEN = slice(0, 3, 2)
"""Steps, which both sides of a rut show alike."""
SURE = slice(3, 5)
"""Those that a rut answers with a positive number, wherever the sun is."""
PLACING = np.array([0.0, 1.0, 0.0, 1.0, 1.0] * 2)
"""Kernels that place the rut: where a step seems to be depends on which wall is in the sun."""


@dataclass(frozen=True, slots=True)
class Roughness:
    """Logarithms of how much the ground changes along the way, as prints of grousers do, and across it."""

    bars: Patch
    grain: Patch

    @property
    def mean(self) -> Patch:
        """Both together."""
        return np.asarray((self.bars + self.grain) / 2, np.float32)

    def without(self, field: Patch) -> "Roughness":
        """Return what is left when a field that both share is taken out."""
        return Roughness(self.bars - field, self.grain - field)


@dataclass(frozen=True, slots=True)
class CrossSections:
    """Answers of the kernels in units of their standard deviation over the ground, 0 where not valid.

    Attributes:
        answers: Kernel, block, column.
        sides: The same to look up places: side, block and column, kernel.
    """

    answers: Answers
    sides: Answers


@dataclass(frozen=True, slots=True)
class RutPoints:
    """Places of the rut's centre line, one for each block that shows it: behind and left of the contact."""

    s_m: Floats
    y_m: Floats
    sd_m: Floats


class RutFinder:
    """Cross-sections of one rig's ground.

    Args:
        ground: The rectified ground.
    """

    def __init__(self, ground: GroundPatch) -> None:
        self._centre = ground.centre
        self._columns = ground.shape[1]
        self.blocks = ground.shape[0] // BLOCK_ROWS
        self.s_m: Floats = np.asarray((np.arange(self.blocks) + 0.5) * BLOCK_M, np.float64)
        self._rows = self.blocks * BLOCK_ROWS
        self._visible = ground.visible[: self._rows].astype(np.float32)
        window = 2 * round(LIGHT_M / 2 / RESOLUTION_M) + 1
        self._window = (window, window)
        self._share: Patch = np.asarray(np.maximum(cv2.blur(self._visible, self._window), 1e-3), np.float32)
        self.inner: Patch = np.asarray(
            cv2.erode(self._visible, np.ones((5, 5), np.uint8), borderValue=0), np.float32
        )
        self._kernels = _kernels(ground.rig.wheel_width_m)
        self._size = (self._columns, self.blocks)
        self._weight = np.maximum(self._to_blocks(self._visible), 0.1)
        self._inner_weight = np.maximum(self._to_blocks(self.inner), 0.1)
        self.valid = self._valid_places()
        self._flat_valid = self.valid.ravel()
        self._sample = np.flatnonzero(self._flat_valid)[::MEDIAN_STRIDE]
        self._block = np.arange(self.blocks)

    def roughness(self, detail: Patch) -> Roughness:
        """Return how much the ground changes along and across the way."""
        smooth = cv2.GaussianBlur(detail, (5, 5), 1.0)
        along = cv2.blur(np.abs(cv2.Sobel(smooth, cv2.CV_32F, 0, 1)), TEXTURE_WINDOW)
        across = cv2.blur(np.abs(cv2.Sobel(smooth, cv2.CV_32F, 1, 0)), TEXTURE_WINDOW)
        bars, grain = (np.asarray(cv2.log(e + ENERGY_FLOOR), np.float32) for e in (along, across))
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
        answers /= np.sqrt(1 + (answers / CLIP) ** 2)
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
            edges_m: Places to the left at `s_m` (curve, block) of the trace whose right edge is seen, and of
                the one whose left edge is: the same but where two traces overlap.
            reaches: Numbers of blocks to count, from the contact on.

        Returns:
            For each reach the sums (curve, kernel), in ground without a rut of variance about 1, and the
            numbers (curve).
        """
        answers, valid = self._answers(sections, edges_m)
        within = (self._block[:, None] < np.array(reaches)).astype(np.float32)
        # One product of matrices adds up blocks for every reach, many times faster than sums along an axis.
        adds = np.kron(within, np.eye(answers.shape[-1], dtype=np.float32))
        sums = answers.reshape(len(answers), -1) @ adds
        counts = np.rint(valid @ within).astype(np.int_)
        return [
            (part / np.sqrt(np.maximum(count, 1))[:, None], count)
            for part, count in zip(np.hsplit(sums, len(reaches)), counts.T, strict=True)
        ]

    def answers_on(self, sections: CrossSections, edges_m: Edges) -> Floats:
        """Return the answers block by block along one curve, where they are valid: kernel, block."""
        answers, valid = self._answers(sections, edges_m)
        return np.asarray(answers[valid].T)

    def points(self, sections: CrossSections, curve_m: Floats, edges_m: Edges, look: Floats) -> RutPoints:
        """Return where near a curve each block shows a rut like `look`, one weight for each kernel."""
        near = round(NEAR_M / RESOLUTION_M)
        columns = self._column(curve_m)
        span = columns[:, None] + np.arange(-near - 1, near + 2)
        here = np.zeros(span.shape)
        for weights, answers, edge in zip(
            np.split(_placing(look), 2), np.split(sections.answers, 2), edges_m, strict=True
        ):
            matched = np.tensordot(weights, answers, 1)
            there = span + (self._column(edge) - columns)[:, None]
            here += matched[self._block[:, None], np.clip(there, 0, self._columns - 1)]
        best = 1 + here[:, 1:-1].argmax(axis=1)
        before, peak, after = (here[self._block, best + step] for step in (-1, 0, 1))
        bend = np.maximum(2 * peak - before - after, 1e-3)
        place = span[self._block, best] - self._centre + np.clip((after - before) / (2 * bend), -0.5, 0.5)
        strong = peak > max(ALIKE * float(np.percentile(peak, 75)), LEAST_PEAK)
        for edge in (curve_m, *edges_m):
            strong &= self.valid[self._block, np.clip(self._column(edge), 0, self._columns - 1)]
        sd = 0.004 * np.clip(2.5 / np.maximum(peak, 0.6), 0.7, 3.0)
        return RutPoints(self.s_m[strong], place[strong] * RESOLUTION_M, sd[strong])

    def _column(self, place_m: Floats) -> NDArray[np.intp]:
        columns: NDArray[np.intp] = np.round(place_m / RESOLUTION_M).astype(np.intp) + self._centre
        return columns

    def _answers(self, sections: CrossSections, edges_m: Edges) -> tuple[Floats, Mask]:
        """Return answers along the edges of curves (..., block, kernel), 0 out of view; and where valid."""
        sides = []
        valid: Mask = np.ones(np.shape(edges_m[0]), np.bool_)
        for answers, edge_m in zip(sections.sides, edges_m, strict=True):
            columns = self._column(edge_m)
            columns[(columns < 0) | (columns >= self._columns)] = 0
            places = self._block * self._columns + columns
            valid &= self._flat_valid[places]
            sides.append(answers[places])
        return np.concatenate(sides, axis=-1) * valid[..., None], valid

    def _to_blocks(self, patch: Patch) -> Patch:
        return np.asarray(
            cv2.resize(patch[: self._rows], self._size, interpolation=cv2.INTER_AREA), np.float32
        )

    def _valid_places(self) -> Mask:
        """Return where a kernel sees ground enough on both sides."""
        reach = int(0.8 * (self._kernels[0][0].shape[1] // 2))
        thin = (self._to_blocks(self._visible) < LEAST_WEIGHT).astype(np.float32)
        near = cv2.filter2D(thin, -1, np.ones((1, 2 * reach + 1), np.float32), borderType=cv2.BORDER_CONSTANT)
        valid = near < LEAST_WEIGHT
        valid[:, :reach] = valid[:, -reach:] = False
        return valid


def floor_evidence(answers: Floats) -> float:
    """Return what the sure kernels say on the weaker side, in about standard deviations.

    Of all lengths of trace that begin at the wheel the one that says most counts.

    Args:
        answers: Along one curve: kernel, block, the nearest first.
    """
    count = np.arange(1, answers.shape[1] + 1)[LEAST_BLOCKS:]
    if not count.size:
        return 0.0
    sides = answers.reshape(2, -1, answers.shape[1])[:, SURE].sum(axis=1)
    sums = np.cumsum(sides, axis=1)[:, LEAST_BLOCKS:] / np.sqrt(count * (SURE.stop - SURE.start))
    return float(sums.min(axis=0).max())


def two_sided(sums: Floats) -> Floats:
    """Return how strongly both sides of a rut answer, kernel by kernel the weaker side counting.

    Floor and texture differ from the ground on both sides alike; walls may be lit from one side.
    """
    sides = sums.reshape(len(sums), 2, -1).copy()
    sides[:, :, SURE] = np.maximum(sides[:, :, SURE], 0.0)
    squares = sides**2
    both = 2 * squares.min(axis=1)
    both[:, EVEN] *= sides[:, 0, EVEN] * sides[:, 1, EVEN] > 0
    return np.asarray(both.sum(axis=1) + ONE_SIDED_SHARE * squares.sum(axis=(1, 2)))


def _placing(look: Floats) -> Floats:
    """Return the weights that place a rut of this look: both sides alike where they must be."""
    sides = look.reshape(2, -1).copy()
    sides[:, SURE] = np.maximum(sides[:, SURE].mean(axis=0), 0.0)
    weights = sides.ravel() * PLACING
    return np.asarray(weights / max(float(np.linalg.norm(weights)), 1e-6))


def _kernels(width_m: float) -> list[list[Answers]]:
    """Return kernels of unit norm across the way, for the right side of the rut and for the left.

    They are: step in grey, wall, step in roughness, walls that change across the way more than the floor, a
    floor that changes along the way (grouser prints) more than the walls.
    """
    half = width_m / 2 / RESOLUTION_M
    reach = int(np.ceil(1.2 * KERNEL_REACH * half))
    n = np.arange(-reach, reach + 1) / half

    def within(side: int, low: float, high: float) -> Floats:
        place = side * n
        window = 1 / (1 + np.exp((low - place) / SOFTNESS)) / (1 + np.exp((place - high) / SOFTNESS))
        return np.asarray(window / window.sum())

    kernels = []
    for side in (-1, 1):
        step = within(side, 0.1, 0.85) - within(side, 1.2, 2.1)
        wall = 2 * within(side, 0.85, 1.2) - within(side, 0.3, 0.7) - within(side, 1.4, 1.8)
        floor = within(side, 0.0, 0.7) - within(side, 0.85, 1.3)
        shapes = (step, wall, step, -floor, floor)
        kernels.append([np.asarray(s / np.linalg.norm(s), np.float32)[None, :] for s in shapes])
    return kernels
