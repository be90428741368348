import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from controllers.slip.scomp.motion_model import expected_drift, tilt_along
from controllers.slip.scomp.parameters import ScompParameters
from drivers.errors import ModelError
from rover_hil.drives.ground_truth import TruePoses
from rover_hil.identify.scomp.fit import _checked, fit_gyro, fit_pitch, fit_roll, identify
from rover_hil.scomp.drive import SensorRows
from rover_hil.scomp.true_slip import SlipWindows, cut, true_velocity
from tests.controllers.scomp.drives import fitted, read, sideways


def windows_of(resistance: float, stiffness_n: float, sign: int = 1, noise: float = 0.01) -> SlipWindows:
    """Return windows whose slip follows the model exactly but for noise."""
    rng = np.random.default_rng(2)
    pitch = np.radians(rng.uniform(0.0, 14.0, 60))
    angle = np.radians(rng.uniform(-20.0, 20.0, 60))
    model = ScompParameters().pitch.model
    slip = [
        model.slip_at(math.sin(p) + resistance, a, stiffness_n)
        for p, a in zip(pitch.tolist(), angle.tolist(), strict=True)
    ]
    return SlipWindows(
        t_s=2.0 * np.arange(60.0),
        slip=np.array(slip) + noise * rng.standard_normal(60),
        slip_angle_rad=angle,
        pitch_rad=sign * pitch,
        roll_rad=None,
        steering_rad=np.zeros(60),
    )


@pytest.mark.parametrize("sign", [1, -1])
def test_resistance_and_stiffness_are_found(sign: int) -> None:
    notes: list[str] = []
    pitch, slip_rms = fit_pitch(windows_of(0.09, 80.0, sign), notes)
    assert pitch.pitch_sign == sign
    assert pitch.rolling_resistance == pytest.approx(0.09, abs=0.01)
    assert pitch.model.c_x_n == pytest.approx(80.0, rel=0.06)
    assert slip_rms == pytest.approx(0.01, rel=0.3)
    assert bool(notes) == (sign < 0)


def test_intervals_cover_the_truth() -> None:
    pitch, _ = fit_pitch(windows_of(0.02, 50.0, noise=0.03), [])
    assert abs(pitch.rolling_resistance - 0.02) < 3.0 * pitch.rolling_resistance_sd
    assert 0.001 < pitch.rolling_resistance_sd < 0.03
    assert pitch.stiffness_follows > 0.0


@pytest.mark.parametrize(("noise_deg", "is_told"), [(0.5, False), (40.0, True)])
def test_drift_that_the_roll_does_not_explain_is_told(noise_deg: float, is_told: bool) -> None:
    parameters, rng = ScompParameters(), np.random.default_rng(3)
    roll = np.radians(rng.uniform(-14.0, 14.0, 60))
    drift = [expected_drift(parameters, *tilt_along(parameters, 0.1, each, 0.0)) for each in roll.tolist()]
    angle = np.array(drift) + np.radians(noise_deg) * rng.standard_normal(60)
    windows = replace(windows_of(0.06, 80.0), slip_angle_rad=angle, pitch_rad=np.full(60, 0.1), roll_rad=roll)
    notes: list[str] = []
    fitted_roll = fit_roll(windows, parameters, notes)
    assert math.degrees(fitted_roll.rest) == pytest.approx(max(noise_deg, 1.5), rel=0.2)
    assert [note.partition(":")[0] for note in notes] == ["the roll explains little of the drift"] * is_told


def test_sensors_of_the_field_test() -> None:
    parameters = fitted().parameters
    assert math.degrees(parameters.trace.noise_rad) == pytest.approx(1.5, abs=0.35)
    assert parameters.trace.noise_time_s == pytest.approx(0.2 / -math.log(0.55), abs=0.2)
    assert parameters.rover.rear_axle_m == pytest.approx(0.30, abs=0.09)
    assert math.degrees(parameters.compass.noise_rad) == pytest.approx(0.4, abs=0.1)
    assert parameters.starts_along_x
    assert parameters.compass.sign == parameters.trace.sign == parameters.pitch.pitch_sign == 1


def mirrored() -> SensorRows:
    drive, _ = read(sideways())
    assert drive.compass_rad is not None
    assert drive.trace_rad is not None
    assert drive.pitch_rad is not None
    return replace(
        drive, compass_rad=2.0 - drive.compass_rad, trace_rad=-drive.trace_rad, pitch_rad=-drive.pitch_rad
    )


