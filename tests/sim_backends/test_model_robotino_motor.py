from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from drivers.errors import ConfigError
from rover_hil.config import load_config
from rover_hil.drives.drive import Drive
from rover_hil.gap.data.observed_model import ObservedModel
from rover_hil.gap.data.readers.robotino_motor import motor_runs_of_log, read_motor_runs
from rover_hil.gap.workflow import analyse
from sim_backends.models.interface import Array, DrivenModel, Run, Values
from sim_backends.models.robotino_motor.model import (
    CURRENT_STEP_A,
    PARAMETERS,
    SPEED_STEP_RAD_S,
    RobotinoMotor,
    make_model,
)
from tests.nature.motor import TrueMotor, measure, staircase, write_csv
from tests.sim_backends.model_contract import (
    assert_cards_are_whole,
    assert_effects_act,
    assert_nulls_change_nothing,
)

PERIOD_S = 0.03
BASE = {item.name: item.nominal for item in PARAMETERS}
COULOMB: Values = {"torque": 0.009}
VISCOUS: Values = {"per_speed": 2e-5}


def loop_run(set_points: np.ndarray, *, others_a: float = 0.0, integral: float = 0.0) -> Run:
    t_s = PERIOD_S * np.arange(set_points.size)
    inputs = {"t_s": t_s, "set_point_rad_s": set_points, "others_current_a": np.full(t_s.size, others_a)}
    return Run(name="loop", conditions={"integral": integral}, inputs=inputs)


def voltage_run(volts: float, *, rows: int = 400) -> Run:
    t_s = PERIOD_S * np.arange(rows)
    inputs = {"t_s": t_s, "voltage_v": np.full(rows, volts), "others_current_a": np.zeros(rows)}
    return Run(name="voltage", conditions={"integral": 0.0}, inputs=inputs)


def last(run: Run, effects: dict[str, Values]) -> tuple[float, float]:
    table = make_model().predict([run], {}, effects)[0]
    return float(table["speed_rad_s"][-1]), float(table["current_a"][-1])


def changing_run() -> Run:
    steps = np.repeat([40.0, 0.0, -90.0, 15.0, -5.0], 60)
    slow = 100.0 * np.sin(np.arange(300) / 15.0)
    return loop_run(np.concatenate((steps, slow)), others_a=0.4)


def test_cards() -> None:
    model = make_model()
    assert isinstance(model, DrivenModel)
    assert_cards_are_whole(model)
    assert_nulls_change_nothing(model, [changing_run(), voltage_run(5.0)])
    assert_effects_act(model, [changing_run(), voltage_run(5.0)])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_steady_speed_and_current_in_the_loop(sign: float) -> None:
    base = BASE
    speed, current = last(
        loop_run(np.full(100, sign * 100.0)), {"coulomb_friction": COULOMB, "viscous_friction": VISCOUS}
    )
    brake = 0.009 + 2e-5 * abs(speed)
    pull = brake / base["motor_constant_v_s_rad"]
    stiffness = base["stiffness_v_s_rad"]
    asked = (base["feed_forward_v_s_rad"] + stiffness) * 100.0 - base["resistance_ohm"] * pull
    assert sign * speed == pytest.approx(asked / (stiffness + base["motor_constant_v_s_rad"]), rel=1e-6)
    assert sign * current == pytest.approx(pull, rel=1e-3)


def test_a_motor_on_a_voltage_turns_at_its_constant() -> None:
    speed, current = last(voltage_run(5.08), {})
    assert speed == pytest.approx(100.0, rel=1e-6)
    assert current == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("volts", "turns"), [(0.9, False), (1.2, True)])
def test_dry_friction_holds_the_motor_at_rest(volts: float, turns: bool) -> None:
    # Breakaway at R Tc / Km = 5.6 * 0.009 / 0.0508 = 0.992 V.
    speed, _ = last(voltage_run(volts), {"coulomb_friction": COULOMB})
    assert (speed > 0.0) is turns


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("coulomb_friction", COULOMB),
        ("viscous_friction", VISCOUS),
        ("stribeck_friction", {"excess": 0.005, "speed": 40.0}),
    ],
)
def test_friction_brakes_both_ways(name: str, values: Values) -> None:
    ahead, pull = last(loop_run(np.full(100, 40.0)), {name: values})
    back, push = last(loop_run(np.full(100, -40.0)), {name: values})
    free, _ = last(loop_run(np.full(100, 40.0)), {})
    assert ahead == pytest.approx(-back)
    assert pull == pytest.approx(-push)
    assert 0.0 < ahead < free


