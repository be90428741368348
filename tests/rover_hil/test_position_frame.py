"""The frame of positions is estimated over the whole drive, and poses are written in it."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.nature.odd_drives.__main__ import write_case
from tests.nature.odd_drives.sound import SOUND
from tests.rover_hil.command import Command

CASES = {case.name: case for case in SOUND}


@pytest.mark.usefixtures("unrendered")
@pytest.mark.parametrize("seed", [1, 2])
def test_replay_writes_the_poses_in_the_frame_of_the_positions(
    command: Command, tmp_path: Path, seed: int
) -> None:
    folder = tmp_path / "drive"
    write_case(CASES["large_gnss_half_metre"], folder, np.random.default_rng(seed))
    answer = json.loads((folder / "answer.json").read_text("utf-8"))
    table, columns = str(folder / "table.csv.gz"), str(folder / "columns.toml")
    assert command("import", "table", table, "--columns", columns, "--out", "drive.mcap") == 0, command.error
    assert command("replay", "drive.mcap", "--out", "page", "--json") == 0, command.error
    frame = json.loads(command.out)["position_frame"]
    start, end = answer["true_path"][0], answer["true_path"][-1]
    error_rad = (frame["turned_rad"] - start[3] + np.pi) % (2.0 * np.pi) - np.pi
    assert abs(error_rad) < 3.0 * frame["turned_sd_rad"] < 0.3
    poses = np.loadtxt("page/poses_in_frame.csv", delimiter=",", skiprows=1)
    # Positions count from the first one, which has the error of the receiver.
    went = poses[-1, 1:3] - poses[0, 1:3]
    way = np.array(end[1:3]) - np.array(start[1:3])
    assert np.hypot(*(went - way)) < 0.1 * np.hypot(*way) + 1.0
    assert poses[-1, 1:3].tolist() == pytest.approx([frame["end"]["x_m"], frame["end"]["y_m"]], abs=1e-5)


@pytest.mark.usefixtures("unrendered")
def test_without_positions_there_is_no_frame(command: Command, tmp_path: Path) -> None:
    folder = tmp_path / "drive"
    write_case(CASES["small_plain"], folder, np.random.default_rng(1))
    table, columns = str(folder / "table.csv.gz"), str(folder / "columns.toml")
    assert command("import", "table", table, "--columns", columns, "--out", "drive.mcap") == 0, command.error
    assert command("replay", "drive.mcap", "--out", "page", "--json") == 0, command.error
    assert json.loads(command.out)["position_frame"] is None
    assert not Path("page/poses_in_frame.csv").exists()