def test_a_noisy_tracker_does_not_blame_the_gyro() -> None:
    drive, path = read(sideways())
    assert drive.gyro_rad_s is not None
    walk = math.degrees(fit_gyro(drive, path).walk_rad_sqrt_s)
    noisy = replace(
        path, yaw_rad=path.yaw_rad + 0.005 * np.random.default_rng(1).standard_normal(len(path.yaw_rad))
    )
    assert math.degrees(fit_gyro(drive, noisy).walk_rad_sqrt_s) == pytest.approx(walk, rel=0.3)
    # The same gyro, at half the rate: each reading stands for twice as long.
    held = replace(drive, gyro_rad_s=np.repeat(drive.gyro_rad_s[::2], 2)[: len(drive.t_s)])
    assert math.degrees(fit_gyro(held, path).walk_rad_sqrt_s) == pytest.approx(walk * 2**0.5, rel=0.3)
    few = replace(drive, gyro_rad_s=np.zeros_like(drive.t_s))
    assert fit_gyro(few, path) == ScompParameters().gyro


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda path: replace(path, x_m=-path.x_m), "backwards or sideways in"),
        (lambda path: replace(path, yaw_rad=path.yaw_rad + 1.6), "backwards or sideways in"),
        (lambda path: replace(path, x_m=0.0 * path.x_m, y_m=0.0 * path.y_m), "does not move in the truth"),
    ],
)
def test_a_truth_that_cannot_be_the_logs_is_refused(
    change: Callable[[TruePoses], TruePoses], words: str
) -> None:
    drive, path = read(sideways())
    with pytest.raises(ModelError, match=words):
        identify(drive, change(path))


def test_signs_of_another_house_are_noticed() -> None:
    found = identify(mirrored(), read(sideways())[1])
    parameters = found.parameters
    assert parameters.compass.sign == parameters.trace.sign == parameters.pitch.pitch_sign == -1
    assert len(found.notes) == 3
    assert parameters.pitch.model.c_x_n == pytest.approx(fitted().parameters.pitch.model.c_x_n)


def test_a_truth_in_another_frame_gives_the_compass_an_offset() -> None:
    drive, path = read(sideways())
    turned = identify(drive, replace_psi(path, 0.7)).parameters
    assert not turned.starts_along_x
    assert turned.compass.offset_rad == pytest.approx((fitted().parameters.compass.offset_rad or 0.0) - 0.7)


def replace_psi(path: TruePoses, turn_rad: float) -> TruePoses:
    """Return the path in a frame turned the other way."""
    x_m = path.x_m * math.cos(turn_rad) - path.y_m * math.sin(turn_rad)
    y_m = path.x_m * math.sin(turn_rad) + path.y_m * math.cos(turn_rad)
    return replace(path, x_m=x_m, y_m=y_m, yaw_rad=path.yaw_rad + turn_rad)


def test_bare_wheels_give_the_two_segment_law() -> None:
    drive, path = read(sideways())
    bare = SensorRows(t_s=drive.t_s, wheel_rad=drive.wheel_rad, wheel_yaw_rad=drive.wheel_yaw_rad)
    found = identify(bare, path)
    assert found.parameters.two_segment_slip == fitted().parameters.two_segment_slip
    assert found.slip_rms is None
    assert "no pitch" in found.notes[0]


def test_log_and_truth_must_share_their_clock() -> None:
    drive, path = read(sideways())
    with pytest.raises(ModelError, match="same clock"):
        identify(replace(drive, t_s=drive.t_s + 1e4), path)


def test_windows_know_slip_and_slip_angle() -> None:
    recorded = sideways()
    drive, path = read(recorded)
    windows = cut(drive, path, 0.092)
    truth = np.interp(windows.t_s, recorded.truth["t_s"], recorded.truth["slip"])
    assert float(np.sqrt(np.mean((windows.slip - truth) ** 2))) < 0.02
    angle = np.interp(windows.t_s, recorded.truth["t_s"], recorded.truth["slip_angle_rad"])
    assert float(np.degrees(np.sqrt(np.mean((windows.slip_angle_rad - angle) ** 2)))) < 1.0


def test_true_velocity_of_a_noisy_tracker() -> None:
    recorded = sideways()
    _, path = read(recorded)
    rng = np.random.default_rng(6)
    noisy = replace(
        path,
        x_m=path.x_m + 0.003 * rng.standard_normal(len(path.t_s)),
        y_m=path.y_m + 0.003 * rng.standard_normal(len(path.t_s)),
    )
    at_s = np.arange(10.0, 70.0, 0.2)
    angle = true_velocity(noisy, at_s).slip_angle_rad
    truth = np.interp(at_s, recorded.truth["t_s"], recorded.truth["slip_angle_rad"])
    assert float(np.degrees(np.sqrt(np.mean((angle - truth) ** 2)))) < 1.2


def test_a_truth_of_another_drive_is_refused() -> None:
    drive, path = read(sideways())
    other = replace(path, x_m=4.0 * path.x_m, y_m=4.0 * path.y_m)
    with pytest.raises(ModelError, match="check wheel radius and truth"):
        identify(drive, other)


def test_parameters_that_no_file_may_hold_are_refused() -> None:
    parameters = fitted().parameters
    wrong = parameters.model_copy(update={"roll": parameters.roll.model_copy(update={"gain": 99.0})})
    with pytest.raises(ModelError, match=r"roll.gain = 99"):
        _checked(wrong)
