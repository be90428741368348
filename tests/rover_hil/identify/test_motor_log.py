from pathlib import Path

import numpy as np
import pytest

from drivers.errors import LogError
from drivers.samples import SentCommand, WheelSample
from rover_hil.config import load_config
from rover_hil.drives.formats.to_log import observing_config
from rover_hil.identify.motor.identify import read_records
from rover_hil.identify.motor.log import read_log
from rover_hil.recording.writer import LogWriter

START_NS = 1_000_000_000
PERIOD_NS = 20_000_000
CONFIG = observing_config(load_config("robotino"))


def write_log(
    path: Path, *, wheels: int = 3, current_a: float | None = 0.2, late: int | None = None, commands: int = 20
) -> Path:
    """Write a log in which wheel i turns with i + 1 rad/s; sample `late` has the stamp of one far earlier."""
    config_json = CONFIG.model_dump_json(by_alias=True).encode()
    with LogWriter(path, START_NS, config_json, {}, "virtual") as log:
        for cycle in range(20):
            t_ns = START_NS + cycle * PERIOD_NS
            stamp_ns = START_NS if cycle == late else t_ns
            log.samples(
                t_ns,
                [
                    WheelSample(
                        device=CONFIG.roles.wheels,
                        t_ns=stamp_ns,
                        wheel=wheel,
                        position_rad=(wheel + 1) * cycle * 0.02,
                        current_a=current_a,
                        current_is_signed=False,
                    )
                    for wheel in range(wheels)
                ],
            )
            if cycle < commands:
                speeds = (10.0 * (cycle % 2), 5.0, 0.0)
                # The undelivered setpoint never reached the motors.
                sent = SentCommand(t_ns=t_ns, speed_rad_s=speeds, delivered=cycle != 5)
                log.write_json("/command", t_ns, sent)
    return path


def test_wheels_become_motors(tmp_path: Path) -> None:
    records = read_log(write_log(tmp_path / "run.mcap"))
    assert [record.motor for record in records] == [1, 2, 3]
    second = records[1]
    assert second.position is not None
    np.testing.assert_allclose(np.diff(second.position.value) / 0.02, 2 * 16)
    np.testing.assert_allclose(np.diff(second.position.t_s), 0.02)
    assert second.speed is None
    assert not second.current_is_signed
    step = second.scale.speed_rad_s
    assert step == pytest.approx(27 * 2 * np.pi / 60)
    # 5 rad/s at the wheel is 80 at the motor: 28 whole steps.
    np.testing.assert_allclose(second.set_point.value, 28 * step)
    assert second.set_point.t_s.size == 19


def test_a_log_without_currents_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="motor 1: no motor currents in the log"):
        read_records(write_log(tmp_path / "run.mcap", current_a=None))


def test_a_missing_wheel_is_named(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="no samples of motor 3"):
        read_records(write_log(tmp_path / "run.mcap", wheels=2))


def test_a_clock_that_goes_backwards_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"the clock goes backwards or does not advance after 0\.220 s"):
        read_records(write_log(tmp_path / "run.mcap", late=12))


def test_a_log_without_set_points_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="no wheel samples or no setpoints"):
        read_records(write_log(tmp_path / "run.mcap", commands=0))
