"""Motion of textured ground under a camera, with exact truth: patches cut from a large picture."""

import math

import cv2
import numpy as np
import pytest

from controllers.ground_motion.estimator import GroundMotionEstimator
from controllers.ground_motion.ground_patch import GroundPatch
from controllers.ground_motion.ground_view import GroundView
from controllers.ground_motion.motion import GroundMotion
from controllers.ground_motion.parameters import DEFAULTS
from controllers.ground_motion.prior import MotionPrior, turned
from controllers.ground_motion.repeating_ground import REPEATS
from controllers.ground_motion.rig_tolerance import RigTolerance
from controllers.ground_motion.structure import FineStructure
from drivers.errors import ModelError
from drivers.samples import Image
from tests.controllers.ftrace.rigs import geometry

GROUND = GroundPatch(geometry())
STEP_NS = 200_000_000
WHEEL_M = 0.016
EXACT = RigTolerance(height_sd_m=0.0, pitch_sd_deg=0.0, focal_length_sd=0.0, sinkage_sd_m=0.0)


def wide_ground(seed: int = 1, length: int = 1000) -> Image:
    noise = np.random.default_rng(seed).standard_normal((GROUND.shape[0] + length, GROUND.shape[1]))
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)
    return np.asarray(np.clip(128 + 40 * smooth / smooth.std(), 0, 255), np.uint8)


def patch_at(wide: Image, travelled_m: float) -> Image:
    """Return the view after a travel: ground that was at row r is then further behind."""
    rows, columns = np.indices(GROUND.shape).astype(np.float32)
    middle = (wide.shape[0] - GROUND.shape[0]) / 2
    rows += np.float32(middle - travelled_m / GROUND.pixel_m)
    return np.asarray(cv2.remap(wide, columns, rows, cv2.INTER_LINEAR), np.uint8)


