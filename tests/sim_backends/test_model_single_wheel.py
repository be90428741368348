from pathlib import Path

import numpy as np
import pytest

from drivers.errors import ConfigError
from rover_hil.gap.data.readers.single_wheel import FILE, read_single_wheel
from sim_backends.models.interface import EffectCard, Model, Run
from sim_backends.models.single_wheel.model import EFFECTS, SingleWheel, make_model
from sim_backends.terramechanics.soil.any_angle_wheel import Motion, any_angle_at_load, load_any_angle_soil
from sim_backends.terramechanics.soil.library import load_wheel

ROLLING = (20.0, 10.0, 0.0, 23.0)
SKIDDING = (3.0, 10.0, 45.0, 22.0)
SLIDING = (10.0, 10.0, 90.0, 17.0)


def trial(rim: float, travel: float, angle: float, load: float) -> Run:
    conditions = {"rim_speed_mm_s": rim, "travel_speed_mm_s": travel, "slip_angle_deg": angle, "load_N": load}
    return Run(name="one", conditions=conditions)


def predict(model: SingleWheel, run: Run, effect: str = "", **parameters: float) -> dict[str, float]:
    table = model.predict([run], {}, {effect: parameters} if effect else {})[0]
    return {name: float(values[0]) for name, values in table.items()}


@pytest.mark.parametrize("at", [ROLLING, SKIDDING, SLIDING])
def test_base_is_the_blind_wheel(at: tuple[float, float, float, float]) -> None:
    model: Model = make_model()
    rim, travel, angle, load = at
    side = travel * np.sin(np.radians(angle))
    motion = Motion(
        np.array([rim]), np.array([max(travel * np.cos(np.radians(angle)), 0.0)]), np.array([side])
    )
    sinkage, forces = any_angle_at_load(
        load_wheel("cmu_smooth"), load_any_angle_soil("cmu_sand_blind"), motion, np.array([load])
    )
    found = model.predict([trial(*at)], {}, {})[0]
    assert found["drawbar_N"] == pytest.approx(forces.drawbar_n, abs=1e-6)
    assert found["side_N"] == pytest.approx(-forces.side_n, abs=1e-6)
    assert found["sinkage_mm"] == pytest.approx(1000.0 * sinkage, abs=1e-6)


@pytest.mark.parametrize("card", EFFECTS, ids=lambda card: card.name)
def test_null_changes_nothing_and_natural_size_something(card: EffectCard) -> None:
    model = make_model()
    strength = card.parameters[0]
    changes = []
    for at in (ROLLING, SKIDDING, SLIDING):
        before = predict(model, trial(*at))
        assert predict(model, trial(*at), card.name, **{strength.name: strength.nominal}) == pytest.approx(
            before, rel=1e-12
        )
        after = predict(model, trial(*at), card.name, **{strength.name: strength.prior_sd})
        changes += [abs(after[name] - before[name]) for name in before]
    assert max(changes) > 0.01


def test_lugs_pull_where_the_wheel_slips() -> None:
    model = make_model()
    for height in (0.002, 0.005):
        lugged = predict(model, trial(*ROLLING), "lugs", height=height)
        assert lugged["drawbar_N"] > predict(model, trial(*ROLLING))["drawbar_N"] + 0.2


def test_slip_sinkage_needs_slip() -> None:
    model = make_model()
    skidding, rolling = (predict(model, trial(*at)) for at in (SKIDDING, ROLLING))
    dug = {"depth_per_slip": 0.01}
    assert predict(model, trial(*SKIDDING), "slip_sinkage", **dug) == skidding
    found = predict(model, trial(*ROLLING), "slip_sinkage", **dug)
    assert found["sinkage_mm"] == pytest.approx(rolling["sinkage_mm"] + 10.0 * 0.5)
    assert found["drawbar_N"] == rolling["drawbar_N"]


def test_flow_and_yaw_of_the_rig_are_told_apart_straight_ahead() -> None:
    model = make_model()
    straight = predict(model, trial(*ROLLING))
    assert predict(model, trial(*ROLLING), "trench_flow", share=0.4) == straight
    turned = predict(model, trial(*ROLLING), "rig_yaw", offset=2.0)
    other = predict(model, trial(*ROLLING), "rig_yaw", offset=-2.0)
    assert turned["side_N"] == pytest.approx(-other["side_N"], rel=1e-9)
    assert turned["side_N"] > 0.1


def test_pushed_soil_holds_a_dragged_wheel() -> None:
    model = make_model()
    dragged = trial(3.0, 10.0, 0.0, 20.0)
    assert (
        predict(model, dragged, "pushed_soil", change=10.0)["drawbar_N"]
        < predict(model, dragged)["drawbar_N"]
    )


def test_too_great_a_load_is_not_a_number() -> None:
    assert np.isnan(predict(make_model(), trial(20.0, 10.0, 0.0, 50_000.0))["sinkage_mm"])


def test_reader_groups_the_trials_of_the_test_bed(shared_data: Path) -> None:
    runs = read_single_wheel(shared_data / "cmu_single_wheel")
    assert len(runs) == 189
    keys = {tuple(run.conditions.values()) for run in runs}
    assert len(keys) == 63
    assert len({run.name for run in runs}) == 189


def test_reader_brings_forces_to_the_load_of_the_group(tmp_path: Path) -> None:
    head = "beta_deg,Vry_cmd_mm_s,V_mm_s,r_omega_mm_s,Fx_tractive_N,Fy_lateral_N,Fz_load_N,sinkage_mm\n"
    (tmp_path / FILE).write_text(head + "15,8,10,8,-9,6,18,20\n15,8,10,8,-11,8,22,21\n")
    one, other = read_single_wheel(tmp_path)
    assert one.conditions == other.conditions
    assert one.conditions["load_N"] == 20.0
    assert one.measured["drawbar_N"] == pytest.approx([-10.0])
    assert other.measured["side_N"] == pytest.approx([8.0 * 20.0 / 22.0])
    (tmp_path / FILE).write_text(head.replace("Fz_load_N,", "") + "15,8,10,8,-9,6,20\n")
    with pytest.raises(ConfigError, match="no column 'Fz_load_N'"):
        read_single_wheel(tmp_path)
