"""Logs with gaps, with numbers that are none and with setpoints that never arrived."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from controllers.motion.kinematics import OmniKinematics
from controllers.slip.effort.motor_model import MotorSettings
from drivers.errors import LogError
from drivers.samples import SentCommand, WheelSample
from rover_hil.config import load_config
from rover_hil.drives.robotino_csv import ROBOTINO
from rover_hil.identify.slip.form_windows import form_windows
from rover_hil.identify.slip.log_runs import read_log_run
from rover_hil.identify.slip.run_data import RunWindows
from rover_hil.identify.slip.scores import predict_by_surface
from rover_hil.identify.slip.surface_fit import fit_surface_map
from rover_hil.recording.writer import LogWriter
from tests.rover_hil.identify.slip_runs import windows

PERIOD_S = 0.02
START_NS = 1_000_000_000
SPEEDS = OmniKinematics(ROBOTINO).wheel_speeds(0.14, 0.14, 0.0)

Change = Callable[[WheelSample, float], WheelSample | None]


def write_log(
    path: Path,
    change: Change = lambda sample, t_s: sample,
    *,
    x_m: float = 0.1,
    set_share: Callable[[float], float] = lambda t_s: 1.0,
    delivered: bool = True,
) -> Path:
    """Write four seconds of steady travel; `change` makes of each sample another one, or none."""
    config_json = load_config("robotino").model_dump_json(by_alias=True).encode()
    with LogWriter(path, START_NS, config_json, {}, "test") as log:
        for step in range(1, 200):
            t_s = step * PERIOD_S
            t_ns = START_NS + round(t_s * 1e9)
            samples = [
                WheelSample(
                    device="board",
                    t_ns=t_ns,
                    wheel=wheel,
                    position_rad=speed * t_s,
                    current_a=0.8,
                    current_is_signed=False,
                )
                for wheel, speed in enumerate(SPEEDS)
            ]
            log.samples(t_ns, [kept for each in samples if (kept := change(each, t_s)) is not None])
            log.write_json("/truth", t_ns, {"t_ns": t_ns, "x_m": x_m * t_s, "y_m": 0.0, "yaw_rad": 0.0})
            told = tuple(set_share(t_s) * speed for speed in SPEEDS)
            log.write_json("/command", t_ns, SentCommand(t_ns=t_ns, speed_rad_s=told, delivered=delivered))
    return path


def read(path: Path) -> RunWindows:
    return form_windows(read_log_run(path, "lawn"), MotorSettings())


def test_a_current_that_pauses_is_not_made_up(tmp_path: Path) -> None:
    def pause(sample: WheelSample, t_s: float) -> WheelSample:
        is_silent = sample.wheel == 1 and 1.0 < t_s < 3.0
        return replace(sample, current_a=None) if is_silent else sample

    run = read(write_log(tmp_path / "run.mcap", pause))
    assert run.usable[:, 0].all()
    assert run.usable[:, 1].tolist() == [True, True, False, False, False, False, True, True]
    assert run.work_known.tolist() == run.usable[:, 1].tolist()


@pytest.mark.parametrize("until_s", [3.0, 9.0])
def test_a_wheel_that_falls_silent_is_named(tmp_path: Path, until_s: float) -> None:
    def fall_silent(sample: WheelSample, t_s: float) -> WheelSample | None:
        return None if sample.wheel == 2 and 1.5 < t_s < until_s else sample

    with pytest.raises(LogError, match=r"wheel 2 gives no position 1\.\d+ s after wheel 0's first"):
        read(write_log(tmp_path / "run.mcap", fall_silent))


@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_what_is_no_number_is_not_used(tmp_path: Path, number: float) -> None:
    def spoil(sample: WheelSample, t_s: float) -> WheelSample:
        return replace(sample, current_a=number) if sample.wheel == 1 and t_s > 2.0 else sample

    run = read(write_log(tmp_path / "run.mcap", spoil))
    assert not run.usable[-3:, 1].any()
    assert run.usable[:, 0].all()
    with pytest.raises(LogError, match=r"no numbers|is damaged"):
        read(write_log(tmp_path / "other.mcap", x_m=number))


@pytest.mark.parametrize(("delivered", "is_known"), [(True, False), (False, True)])
def test_set_points_that_never_arrived_brake_no_wheel(
    tmp_path: Path, delivered: bool, is_known: bool
) -> None:
    log = write_log(
        tmp_path / "run.mcap", set_share=lambda t_s: 0.1 if t_s > 2.0 else 1.0, delivered=delivered
    )
    assert read(log).work_known[-1] == is_known


def runs_on(surface: str, torque_nm: float, *, seems_nm: float | None = None) -> list[RunWindows]:
    """Return runs whose torque is `seems_nm` in the second half, where it is not known."""
    known = np.arange(20) < (20 if seems_nm is None else 10)
    found = []
    for direction_rad in np.linspace(-3.0, 3.0, 12):
        true_nm = np.full((20, 3), torque_nm)
        run = windows(direction_rad, surface, slip=lambda torque: 0.5 * torque, torque_nm=true_nm)
        share = np.where(known, 1.0, (seems_nm or torque_nm) / torque_nm)[:, None]
        found.append(replace(run, work_known=known, wheel_torque_nm=run.wheel_torque_nm * share))
    return found


def test_windows_of_unknown_work_teach_nothing_and_are_flagged() -> None:
    lawn, spoilt, rug = runs_on("lawn", 0.4), runs_on("lawn", 0.4, seems_nm=0.8), runs_on("rug", 0.8)
    clean, surfaces = fit_surface_map([*lawn, *rug], 1.0), fit_surface_map([*spoilt, *rug], 1.0)
    for found, expected in zip(surfaces.surfaces, clean.surfaces, strict=True):
        assert found.force_n.mean == pytest.approx(expected.force_n.mean, rel=0.01)
    way_m, invalid = predict_by_surface(spoilt[3], surfaces)
    assert way_m == pytest.approx(predict_by_surface(lawn[3], clean)[0], rel=0.01)
    assert invalid == pytest.approx(0.5, abs=0.01)
