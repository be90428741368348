import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import ModelError
from sim_backends.terramechanics.soil import skid_from_slip as skid
from sim_backends.terramechanics.soil import slip_skid_model as model
from sim_backends.terramechanics.soil.library import load_wheel

WHEELS = model.shipped_wheels()
LINES = [
    lines
    for wheel in WHEELS.values()
    for lines in (wheel.sinkage_mm, wheel.moment, wheel.drawbar_pull)
    if lines is not None
]


@pytest.mark.parametrize(
    ("name", "up_deg", "down_deg", "shearing_radius_mm"),
    [("Wh31", 18.2, -39.4, 168.6), ("Wh32", 16.3, -39.4, 163.85), ("Wh34", 10.2, -35.8, 157.35)],
)
def test_slopes_and_shearing_radius_of_the_paper(
    name: str, up_deg: float, down_deg: float, shearing_radius_mm: float
) -> None:
    slopes = np.degrees(model.slope_rad(WHEELS[name], [0.6, -1.0]))
    assert slopes == pytest.approx([up_deg, down_deg], abs=0.05)
    assert WHEELS[name].shearing_radius_m * 1000 == pytest.approx(shearing_radius_mm, rel=1e-9)


@pytest.mark.parametrize(
    ("name", "moment_rms_nm", "pull_rms_n"), [("Wh31", 0.83, 3.1), ("Wh32", 0.33, 2.3), ("Wh34", 1.44, 9.1)]
)
def test_skid_from_slip_misses_the_skid_lines_by_what_the_docstring_says(
    name: str, moment_rms_nm: float, pull_rms_n: float
) -> None:
    wheel, slip = WHEELS[name], np.linspace(-1, 0, 2001)
    moment = skid.resistance_moment_in_skid_nm(wheel, slip) - model.resistance_moment_nm(wheel, slip)
    pull = skid.drawbar_pull_in_skid_n(wheel, slip) - model.drawbar_pull_n(wheel, slip)
    assert np.sqrt(np.mean(moment**2)) == pytest.approx(moment_rms_nm, abs=0.006)
    assert np.sqrt(np.mean(pull**2)) == pytest.approx(pull_rms_n, abs=0.06)


def test_transitions_are_close_to_the_tables_but_not_the_tables() -> None:
    # Tables III to V print these; they are rounded from data, off by up to 0.012.
    printed = {"Wh31": (-0.35, 0.16, -0.13, 0.12, -0.15, 0.11), "Wh34": (-0.27, 0, -0.14, 0.14, -0.18, 0.12)}
    worst = 0.0
    for name, numbers in printed.items():
        wheel = WHEELS[name]
        assert wheel.sinkage_mm is not None
        lines = (wheel.sinkage_mm, wheel.moment, wheel.drawbar_pull)
        ours = [at for three in lines for at in (three.skid_transition, three.slip_transition)]
        worst = max(worst, float(np.max(np.abs(np.subtract(ours, numbers)))))
    assert 0.008 < worst < 0.0125


@pytest.mark.parametrize("lines", LINES)
def test_the_pieces_join(lines: model.ThreeLines) -> None:
    for corner in (lines.skid_transition, lines.slip_transition):
        around = lines.at([corner - 1e-9, corner, corner + 1e-9])
        assert np.ptp(around) < 1e-6


@pytest.mark.parametrize("name", WHEELS)
def test_slip_and_skid_meet_at_zero(name: str) -> None:
    wheel = WHEELS[name]
    assert skid.resistance_moment_in_skid_nm(wheel, 0.0) == pytest.approx(
        model.resistance_moment_nm(wheel, 0.0)
    )
    assert skid.resistance_coefficient_in_skid(wheel, 0.0) == pytest.approx(wheel.resistance.at(0.0))
    assert model.drawbar_pull_n(wheel, 0.0) == pytest.approx(0.0, abs=1e-12)


def test_resistance_is_positive_in_skid_as_in_slip() -> None:
    wheel = WHEELS["Wh31"]
    assert wheel.resistance.at([-0.6, 0.0, 0.6]) == pytest.approx([0.2506, 0.1, 0.2458])
    assert skid.resistance_coefficient_in_skid(wheel, -0.6) == pytest.approx(0.2458)


def test_the_smooth_wheel_sinks_by_table_three() -> None:
    assert model.sinkage_m(WHEELS["Wh34"], [-1.0, 0.0, 0.6]) == pytest.approx([0.0238, 0.0067, 0.01844])
    with pytest.raises(ModelError, match="no sinkage lines"):
        model.sinkage_m(WHEELS["Wh32"], 0.0)


@given(st.sampled_from(sorted(WHEELS)), st.floats(-39, 39))
def test_the_slip_on_a_slope_gives_that_slope(name: str, slope_deg: float) -> None:
    wheel, slope = WHEELS[name], math.radians(slope_deg)
    slip = model.slip_ratio_on_slope(wheel, slope)
    if slip is None:
        steepest = model.slope_rad(wheel, [1.0, -1.0])
        assert not steepest[1] <= slope <= steepest[0]
    else:
        assert float(model.slope_rad(wheel, slip)) == pytest.approx(slope, abs=1e-9)
        assert slip * slope >= 0


@pytest.mark.parametrize("slip", [float("nan"), 1.01, -1.5])
def test_slips_outside_the_definition_are_refused(slip: float) -> None:
    with pytest.raises(ModelError, match="slip_ratio"):
        model.drawbar_pull_n(WHEELS["Wh31"], [0.1, slip])


@pytest.mark.parametrize("load", [0.0, -5.0, float("nan")])
def test_loads_that_are_none_are_refused(load: float) -> None:
    with pytest.raises(ModelError, match=re.escape("normal_force_n")):
        model.drawbar_pull_n(WHEELS["Wh31"], 0.1, load)


def test_skid_laws_refuse_slip_and_degrees() -> None:
    with pytest.raises(ModelError, match="between -1 and 0"):
        skid.drawbar_pull_in_skid_n(WHEELS["Wh31"], 0.2)
    with pytest.raises(ModelError, match="slope_angle_rad"):
        model.slip_ratio_on_slope(WHEELS["Wh31"], 20.0)


@pytest.mark.parametrize("name", WHEELS)
def test_the_library_has_the_same_wheels(name: str) -> None:
    entry = load_wheel(name.lower())
    wheel = WHEELS[name]
    assert (entry.radius_m, entry.width_m) == (wheel.radius_m, wheel.width_m)
    assert (entry.lug_height_m, entry.shearing_share) == (wheel.lug_height_m, wheel.shearing_fraction)
