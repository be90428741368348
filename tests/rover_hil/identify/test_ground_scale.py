"""Scale of a ground camera: the factor and its interval from pieces of a drive, and what forbids its use."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from controllers.estimation.ground.travel import WHEELS_SD
from controllers.ground_motion.flow import GroundFlow
from controllers.ground_motion.ground_patch import GroundPatch
from controllers.ground_motion.parameters import DEFAULTS
from controllers.ground_motion.rig_tolerance import RigTolerance
from controllers.ground_motion.tolerance import scale_of
from rover_hil.config import load_config
from rover_hil.ready.scale.fit import PIECE_M, fit_scale
from rover_hil.ready.scale.record import CameraTravels, Travel
from rover_hil.ready.wheels.fit import NORMAL_95

STEP_M = 0.015


def drive(
    length_m: float, scale: float, noise: float = 0.0, seed: int = 1, course_rad: float = 0.0
) -> CameraTravels:
    """Return a straight drive whose camera measures 1 / `scale` of the travel, with noise of each piece."""
    settings = load_config("robotino-camera").ground_motion
    assert settings is not None
    rng = np.random.default_rng(seed)
    travels = []
    for number in range(round(length_m / STEP_M)):
        if number % round(PIECE_M / STEP_M) == 0:
            error = noise * rng.standard_normal()
        camera_m = STEP_M / scale * (1.0 + error) * np.exp(1j * course_rad)
        travels.append(Travel(known_m=complex(STEP_M), camera_m=complex(camera_m)))
    return CameraTravels(
        path=Path("drive.mcap"),
        wall_ns=0,
        reference="wheels",
        known_sd_m=0.0,
        rig=settings.rig,
        travels=tuple(travels),
        reasons={},
        picture=None,
    )


@pytest.mark.parametrize("scale", [0.97, 1.0, 1.04])
def test_the_factor_is_known_over_measured_and_no_surer_than_the_wheels(scale: float) -> None:
    fit = fit_scale([drive(3.2, scale)])
    assert fit.problem == ""
    assert fit.factor is not None
    assert fit.factor.value == pytest.approx(scale)
    assert fit.factor.half_width == pytest.approx(NORMAL_95 * WHEELS_SD)
    assert fit.sd == pytest.approx(WHEELS_SD)


def test_the_interval_holds_the_true_factor_as_often_as_it_says() -> None:
    held = 0
    for seed in range(200):
        fit = fit_scale([drive(3.2, 1.02, noise=0.02, seed=seed)])
        assert fit.factor is not None
        held += abs(fit.factor.value - 1.02) < fit.factor.half_width
    assert 180 <= held <= 200


def test_drives_together_are_surer_than_one() -> None:
    drives = [drive(3.2, 1.0, noise=0.04, seed=seed) for seed in range(5)]
    singles = [fit_scale([each]).sd for each in drives]
    assert fit_scale(drives).sd < 0.6 * np.mean(singles)


def test_the_course_of_a_turned_camera_is_told_and_does_not_change_the_scale_much() -> None:
    fit = fit_scale([drive(3.2, 1.0, course_rad=0.03)])
    assert fit.sideways_deg == pytest.approx(np.degrees(0.03), abs=0.01)
    assert fit.factor is not None
    assert fit.factor.value == pytest.approx(1.0, abs=0.001)


def test_a_pair_that_is_not_valid_ends_a_piece() -> None:
    whole = drive(1.6, 1.0)
    gaps = tuple(
        replace(travel, camera_m=None) if number % 25 == 24 else travel
        for number, travel in enumerate(whole.travels)
    )
    fit = fit_scale([replace(whole, travels=gaps, reasons={"too dark": 4, "frame repeated": 1})])
    assert fit.factor is None
    assert "0 pieces" in fit.problem
    assert "too dark" in fit.problem


def test_turns_on_the_spot_are_no_pieces() -> None:
    around = drive(3.2, 1.0)
    turns = tuple(
        replace(travel, known_m=travel.known_m * 1j**number, camera_m=complex(STEP_M) * 1j**number)
        for number, travel in enumerate(around.travels)
    )
    assert "0 pieces" in fit_scale([replace(around, travels=turns)]).problem


@pytest.mark.parametrize(
    ("scale", "noise", "words"), [(1.3, 0.0, "0.769 times the travel"), (1.0, 0.08, "uncertain by")]
)
def test_an_implausible_or_uncertain_factor_is_not_used(scale: float, noise: float, words: str) -> None:
    assert words in fit_scale([drive(2.2, scale, noise)]).problem


def test_noise_of_fixes_widens_the_interval() -> None:
    exact = drive(3.2, 1.0)
    wide = fit_scale([replace(exact, known_sd_m=0.005)])
    assert wide.factor is not None
    by_fixes = NORMAL_95 * np.sqrt(2) * 0.005 / np.sqrt(6 * (0.51**2))
    assert wide.factor.half_width == pytest.approx(np.hypot(by_fixes, NORMAL_95 * WHEELS_SD), rel=0.02)


def test_a_calibrated_scale_replaces_the_tolerances_of_the_rig_but_not_the_sinkage() -> None:
    settings = load_config("robotino-camera").ground_motion
    assert settings is not None
    ground = GroundPatch(settings.rig.geometry())
    flow = GroundFlow(ground, DEFAULTS.flow)
    calibrated = RigTolerance(scale=0.97, scale_sd=0.003, sinkage_m=0.009, sinkage_sd_m=0.0045)
    factor, sd = scale_of(ground, flow, calibrated)
    assert factor == pytest.approx(0.97 * (1 - 0.009 / 0.45))
    assert sd == pytest.approx(factor * np.hypot(0.003, 0.01))
    plain, plain_sd = scale_of(ground, flow, RigTolerance(sinkage_sd_m=0.0045))
    assert plain == 1.0
    assert plain_sd > sd
