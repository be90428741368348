"""`rover-hil identify probe` on logs whose slip is twice the transmission loss."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from controllers.motion.kinematics import OmniKinematics
from controllers.slip.effort.gyro_response import GyroResponse
from controllers.slip.effort.yaw_excitation import slip_of
from drivers.errors import ConfigError, LogError
from drivers.samples import PoseFixSample, RateSample, Sample, WheelSample
from rover_hil.app.app import app
from rover_hil.app.identify.probe import identify_probe
from rover_hil.config import load_config
from rover_hil.datasets.robotino_csv import ROBOTINO
from rover_hil.identify.slip.map_file import read_slip_map
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.writer import LogWriter
from tests.cases import first_often
from tests.rover_hil.test_overhead_run import config_with

PERIOD_S = 0.02
SHARES = (0.0, 0.1, 0.2, 0.3, 0.4)
STRETCH_S = 6.0
SPEED_M_S = 0.15


def write_shaken_drive(
    path: Path,
    *,
    has_gyro: bool = True,
    amplitude_rad_s: float = 0.5,
    shares: tuple[float, ...] = SHARES,
    stretch_s: float = STRETCH_S,
    seed: int = 1,
    fix_period_s: float | None = None,
    gyro_gain: float = 1.0,
) -> Path:
    """Write a drive to the left with yaw excitation; each stretch has another transmission loss.

    The gyro reads `gyro_gain` of the turns, and the configuration states it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    config = load_config("robotino") if fix_period_s is None else config_with()
    assert config.slip is not None
    response = GyroResponse(source="by hand", identified_on="2026-01-01", gain=gyro_gain)
    config = config.model_copy(update={"slip": config.slip.model_copy(update={"gyro_response": response})})
    config_json = config.model_dump_json(by_alias=True).encode()
    next_fix_s = 0.0
    kinematics, rng = OmniKinematics(ROBOTINO), np.random.default_rng(seed)
    position_rad = np.zeros(3)
    place, yaw_rad = 0j, 0.7
    with LogWriter(path, 1_000_000_000, config_json, collect_data_files(config), "virtual") as log:
        for step in range(1, round(len(shares) * stretch_s / PERIOD_S)):
            t_ns, t_s = 1_000_000_000 + round(step * PERIOD_S * 1e9), step * PERIOD_S
            lost = shares[int(t_s / stretch_s)] + 0.01 * float(rng.normal())
            rate_rad_s = amplitude_rad_s * math.sin(math.tau * 5.0 * t_s)
            position_rad += PERIOD_S * np.array(kinematics.wheel_speeds(0.0, SPEED_M_S, rate_rad_s))
            turn_rad = (1.0 - lost) * rate_rad_s * PERIOD_S
            place += 1j * SPEED_M_S * (1.0 - 2.0 * lost) * PERIOD_S * np.exp(1j * (yaw_rad + 0.5 * turn_rad))
            yaw_rad += turn_rad
            samples: list[Sample] = [
                WheelSample(device="board", t_ns=t_ns, wheel=wheel, position_rad=float(angle), current_a=0.5)
                for wheel, angle in enumerate(position_rad)
            ]
            if has_gyro:
                samples.append(
                    RateSample(device="imu", t_ns=t_ns, rate_z_rad_s=gyro_gain * turn_rad / PERIOD_S + 0.03)
                )
            if fix_period_s is not None and t_s >= next_fix_s:
                next_fix_s += fix_period_s
                x_m, y_m = rng.normal((place.real, place.imag), 0.002).tolist()
                fix = PoseFixSample(
                    device="overhead",
                    t_ns=t_ns,
                    t_capture_ns=t_ns,
                    x_m=x_m,
                    y_m=y_m,
                    yaw_rad=yaw_rad,
                    position_std_m=0.002,
                    yaw_std_rad=0.0035,
                )
                samples.append(fix)
            log.samples(t_ns, samples)
            if fix_period_s is not None:
                continue
            truth = {"t_ns": t_ns, "x_m": place.real, "y_m": place.imag, "yaw_rad": yaw_rad}
            log.write_json("/truth", t_ns, truth)
    return path


def identify(logs: list[Path], out: Path, *, amplitude_rad_s: float = 0.5, frequency_hz: float = 5.0) -> int:
    return identify_probe(
        logs,
        maps="robotino",
        amplitude_rad_s=amplitude_rad_s,
        frequency_hz=frequency_hz,
        out=out,
        as_json=True,
        force=False,
    )


