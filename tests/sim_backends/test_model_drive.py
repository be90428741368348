import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.errors import ConfigError
from rover_hil.config import load_config
from rover_hil.drives.drive import Drive
from rover_hil.gap.data.readers.four_wheel_drive import (
    four_wheel_run,
    four_wheel_runs_of_log,
    read_four_wheel_runs,
)
from rover_hil.gap.data.readers.robotino_drive import drive_runs_of_log, read_drive_runs
from rover_hil.gap.data.stretches import stretches, windows_over
from rover_hil.gap.verdict import Answer
from rover_hil.gap.workflow import analyse
from sim_backends.models.delay import earlier
from sim_backends.models.four_wheel_drive.model import TRACK_M, WHEELS, FourWheelDrive
from sim_backends.models.four_wheel_drive.model import make_model as make_four_wheel
from sim_backends.models.interface import DrivenModel, Run
from sim_backends.models.robotino_drive.model import RobotinoDrive
from sim_backends.models.robotino_drive.model import make_model as make_robotino
from tests.nature.four_wheel_drive import Rover, draw_soil, drive, random_site
from tests.nature.omni_drive import TrueRover, record, write
from tests.sim_backends.model_contract import (
    assert_cards_are_whole,
    assert_effects_act,
    assert_nulls_change_nothing,
)

DIRECTIONS_DEG = (0.0, 50.0, 100.0, 155.0, 200.0, 250.0, 300.0, 345.0)


def omni_run(count: int = 60) -> Run:
    t_s = 0.1 + 0.2 * np.arange(count)
    inputs = {
        "t_s": t_s,
        **{f"wheel_{wheel}_rad_s": (wheel - 1.7) * 4.0 * np.minimum(1.0, t_s) for wheel in (1, 2, 3)},
        **{f"current_{wheel}_a": 0.3 * wheel + 0.1 * np.sin(t_s) for wheel in (1, 2, 3)},
        "image_x_m": 0.1 * t_s,
        "image_y_m": -0.2 * t_s,
    }
    return Run(name="run", conditions={"direction_deg": 0.0, "speed_m_s": 0.1, "surface": 1.0}, inputs=inputs)


def skid_run(count: int = 60) -> Run:
    t_s = 0.1 + 0.2 * np.arange(count)
    speed = np.minimum(1.0, t_s)
    inputs = {
        "t_s": t_s,
        **{f"wheel_{wheel}_rad_s": speed * (1.5 if wheel % 2 else 2.0) for wheel in (1, 2, 3, 4)},
        "pitch_rad": 0.2 * np.sin(t_s),
        "roll_rad": 0.1 * np.cos(t_s),
        "heading_rad": 0.4 * t_s,
        "true_turn_rad_s": np.full(count, 0.4),
    }
    return Run(name="run", conditions={"climb_deg": 0.0, "roll_deg": 0.0, "speed_m_s": 0.1}, inputs=inputs)


@pytest.mark.parametrize(
    ("model", "run"), [(make_robotino(), omni_run()), (make_four_wheel(), skid_run())], ids=["omni", "skid"]
)
def test_cards(model: RobotinoDrive | FourWheelDrive, run: Run) -> None:
    assert isinstance(model, DrivenModel)
    assert_cards_are_whole(model)
    assert_nulls_change_nothing(model, [run])
    assert_effects_act(model, [run])


def test_windows_give_mean_rates() -> None:
    windows = windows_over(1.0, 7.0, "drive")
    t_s = np.linspace(0.5, 7.5, 211)
    assert windows.rate(t_s, t_s**2) == pytest.approx(2.0 * windows.middle_s, abs=0.01)
    with pytest.raises(ConfigError, match="or more"):
        windows_over(0.0, 1.0, "drive")


@pytest.mark.parametrize("latency_s", [0.05, 0.2, 0.33])
def test_an_earlier_rate_is_that_of_the_shifted_ramp(latency_s: float) -> None:
    t_s = np.asarray(0.1 + 0.2 * np.arange(50), np.float64)
    assert earlier(t_s, 3.0 * t_s, latency_s)[5:] == pytest.approx(3.0 * (t_s - latency_s)[5:])


