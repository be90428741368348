"""`rover-hil identify motor` on averages over half a second of driving."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.errors import LogError
from rover_hil.drives.robotino_csv import COMMANDS, CURRENTS, ROBOTINO, SPEEDS
from rover_hil.identify.motor.command import identify_motor
from rover_hil.identify.motor.robotino import read_means, report_means
from rover_hil.identify.slip.run_data import to_wheels

GAIN, DROOP = 0.98, 8.0
STEP_RAD_S = 27.0 * math.tau / 60.0


def write_averages(
    path: Path,
    *,
    drives: int = 60,
    greatest_a: float = 1.4,
    noise_rad_s: float = 0.5,
    names: str = "",
    seed: int = 3,
) -> Path:
    """Write drives of four rows in all directions; the first row is of a rover that still accelerates."""
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(drives):
        angle, speed_mm_s = rng.uniform(-math.pi, math.pi), rng.uniform(100.0, 400.0)
        command = np.array([speed_mm_s * math.cos(angle), speed_mm_s * math.sin(angle), 0.0])
        wanted = to_wheels(ROBOTINO) @ (command / 1000.0) * 16.0
        told = np.trunc(wanted / STEP_RAD_S) * STEP_RAD_S
        current_a = rng.uniform(0.2, greatest_a, 3)
        for row in range(4):
            steady = GAIN * told - np.sign(told) * DROOP * current_a + rng.normal(0.0, noise_rad_s, 3)
            speed = steady if row else 0.3 * steady
            cells = [*command, *(speed * 60.0 / math.tau), *np.abs(current_a)]
            rows.append(";".join(f"{cell:.6g}" for cell in cells))
    head = names or ";".join((*COMMANDS, *SPEEDS, *CURRENTS))
    path.write_text("\n".join((head, *rows)), encoding="utf-8")
    return path


def run_json(capsys: pytest.CaptureFixture[str], *logs: Path) -> tuple[int, list[dict[str, Any]]]:
    code = identify_motor([*logs], out=None, as_json=True)
    return code, json.loads(capsys.readouterr().out)["motors"]


def by_name(motor: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {item["name"]: item for item in motor["estimates"]}


def test_gain_and_droop_are_found_and_nothing_else(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, motors = run_json(capsys, write_averages(tmp_path / "experimental_data_lawn.csv"))
    assert (code, [motor["motor"] for motor in motors]) == (0, [1, 2, 3])
    for motor in motors:
        found = by_name(motor)
        for name, truth in (("gain", GAIN), ("droop_rad_s_per_a", DROOP)):
            item = found.pop(name)
            assert item["determined"]
            assert item["low"] < truth < item["high"]
            assert item["value"] == pytest.approx(truth, rel=0.05)
        assert all(item["value"] is None and "averages of drives" in item["why"] for item in found.values())


def test_intervals_hold_the_truth_as_often_as_they_say(tmp_path: Path) -> None:
    inside = []
    for seed in range(60):
        path = write_averages(tmp_path / f"{seed}.csv", noise_rad_s=3.0, seed=seed)
        for drives in read_means(path):
            found = {item.name: item for item in report_means([drives]).estimates}
            for name, truth in (("gain", GAIN), ("droop_rad_s_per_a", DROOP)):
                low, high = found[name].low, found[name].high
                assert low is not None
                assert high is not None
                inside.append(low < truth < high)
    assert 0.92 <= np.mean(inside) <= 0.98


def test_saturated_drives_are_left_out(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"motor 1 has \d steady drives with currents below the sensor's end"):
        identify_motor([write_averages(tmp_path / "a.csv", drives=9)], out=None, as_json=True)
    with pytest.raises(LogError, match="fewer than 10"):
        identify_motor([write_averages(tmp_path / "b.csv", greatest_a=90.0)], out=None, as_json=True)


def test_a_missing_current_is_named(tmp_path: Path) -> None:
    names = ";".join((*COMMANDS, *SPEEDS, *CURRENTS)).replace("Motor 3 current", "other")
    with pytest.raises(LogError, match="names no column 'Motor 3 current, A'"):
        identify_motor([write_averages(tmp_path / "a.csv", names=names)], out=None, as_json=True)


def test_averages_and_readings_are_not_mixed(shared_data: Path, tmp_path: Path) -> None:
    record = "robotino_2023/motor_identification/data_for_identification_without_integral.csv.gz"
    averages = write_averages(tmp_path / "a.csv")
    with pytest.raises(LogError, match=r"a\.csv holds averages and data_for.* does not"):
        identify_motor([averages, shared_data / record], out=None, as_json=True)


def test_the_measured_averages(shared_data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, motors = run_json(capsys, shared_data / "robotino_2021")
    assert code == 0
    for motor in motors:
        found = by_name(motor)
        assert found["gain"]["value"] == pytest.approx(1.0, abs=0.01)
        assert found["droop_rad_s_per_a"]["value"] == pytest.approx(7.8, abs=0.5)
