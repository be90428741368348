"""The whole CAN path in real time, as `benchmarks.program.can_path` loads it."""

import pytest

from benchmarks.program.can_path import sustain


@pytest.mark.slow
def test_no_frame_is_lost_or_refused_in_either_direction() -> None:
    figures = sustain("virtual", 0.5)
    assert figures["sent"] > 0
    assert figures["set_points_heard"] == figures["set_points_sent"] > 0
    assert (figures["lost"], figures["rejected"]) == (0, 0)
