"""Looks for the rut: cross-sections of the ground against what a wheel of this width can leave.

The rectified ground is cut into blocks across the way. Kernels of the wheel's width answer, for every block
and place: a floor darker or brighter than its surroundings, walls and berms lit from the side, a change of
texture. Which of them a rut shows depends on soil and sun and is learned; that it shows the same in all
blocks along one smooth curve through the contact is what makes it a rut.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from controllers.ftrace.geometry import RESOLUTION_M, Floats, GroundPatch, Mask, Patch

BLOCK_ROWS = 10
BLOCK_M = BLOCK_ROWS * RESOLUTION_M
LIGHT_M = 0.5
"""Brightness that varies more slowly than this is light, not rut."""
KERNEL_REACH = 2.0
"""Kernels reach this many half widths to either side."""
LEAST_WEIGHT = 0.5
CLIP = 2.5
"""Answers are limited to about this many standard deviations, so that no stone decides alone."""
ENERGY_FLOOR = 0.02
TEXTURE_WINDOW = (3, 11)
SOFTNESS = 0.12
NEAR_M = 0.016
LEAST_BLOCKS = 4


Answers = NDArray[np.float32]
EVEN_KERNELS = (0, 3, 4)
"""Steps, which both sides of a rut show alike."""


@dataclass(frozen=True, slots=True)
class CrossSections:
    """Answers of the kernels in units of their standard deviation over the ground: kernel, block, column."""

    answers: Answers
    valid: Mask


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
        self._inner: Patch = np.asarray(
            cv2.erode(self._visible, np.ones((5, 5), np.uint8), borderValue=0), np.float32
        )
        self._kernels = _kernels(ground.rig.wheel_width_m)
        self._size = (self._columns, self.blocks)
        self._weight = np.maximum(self._to_blocks(self._visible), 0.1)
        self._inner_weight = np.maximum(self._to_blocks(self._inner), 0.1)
        self.valid = self._valid_places()
        self._block = np.arange(self.blocks)

    def cross_sections(self, log_grey: Patch) -> CrossSections:
        """Return the answers to a rectified frame, given as logarithm of its grey."""
        detail = self.without_light(log_grey)
        smooth = cv2.GaussianBlur(detail, (5, 5), 1.0)
        along = cv2.blur(np.abs(cv2.Sobel(smooth, cv2.CV_32F, 0, 1)), TEXTURE_WINDOW)
        across = cv2.blur(np.abs(cv2.Sobel(smooth, cv2.CV_32F, 1, 0)), TEXTURE_WINDOW)
        bars, grain = (np.asarray(cv2.log(e + ENERGY_FLOOR), np.float32) for e in (along, across))
        rough, barred = (self._to_blocks((bars + sign * grain) * self._inner) for sign in (1, -1))
        grey = self._to_blocks(detail) / self._weight
        pictures = (grey, grey, grey, rough / self._inner_weight, barred / self._inner_weight)
        answers: Answers = np.stack(
            [
                np.asarray(cv2.filter2D(picture, -1, kernel), np.float32)
                for kernels in self._kernels
                for picture, kernel in zip(pictures, kernels, strict=True)
            ]
        )
        spread = 1.4826 * np.median(np.abs(answers[:, self.valid]), axis=1)
        answers /= np.maximum(spread, 1e-4)[:, None, None]
        answers /= np.sqrt(1 + (answers / CLIP) ** 2)
        answers *= self.valid
        return CrossSections(answers, self.valid)

    def without_light(self, log_grey: Patch) -> Patch:
        """Return the logarithm of grey without what varies slowly, 0 where the camera does not see."""
        seen = log_grey[: self._rows] * self._visible
        return np.asarray((seen - cv2.blur(seen, self._window) / self._share) * self._visible, np.float32)

    def along(
        self, sections: CrossSections, curves_m: Floats, blocks: int
    ) -> tuple[Floats, NDArray[np.int_]]:
        """Return sums of the answers along curves over root of the number of blocks, and that number.

        Args:
            sections: Answers.
            curves_m: Places to the left at `s_m`: curve, block.
            blocks: Number of blocks to count, from the contact on.

        Returns:
            Sums: curve, kernel; in ground without a rut their variance is about 1. Numbers: curve.
        """
        columns = np.round(curves_m / RESOLUTION_M).astype(np.intp) + self._centre
        inside = (columns >= 0) & (columns < self._columns)
        inside[:, blocks:] = False
        columns = np.clip(columns, 0, self._columns - 1)
        count = (sections.valid[self._block, columns] & inside).sum(axis=1)
        sums = (sections.answers[:, self._block, columns] * inside).sum(axis=2).T
        return sums / np.sqrt(np.maximum(count, 1))[:, None], count

    def answers_on(self, sections: CrossSections, curve_m: Floats) -> Floats:
        """Return the answers block by block along one curve, where they are valid: kernel, block."""
        columns = np.clip(
            np.round(curve_m / RESOLUTION_M).astype(np.intp) + self._centre, 0, self._columns - 1
        )
        return np.asarray(sections.answers[:, self._block, columns][:, sections.valid[self._block, columns]])

    def points(self, sections: CrossSections, curve_m: Floats, look: Floats) -> RutPoints:
        """Return where near a curve each block shows a rut like `look`, one weight for each kernel."""
        matched = np.tensordot(look, sections.answers, 1)
        near = round(NEAR_M / RESOLUTION_M)
        columns = np.round(curve_m / RESOLUTION_M).astype(np.intp) + self._centre
        span = np.clip(columns[:, None] + np.arange(-near - 1, near + 2), 0, self._columns - 1)
        here = matched[self._block[:, None], span]
        best = 1 + here[:, 1:-1].argmax(axis=1)
        before, peak, after = (here[self._block, best + step] for step in (-1, 0, 1))
        bend = np.maximum(2 * peak - before - after, 1e-3)
        place = span[self._block, best] - self._centre + np.clip((after - before) / (2 * bend), -0.5, 0.5)
        strong = peak > max(0.4 * float(np.median(peak)), 0.6)
        strong &= sections.valid[self._block, span[:, near + 1]]
        sd = 0.004 * np.clip(2.5 / np.maximum(peak, 0.6), 0.7, 3.0)
        return RutPoints(self.s_m[strong], place[strong] * RESOLUTION_M, sd[strong])

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


def _kernels(width_m: float) -> list[list[Answers]]:
    """Return kernels of unit norm across the way, for the right side of the rut and for the left.

    Steps in grey, wall, berm, step in roughness, step in the share of bars across the way (grouser prints).
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
        shapes = (
            within(side, 0.1, 0.85) - within(side, 1.2, 2.1),
            2 * within(side, 0.75, 1.2) - within(side, 0.2, 0.65) - within(side, 1.35, 1.8),
            2 * within(side, 1.15, 1.65) - within(side, 0.55, 1.0) - within(side, 1.8, 2.2),
        )
        step, wall, berm = (np.asarray(s / np.linalg.norm(s), np.float32)[None, :] for s in shapes)
        kernels.append([step, wall, berm, step, step])
    return kernels
