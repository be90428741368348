"""Frames that are sent again differ less from the last one than frames did before."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from controllers.ground_motion.parameters import DEFAULTS
from controllers.ground_motion.repeats import RepeatWatch
from drivers.samples import Image

SHAPE = (40, 50)
VISIBLE = np.ones(SHAPE, np.uint8)


class Camera:
    """Frames with noise of their own, and the watch that judges them."""

    def __init__(self, seed: int = 1) -> None:
        self._rng = np.random.default_rng(seed)
        self.watch = RepeatWatch(VISIBLE, DEFAULTS.repeats)
        self.last_new = self.ground()
        self.watch.begin(self.last_new)

    def ground(self) -> Image:
        return self._rng.integers(60, 180, SHAPE).astype(np.uint8)

    def noisy(self, ground: Image, noise_grey: float) -> Image:
        return np.asarray(np.rint(ground + self._rng.normal(0.0, noise_grey, SHAPE)), np.uint8)

    def take(self, patch: Image, *, may_wait: bool = True) -> bool:
        """Return whether a frame is repeated."""
        is_repeated = self.watch.is_repeated(patch, self.last_new, may_wait=may_wait)
        if not is_repeated:
            self.last_new = patch
        return is_repeated

    def drive(self) -> Image:
        """Take frames of ground that moves; return the last one."""
        for _ in range(8):
            assert not self.take(self.ground())
        return self.last_new


@pytest.mark.parametrize(("change", "is_repeated"), [(1, True), (11, True), (13, False), (30, False)])
def test_a_frame_with_less_than_a_third_of_the_difference_is_repeated(change: int, is_repeated: bool) -> None:
    """Of frames that differ by 40 grey levels."""
    camera = Camera()
    last = camera.drive()
    assert camera.take(np.asarray(last + change, np.uint8)) is is_repeated


def test_the_same_frame_is_repeated_as_often_as_it_comes() -> None:
    camera = Camera()
    last = camera.drive()
    assert all(camera.take(last, may_wait=False) for _ in range(20))


def test_frames_of_ground_that_stands_show_that_it_does() -> None:
    camera = Camera()
    ground = camera.drive()
    camera.last_new = camera.noisy(ground, 1.2)
    camera.watch.begin(camera.last_new)
    assert [camera.take(camera.noisy(ground, 1.2)) for _ in range(9)] == [True] * 2 + [False] * 7
    assert not camera.watch.is_undecided


def coded(patch: Image, quality: int) -> Image:
    data = cv2.imencode(".jpg", patch, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), np.uint8)


def is_shown_to_stand(camera: Camera, patches: list[Image]) -> bool:
    """Return whether frames are taken for new ones of ground that stands, before they are undecided."""
    taken = [camera.take(patch) or camera.watch.is_undecided for patch in patches]
    return not all(taken)


RATE_VARIES = (90, 85, 90, 80, 88, 83, 91, 86, 90)
"""Qualities of a coder that keeps its rate."""
CODERS: dict[str, Callable[[Camera, Image], list[Image]]] = {
    "alike": lambda camera, picture: [picture, *[camera.noisy(picture, 0.5)] * 8],
    "errors of their own": lambda camera, picture: [picture, *(camera.noisy(picture, 0.5) for _ in range(8))],
    "varying rate": lambda _, picture: [picture, *(coded(picture, quality) for quality in RATE_VARIES[1:])],
    "the first one, too": lambda _, picture: [coded(picture, quality) for quality in RATE_VARIES],
}


@pytest.mark.parametrize("coder", CODERS)
def test_a_frame_that_is_coded_again_and_again_is_not_ground_that_stands(coder: str) -> None:
    camera = Camera()
    camera.last_new, *copies = CODERS[coder](camera, camera.drive())
    camera.watch.begin(camera.last_new)
    assert not is_shown_to_stand(camera, copies)


def test_a_picture_that_is_sent_again_after_a_slow_step_is_not_ground_that_stands() -> None:
    camera = Camera()
    ground = np.asarray(cv2.GaussianBlur(camera.drive(), (0, 0), 2.0), np.uint8)
    camera.last_new = camera.noisy(ground, 1.0)
    camera.watch.begin(camera.last_new)
    by = np.array([[1.0, 0.0, 0.4], [0.0, 1.0, 0.0]])
    nearer = np.asarray(cv2.warpAffine(ground, by, SHAPE[::-1]), np.uint8)
    slow = camera.noisy(nearer, 1.0)
    assert camera.take(slow)
    assert not is_shown_to_stand(camera, [camera.noisy(slow, 0.5) for _ in range(8)])


def filtered(camera: Camera, count: int) -> list[Image]:
    """Return frames of standing ground behind a filter of noise over time, as cameras have it in the dark."""
    ground, frames = camera.drive(), list[Image]()
    noise = np.zeros(SHAPE)
    for _ in range(count):
        noise = 0.9 * noise + camera.noisy(np.full(SHAPE, 100, np.uint8), 2.0) - 100.0
        frames.append(np.asarray(np.rint(ground + noise), np.uint8))
    return frames


def test_frames_that_depend_on_each_other_are_undecided_before_they_are_of_ground_that_stands() -> None:
    camera, undecided, repeated = Camera(), [], []
    for patch in filtered(camera, 20):
        repeated.append(camera.take(patch))
        undecided.append(camera.watch.is_undecided)
    assert repeated == [True] * 4 + [False] * 16
    assert undecided == [False] * 4 + [True] * 5 + [False] * 11


def test_a_pair_that_must_not_become_longer_is_not_left_open() -> None:
    camera = Camera()
    last = camera.drive()
    assert not camera.take(camera.noisy(last, 0.3), may_wait=False)
