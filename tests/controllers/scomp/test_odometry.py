import math
from dataclasses import replace

import numpy as np
import pytest

from controllers.slip.scomp.parameters import CompassModel, ScompParameters
from controllers.slip.scomp.two_segment_slip_law import TwoSegmentSlip
from drivers.errors import ModelError
from rover_hil.scomp.drive import SensorRows, Track, final_error_m
from rover_hil.scomp.files import truth_of
from rover_hil.scomp.odometry import estimate_track, start_heading
from tests.cases import first_often
from tests.controllers.scomp.drives import estimated, fitted, mounds, read, rms, sideways

TWO_SEGMENTS = TwoSegmentSlip(slip_0=0.2, k_per_rad=0.5, beta_0_rad=0.1, fit_range_rad=(0.0, 0.5))
PARAMETERS = ScompParameters(two_segment_slip=TWO_SEGMENTS, compass=CompassModel(sign=1, offset_rad=0.0))
WAY_M = 5.0


def straight(beta_rad: float, heading_rad: float = 0.0) -> SensorRows:
    t_s = np.arange(0.0, 50.05, 0.1)
    return SensorRows(
        t_s=t_s,
        wheel_rad=WAY_M / 0.092 * t_s / t_s[-1],
        wheel_yaw_rad=np.zeros_like(t_s),
        compass_rad=np.full_like(t_s, heading_rad),
        trace_rad=np.full_like(t_s, beta_rad),
    )


def test_final_error_counts_from_each_start() -> None:
    t_s = np.array([0.0, 50.0])
    still = np.zeros(2)
    track = Track(
        t_s=t_s,
        x_m=np.array([0.0, WAY_M]),
        y_m=still,
        heading_rad=still,
        slip=still,
        slip_angle_rad=still,
        sigma_x_m=still,
        sigma_y_m=still,
    )
    truth = {"t_s": t_s, "x_m": np.array([7.0, 11.0]), "y_m": np.array([-1.0, 2.0]), "yaw_rad": np.zeros(2)}
    assert final_error_m(track, truth_of(truth, "simulated")) == pytest.approx(math.hypot(1.0, 3.0))


def test_start_heading_is_the_frames_unless_the_compass_contradicts() -> None:
    known = PARAMETERS.model_copy(update={"compass": CompassModel(sign=1, offset_rad=0.5)})
    near, _ = start_heading(straight(0.0, 0.5 + math.radians(2.0)), known)
    assert near is None
    far, notes = start_heading(straight(0.0, 0.5 + math.radians(30.0)), known)
    assert far == pytest.approx(math.radians(30.0))
    assert "30.0 deg" in notes[0]
    elsewhere, _ = start_heading(
        straight(0.0, 0.5 + math.radians(2.0)), known.model_copy(update={"starts_along_x": False})
    )
    assert elsewhere == pytest.approx(math.radians(2.0))


def test_the_compass_alone_turns_the_whole_path() -> None:
    compass = CompassModel(sign=-1, offset_rad=0.5, reference_rad=1.0)
    drive = straight(0.0, -1.5)
    assert drive.compass_rad is not None
    parameters = PARAMETERS.model_copy(update={"compass": compass})
    track = estimate_track(drive, parameters).track
    assert track.heading_rad == pytest.approx(1.0, abs=1e-3)
    way_m = math.hypot(track.x_m[-1], track.y_m[-1])
    assert way_m == pytest.approx(WAY_M * 0.8, abs=0.05)
    assert math.atan2(track.y_m[-1], track.x_m[-1]) == pytest.approx(1.0, abs=1e-3)
    # Across the course: the offset's own uncertainty, turned by the distance.
    across_m = math.hypot(track.sigma_x_m[-1] * math.sin(1.0), track.sigma_y_m[-1] * math.cos(1.0))
    assert across_m > way_m * compass.offset_sd_rad


@pytest.mark.parametrize(("which", "bar_m"), first_often([("mounds", 0.25), ("sideways", 0.12)]))
def test_field_tests_with_parameters_of_the_first(which: str, bar_m: float) -> None:
    recorded = sideways() if which == "sideways" else mounds()
    _, path = read(recorded)
    ours = estimated(which, online=True)
    drives = path.t_s > 3.5
    assert final_error_m(ours.track, path) < bar_m
    off = np.degrees(ours.track.slip_angle_rad - recorded.truth["slip_angle_rad"])[drives]
    assert rms(off) < 1.0
    assert rms((ours.track.slip - recorded.truth["slip"])[drives]) < 0.05
    assert np.degrees(rms((ours.track.heading_rad - path.yaw_rad)[drives])) < 0.3
    sigmas = (ours.track.sigma_x_m[-1], ours.track.sigma_y_m[-1])
    assert all(0.005 < sigma < 0.6 for sigma in sigmas)
    for axis, sigma in (("x_m", sigmas[0]), ("y_m", sigmas[1])):
        error_m = getattr(ours.track, axis)[-1] - getattr(path, axis)[-1]
        assert abs(error_m) < 3.5 * sigma, axis