def test_three_wheels_move_the_body_as_the_papers_kinematics_say() -> None:
    run = omni_run()
    for wheel, angle in zip((1, 2, 3), (60.0, 180.0, 300.0), strict=True):
        rim = -math.sin(math.radians(angle)) * 0.1 + math.cos(math.radians(angle)) * -0.05 + 0.125 * 0.3
        run.inputs[f"wheel_{wheel}_rad_s"][:] = rim / 0.04
    table = make_robotino().predict([run], {"camera_age_s": 0.0}, {})[0]
    assert table["forward_m_s"] == pytest.approx(0.1)
    assert table["left_m_s"] == pytest.approx(-0.05)
    assert table["turn_rad_s"] == pytest.approx(0.3)


def test_a_larger_wheel_is_a_smaller_scale_but_for_turns() -> None:
    model, run = make_robotino(), omni_run()
    scale = model.predict([run], {}, {"camera_scale": {"error": -0.1}})[0]
    radius = model.predict([run], {}, {"wheel_radius": {"error": 1 / 0.9 - 1}})[0]
    assert scale["forward_m_s"] == pytest.approx(radius["forward_m_s"])
    assert scale["left_m_s"] == pytest.approx(radius["left_m_s"])
    assert radius["turn_rad_s"] == pytest.approx(scale["turn_rad_s"] / 0.9)


def test_slip_takes_from_wheels_that_pull_on_its_surface_only() -> None:
    model, run = make_robotino(), omni_run()
    free = model.predict([run], {}, {})[0]["turn_rad_s"]
    here = model.predict([run], {}, {"wheel_slip": {"gain": 0.3, "surface": 1.0}})[0]["turn_rad_s"]
    elsewhere = model.predict([run], {}, {"wheel_slip": {"gain": 0.3, "surface": 2.0}})[0]["turn_rad_s"]
    assert np.abs(here - free).max() > 0.01
    assert elsewhere == pytest.approx(free)


def test_reads_measured_runs_as_the_files_own_steps_say(shared_data: Path) -> None:
    folder = shared_data / "robotino_2023" / "one_surface_type" / "table_surface"
    runs = read_drive_runs(folder)
    assert len(runs) == 36
    # 0 deg forward, 90 deg left; the encoders see 0.09 m/s, the camera at its nominal scale a tenth less.
    by_name = {run.name: run for run in runs}
    ahead, left = by_name["exp00"], by_name["exp18"]
    assert ahead.conditions["direction_deg"] == 0.0
    assert left.conditions["direction_deg"] == 90.0
    assert ahead.measured["forward_m_s"].mean() == pytest.approx(0.081, abs=0.003)
    assert abs(ahead.measured["left_m_s"].mean()) < 0.004
    assert left.measured["left_m_s"].mean() == pytest.approx(0.081, abs=0.003)


@pytest.mark.nightly
def test_reads_averages_and_several_surfaces(shared_data: Path) -> None:
    averaged = read_drive_runs(shared_data / "robotino_2021" / "experimental_data_blue.csv")
    assert len(averaged) >= 8
    assert all(run.measured["forward_m_s"].size >= 30 for run in averaged)
    surfaces = {
        run.conditions["surface"]
        for run in read_drive_runs(shared_data / "robotino_2023" / "one_surface_type")
    }
    assert surfaces == {1.0, 2.0, 3.0, 4.0}


def omni_records(folder: Path, rover: TrueRover) -> tuple[RobotinoDrive, list[Run]]:
    """Return the model that read the records, which have no gyro, beside them."""
    rng = np.random.default_rng(11)
    for index, direction in enumerate((*DIRECTIONS_DEG, *DIRECTIONS_DEG[::2])):
        speed = 0.2 if index < len(DIRECTIONS_DEG) else 0.1
        write(folder / f"exp{index:02}.csv.gz", record(rover, direction, speed, rng))
    return make_robotino(), read_drive_runs(folder)


def test_rolling_wheels_under_a_good_camera_leave_no_gap(tmp_path: Path) -> None:
    verdict = analyse(*omni_records(tmp_path, TrueRover())).verdict
    assert verdict.verdict is Answer.NO_GAP, verdict.sentence


