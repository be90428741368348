import itertools
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.errors import ConfigError
from rover_hil.gap.data.observed_model import ObservedModel
from rover_hil.gap.data.readers.side_slope import path_bend_deg_m, read_side_slope
from sim_backends.models.interface import EffectCard, Model, Run
from sim_backends.models.side_slope import states
from sim_backends.models.side_slope.model import BEND, EFFECTS, SideSlope, make_model
from sim_backends.terramechanics.slope.load_transfer import Demand, demand
from tests.nature.side_slope import Experiment, Nature, Sites, some_nature, travel, write

AT_ONCE = {"start_length_m": 0.005}
"""Slip builds up at once, so that the way that counts is all steady."""
NAMES = (
    "slope_failure",
    "friction_angle",
    "shear_modulus",
    "sinkage_modulus",
    "cog_offset",
    "heading_drift",
    "heading_offset",
    "camera_yaw",
    "grouser_radius",
    "slip_sinkage",
    "wheel_radius",
)
PATH_CHANNELS = ("slip", "slip_angle_deg", BEND)
BODY_CHANNELS = ("sinkage_up_mm", "sinkage_down_mm", "torque_up_Nm", "torque_down_Nm")


@pytest.fixture(scope="module")
def model() -> SideSlope:
    return make_model()


def site(slope: float, roll: float, mass: float = 23.8) -> Run:
    return Run(name="one", conditions={"slope_deg": slope, "roll_deg": roll, "mass_kg": mass})


def predict(
    model: SideSlope, run: Run, effects: Mapping[str, Mapping[str, float]] | None = None
) -> dict[str, float]:
    table = model.predict([run], AT_ONCE, effects or {})[0]
    return {name: float(values[0]) for name, values in table.items()}


def change(model: SideSlope, run: Run, effect: str, **parameters: float) -> dict[str, float]:
    before, after = predict(model, run), predict(model, run, {effect: parameters})
    return {name: after[name] - before[name] for name in before}


def test_model_offers_the_cards_by_name(model: SideSlope) -> None:
    offered: Model = model
    assert set(NAMES) <= {card.name for card in offered.effects}
    for card in EFFECTS:
        assert card.sentence.endswith(".")
        assert card.experiment
        assert card.source
        assert card.claims


@pytest.mark.parametrize(
    ("slope", "roll", "slip", "angle"),
    [(10, 0, 0.0695, -6.289), (10, 20, 0.0364, 3.625), (15, 5, 0.0677, -6.220), (15, 15, 0.0, 0.0)],
)
def test_base_is_the_table_of_the_paper(
    model: SideSlope, slope: float, roll: float, slip: float, angle: float
) -> None:
    found = predict(model, site(slope, roll))
    assert found["slip"] == pytest.approx(slip, abs=1e-4)
    assert found["slip_angle_deg"] == pytest.approx(angle, abs=2e-3)
    assert found[BEND] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("card", EFFECTS, ids=lambda card: card.name)