def test_the_law_of_the_drives_is_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for seed in (1, 2):
        write_shaken_drive(tmp_path / "drives" / f"{seed}" / "run.mcap", seed=seed)
    out = tmp_path / "map.toml"
    assert identify([tmp_path / "drives"], out) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["logs"] == 2
    found = read_slip_map(str(out))
    assert found.yaw_probe is not None
    assert found.yaw_probe.source == "drives in drives"
    assert (found.yaw_probe.amplitude_rad_s, found.yaw_probe.frequency_hz) == (0.5, 5.0)
    for lost in (0.1, 0.2, 0.3):
        assert slip_of(found.yaw_probe, lost) == pytest.approx(2.0 * lost, abs=0.03)
    # What is left are the windows over two stretches.
    assert found.yaw_probe.slip_sd < 0.06
    shipped = read_slip_map("robotino")
    assert found.model_copy(update={"yaw_probe": None}) == shipped.model_copy(update={"yaw_probe": None})
    assert not list(tmp_path.glob("*.part"))


def test_the_gain_of_a_calibrated_gyro_is_no_loss(tmp_path: Path) -> None:
    log = write_shaken_drive(tmp_path / "run.mcap", gyro_gain=0.8, stretch_s=12.0)
    assert identify([log], tmp_path / "map.toml") == 0
    probe = read_slip_map(str(tmp_path / "map.toml")).yaw_probe
    assert probe is not None
    for lost in (0.1, 0.2, 0.3):
        assert slip_of(probe, lost) == pytest.approx(2.0 * lost, abs=0.05)


@pytest.mark.parametrize(("fix_period_s", "stretch_s"), first_often([(0.2, 12.0), (2.0, 48.0)]))
def test_the_law_is_found_with_pose_fixes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], fix_period_s: float, stretch_s: float
) -> None:
    log = write_shaken_drive(tmp_path / "run.mcap", fix_period_s=fix_period_s, stretch_s=stretch_s)
    assert identify([log], tmp_path / "map.toml") == 0
    assert "truth of 1 log: pose fixes of 'overhead'" in json.loads(capsys.readouterr().out)["notes"]
    probe = read_slip_map(str(tmp_path / "map.toml")).yaw_probe
    assert probe is not None
    for lost in (0.1, 0.2, 0.3):
        assert slip_of(probe, lost) == pytest.approx(2.0 * lost, abs=0.05)


def test_fixes_that_are_too_rare_are_named(tmp_path: Path) -> None:
    log = write_shaken_drive(tmp_path / "run.mcap", fix_period_s=4.0)
    with pytest.raises(LogError, match=r"drive more; \d+ rejected: no pose fix"):
        identify([log], tmp_path / "map.toml")


def test_the_command(tmp_path: Path) -> None:
    write_shaken_drive(tmp_path / "drives" / "run.mcap", stretch_s=12.0)
    arguments = ["identify", "probe", str(tmp_path / "drives"), "--out", str(tmp_path / "map.toml")]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0
    assert "slip follows the transmission loss with a scatter of 0.0" in " ".join(result.output.split())
    assert read_slip_map(str(tmp_path / "map.toml")).yaw_probe is not None


def test_an_existing_file_is_kept(tmp_path: Path) -> None:
    out = tmp_path / "map.toml"
    out.write_text("mine", encoding="utf-8")
    with pytest.raises(ConfigError, match="never overwritten"):
        identify([tmp_path], out)
    assert out.read_text(encoding="utf-8") == "mine"


def test_a_log_without_a_gyro_is_refused(tmp_path: Path) -> None:
    log = write_shaken_drive(tmp_path / "run.mcap", has_gyro=False, shares=(0.1,))
    with pytest.raises(LogError, match="no yaw rates of its gyro"):
        identify([log], tmp_path / "map.toml")
    assert not (tmp_path / "map.toml").exists()


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        ({"amplitude_rad_s": 0.0}, "1 runs give 0 windows with excitation, 100 needed: drive more"),
        ({"stretch_s": 2.0}, "windows with excitation, 100 needed: drive more"),
    ],
)
def test_too_little_shaking_is_refused(tmp_path: Path, drive: dict[str, float], message: str) -> None:
    log = write_shaken_drive(tmp_path / "run.mcap", **drive)  # type: ignore[arg-type]
    with pytest.raises(LogError, match=message):
        identify([log], tmp_path / "map.toml")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"amplitude_rad_s": 50.0}, "--amplitude 50: Input should be less than or equal to 2"),
        ({"frequency_hz": 0.5}, "--frequency 0.5: Input should be greater than or equal to 2"),
    ],
)
def test_a_shake_out_of_range_is_refused(tmp_path: Path, changes: dict[str, float], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        identify([tmp_path], tmp_path / "map.toml", **changes)


def test_other_files_are_refused(tmp_path: Path) -> None:
    out = tmp_path / "map.toml"
    (tmp_path / "run.csv").write_text("a;b\n", encoding="utf-8")
    for logs in ([tmp_path / "run.csv"], [tmp_path / "none"]):
        with pytest.raises(LogError):
            identify(logs, out)
    with pytest.raises(ConfigError, match="cannot read slip map"):
        identify_probe([tmp_path], maps="none", amplitude_rad_s=0.5, frequency_hz=5.0, out=out, as_json=True)
