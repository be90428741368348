"""Ground that moves under a dark band which is fixed in the picture, drawn here."""

import numpy as np
import pytest

from controllers.ftrace.parameters import DEFAULTS
from controllers.ftrace.rut.fixed_picture import FixedPicture
from controllers.ground_motion.ground_patch import RESOLUTION_M, GroundPatch, Patch
from controllers.ground_motion.structure import FineStructure
from tests.controllers.ftrace.rigs import geometry

GROUND = GroundPatch(geometry())
STRUCTURE = FineStructure(GROUND, DEFAULTS.ground_motion.structure)
STEP_PIXELS = 4
HALF_PIXELS = 12
"""Of the band."""
INSIDE = slice(GROUND.centre - HALF_PIXELS + 4, GROUND.centre + HALF_PIXELS - 3)
BESIDE = slice(GROUND.centre + HALF_PIXELS + 35, GROUND.centre + HALF_PIXELS + 60)


def frames(count: int, depth: float) -> list[Patch]:
    """Return logarithms of grey; the band is darker by `depth`."""
    rows, columns = GROUND.shape
    wide = np.random.default_rng(3).normal(0.0, 0.1, (rows + count * STEP_PIXELS, columns))
    band = np.abs(np.arange(columns) - GROUND.centre) <= HALF_PIXELS
    starts = range((count - 1) * STEP_PIXELS, -1, -STEP_PIXELS)
    return [np.asarray(4.0 + wide[start : start + rows] - depth * band, np.float32) for start in starts]


def strength(structure: Patch, columns: slice) -> float:
    seen = GROUND.visible[:, columns]
    return float(np.abs(structure[:, columns])[seen].mean())


@pytest.mark.parametrize("depth", [0.3, 0.6, 1.0])
def test_the_ground_is_as_rough_in_a_band_as_beside_it(depth: float) -> None:
    fixed = FixedPicture(STRUCTURE, GROUND.shape, GROUND.shape, DEFAULTS.fixed)
    for log_grey in frames(60, depth):
        fixed.update(log_grey, log_grey, STEP_PIXELS * RESOLUTION_M)
    structure = STRUCTURE.of(log_grey)
    detail, moving = fixed.without(log_grey, log_grey, structure)

    assert strength(structure, INSIDE) < 0.95 * strength(structure, BESIDE)
    assert strength(moving, INSIDE) == pytest.approx(strength(moving, BESIDE), rel=0.05)
    assert abs(float(detail[:, INSIDE].mean() - detail[:, BESIDE].mean())) < 0.02


def test_at_first_nothing_is_known_to_be_fixed() -> None:
    fixed = FixedPicture(STRUCTURE, GROUND.shape, GROUND.shape, DEFAULTS.fixed)
    first, second = frames(2, 0.6)
    fixed.update(first, first, STEP_PIXELS * RESOLUTION_M)
    structure = STRUCTURE.of(second)
    assert fixed.without(second, second, structure) == (second, structure)
