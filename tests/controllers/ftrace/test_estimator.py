"""The estimators on rendered drives with exact truth. How good they are in general is measured in
`benchmarks/ftrace/rendered_drives.py`; here is tested that each rule works at all."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from controllers.ftrace.estimator import Method, TraceAngle, TraceEstimator
from controllers.ftrace.frame import Frame
from controllers.ftrace.parameters import DEFAULTS
from controllers.ftrace.rut.tracker import RutTracker
from controllers.ground_motion.flow import PatchMotion
from controllers.ground_motion.ground_patch import Patch
from controllers.ground_motion.rig import RigFile
from drivers.clock import nanoseconds
from drivers.errors import ModelError
from drivers.samples import Image
from tests.controllers.ftrace.rigs import errors_deg, follow, geometry, grey_frames, rates, rms
from tests.rear_scene.sequence import FrameSequence
from tests.rear_scene.sets import make_sequence

Drive = tuple[FrameSequence, list[Image]]
AnglesOf = Callable[[Method], list[TraceAngle]]
"""Follows a drive by a method, once for all tests."""


@pytest.fixture(scope="module")
def left() -> Drive:
    """Drifting to the left, 8 deg at most; at the end 4 deg, along a trace whose chord is at 9 deg."""
    sequence = make_sequence("curved", 1, 15.0)
    return sequence, grey_frames(sequence)


@pytest.fixture(scope="module")
def right() -> Drive:
    """Drifting to the right, 4 deg at the end, along a trace whose chord is at 10 deg."""
    sequence = make_sequence("curved", 4, 15.0)
    return sequence, grey_frames(sequence)


@pytest.fixture(scope="module")
def left_angles(left: Drive) -> AnglesOf:
    return cache(lambda method: follow(*left, method))


@pytest.fixture(scope="module")
def right_angles(right: Drive) -> AnglesOf:
    return cache(lambda method: follow(*right, method))


@pytest.mark.parametrize("method", ["hough", "fused"])
def test_the_angle_has_the_sign_and_size_of_the_truth(
    left: Drive, right: Drive, left_angles: AnglesOf, right_angles: AnglesOf, method: Method
) -> None:
    for (sequence, _), angles_of in ((left, left_angles), (right, right_angles)):
        angles = angles_of(method)

        assert len(errors_deg(sequence, angles)) > 30
        assert rms(errors_deg(sequence, angles)) < {"hough": 6.0, "fused": 1.2}[method]
        truth = sequence.truth[-1]
        assert angles[-1].theta_deg * truth.theta_t_deg > 0
        assert angles[-1].distance_m == pytest.approx(truth.d_t_m, abs=0.03 if method == "fused" else 0.08)


def test_a_curved_trace_gives_the_current_direction_not_the_chord(
    right: Drive, right_angles: AnglesOf
) -> None:
    sequence, _ = right
    angles = right_angles("fused")

    current, chord = errors_deg(sequence, angles), errors_deg(sequence, angles, "chord_deg")
    assert rms(current) < 0.6 * rms(chord)


def test_the_paper_s_straight_line_gives_the_chord(right: Drive, right_angles: AnglesOf) -> None:
    sequence, _ = right
    angles = right_angles("hough")

    assert rms(errors_deg(sequence, angles, "chord_deg")) < rms(errors_deg(sequence, angles))


def test_without_telemetry(left: Drive) -> None:
    sequence, images = left
    angles = follow(sequence, images, "fused", telemetry=False)

    assert rms(errors_deg(sequence, angles)) < 3.0


@pytest.mark.parametrize("method", ["hough", "fused"])
def test_three_misses_keep_the_trace_and_the_fourth_loses_it(left: Drive, method: Method) -> None:
    sequence, images = left
    black = np.zeros_like(images[0])
    angles = follow(sequence, [*images[:-5], *[black] * 5], method)

    last = angles[-6]
    assert last.detected
    for angle in angles[-5:]:
        assert not angle.detected
    for angle in angles[-5:-2]:
        assert angle.theta_rad is not None
        assert 0 < angle.confidence < last.confidence
    assert angles[-2].theta_rad is None
    assert angles[-2].distance_m is None
    assert angles[-2].confidence == 0
    assert len(angles[-2].path_m) == 0


@pytest.mark.parametrize("period_s", [0.05, 0.1, 0.2])
def test_the_trace_is_kept_for_the_same_travel_at_any_frame_rate(left: Drive, period_s: float) -> None:
    sequence, images = left
    rows = list(sequence.telemetry)
    estimator = TraceEstimator(RigFile.model_validate(sequence.rig.as_json()).geometry(), "fused")
    for image, row in zip(images, rows, strict=True):
        last = estimator.step(
            nanoseconds(row.t), image, wheel_speed_m_s=row.wheel_speed_mps, rates_rad_s=rates(row)
        )
    assert last.detected
    speed_m_s, kept_m = 0.08, 0.0
    for number in range(1, 40):
        angle = estimator.step(
            nanoseconds(rows[-1].t + number * period_s), np.zeros_like(images[0]), wheel_speed_m_s=speed_m_s
        )
        if angle.theta_rad is None:
            break
        kept_m = number * period_s * speed_m_s
    assert DEFAULTS.kept_m - period_s * speed_m_s <= kept_m <= DEFAULTS.kept_m


def test_found_again_after_it_was_lost(left: Drive) -> None:
    sequence, images = left
    dark = list(images)
    dark[-16:-10] = [np.zeros_like(images[0])] * 6
    angles = follow(sequence, dark, "fused")

    assert not angles[-11].detected
    assert all(angle.detected for angle in angles[-9:-3])
    assert angles[-1].theta_deg == pytest.approx(sequence.truth[-1].theta_t_deg, abs=2.0)


def test_nothing_is_found_before_the_wheel_left_a_trace(left: Drive, left_angles: AnglesOf) -> None:
    sequence, _ = left
    angles = left_angles("fused")

    early = [angle for angle, truth in zip(angles, sequence.truth, strict=True) if truth.visible_m < 0.07]
    assert len(early) > 10
    assert not any(angle.detected for angle in early)
    assert all(angle.source == "flow" for angle in early[2:])
    assert all(angle.distance_m is None for angle in early)


def test_ground_without_a_trace() -> None:
    sequence = make_sequence("no_trace", 2, 9.0)
    angles = follow(sequence, grey_frames(sequence), "fused")

    assert not any(angle.detected for angle in angles)
    assert all(angle.source == "flow" for angle in angles[2:])
    true_deg = np.array([row.theta_t_deg for row in sequence.truth])
    assert rms(np.array([angle.theta_deg for angle in angles])[2:] - true_deg[2:]) < 1.0
    assert max(angle.confidence for angle in angles) < 0.5


@pytest.mark.parametrize("grey", [0.5, 0.8])
def test_a_dark_band_that_is_fixed_in_the_picture_is_no_trace(grey: float) -> None:
    sequence = make_sequence("no_trace", 2, 9.0)
    clear = grey_frames(sequence)
    mask = np.ones(clear[0].shape, np.float32)
    cv2.fillConvexPoly(mask, _behind_the_wheel(sequence), grey)
    band = np.asarray(cv2.GaussianBlur(mask, (0, 0), 3.0))
    frames = [(image * band).astype(np.uint8) for image in clear]

    found = [angle.detected for angle in follow(sequence, frames, "fused")]

    assert sum(found) <= 0.02 * len(found)


def _behind_the_wheel(sequence: FrameSequence) -> NDArray[np.int32]:
    """Return the corners of a strip of ground as wide as the wheel, in the picture."""
    rig = sequence.rig
    half_m = rig.wheel.width_m / 2
    ground_m = np.array([[rig.wheel.x_m - s, rig.wheel.y_m + y, 0.0] for s, y in _corners(half_m)])
    seen = (ground_m - rig.camera_m) @ rig.vehicle_from_camera @ rig.camera_matrix.T
    return np.round(seen[:, :2] / seen[:, 2:]).astype(np.int32)


def _corners(half_m: float) -> list[tuple[float, float]]:
    return [(0.1, -half_m), (0.1, half_m), (1.0, half_m), (1.0, -half_m)]


def test_ground_at_rest_under_spinning_wheels_has_no_direction() -> None:
    sequence = make_sequence("no_trace", 1, 9.0)
    pictures = grey_frames(sequence)
    rig = RigFile.model_validate(sequence.rig.as_json())
    estimator = TraceEstimator(rig.geometry(), "fused")
    rows = list(sequence.telemetry)
    for picture, row in zip(pictures, rows, strict=True):
        estimator.step(
            nanoseconds(row.t), picture, wheel_speed_m_s=row.wheel_speed_mps, rates_rad_s=(0.0,) * 3
        )
    noise = np.random.default_rng(0)
    for number in range(1, 5):
        noisy = pictures[-1] + noise.normal(0.0, 1.5, pictures[-1].shape)
        angle = estimator.step(
            nanoseconds(rows[-1].t + 0.2 * number),
            np.clip(noisy, 0, 255).astype(np.uint8),
            wheel_speed_m_s=rows[-1].wheel_speed_mps,
            rates_rad_s=(0.0,) * 3,
        )
        assert angle.source != "flow"


@pytest.mark.parametrize("grey", [0, 128, 255])
@pytest.mark.parametrize("method", ["hough", "fused"])
def test_black_empty_and_burnt_frames(grey: int, method: Method) -> None:
    rig = geometry()
    estimator = TraceEstimator(rig, method)

    for frame in range(8):
        angle = estimator.step(frame * 200_000_000, np.full((rig.height, rig.width), grey, np.uint8))
        assert not angle.detected
        assert angle.theta_rad is None


def test_a_camera_upside_down_finds_nothing(left: Drive) -> None:
    sequence, images = left
    angles = follow(sequence, [np.ascontiguousarray(image[::-1, ::-1]) for image in images], "fused")

    assert not any(angle.detected for angle in angles)


def test_mirrored_pictures_give_no_angle_once_they_rotate_against_the_gyro(left: Drive) -> None:
    sequence, images = left
    angles = follow(sequence, [np.ascontiguousarray(image[:, ::-1]) for image in images], "fused")
    contradicted = [angle for angle in angles if angle.contradiction]
    assert len(contradicted) > 20
    for angle in contradicted:
        assert angle.contradiction.startswith("pictures rotate against the gyro")
        assert (angle.source, angle.detected, angle.theta_rad, angle.confidence) == ("none", False, None, 0.0)


def test_a_right_rig_is_not_contradicted(left_angles: AnglesOf, right_angles: AnglesOf) -> None:
    assert not [
        angle for angles in (left_angles, right_angles) for angle in angles("fused") if angle.contradiction
    ]


def three_headings(monkeypatch: pytest.MonkeyPatch, aside_deg: float, curve_rad: float = 0.0) -> TraceAngle:
    """Drive 1 m on each of three headings, where the ground moves aside by an angle; return the end."""
    motion = PatchMotion(
        forward_m=0.02,
        left_m=0.02 * np.tan(np.radians(aside_deg)),
        turn_rad=0.0,
        tilt_rad=(0.0, 0.0),
        forward_sd_m=1e-4,
        left_sd_m=1e-4,
        turn_sd_rad=1e-3,
        points=100,
        share=1.0,
        moved_pixels=20.0,
        moved_sd_pixels=0.1,
    )
    monkeypatch.setattr(RutTracker, "_motion", lambda self, frame, structure: motion)
    rig = geometry()
    estimator, image, t_s = TraceEstimator(rig), np.full((rig.height, rig.width), 90, np.uint8), 0.0
    for _ in range(3):
        for rate_rad_s in (*[curve_rad / 0.1] * 50, *[np.radians(150.0)] * 2):
            t_s += 0.1
            found = estimator.step(
                nanoseconds(t_s), image, wheel_speed_m_s=0.2, rates_rad_s=(0.0, 0.0, rate_rad_s)
            )
    return found


def test_a_camera_turned_in_yaw_gives_no_angle_after_three_headings(monkeypatch: pytest.MonkeyPatch) -> None:
    found = three_headings(monkeypatch, aside_deg=3.0)
    assert (found.source, found.theta_rad) == ("none", None)
    assert found.contradiction.startswith("ground moves +3.0 deg aside on all headings")
    assert found.mounting_sd_rad == pytest.approx(np.radians(3.0))


def test_three_headings_confirm_the_yaw_of_the_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    found = three_headings(monkeypatch, aside_deg=0.5)
    assert not found.contradiction
    assert found.mounting_sd_rad == pytest.approx(np.radians(0.75))


def test_a_wheel_that_moves_aside_in_curves_is_not_the_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    found = three_headings(monkeypatch, aside_deg=3.0, curve_rad=0.003)
    assert not found.contradiction
    assert found.mounting_sd_rad == pytest.approx(np.radians(3.0))


def test_the_same_frames_give_the_same_angles(left: Drive, left_angles: AnglesOf) -> None:
    first, second = left_angles("fused"), follow(*left, "fused")

    assert [angle.theta_rad for angle in first] == [angle.theta_rad for angle in second]


def test_time_that_stands_still() -> None:
    rig = geometry()
    estimator = TraceEstimator(rig)
    image = np.zeros((rig.height, rig.width), np.uint8)
    estimator.step(5, image)

    with pytest.raises(ModelError, match="in order"):
        estimator.step(5, image)


def test_a_frame_of_another_size() -> None:
    with pytest.raises(ModelError, match="of this rig"):
        TraceEstimator(geometry()).step(0, np.zeros((100, 100), np.uint8))


@pytest.mark.parametrize("wrong_deg", [9.0, -9.0])
def test_a_motion_that_follows_a_shadow_is_found_out_by_the_imprint(
    left: Drive, left_angles: AnglesOf, monkeypatch: pytest.MonkeyPatch, wrong_deg: float
) -> None:
    """The motion of the ground turns by 9 deg within six frames, as if locked on a shadow; no jump tells it.

    The imprint begins at the contact, and after a quarter of a metre it lies beside the path.
    """
    first, ramp = 35, 6
    count = 0
    measured = RutTracker._motion

    def locked(self: RutTracker, frame: Frame, structure: Patch) -> PatchMotion | None:
        nonlocal count
        motion = measured(self, frame, structure)
        share = min(max(count - first + 1, 0) / ramp, 1.0)
        count += 1
        if motion is None:
            return None
        aside_m = np.tan(np.radians(share * wrong_deg)) * motion.forward_m
        return replace(motion, left_m=motion.left_m + float(aside_m))

    healthy = left_angles("fused")
    monkeypatch.setattr(RutTracker, "_motion", locked)
    found = follow(*left, "fused")

    later = slice(first + 18, first + 26)
    for angles, least, most in ((healthy, 0.0, 1.5), (found, 1.9, 90.0)):
        sds = [np.degrees(a.theta_sd_rad) for a in angles[later] if a.theta_sd_rad is not None]
        assert len(sds) == 8
        assert least < np.median(sds) < most
    assert np.median([a.confidence for a in found[later]]) < np.median([a.confidence for a in healthy[later]])


def test_motions_that_scatter_by_more_than_is_assumed_are_not_halved(
    left: Drive, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames rock back and forth: every other motion is off to the left, the others to the right.

    A gate that believes the first kind takes the second for jumps, and the angle is off by as much.
    """
    aside_m = 0.0015
    count = 0
    measured = RutTracker._motion

    def rocking(self: RutTracker, frame: Frame, structure: Patch) -> PatchMotion | None:
        nonlocal count
        motion = measured(self, frame, structure)
        count += 1
        return motion and replace(motion, left_m=motion.left_m + (-1) ** count * aside_m)

    monkeypatch.setattr(RutTracker, "_motion", rocking)
    errors = errors_deg(left[0], follow(*left, "fused"))
    assert abs(np.mean(errors[10:])) < 1.0