def test_normalised_innovations_are_near_one() -> None:
    found = estimated("mounds", online=True).innovations
    for name in ("compass magnetic", "trace"):
        nis = [i.nis for i in found if i.name == name and i.nis is not None]
        # Neighbours are alike: the bounds of a mean over independent ones would be far tighter.
        assert 0.6 < float(np.mean(nis)) < 1.4, name
        assert float(np.mean([value > 3.84 for value in nis])) < 0.09, name


def test_the_whole_drive_ends_where_the_rover_knew_it_was() -> None:
    _, path = read(mounds())
    online, whole = (estimated("mounds", online=flag).track for flag in (True, False))
    assert whole.x_m[-1] == pytest.approx(online.x_m[-1])
    assert whole.sigma_y_m[-1] == pytest.approx(online.sigma_y_m[-1])
    assert (whole.sigma_x_m <= online.sigma_x_m + 1e-6).all()
    drives = path.t_s > 3.5
    truth = mounds().truth["slip_angle_rad"]
    assert rms((whole.slip_angle_rad - truth)[drives]) < rms((online.slip_angle_rad - truth)[drives])


@pytest.mark.parametrize(
    ("sensor", "word", "bar_m"),
    first_often(
        [
            ("trace_rad", "no trace", 0.5),
            ("gyro_rad_s", "no gyro", 1.2),
            ("compass_rad", "no compass", 1.2),
            ("pitch_rad", "no pitch", 1.2),
            ("roll_rad", "no roll", 0.5),
        ]
    ),
)
def test_without_a_sensor(sensor: str, word: str, bar_m: float) -> None:
    drive, path = read(mounds())
    lesser = {
        "gyro_rad_s": replace(drive, gyro_rad_s=None),
        "compass_rad": replace(drive, compass_rad=None),
        "pitch_rad": replace(drive, pitch_rad=None),
        "roll_rad": replace(drive, roll_rad=None),
        "trace_rad": replace(drive, trace_rad=None),
    }[sensor]
    result = estimate_track(lesser, fitted().parameters)
    assert [note for note in result.notes if note.startswith(word)]
    assert final_error_m(result.track, path) < bar_m


def test_fixes_on_the_way_correct_the_end() -> None:
    drive, path = read(mounds())
    wrong = fitted().parameters
    wrong = wrong.model_copy(
        update={
            "pitch": wrong.pitch.model_copy(
                update={"rolling_resistance": 0.12, "rolling_resistance_sd": 0.05}
            )
        }
    )
    fix_m = np.full((len(drive.t_s), 2), np.nan)
    for t_s in (30.0, 60.0, 90.0):
        row = int(np.searchsorted(drive.t_s, t_s))
        fix_m[row] = np.interp(t_s, path.t_s, path.x_m), np.interp(t_s, path.t_s, path.y_m)
    blind, seeing = (estimate_track(item, wrong) for item in (drive, replace(drive, fix_m=fix_m)))
    assert final_error_m(blind.track, path) > 0.5
    assert final_error_m(seeing.track, path) < 0.25
    assert seeing.learnt[2] < 0.8 * blind.learnt[2]


def test_a_drive_of_one_row_is_refused() -> None:
    drive = straight(0.0)
    one = SensorRows(t_s=drive.t_s[:1], wheel_rad=drive.wheel_rad[:1], wheel_yaw_rad=drive.wheel_yaw_rad[:1])
    with pytest.raises(ModelError, match="two rows"):
        estimate_track(one, PARAMETERS)


@pytest.mark.slow
def test_an_unknown_clockwise_compass_is_noticed() -> None:
    drive, _ = read(mounds())
    assert drive.compass_rad is not None
    mirrored = replace(drive, compass_rad=-drive.compass_rad)
    right, turned = (estimate_track(item, ScompParameters()) for item in (drive, mirrored))
    assert [note for note in turned.notes if "clockwise" in note]
    assert not [note for note in right.notes if "clockwise" in note]
    assert turned.track.heading_rad[-1] == pytest.approx(right.track.heading_rad[-1], abs=1e-6)
