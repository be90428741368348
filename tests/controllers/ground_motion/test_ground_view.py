"""A frame is made ready once for all that look at it."""

from collections import Counter

import cv2
import numpy as np
import pytest

from controllers.ground_motion.ground_patch import GroundPatch
from controllers.ground_motion.ground_view import MOST_KEPT, GroundView
from drivers.errors import ModelError
from drivers.samples import Image
from tests.controllers.ftrace.rigs import geometry


def frame(seed: int, shape: tuple[int, ...] = (480, 640, 3)) -> Image:
    return np.random.default_rng(seed).integers(0, 255, shape, np.uint8)


def test_a_frame_is_rectified_once_and_others_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    view, rectified = GroundView(GroundPatch(geometry())), Counter[str]()
    rectify = view.ground.rectify

    def counted(image: Image) -> Image:
        rectified["frames"] += 1
        return rectify(image)

    monkeypatch.setattr(view.ground, "rectify", counted)
    frames = [frame(seed) for seed in range(MOST_KEPT + 1)]
    first = view.look(frames[0])
    assert view.look(frames[0]) is first
    assert rectified["frames"] == 1
    for image in frames[1:]:
        assert not np.array_equal(view.look(image).patch, first.patch)
    assert rectified["frames"] == len(frames)
    again = view.look(frames[0])  # forgotten by now
    assert rectified["frames"] == len(frames) + 1
    assert np.array_equal(first.structure, again.structure)


def test_colours_are_seen_as_grey() -> None:
    view, image = GroundView(GroundPatch(geometry())), frame(5)
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
    assert np.array_equal(view.look(image).structure, view.look(grey).structure)


def test_a_frame_of_another_size_is_a_mistake() -> None:
    with pytest.raises(ModelError, match="use frames of this rig"):
        GroundView(GroundPatch(geometry())).look(frame(0, (240, 320)))