def test_stribeck_is_gone_at_high_speed() -> None:
    excess: dict[str, Values] = {"stribeck_friction": {"excess": 0.005, "speed": 10.0}}
    _, slow = last(loop_run(np.full(100, 8.0)), excess)
    _, fast = last(loop_run(np.full(100, 150.0)), excess)
    assert slow > 0.02
    assert fast < 1e-6


def test_asymmetric_friction_brakes_one_way() -> None:
    effect = {"coulomb_friction": COULOMB, "asymmetric_friction": {"excess": 0.003}}
    _, ahead = last(loop_run(np.full(100, 50.0)), effect)
    _, back = last(loop_run(np.full(100, -50.0)), effect)
    assert ahead + back == pytest.approx(0.003 / 0.0508, rel=1e-3)
    assert back == pytest.approx(-0.009 / 0.0508, rel=1e-3)


def test_a_delay_moves_the_answer_as_far_as_it_is_long() -> None:
    run = loop_run(np.concatenate((np.zeros(50), np.full(50, 50.0))))
    model = make_model()
    prompt = model.predict([run], {}, {})[0]["speed_rad_s"]
    late = model.predict([run], {}, {"loop_delay": {"time": 4 * PERIOD_S}})[0]["speed_rad_s"]
    assert late[54:] == pytest.approx(prompt[50:-4], abs=1e-6)
    assert not late[:53].any()


def test_a_motor_driven_by_all_of_the_supply_comes_to_its_set_point() -> None:
    # A stiff loop asks for more than the supply on the way; within one step it must not oscillate.
    base = {"wait_share": 0.3, "stiffness_v_s_rad": 1.0}
    speed = make_model().predict([loop_run(np.full(60, 100.0))], base, {})[0]["speed_rad_s"]
    assert speed[2:] == pytest.approx(100.0, rel=0.01)


def test_an_offset_of_the_current_shows_at_rest() -> None:
    model, run = make_model(), loop_run(np.zeros(40))
    run = replace(run, conditions={**run.conditions, "is_unsigned": 1.0})
    above, below = (
        model.predict([run], {}, {"current_offset": {"offset": offset}})[0]["current_a"]
        for offset in (0.05, -0.05)
    )
    assert above == pytest.approx(np.full(40, 0.05))
    assert not below.any()


def test_heat_takes_current_away_where_the_voltage_is_given() -> None:
    model, run = make_model(), voltage_run(12.0, rows=8000)
    effects = {"coulomb_friction": {"torque": 0.05}}
    warm = {**effects, "winding_heat": {"per_watt": 10.0, "time": 30.0}}
    cold_speed = model.predict([run], {}, effects)[0]["speed_rad_s"]
    warm_speed = model.predict([run], {}, warm)[0]["speed_rad_s"]
    assert warm_speed[20] == pytest.approx(cold_speed[20], rel=0.01)
    # The friction sets the current: 0.984 A and 5.42 W heat by 54 K (and more, for what they add): R + 23 %.
    lost_v = 0.05 / 0.0508 * 5.6 * 0.0039 * 10.0 * 5.6 * (0.05 / 0.0508) ** 2 * 1.27
    assert cold_speed[-1] - warm_speed[-1] == pytest.approx(lost_v / 0.0508, rel=0.03)


def test_sag_follows_the_current_of_the_other_motors() -> None:
    sag: dict[str, Values] = {"battery_sag": {"per_amp": 1.0}}
    free, _ = last(loop_run(np.full(100, 100.0)), sag)
    loaded, _ = last(loop_run(np.full(100, 100.0), others_a=3.0), sag)
    assert loaded < free


def test_readings_are_cut_to_whole_steps_on_average() -> None:
    run = loop_run(np.full(100, 100.0))
    labels = {**run.conditions, "is_unsigned": 1.0, "current_step_a": CURRENT_STEP_A}
    back = Run(name="b", conditions=labels, inputs={**run.inputs, "set_point_rad_s": np.full(100, -100.0)})
    _, whole = last(run, {"coulomb_friction": COULOMB})
    _, told = last(back, {"coulomb_friction": COULOMB})
    assert told == pytest.approx(whole - CURRENT_STEP_A / 2, abs=1e-4)