class Drive:
    """Feeds patches to an estimator.

    Args:
        tolerance: What is not known about the rig.
    """

    def __init__(self, tolerance: RigTolerance = EXACT) -> None:
        self.estimator = GroundMotionEstimator(GroundView(GROUND), tolerance)
        self._structure = FineStructure(GROUND, DEFAULTS.structure)
        self._rng = np.random.default_rng(7)
        self._t_ns = 0
        self.motions: list[GroundMotion] = []

    def show(
        self, patch: Image, wheel_m: float | None = WHEEL_M, *, noisy: bool = True
    ) -> GroundMotion | None:
        """Show the next frame, with the noise of a camera."""
        grey = patch
        if noisy:
            grey = np.asarray(np.clip(patch + self._rng.normal(0, 1, patch.shape), 0, 255), np.uint8)
        turn, turn_sd = turned((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.2, DEFAULTS.turn)
        prior = MotionPrior(forward_m=wheel_m, left_m=0.0, turn_rad=turn, turn_sd_rad=turn_sd)
        structure = self._structure.of(self._structure.log_grey(grey))
        motion = self.estimator.step_patch(self._t_ns, grey, structure, prior)
        self._t_ns += STEP_NS
        if motion is not None:
            self.motions.append(motion)
        return motion

    @property
    def travelled_m(self) -> float:
        """Return the sum of the motions."""
        return sum(motion.forward_m for motion in self.motions)


@pytest.mark.parametrize(
    ("slip", "left_out"), [(-0.05, 0), (0.0, 0), (0.3, 0), (0.55, 0), (0.7, 0), (0.8, 0), (0.9, 1)]
)
def test_ground_is_measured_at_every_slip(slip: float, left_out: int) -> None:
    """Ground that hardly moves is not known to be seen before it has moved."""
    drive, wide = Drive(), wide_ground()
    ways_m = [(1 - slip) * WHEEL_M] * 20
    for place_m in np.cumsum([0.0, *ways_m]):
        drive.show(patch_at(wide, float(place_m)))

    invalid = [motion.invalid_because for motion in drive.motions if not motion.is_valid]
    assert all("no motion confirmed" in reason for reason in invalid)
    assert len(invalid) <= left_out
    assert drive.travelled_m == pytest.approx(sum(ways_m), abs=0.0015)


@pytest.mark.parametrize(("slip", "left_out"), [(1.0, 9), (1.3, 1), (2.0, 2)])
def test_a_rover_that_gets_stuck_or_rolls_back_is_measured_soon(slip: float, left_out: int) -> None:
    """A rover that begins with rolling back cannot be distinguished from a camera that is upside down."""
    drive, wide = Drive(), wide_ground()
    ways_m = [WHEEL_M] * 16 + [(1 - slip) * WHEEL_M] * 12
    for place_m in np.cumsum([0.0, *ways_m]):
        drive.show(patch_at(wide, float(place_m)))

    assert sum(not motion.is_valid for motion in drive.motions) <= left_out
    assert all(motion.is_valid for motion in drive.motions[-12 + left_out :])
    assert drive.travelled_m == pytest.approx(sum(ways_m), abs=0.0015)


def test_ground_that_stands_from_the_beginning_is_not_known_to_be_seen() -> None:
    drive, wide = Drive(), wide_ground()
    for _ in range(20):
        drive.show(patch_at(wide, 0.0))

    reasons = {motion.invalid_because for motion in drive.motions}
    assert reasons == {"no motion confirmed: the ground was not seen to move so far"}


def test_fast_ground_that_slips_is_found_between_the_starts() -> None:
    drive, wide = Drive(), wide_ground()
    for frame in range(6):
        drive.show(patch_at(wide, frame * 0.037), wheel_m=0.08)

    assert all(motion.is_valid for motion in drive.motions)
    assert drive.travelled_m == pytest.approx(5 * 0.037, rel=0.01)


def test_errors_of_slow_motion_do_not_add_up() -> None:
    """A tenth of a pixel a frame: frames are compared with one that is some pixels of ground away."""
    drive, wide = Drive(), wide_ground()
    for frame in range(101):
        drive.show(patch_at(wide, frame * 0.0004), wheel_m=0.0005)

    assert all(motion.is_valid for motion in drive.motions)
    assert drive.travelled_m == pytest.approx(0.04, abs=0.0006)


def specks(patch: Image) -> Image:
    """Return a frame with specks on the lens, over about a third of the points."""
    changed = patch.copy()
    rng = np.random.default_rng(3)
    for _ in range(60):
        x, y = rng.integers(0, patch.shape[1]), rng.integers(0, patch.shape[0])
        cv2.circle(changed, (int(x), int(y)), int(rng.integers(2, 6)), 30, -1)
    return changed


def test_specks_on_the_lens_are_not_ground_that_stands() -> None:
    drive, wide = Drive(), wide_ground()
    for frame in range(30):
        drive.show(specks(patch_at(wide, frame * 0.012)))

    assert all(motion.is_valid for motion in drive.motions)
    assert drive.travelled_m == pytest.approx(29 * 0.012, rel=0.02)
    shown = drive.estimator.fixed_in_picture
    dirty = specks(np.full(GROUND.shape, 200, np.uint8)) < 100
    clean = cv2.dilate(dirty.astype(np.uint8), np.ones((9, 9), np.uint8)) == 0
    assert shown[dirty & GROUND.visible].mean() > 0.3
    assert shown[clean & GROUND.visible].mean() < 0.02


def test_specks_alone_do_not_prove_that_the_ground_stands() -> None:
    """The ground cannot be followed: every frame shows other ground behind the same specks."""
    drive = Drive()
    for frame in range(8):
        drive.show(specks(patch_at(wide_ground(seed=frame), 0.0)))

    assert not any(motion.is_valid for motion in drive.motions)


def test_ground_that_stops_is_told_from_specks() -> None:
    drive, wide = Drive(), wide_ground()
    for frame in range(25):
        drive.show(specks(patch_at(wide, min(frame, 10) * 0.014)))

    assert sum(not motion.is_valid for motion in drive.motions) <= 9
    assert drive.travelled_m == pytest.approx(0.14, abs=0.002)
    assert all(motion.is_valid and abs(motion.forward_m) < 0.0006 for motion in drive.motions[-5:])


def test_repeated_frame_is_not_standing() -> None:
    drive, wide = Drive(), wide_ground()
    drive.show(patch_at(wide, 0.0), noisy=False)
    drive.show(patch_at(wide, 0.012), noisy=False)
    drive.show(patch_at(wide, 0.012), noisy=False)
    drive.show(patch_at(wide, 0.036), noisy=False)

    first, repeated, after = drive.motions
    assert repeated.invalid_because == "frame repeated"
    assert repeated.forward_m == 0.0
    assert after.is_valid
    assert after.from_ns == first.to_ns
    assert after.forward_m == pytest.approx(0.024, abs=4e-4)


def test_ground_that_cannot_be_seen_is_not_measured() -> None:
    drive = Drive()
    for _ in range(5):
        drive.show(np.full(GROUND.shape, 60, np.uint8))

    assert not any(motion.is_valid for motion in drive.motions)
    assert {motion.forward_m for motion in drive.motions} == {0.0}


def test_smooth_ground_of_little_contrast_is_measured() -> None:
    """Grey levels that vary by less than three: the fit decides, not the contrast."""
    drive, wide = Drive(), wide_ground()
    for frame in range(10):
        view = patch_at(wide, frame * 0.012).astype(np.float64)
        drive.show(np.asarray(np.round(120 + (view - 128) / 18), np.uint8), noisy=False)

    assert all(motion.is_valid for motion in drive.motions)
    assert drive.travelled_m == pytest.approx(9 * 0.012, rel=0.02)


@pytest.mark.parametrize("slip", [0.0, 0.5])
def test_frames_that_have_changed_places_are_not_used(slip: float) -> None:
    drive, wide = Drive(), wide_ground()
    for place in (0, 1, 2, 3, 5, 4, 6, 7, 8, 9):
        drive.show(patch_at(wide, place * (1.0 - slip) * WHEEL_M))

    reasons = [motion.invalid_because for motion in drive.motions]
    assert [number for number, reason in enumerate(reasons) if reason] == [3, 4]
    assert all("out of order" in reason or "farther than the wheels" in reason for reason in reasons[3:5])
    assert drive.travelled_m == pytest.approx(9 * (1.0 - slip) * WHEEL_M, abs=0.0015)


def test_too_much_travel_between_two_frames_is_refused() -> None:
    drive, wide = Drive(), wide_ground()
    drive.show(patch_at(wide, 0.0))
    motion = drive.show(patch_at(wide, 0.15), wheel_m=0.15)

    assert motion is not None
    assert "0.15 m between two frames, at most 0.0" in motion.invalid_because


def test_travel_without_wheels() -> None:
    drive, wide = Drive(), wide_ground()
    for frame in range(8):
        drive.show(patch_at(wide, frame * 0.03), wheel_m=None)

    assert all(motion.is_valid for motion in drive.motions)
    assert drive.travelled_m == pytest.approx(7 * 0.03, rel=0.01)


def test_camera_upside_down_is_reported() -> None:
    drive, wide = Drive(), wide_ground()
    for frame in range(60):
        view = patch_at(wide, frame * 0.9 * WHEEL_M)
        drive.show(np.asarray(view[::-1, ::-1].copy(), np.uint8))

    assert "upside down" in drive.motions[-1].invalid_because


def test_what_contradicts_the_rig_does_so_while_the_rover_stands() -> None:
    drive, wide = Drive(), wide_ground()
    for frame in range(60):
        view = patch_at(wide, min(frame, 55) * 0.9 * WHEEL_M)
        drive.show(np.asarray(view[::-1, ::-1].copy(), np.uint8), 0.0 if frame > 55 else WHEEL_M, noisy=False)

    assert all("upside down" in motion.invalid_because for motion in drive.motions[50:])


def test_camera_turned_by_a_quarter_is_reported() -> None:
    drive = Drive()
    noise = np.random.default_rng(1).standard_normal((GROUND.shape[0], GROUND.shape[1] + 400))
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)
    wide = np.asarray(np.clip(128 + 40 * smooth / smooth.std(), 0, 255), np.uint8)
    rows, columns = np.indices(GROUND.shape).astype(np.float32)
    for frame in range(40):
        aside = np.float32(frame * 0.9 * WHEEL_M / GROUND.pixel_m)
        drive.show(np.asarray(cv2.remap(wide, columns + aside, rows, cv2.INTER_LINEAR), np.uint8))

    assert "not turned" in drive.motions[-1].invalid_because


