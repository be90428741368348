"""Pixels of the drives that sink move as their written truth says."""

import re

import pytest

from tests.nature.sinking_drives.check import check_markers

pytestmark = pytest.mark.nightly  # a truth generator, which no change of the program touches


@pytest.mark.parametrize(
    ("relief_m", "blur_px", "bar_px"), [(0.0, 0.0, 0.05), (0.01, 0.0, 0.05), (0.01, 12.0, 0.1)]
)
def test_markers_are_where_the_truth_says(relief_m: float, blur_px: float, bar_px: float) -> None:
    said = check_markers(relief_m, blur_px)
    place, motion = (float(text) for text in re.findall(r"rms ([\d.]+) px", said))
    assert place < bar_px, said
    assert motion < bar_px, said