@pytest.mark.nightly
def test_a_wrong_scale_on_straight_drives_is_a_set_of_two(tmp_path: Path) -> None:
    verdict = analyse(*omni_records(tmp_path, TrueRover(mm_per_px=2.02))).verdict
    assert verdict.verdict is Answer.NAMED_SET, verdict.sentence
    assert {tuple(one) for one in verdict.confidence_set} == {("camera_scale",), ("wheel_radius",)}
    # A picture that shows too little is a wheel that is too small.
    true = {"camera_scale": 2.02 / 1.84 - 1.0, "wheel_radius": 1.84 / 2.02 - 1.0}
    best = verdict.effects[0]
    assert best.parameters["error"].value == pytest.approx(true[best.name], abs=0.012)


@pytest.mark.nightly
def test_slip_that_follows_the_pull_is_named(tmp_path: Path) -> None:
    verdict = analyse(*omni_records(tmp_path, TrueRover(slip_per_pull=0.25))).verdict
    assert any("wheel_slip" in names for names in verdict.confidence_set), verdict.sentence


def write_table(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    rows = (",".join(f"{value:.6g}" for value in row) for row in zip(*columns.values(), strict=True))
    path.write_text("\n".join((",".join(columns), *rows)))


def field_drives(folder: Path, errors: tuple[float, float, float, float]) -> None:
    soil = draw_soil(np.random.default_rng(5))
    for index in range(8):
        rng = np.random.default_rng([index, 9])
        rover = Rover(compass_errors=errors, compass_bias=0.3 * rng.standard_normal(), compass_lag_s=0.45)
        site = replace(random_site(rng), way_m=3.0)
        recorded = drive(site, soil, rover, rng, psi_rad=math.tau * index / 8)
        write_table(folder / f"drive{index}.csv", recorded.log)
        write_table(folder / f"drive{index}_truth.csv", recorded.truth)


@pytest.mark.nightly
def test_hard_iron_is_named_from_field_drives(tmp_path: Path) -> None:
    field_drives(tmp_path, (6.0, -3.0, 0.0, 0.0))
    model = make_four_wheel()
    runs = read_four_wheel_runs(tmp_path)
    assert len(runs) == 8
    assert "turn_rad_s" not in runs[0].measured  # all wheels were driven alike
    verdict = analyse(model, runs).verdict
    found = {effect.name: effect.parameters for effect in verdict.effects}
    assert "hard_iron" in found, verdict.sentence
    assert "soft_iron" not in found
    assert abs(found["hard_iron"]["size"].value) == pytest.approx(math.hypot(6.0, 3.0), rel=0.1)


def test_gravity_slows_uphill_and_drifts_downhill() -> None:
    model, run = make_four_wheel(), skid_run()
    run.inputs["pitch_rad"][:], run.inputs["roll_rad"][:] = 0.1, 0.2
    free = model.predict([run], {}, {})[0]
    up = model.predict([run], {}, {"slope_slip": {"per_slope": 0.5}})[0]
    aside = model.predict([run], {}, {"side_drift": {"per_roll": 0.5}})[0]
    assert up["forward_m_s"] == pytest.approx(0.95 * free["forward_m_s"])
    # Left side up: the rover drifts to the right.
    assert aside["left_m_s"] == pytest.approx(-free["forward_m_s"] * math.tan(0.1))


def test_sides_turn_the_rover_by_its_track() -> None:
    model, run = make_four_wheel(), skid_run()
    turn = model.predict([run], {}, {})[0]["turn_rad_s"]
    assert turn[-1] == pytest.approx(0.092 * 0.5 / TRACK_M)
    wide = model.predict([run], {}, {"base_radius": {"error": 1.0}})[0]["turn_rad_s"]
    assert wide == pytest.approx(turn / 2)


def test_lost_ticks_hide_motion() -> None:
    model, run = make_four_wheel(), skid_run()
    free = model.predict([run], {}, {})[0]
    lost = model.predict([run], {}, {"encoder_dropouts": {"share": 0.2, "wheel": 2.0, "onset": 0.0}})[0]
    # The right front wheel turned 1.25 times what was counted: the right side an eighth more.
    assert lost["turn_rad_s"][-1] - free["turn_rad_s"][-1] == pytest.approx(0.092 * 2.0 * 0.125 / TRACK_M)


def test_logs_without_truth_and_of_other_rovers_are_refused(tmp_path: Path) -> None:
    wheels = {f"position{wheel}_rad": np.arange(50.0) for wheel in (1, 2, 3, 4)}
    write_table(tmp_path / "drive.csv", {"t_s": np.arange(50.0), **wheels})
    with pytest.raises(ConfigError, match="no truth in its folder"):
        read_four_wheel_runs(tmp_path)
    robotino, el_dorado = (
        cast("Drive", SimpleNamespace(name="drive", config=load_config(name)))
        for name in ("robotino", "el-dorado")
    )
    with pytest.raises(ConfigError, match="of the kind omni3: use the log of four wheels"):
        four_wheel_runs_of_log(robotino)
    with pytest.raises(ConfigError, match="of the kind skid_steer_4: use the log of three omnidirectional"):
        drive_runs_of_log(el_dorado)


def test_wheels_that_are_logged_late_do_not_stop_when_the_log_does() -> None:
    model, run = make_four_wheel(), skid_run()
    on_time, late = (
        model.predict([run], {}, {"latency": {"time": time_s}})[0]["forward_m_s"] for time_s in (0.0, 0.4)
    )
    assert late[:-2] == pytest.approx(on_time[2:])
    assert late[-3:] == pytest.approx(on_time[-1])


def test_a_small_latency_changes_rates_in_proportion() -> None:
    # Also where a whole window is a step of the latency: straight pieces would have a kink there.
    t_s = np.asarray(0.1 + 0.2 * np.arange(50), np.float64)
    rate = np.asarray(np.sin(t_s), np.float64)
    before, at, after = (earlier(t_s, rate, latency_s)[5:] for latency_s in (0.19, 0.2, 0.21))
    assert after - at == pytest.approx(at - before, abs=2e-4)
    assert at == pytest.approx(rate[4:-1], abs=1e-9)


def test_a_long_drive_is_cut_into_stretches_and_a_short_one_is_not() -> None:
    run = skid_run(count=300)
    run = replace(run, measured={"forward_m_s": np.arange(300.0)})
    parts = stretches(run)
    assert [part.name for part in parts] == [f"run part {number}" for number in (1, 2, 3, 4)]
    assert sum(part.inputs["t_s"].size for part in parts) == 300
    missing = [np.flatnonzero(np.isnan(part.measured["forward_m_s"])).tolist() for part in parts]
    assert missing == [[0, 1, 74]] * 4
    assert parts[1].measured["forward_m_s"][2] == 77.0
    assert run.measured["forward_m_s"][0] == 0.0
    assert len(stretches(skid_run())) == 1


def test_ends_at_which_a_wheel_says_nothing_are_left_out() -> None:
    count = 200
    steps = np.arange(count, dtype=np.float64)
    columns: dict[str, NDArray[np.float64]] = {
        "t_s": np.multiply(0.05, steps),
        **{f"position{wheel}_rad": np.multiply(0.1, steps) for wheel in WHEELS},
    }
    columns |= {"x_m": np.multiply(0.01, steps), "y_m": np.zeros(count), "yaw_rad": np.zeros(count)}
    columns["position4_rad"][-3:] = np.nan
    run = four_wheel_run("drive", columns, columns, {})
    assert np.isfinite(run.inputs["wheel_4_rad_s"]).all()
    assert run.inputs["t_s"][-1] < columns["t_s"][-4]


@pytest.mark.parametrize("read", [read_four_wheel_runs, read_drive_runs])
def test_gaps_that_are_bridged_are_counted_and_an_empty_column_is_refused(
    tmp_path: Path, read: Callable[[Path], list[Run]]
) -> None:
    count = 200
    steps = np.arange(count, dtype=np.float64)
    columns: dict[str, NDArray[np.float64]] = {
        "t_s": np.multiply(0.05, steps),
        **{f"position{wheel}_rad": np.multiply(0.1, steps) for wheel in WHEELS},
    }
    columns |= {"x_m": np.multiply(0.01, steps), "y_m": np.zeros(count), "yaw_rad": np.zeros(count)}
    columns["yaw_rate_deg_s"] = np.zeros(count)
    columns["yaw_rate_deg_s"][20:26] = np.nan
    write_table(tmp_path / "drive.csv", columns)
    (run,) = read(tmp_path)
    assert run.missing == {"yaw_rate_deg_s": (6, count)}
    columns["yaw_rate_deg_s"][:] = np.nan
    write_table(tmp_path / "drive.csv", columns)
    with pytest.raises(ConfigError, match="drive: column 'yaw_rate_deg_s' holds no value"):
        read(tmp_path)