def test_reads_the_measured_records(shared_data: Path) -> None:
    runs = read_motor_runs(shared_data / "robotino_2023" / "motor_identification")
    assert len(runs) == 6
    assert sorted(run.conditions["integral"] for run in runs) == [0.0] * 3 + [1.0] * 3
    assert {run.measured["speed_rad_s"].size for run in runs} == {2294, 2291}
    assert max(run.measured["current_a"].max() for run in runs) == pytest.approx(1.05, abs=0.01)
    assert "voltage_v" not in ObservedModel(RobotinoMotor(), runs).input_units


def test_reads_a_table_with_voltages(tmp_path: Path) -> None:
    rows = [f"{name},{0.1 * i},{i % 7},{i},{0.1}" for name in ("one", "two") for i in range(40)]
    head = "run,t_s,voltage_v [V],speed_rad_s,current_a"
    (tmp_path / "motor.csv").write_text("\n".join([head, *rows]))
    runs = read_motor_runs(tmp_path / "motor.csv")
    assert [run.name for run in runs] == ["one", "two"]
    assert runs[1].inputs["voltage_v"].tolist() == [float(i % 7) for i in range(40)]
    assert list(ObservedModel(RobotinoMotor(), runs).input_units) == ["t_s", "voltage_v", "others_current_a"]


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("t_s,speed_rad_s,current_a\n0,1,1\n1,1,1\n", "set_point_rad_s"),
        ("t_s,set_point_rad_s,speed_rad_s,current_a\n0,1,1,1\n0,1,1,1\n", "time"),
        ("t_s,set_point_rad_s,speed_rad_s,current_a\n0,1,1,x\n", "is not a number"),
        ("t_s,set_point_rad_s,speed_rad_s,current_a\n0,1,1\n", "cells"),
        ("nothing here\n", "not a table"),
    ],
)
def test_wrong_tables_are_refused(tmp_path: Path, text: str, wrong: str) -> None:
    (tmp_path / "motor.csv").write_text(text)
    with pytest.raises(ConfigError, match=wrong):
        read_motor_runs(tmp_path)


def test_a_log_makes_one_run_per_wheel() -> None:
    count = 40
    columns: dict[str, Array] = {"t_s": np.linspace(0.0, 3.9, count)}
    for wheel in (1, 2):
        columns |= {
            f"set{wheel}_rad_s": np.full(count, 2.0),
            f"speed{wheel}_rad_s": np.full(count, 1.9),
            f"current{wheel}_a": np.full(count, 0.3 * wheel),
        }
    drive = SimpleNamespace(
        name="drive",
        config=load_config("robotino"),
        clock="speed1_rad_s",
        channels=columns,
        table=lambda names, outside: columns,
    )
    runs = motor_runs_of_log(cast("Drive", drive))
    assert [run.name for run in runs] == ["drive wheel 1", "drive wheel 2"]
    assert runs[0].inputs["set_point_rad_s"][0] == pytest.approx(32.0)
    assert runs[0].inputs["others_current_a"][0] == pytest.approx(0.6)
    assert runs[0].conditions["speed_step_rad_s"] == pytest.approx(SPEED_STEP_RAD_S, rel=1e-3)


@pytest.mark.nightly
def test_friction_and_delay_are_named_in_records_of_another_simulator(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    motor = TrueMotor(supply_v=34.0, kp=110.0, coulomb_nm=0.0085, viscous_nm_s=0.0)
    for number in (1, 2):
        profile = staircase((40.0, 120.0), hold_s=1.0, rest_s=0.5)
        measured = measure(motor, profile, 3, rng, steps_per_cycle=2)
        write_csv(tmp_path / f"record{number}_without_integral.csv.gz", measured, (0, 1, 2))
    model = make_model()
    analysis = analyse(model, read_motor_runs(tmp_path))
    found = {effect.name: effect.parameters for effect in analysis.verdict.effects}
    assert {"coulomb_friction", "loop_delay"} <= set(found), analysis.verdict.sentence
    assert found["coulomb_friction"]["torque"].value == pytest.approx(0.0085, rel=0.15)
    # Setpoints of this simulator do not wait for their turn, those of the model half a cycle on average.
    assert found["loop_delay"]["time"].value + PERIOD_S / 2 == pytest.approx(0.11, abs=0.02)
