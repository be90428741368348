"""`rover-hil calibrate imu` on turns of which gain, delay and low-pass are known."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from controllers.motion.kinematics import OmniKinematics
from drivers.errors import ConfigError, LogError
from drivers.samples import RateSample, Sample, WheelSample
from rover_hil.app.app import app
from rover_hil.config import load_config
from rover_hil.config.loader import read_config_text
from rover_hil.drives.robotino_csv import ROBOTINO
from rover_hil.ready.imu.calibration import GyroCalibration, small_turns_config
from rover_hil.ready.imu.fit import fit_response
from rover_hil.ready.imu.turns import read_turns
from rover_hil.ready.procedure import Request, run
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.writer import LogWriter

FREQUENCIES_HZ = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0)
EACH_S = 3.0
AMPLITUDE_RAD_S = 0.3
WHEEL_PERIOD_S = 1.0 / 43.0
GYRO_PERIOD_S = 0.02


def write_turns(
    path: Path,
    *,
    gain: float = 1.0,
    delay_s: float = 0.0,
    low_pass_hz: float = math.inf,
    speed_m_s: float = 0.0,
    has_gyro: bool = True,
    spring_hz: float = math.inf,
) -> Path:
    """Write turns in place at several frequencies, of a rover whose wheels do not slip.

    The response of the gyro to a sinusoid is written in closed form, transients left out. A body on springs
    without damping turns further than its wheels.
    """
    config = small_turns_config(load_config("robotino"))
    age_s = config.device_roles().wheel_age_s or 0.0
    kinematics, rng = OmniKinematics(ROBOTINO), np.random.default_rng(3)
    end_s = EACH_S * len(FREQUENCIES_HZ)
    events: list[tuple[float, bool]] = [(t, True) for t in np.arange(0.0, end_s, WHEEL_PERIOD_S).tolist()]
    events += [(t, False) for t in np.arange(0.005, end_s, GYRO_PERIOD_S).tolist()] if has_gyro else []
    with LogWriter(
        path,
        1_000_000_000,
        config.model_dump_json(by_alias=True).encode(),
        collect_data_files(config),
        "virtual",
    ) as log:
        for t_s, is_wheel in sorted(events):
            t_ns = 1_000_000_000 + round((t_s + (age_s if is_wheel else 0.0)) * 1e9)
            turning = math.tau * FREQUENCIES_HZ[int(t_s / EACH_S)]
            samples: list[Sample]
            if is_wheel:
                angle_rad = AMPLITUDE_RAD_S / turning * (1.0 - math.cos(turning * t_s))
                turned = kinematics.wheel_speeds(speed_m_s * t_s, 0.0, angle_rad)
                samples = [
                    WheelSample(device="board", t_ns=t_ns, wheel=wheel, position_rad=each, current_a=0.1)
                    for wheel, each in enumerate(turned)
                ]
            else:
                lag = turning / (math.tau * low_pass_hz)
                further = 1.0 / (1.0 - (turning / (math.tau * spring_hz)) ** 2)
                share = gain * further / math.hypot(1.0, lag)
                rate = share * AMPLITUDE_RAD_S * math.sin(turning * (t_s - delay_s) - math.atan(lag))
                noise = 0.002 * float(rng.normal())
                samples = [RateSample(device="imu", t_ns=t_ns, rate_z_rad_s=rate + 0.01 + noise)]
            log.samples(t_ns, samples)
    return path


@pytest.mark.parametrize(
    ("gain", "delay_s", "low_pass_hz"), [(1.0, 0.0, math.inf), (0.95, 0.04, 20.0), (1.05, 0.0, 10.0)]
)
def test_the_constants_are_found(tmp_path: Path, gain: float, delay_s: float, low_pass_hz: float) -> None:
    path = write_turns(tmp_path / "turns.mcap", gain=gain, delay_s=delay_s, low_pass_hz=low_pass_hz)
    found = fit_response(read_turns(path))
    assert found.problem == ""
    assert found.gain == pytest.approx(gain, abs=3.0 * found.gain_sd)
    assert found.delay_s == pytest.approx(delay_s, abs=3.0 * found.delay_sd_s)
    assert found.lag_s == pytest.approx(1.0 / (math.tau * low_pass_hz), abs=3.0 * found.lag_sd_s)
    assert max(found.delay_sd_s, found.lag_sd_s) < 0.005


def test_ground_that_is_not_firm_gives_a_page_and_no_file(tmp_path: Path) -> None:
    path, out = write_turns(tmp_path / "turns.mcap", gain=0.7), tmp_path / "gyro.toml"
    assert run(GyroCalibration(), Request(source=str(path), out=out)) == 1
    assert not out.exists()
    assert "the ground is not firm" in out.with_suffix(".html").read_text("utf-8")


def test_a_rover_that_springs_on_its_wheels_is_found_and_refused(tmp_path: Path) -> None:
    found = fit_response(read_turns(write_turns(tmp_path / "turns.mcap", spring_hz=12.0)))
    assert found.contact is not None
    assert found.contact.frequency_hz == pytest.approx(12.0, rel=0.1)
    assert found.gain == pytest.approx(1.0, abs=0.02)
    assert "springs on its wheels at 12 Hz" in found.problem


def test_a_spring_that_hides_the_gyro_at_another_frequency_only(tmp_path: Path) -> None:
    turns = read_turns(write_turns(tmp_path / "turns.mcap", spring_hz=20.0))
    assert fit_response(turns).problem == ""
    assert "springs on its wheels at 20 Hz" in fit_response(turns, excitation_hz=5.0).problem


def test_constants_that_predict_no_better_than_none_are_not_needed(tmp_path: Path) -> None:
    found = fit_response(read_turns(write_turns(tmp_path / "turns.mcap", delay_s=0.02)))
    assert found.left_out < 0.2 * found.left_out_without < 0.2
    useless = replace(found, left_out=0.1, left_out_without=0.1)
    assert "they are not needed" in useless.problem


def test_a_stiff_spring_is_taken_out_of_the_gain(tmp_path: Path) -> None:
    found = fit_response(read_turns(write_turns(tmp_path / "turns.mcap", spring_hz=30.0, delay_s=0.01)))
    assert found.problem == ""
    assert found.gain == pytest.approx(1.0, abs=2.0 * found.gain_sd)
    assert found.delay_s == pytest.approx(0.01, abs=2.0 * found.delay_sd_s)


def test_a_gain_beyond_every_data_sheet_is_refused(tmp_path: Path) -> None:
    found = fit_response(read_turns(write_turns(tmp_path / "turns.mcap", gain=1.09)))
    assert "its data sheet allows 1 +- 0.06" in found.problem


def test_the_command_writes_what_the_configuration_reads(tmp_path: Path) -> None:
    path, out = write_turns(tmp_path / "turns.mcap", delay_s=0.04, low_pass_hz=20.0), tmp_path / "gyro.toml"
    result = CliRunner().invoke(app, ["calibrate", "imu", str(path), "--out", str(out)])
    assert result.exit_code == 0, result.output
    config = tmp_path / "rover.toml"
    text = read_config_text("robotino")
    config.write_text(
        text.replace('use = "yaw_probe"', f'use = "yaw_probe"\ngyro_response = "{out}"'), "utf-8"
    )
    slip = load_config(str(config)).slip
    assert slip is not None
    assert slip.gyro_response is not None
    assert slip.gyro_response.delay_s == pytest.approx(0.04, abs=3.0 * slip.gyro_response.delay_sd_s)
    with pytest.raises(ConfigError, match="never overwritten"):
        run(GyroCalibration(), Request(source=str(path), out=out))


def test_logs_without_turns_are_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="no yaw rates"):
        read_turns(write_turns(tmp_path / "a.mcap", has_gyro=False))
    with pytest.raises(LogError, match="turned in place for 0 s"):
        read_turns(write_turns(tmp_path / "b.mcap", speed_m_s=0.1))