def test_a_picture_that_is_sent_for_long_is_no_ground_that_stands() -> None:
    """Coded again each time; the wheels roll on."""
    drive, wide, rng = Drive(), wide_ground(), np.random.default_rng(7)
    sent = np.zeros(GROUND.shape, np.uint8)
    for frame in range(12):
        noise = rng.normal(0, 1, GROUND.shape)
        sent = np.asarray(np.clip(patch_at(wide, frame * WHEEL_M) + noise, 0, 254), np.uint8)
        drive.show(sent, noisy=False)
    for _ in range(7):
        drive.show(np.asarray(sent + rng.integers(0, 2, GROUND.shape), np.uint8), noisy=False)

    assert all(motion.is_valid for motion in drive.motions[2:11])
    assert not any(motion.is_valid for motion in drive.motions[11:])


def test_rover_that_rolls_back_later_has_no_wrong_camera() -> None:
    drive, wide = Drive(), wide_ground()
    ways_m = [0.9 * WHEEL_M] * 65 + [-0.5 * WHEEL_M] * 40
    for place_m in np.cumsum([0.0, *ways_m]):
        drive.show(patch_at(wide, float(place_m)))

    assert sum(not motion.is_valid for motion in drive.motions) <= 3
    assert drive.travelled_m == pytest.approx(sum(ways_m), abs=0.002)


def test_ground_faster_than_the_wheels_is_reported() -> None:
    drive, wide = Drive(), wide_ground()
    for frame in range(40):
        drive.show(patch_at(wide, frame * 1.25 * WHEEL_M))

    assert "1.25 times as far as the wheels" in drive.motions[-1].invalid_because


