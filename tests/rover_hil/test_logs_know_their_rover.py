"""An imported log, or its file of columns, describes the rover for every command that asks for one."""

import math
from pathlib import Path

import numpy as np
import pytest

from rover_hil.config import load_config
from rover_hil.drives.formats.described_rover import load_rover
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.test_import_table import (
    RADIANS,
    RADIUS_M,
    ROVER,
    ROWS,
    T_S,
    TIME,
    TRACK_M,
    TRUTH,
    drive,
    import_it,
    write,
)

LINE_M, TURNS = 2.0, 3.0
LARGER, WIDER = 1.02, 1.05
"""True radius and track over those of the file of columns."""


def import_columns(command: Command, tmp_path: Path, name: str, columns: dict[str, np.ndarray]) -> str:
    write(tmp_path / f"{name}.csv", columns)
    log = f"{name}.mcap"
    assert import_it(command, TIME + TRUTH + RADIANS + ROVER, str(tmp_path / f"{name}.csv"), out=log) == 0
    return log


def straight(command: Command, tmp_path: Path) -> str:
    turned = LINE_M / (LARGER * RADIUS_M) * T_S / T_S[-1]
    x_m, none = LINE_M * T_S / T_S[-1], np.zeros(ROWS)
    columns = {"t": T_S, "l": turned, "r": turned, "x": x_m, "y": none, "yaw": none}
    return import_columns(command, tmp_path, "line", columns)


def spinning(command: Command, tmp_path: Path) -> str:
    yaw_rad = math.tau * TURNS * T_S / T_S[-1]
    turned = 0.5 * WIDER * TRACK_M * yaw_rad / (LARGER * RADIUS_M)
    none = np.zeros(ROWS)
    columns = {"t": T_S, "l": -turned, "r": turned, "x": none, "y": none, "yaw": yaw_rad}
    return import_columns(command, tmp_path, "spin", columns)


def test_wheels_are_calibrated_by_imported_logs_alone(command: Command, tmp_path: Path) -> None:
    line, spin = straight(command, tmp_path), spinning(command, tmp_path)
    known = ("--line", f"{line}={LINE_M}", "--spin", f"{spin}={TURNS}")
    assert command("calibrate", "wheels", *known, "--out", "wheels.toml", "--json") == 0, command.error
    assert command("calibrate", "wheels", line, *known, "--out", "again.toml") == 0, command.error
    assert command("calibrate", "wheels", "columns.toml", *known, "--out", "third.toml") == 0, command.error
    text = Path("wheels.toml").read_text("utf-8")
    assert f"radius_m = {LARGER * RADIUS_M:.3f}" in text
    for other in ("again.toml", "third.toml"):
        assert Path(other).read_text("utf-8") == text


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ((), "name the configuration of the rover that is to drive, or logs"),
        (("columns.toml",), "not the devices to drive it with"),
    ],
)
def test_a_described_rover_without_devices_is_not_driven(
    command: Command, tmp_path: Path, source: tuple[str, ...], words: str
) -> None:
    straight(command, tmp_path)
    assert command("calibrate", "wheels", *source, "--out", "wheels.toml") == 2
    assert_one_sentence(command.error, words)


def test_a_log_replays_with_the_rover_of_a_file_of_columns_or_of_another_log(
    command: Command, tmp_path: Path
) -> None:
    log = straight(command, tmp_path)
    text = Path("columns.toml").read_text("utf-8")
    Path("larger.toml").write_text(text.replace(f"radius_m = {RADIUS_M}", "radius_m = 0.06"), "utf-8")
    assert command("replay", log, "--config", "columns.toml") == 0, command.error
    assert command("replay", log, "--config", log) == 0, command.error
    assert "every output identical" in command.out
    assert command("replay", log, "--config", "larger.toml") == 1
    assert "fields came out different" in command.out


def test_filter_noise_is_tuned_by_imported_logs_alone(command: Command, tmp_path: Path) -> None:
    circle = import_columns(command, tmp_path, "circle", drive())
    logs = (circle, straight(command, tmp_path))
    assert command("tune", "logs", *logs, "--study", "alone", "--trials", "2") in (0, 1), command.error
    assert "on 1 held-out log after 2 trials" in command.out
    assert command("tune", "logs", "columns.toml", *logs, "--study", "columns", "--trials", "2") in (0, 1)
    assert "on 1 held-out log after 2 trials" in command.out
    if Path("tuning/alone/tuned.toml").exists():
        assert load_config("tuning/alone/tuned.toml").rover == load_rover(circle).rover
    assert command("tune", "logs", "columns.toml", "--study", "none") == 2
    assert_one_sentence(command.error, "name logs of this rover")
