import dataclasses
import math
import sys
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from controllers.slip.effort.slip_map import PolynomialMap, TractionMap, slip_at
from drivers.errors import ConfigError, LogError
from rover_hil.identify.slip.camera_scale import NOMINAL_MM_PER_PX, find_scale
from rover_hil.identify.slip.identification import fit_maps, identify_slip_maps
from rover_hil.identify.slip.parameters import SLIP_FIT
from rover_hil.identify.slip.run_data import RunWindows
from rover_hil.identify.slip.scores import BEST, BEST_KNOWN, ENCODER, Score, score_runs
from rover_hil.identify.slip.surface_fit import fit_surface_map
from rover_hil.identify.slip.wheel_fit import (
    WheelSamples,
    collect_samples,
    fit_line,
    fit_monotone,
    fit_parabola,
    fit_support_vector_line,
    fit_traction,
)
from tests.rover_hil.identify.slip_runs import windows

M_PER_PX = math.nan  # the synthetic runs are in metres: a scale that gets used by mistake shows
DIRECTIONS = [math.radians(degrees) for degrees in range(-175, 180, 15)]


def constant(slip: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda torque_nm: np.full_like(torque_nm, slip)


def line(torque_nm: np.ndarray) -> np.ndarray:
    result: np.ndarray = 0.05 + 0.6 * torque_nm
    return result


def samples_of(truth: TractionMap | PolynomialMap, rng: np.random.Generator) -> WheelSamples:
    values = rng.uniform(0.05, 0.75, 2000)
    slip = np.array([slip_at(truth, value) for value in values]) + rng.normal(0.0, 0.02, len(values))
    return WheelSamples(slip, values, values, values)


def surface_runs(
    name: str,
    torque_nm: float,
    slip: float,
    rng: np.random.Generator,
    directions: Sequence[float] = DIRECTIONS,
) -> list[RunWindows]:
    """Return runs whose slip has a wave of a tenth over the direction."""
    runs: list[RunWindows] = []
    for direction in directions:
        level = slip * (1.0 + 0.1 * math.cos(2 * direction))
        torques = torque_nm + rng.normal(0.0, 0.01, (12, 3))
        runs.append(windows(direction, name, slip=constant(level), torque_nm=torques))
    return runs


def test_slip_of_the_samples_is_the_truth() -> None:
    torques = np.linspace(0.1, 0.9, 60).reshape(-1, 3)
    samples = collect_samples([windows(0.4, "a", slip=line, torque_nm=torques)] * 2, M_PER_PX)
    assert samples.slip == pytest.approx(line(samples.wheel_torque_nm))
    assert (samples.wheel_torque_nm > 0).all()


def test_slow_and_flagged_wheels_are_left_out() -> None:
    torques = np.linspace(0.1, 0.9, 90).reshape(-1, 3)
    run = windows(0.0, "a", slip=line, torque_nm=torques)  # wheel 1 does not turn
    assert len(collect_samples([run], M_PER_PX).slip) == 60
    with pytest.raises(LogError, match="hold 0 usable wheel windows"):
        collect_samples([dataclasses.replace(run, usable=np.zeros_like(run.usable))], M_PER_PX)


def test_lines_and_parabolas_are_recovered() -> None:
    rng = np.random.default_rng(1)
    truth = PolynomialMap(feature="current_a", valid_from=0.0, valid_to=1.0, coefficients=(0.05, 0.4, 0.3))
    parabola = fit_parabola(samples_of(truth, rng), "current_a")
    assert parabola.coefficients == pytest.approx(truth.coefficients, abs=0.03)
    straight = truth.model_copy(update={"coefficients": (0.05, 0.7)})
    samples = samples_of(straight, rng)
    for fit in (fit_line, fit_support_vector_line):
        found = fit(samples, "paper_torque_nm")
        assert found.coefficients == pytest.approx((0.05, 0.7), abs=0.01)
        assert (found.valid_from, found.valid_to) == pytest.approx((0.05, 0.75), abs=0.01)


def test_the_support_vector_line_ignores_outliers() -> None:
    rng = np.random.default_rng(2)
    straight = PolynomialMap(feature="current_a", valid_from=0.0, valid_to=1.0, coefficients=(0.05, 0.7))
    samples = samples_of(straight, rng)
    samples.slip[samples.current_a > 0.7] = -1.0
    steady = fit_support_vector_line(samples, "current_a").coefficients[1]
    pulled = fit_line(samples, "current_a").coefficients[1]
    assert abs(steady - 0.7) < 0.25 * abs(pulled - 0.7)


def test_traction_curve_is_recovered() -> None:
    truth = TractionMap(
        feature="wheel_torque_nm", valid_from=0.0, valid_to=1.0, greatest=0.9, slip_scale=0.25
    )
    found = fit_traction(samples_of(truth, np.random.default_rng(3)), "wheel_torque_nm")
    assert (found.greatest, found.slip_scale) == pytest.approx((0.9, 0.25), rel=0.05)


def test_monotone_map_follows_a_bent_curve() -> None:
    truth = TractionMap(
        feature="wheel_torque_nm", valid_from=0.0, valid_to=1.0, greatest=0.9, slip_scale=0.25
    )
    found = fit_monotone(samples_of(truth, np.random.default_rng(4)), "wheel_torque_nm")
    for value in np.linspace(0.1, 0.7, 20):
        assert slip_at(found, value) == pytest.approx(slip_at(truth, value), abs=0.02)


def test_surface_curves_are_recovered() -> None:
    rng = np.random.default_rng(5)
    runs = surface_runs("lawn", 0.6, 0.4, rng) + surface_runs("table", 0.1, 0.0, rng)
    lawn, table = fit_surface_map(runs, M_PER_PX).surfaces
    for direction in np.linspace(-3.0, 3.0, 13):
        assert lawn.slip.at(direction, 0.2) == pytest.approx(
            0.4 * (1 + 0.1 * math.cos(2 * direction)), abs=0.01
        )
        assert table.slip.at(direction, 0.2) == pytest.approx(0.0, abs=0.01)
    assert lawn.force_n.mean == pytest.approx(6 * table.force_n.mean, rel=0.05)


def test_a_surface_with_two_runs_is_refused() -> None:
    runs = surface_runs("lawn", 0.6, 0.4, np.random.default_rng(6), DIRECTIONS[:2])
    with pytest.raises(LogError, match="surface 'lawn' has 2 training runs"):
        fit_surface_map(runs, M_PER_PX)


def test_scores_are_the_error_over_the_encoder_distance() -> None:
    rng = np.random.default_rng(7)
    # The surface with more effort slips less: only a map that knows the surface can be right on both.
    runs = surface_runs("lawn", 0.5, 0.5, rng) + surface_runs("gravel", 0.7, 0.2, rng)
    runs += surface_runs("table", 0.1, 0.0, rng)
    errors = score_runs(fit_maps(runs, M_PER_PX), runs, M_PER_PX)
    lawn = [item for item in errors[ENCODER] if item.surface == "lawn"]
    assert Score.of(lawn).bias == pytest.approx(0.5, abs=0.01)
    assert Score.of(errors[ENCODER]).n == len(runs)
    assert Score.of(errors["linear_i"]).rms > 0.05
    assert Score.of(errors[BEST]).rms < 0.02
    assert Score.of(errors[BEST_KNOWN]).rms < 0.01
    assert Score.of(errors[BEST]).invalid < 0.05


def test_known_surface_skips_what_it_does_not_know() -> None:
    rng = np.random.default_rng(8)
    maps = fit_maps(
        surface_runs("a_surface", 0.5, 0.5, rng) + surface_runs("b_surface", 0.9, 0.2, rng), M_PER_PX
    )
    errors = score_runs(maps, surface_runs("c_surface", 0.7, 0.3, rng), M_PER_PX)
    assert (len(errors[BEST_KNOWN]), len(errors[BEST])) == (0, len(DIRECTIONS))
    assert Score.of(errors[BEST]).invalid > 0.9
    both = score_runs(maps, surface_runs("a_b", 0.7, 0.35, rng), M_PER_PX)
    assert Score.of(both[BEST_KNOWN]).rms < 0.06


def test_directions_outside_training_are_flagged() -> None:
    rng = np.random.default_rng(9)
    ahead = [direction for direction in DIRECTIONS if abs(direction) < 1.0]
    behind = [direction for direction in DIRECTIONS if abs(direction) > 2.0]
    maps = fit_maps(surface_runs("lawn", 0.5, 0.5, rng, ahead), M_PER_PX)
    errors = score_runs(maps, surface_runs("lawn", 0.5, 0.5, rng, behind), M_PER_PX)
    for name in (BEST, *maps.wheel_maps):
        assert Score.of(errors[name]).invalid == pytest.approx(1.0)


def test_runs_over_two_surfaces_are_not_trained_on() -> None:
    rng = np.random.default_rng(10)
    runs = surface_runs("a_surface", 0.5, 0.5, rng) + surface_runs("b_surface", 0.9, 0.2, rng)
    mixed = surface_runs("a_b", 0.7, 0.3, rng)
    calls: list[int] = []
    found = identify_slip_maps(runs + mixed, lambda: calls.append(1))
    assert (len(found.trained_on), len(found.left_out), len(calls)) == (len(runs), len(mixed), 6)
    assert len(found.cross_validation[BEST]) == len(runs)
    assert found.scale.mm_per_px is None


def table_runs(mm_per_px: float, slip_of_direction: float = 0.0) -> list[RunWindows]:
    """Return runs on the table as a camera of this scale sees them."""
    rng = np.random.default_rng(11)
    runs: list[RunWindows] = []
    for direction in DIRECTIONS:
        slip = slip_of_direction * math.cos(direction)
        run = windows(
            direction,
            "table_surface",
            slip=constant(slip),
            torque_nm=rng.uniform(0.1, 0.2, (9, 3)),
        )
        velocity = run.camera_velocity / np.array([mm_per_px / 1000.0, mm_per_px / 1000.0, 1.0])
        runs.append(dataclasses.replace(run, camera_velocity=velocity, camera_in_pixels=True))
    return runs


def test_an_error_of_scale_is_told_from_slip() -> None:
    scale = find_scale(table_runs(2.1))
    assert scale.mm_per_px == pytest.approx(2.1, rel=1e-3)
    assert scale.is_scale_error is True
    assert "SCALE ERROR" in scale.verdict
    slipping = find_scale(table_runs(2.1, slip_of_direction=0.15))
    assert slipping.is_scale_error is False
    assert "it is slip at least in part" in slipping.verdict
    right = find_scale(table_runs(NOMINAL_MM_PER_PX))
    assert right.is_scale_error is False
    assert "nominal scale holds" in right.verdict


def test_without_the_table_the_known_scale_is_taken_and_said() -> None:
    runs = [dataclasses.replace(run, surface="lawn") for run in table_runs(2.1)]
    scale = find_scale(runs)
    assert (scale.mm_per_px, scale.is_scale_error) == (SLIP_FIT.camera.calibrated_mm_per_px, None)
    assert "a scale error cannot be distinguished from slip" in scale.verdict


def test_a_camera_that_sees_no_motion_is_refused() -> None:
    runs = table_runs(2.0)
    runs[3] = dataclasses.replace(runs[3], camera_velocity=np.zeros_like(runs[3].camera_velocity))
    with pytest.raises(LogError, match="the camera sees no motion"):
        find_scale(runs)


def test_runs_of_one_effort_are_refused() -> None:
    run = windows(0.4, "a", slip=constant(0.1), torque_nm=np.full((40, 3), 0.5))
    with pytest.raises(LogError, match=r"all have a current_a of 0\.5"):
        collect_samples([run], M_PER_PX)


def test_a_missing_scikit_learn_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sklearn.svm", None)
    monkeypatch.setitem(sys.modules, "sklearn.isotonic", None)
    values = np.linspace(0.1, 0.9, 50)
    samples = WheelSamples(values, values, values, values)
    for fit in (fit_support_vector_line, fit_monotone):
        with pytest.raises(ConfigError, match=r"pip install rover-hil\[fit\]"):
            fit(samples, "current_a")