def spin(gyro_deg: float) -> list[GroundMotion]:
    """Return the motions of turns on the spot of 3 deg a frame, of which a gyro reports this."""
    drive = Drive()
    wide = wide_ground(length=800)
    wide = np.asarray(np.tile(wide, (1, 5)), np.uint8)
    rows, columns = np.indices(GROUND.shape).astype(np.float64)
    turn_sd = turned((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.2, DEFAULTS.turn)[1]
    structure = FineStructure(GROUND, DEFAULTS.structure)
    motions = []
    for frame in range(6):
        turn = math.radians(3.0) * frame
        behind, left = rows + 0.5, columns - GROUND.centre
        column = math.cos(turn) * left - math.sin(turn) * behind + wide.shape[1] / 2
        row = math.cos(turn) * behind + math.sin(turn) * left + 400
        view = cv2.remap(wide, column.astype(np.float32), row.astype(np.float32), cv2.INTER_LINEAR)
        grey = np.asarray(view, np.uint8)
        prior = MotionPrior(
            forward_m=0.0,
            left_m=0.0,
            turn_rad=(0.0, 0.0, math.radians(gyro_deg)),
            turn_sd_rad=turn_sd,
            has_gyro=True,
        )
        motion = drive.estimator.step_patch(
            frame * STEP_NS, grey, structure.of(structure.log_grey(grey)), prior
        )
        if motion is not None:
            motions.append(motion)
    return motions


def test_turn_on_the_spot() -> None:
    """Turns of 3 deg a frame are followed, and the measured point stays."""
    for motion in spin(3.1):
        assert motion.is_valid
        assert math.degrees(motion.turn_rad) == pytest.approx(3.0, abs=0.1)
        assert math.hypot(motion.forward_m, motion.left_m) < 0.0015


def test_pictures_that_fit_only_the_reverse_of_the_turn_are_mirrored() -> None:
    reasons = [motion.invalid_because for motion in spin(-3.0)]
    assert all(reasons)
    assert "not mirrored" in reasons[-1]


def test_deviations_cover_the_errors() -> None:
    drive, wide = Drive(), wide_ground()
    for frame in range(40):
        drive.show(patch_at(wide, frame * 0.012))

    errors = np.array([motion.forward_m - 0.012 for motion in drive.motions])
    told = np.array([motion.forward_sd_m for motion in drive.motions])
    assert (np.abs(errors) < 2 * told).mean() > 0.9
    assert told.max() < 0.001


def test_wrong_frames_are_refused() -> None:
    estimator = GroundMotionEstimator(GroundView(GROUND))
    prior = MotionPrior(forward_m=0.0, left_m=0.0, turn_rad=(0.0,) * 3, turn_sd_rad=(0.01,) * 3)
    image = np.zeros((GROUND.rig.height, GROUND.rig.width), np.uint8)
    assert estimator.step(STEP_NS, image, prior) is None
    with pytest.raises(ModelError, match="give frames in order"):
        estimator.step(0, image, prior)
    with pytest.raises(ModelError, match="use frames of this rig"):
        estimator.step(2 * STEP_NS, image[:10], prior)


def test_ribs_that_several_motions_explain_are_reported() -> None:
    """The ground moves by four pixels: half a pixel back is a motion on these wheels, too."""
    drive, wide = Drive(), wide_ground().astype(np.float32)
    rows = np.arange(len(wide), dtype=np.float32)[:, None]
    ribs = 128.0 + 0.1 * (wide - 128.0) + 60.0 * np.cos(2.0 * np.pi * rows / 4.5)
    for frame in range(20):
        drive.show(patch_at(np.asarray(ribs, np.uint8), frame * WHEEL_M), wheel_m=1.5 * WHEEL_M)

    assert REPEATS in {motion.invalid_because for motion in drive.motions}
    assert not any(motion.is_valid for motion in drive.motions)


def test_ribs_that_one_motion_explains_are_measured_and_stated() -> None:
    drive, wide = Drive(), wide_ground().astype(np.float32)
    rows = np.arange(len(wide), dtype=np.float32)[:, None]
    ribs = 128.0 + 0.3 * (wide - 128.0) + 60.0 * np.cos(2.0 * np.pi * rows / 18.0)
    for frame in range(20):
        drive.show(patch_at(np.asarray(np.clip(ribs, 0, 255), np.uint8), frame * WHEEL_M))

    assert all(motion.is_valid for motion in drive.motions[5:])
    assert f"repeats every {18e3 * GROUND.pixel_m:.0f} mm" in drive.motions[-1].unconfirmed