def test_strength_at_its_null_changes_nothing_whatever_the_shapes(model: SideSlope, card: EffectCard) -> None:
    run = site(15.0, 5.0, 33.8)
    before = predict(model, run)
    strength, *shapes = card.parameters
    grid = itertools.product(*(card.shape_grid.get(item.name, (item.nominal,)) for item in shapes))
    for values in grid:
        null = {strength.name: strength.nominal}
        null |= {item.name: value for item, value in zip(shapes, values, strict=True)}
        assert predict(model, run, {card.name: null}) == pytest.approx(before, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("card", EFFECTS, ids=lambda card: card.name)
def test_natural_size_shows_and_stays_inside_bounds(model: SideSlope, card: EffectCard) -> None:
    strength = card.parameters[0]
    assert strength.lower <= strength.nominal < strength.nominal + strength.prior_sd < strength.upper
    changed = change(model, site(20.0, 0.0), card.name, **{strength.name: strength.prior_sd})
    assert max(map(abs, changed.values())) > 1e-3
    for item in card.parameters:
        for value in card.shape_grid.get(item.name, ()):
            assert item.lower <= value <= item.upper


def test_sign_rules() -> None:
    lowers = {card.name: card.parameters[0].lower for card in EFFECTS}
    for name in ("slope_failure", "grouser_radius", "slip_sinkage", "sidewall"):
        assert lowers[name] == 0.0
    released = {card.name: card.releases for card in EFFECTS}
    own = {item.name for item in make_model().parameters}
    assert released["friction_angle"] in own
    assert released["slope_failure"] is None


@pytest.mark.parametrize("roll", [0.0, 15.0, 20.0])
def test_failing_slope_carries_the_rover_downhill_whatever_its_roll(model: SideSlope, roll: float) -> None:
    steep = change(model, site(15.0, roll), "slope_failure", gain=0.3, onset=10.0)
    steeper = change(model, site(20.0, roll), "slope_failure", gain=0.3, onset=10.0)
    flat = change(model, site(10.0, roll), "slope_failure", gain=0.3, onset=10.0)
    assert steeper["slip_angle_deg"] < steep["slip_angle_deg"] < -0.5
    assert all(flat[name] == 0.0 for name in flat)
    assert all(steep[name] == 0.0 for name in BODY_CHANNELS)


@pytest.mark.parametrize(
    "name", ["friction_angle", "shear_modulus", "sinkage_modulus", "slip_sinkage", "sidewall"]
)
def test_soil_leaves_the_slip_angle_at_zero_where_roll_equals_slope(model: SideSlope, name: str) -> None:
    strength = {card.name: card.parameters[0] for card in EFFECTS}[name]
    changed = change(model, site(15.0, 15.0), name, **{strength.name: strength.prior_sd})
    assert changed["slip_angle_deg"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("slope", "roll"), [(10.0, 10.0), (20.0, 0.0), (15.0, 20.0)])
def test_turned_camera_turns_every_path_alike(model: SideSlope, slope: float, roll: float) -> None:
    changed = change(model, site(slope, roll), "camera_yaw", offset=2.0)
    assert changed["slip_angle_deg"] == pytest.approx(2.0, abs=1e-9)
    assert all(changed[name] == 0.0 for name in BODY_CHANNELS)
    kept = change(model, site(slope, roll), "camera_yaw", offset=2.0, slip_share=0.0)
    assert kept["slip"] == 0.0


def test_camera_keeps_the_speed_of_the_body(model: SideSlope) -> None:
    run = site(20.0, 0.0)
    speeds = []
    for offset in (0.0, 5.0):
        found = predict(model, run, {"camera_yaw": {"offset": offset}})
        speeds.append((1.0 - found["slip"]) / math.cos(math.radians(found["slip_angle_deg"])))
    assert speeds[1] == pytest.approx(speeds[0], rel=1e-12)


def test_heading_downhill_lets_the_weight_pull(model: SideSlope) -> None:
    changed = change(model, site(20.0, 0.0), "heading_offset", offset=-3.0)
    assert changed["torque_up_Nm"] < -0.02
    assert changed["torque_down_Nm"] < -0.02
    assert changed["slip_angle_deg"] < -1.5
    creep = change(model, site(20.0, 0.0), "heading_offset", offset=-3.0, body_share=0.0)
    assert all(creep[name] == 0.0 for name in (*BODY_CHANNELS, "slip"))


def test_drift_bends_the_path_and_grows_with_slope_and_load(model: SideSlope) -> None:
    shapes = {"slope_exponent": 1.0, "load_exponent": 2.0}
    gentle = change(model, site(10.0, 10.0), "heading_drift", rate=-3.0, **shapes)
    steep = change(model, site(20.0, 20.0), "heading_drift", rate=-3.0, **shapes)
    heavy = change(model, site(20.0, 20.0, 33.8), "heading_drift", rate=-3.0, **shapes)
    assert heavy[BEND] < steep[BEND] < gentle[BEND] < 0.0
    assert steep[BEND] == pytest.approx(-3.0, rel=0.1)
    assert steep["slip_angle_deg"] == pytest.approx(0.65 * steep[BEND], rel=1e-9)
    assert heavy[BEND] / steep[BEND] == pytest.approx((33.8 / 23.8) ** 2, rel=0.05)


def test_radii_shift_slip_nearly_alike_everywhere(model: SideSlope) -> None:
    for name, parameter in (("wheel_radius", "change"), ("grouser_radius", "excess")):
        shifts = [
            change(model, site(*at), name, **{parameter: 0.002})["slip"]
            for at in ((10, 0), (20, 5), (15, 20))
        ]
        assert max(shifts) < -0.01
        assert np.ptp(shifts) < 0.006


def test_slip_sinkage_needs_slip(model: SideSlope) -> None:
    still = change(model, site(15.0, 15.0), "slip_sinkage", depth_per_slip=0.03)
    slipping = change(model, site(20.0, 0.0), "slip_sinkage", depth_per_slip=0.03)
    assert still["sinkage_down_mm"] == pytest.approx(0.0, abs=1e-6)
    assert slipping["sinkage_down_mm"] > 2.0


def test_centre_of_gravity_shifts_load_between_sides(model: SideSlope) -> None:
    uphill = change(model, site(10.0, 0.0), "cog_offset", offset=0.02)
    assert uphill["sinkage_up_mm"] > 0.2 > -0.2 > uphill["sinkage_down_mm"]
    raised = change(model, site(20.0, 0.0), "cog_offset", offset=0.03, direction=90.0)
    assert raised["sinkage_up_mm"] < -0.2 < 0.2 < raised["sinkage_down_mm"]


def test_start_of_the_rover_bends_its_path(model: SideSlope) -> None:
    run = site(20.0, 0.0)
    slow = model.predict([run], {"start_length_m": 0.12}, {})[0]
    steady = model.predict([run], AT_ONCE, {})[0]
    assert -2.5 < slow[BEND][0] < -0.7
    assert abs(steady[BEND][0]) < 1e-6
    assert abs(slow["slip_angle_deg"][0]) < abs(steady["slip_angle_deg"][0])


def test_replicates_share_one_solution(monkeypatch: pytest.MonkeyPatch) -> None:
    solved = []

    def note(*arguments: Any) -> Demand:
        solved.append(arguments)
        return demand(*arguments)

    monkeypatch.setattr(states, "demand", note)
    fresh = make_model()
    fresh.predict(
        [site(15.0, 5.0), site(15.0, 5.0), site(15.0, 5.0, 33.8)], {}, {"camera_yaw": {"offset": 1.0}}
    )
    assert len(solved) == 2


def test_no_steady_state_is_not_a_number(model: SideSlope) -> None:
    assert math.isnan(predict(model, site(40.0, 0.0))["slip"])


def test_nature_agrees_where_nothing_is_hidden(model: SideSlope) -> None:
    sites = Sites(np.array([10.0, 20.0, 15.0]), np.array([0.0, 5.0, 20.0]), np.array([23.8, 33.8, 23.8]))
    found = travel(Nature(), sites)
    for index, (slope, roll, mass) in enumerate(zip(sites.slope, sites.roll, sites.mass, strict=True)):
        expected = predict(model, site(slope, roll, mass))
        angle = math.degrees(math.atan2(found.aside[index], found.ahead[index]))
        assert 1.0 - found.ahead[index] == pytest.approx(expected["slip"], abs=1e-3)
        assert angle == pytest.approx(expected["slip_angle_deg"], abs=0.05)
        assert 1000.0 * found.sinkage[index] == pytest.approx(
            [expected["sinkage_up_mm"], expected["sinkage_down_mm"]], abs=0.1
        )
        assert found.torque[index] == pytest.approx(
            [expected["torque_up_Nm"], expected["torque_down_Nm"]], abs=0.01
        )


def test_reader_takes_both_files(model: SideSlope, tmp_path: Path) -> None:
    experiment = Experiment(conditions=((15.0, 23.8),), rolls=(0.0, 20.0), replicates=2)
    rng = np.random.default_rng(3)
    write(tmp_path, some_nature(rng, drift=-6.0), experiment, rng)
    runs = read_side_slope(tmp_path)
    assert [run.name for run in runs] == ["c1_p0_r1", "c1_p0_r2", "c1_p20_r1", "c1_p20_r2"]
    assert runs[2].conditions["roll_deg"] == 20.0
    assert runs[2].conditions["rep"] == 1.0
    assert set(runs[0].measured) == {*PATH_CHANNELS, *BODY_CHANNELS}
    assert np.mean([run.measured[BEND][0] for run in runs]) < -2.0
    (tmp_path / "paths.csv").unlink()
    runs = read_side_slope(tmp_path)
    assert BEND not in runs[0].measured
    assert BEND not in {channel.name for channel in ObservedModel(model, runs).channels}


def test_reader_says_what_is_wrong(model: SideSlope, tmp_path: Path) -> None:
    summary = tmp_path / "summary.csv"
    with pytest.raises(ConfigError, match="cannot read"):
        read_side_slope(tmp_path)
    summary.write_text("run,slope_deg,roll_deg,slip\na,10,0,0.1\n")
    with pytest.raises(ConfigError, match="no column 'mass_kg'"):
        read_side_slope(tmp_path)
    summary.write_text("run,slope_deg,roll_deg,mass_kg,slip\na,10,0,23.8,much\n")
    with pytest.raises(ConfigError, match="line 2, column 'slip': 'much' is not a number"):
        read_side_slope(tmp_path)


def test_bend_of_an_arc() -> None:
    x = np.linspace(0.0, 1000.0, 100)
    straight = np.stack([x / 20.0, x, -0.3 * x], axis=1)
    assert path_bend_deg_m(straight) == pytest.approx(0.0, abs=1e-9)
    radius = 20_000.0
    arc = np.stack([x / 20.0, x, -(radius - np.sqrt(radius**2 - x**2))], axis=1)
    assert path_bend_deg_m(arc) == pytest.approx(-math.degrees(1000.0 / radius), rel=0.01)
    assert math.isnan(path_bend_deg_m(straight[:5]))


def test_states_do_not_depend_on_what_was_solved_before(model: SideSlope) -> None:
    rng = np.random.default_rng(4)
    runs = [site(20.0, 20.0), site(15.0, 10.0), site(10.0, 20.0, 33.8)]
    for _ in range(12):
        base = {
            "friction_angle_deg": 38.0 + float(rng.normal()),
            "heading_deg": float(rng.normal()),
            "cog_lateral_m": 0.01 * float(rng.normal()),
            "wheel_radius_m": 0.097 + 0.001 * float(rng.normal()),
        }
        effects = {"slip_sinkage": {"depth_per_slip": 0.02}} if rng.random() < 0.5 else {}
        warm, cold = model.predict(runs, base, effects), make_model().predict(runs, base, effects)
        for one, other in zip(warm, cold, strict=True):
            for name, values in one.items():
                assert values[0] == pytest.approx(other[name][0], rel=1e-7, abs=1e-9), name
