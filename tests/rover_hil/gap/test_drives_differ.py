"""Drives of one rover that differ by a few tenths of a percent are no gap; the answer states by how much."""

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.gap.drive_logs import write_log
from rover_hil.config import load_config
from rover_hil.gap.output.results import VERDICT_NAME
from tests.nature.differential_drive import TrueDifferential, record
from tests.rover_hil.command import Command
from tests.rover_hil.gap.test_rover_of_wheels import DIFFERENTIAL, ROOT

SHARES = np.array([-1.3, 1.2, 0.6, -1.0, 1.1, -0.6])
"""Deviations of the drives, in standard deviations: their root mean square is 1."""
RADIUS_SD = 0.0025
TRACK_SD = 0.003
EXACT = TrueDifferential(pose_noise_m=0.00003, pose_noise_rad=0.0001, gyro_noise=0.0005)


def write_drives(folder: Path, radii: Sequence[float], tracks: Sequence[float]) -> Path:
    """Write drives whose radius and track differ by these shares."""
    rng, config = np.random.default_rng(0), load_config(DIFFERENTIAL)
    for number, (radius, track) in enumerate(zip(radii, tracks, strict=True)):
        rover = replace(
            EXACT, radius_m=EXACT.radius_m * (1.0 + radius), track_m=EXACT.track_m * (1.0 + track)
        )
        write_log(folder / f"{number}" / "run.mcap", config, record(rover, rng))
    return folder


@pytest.mark.slow
def test_drives_that_differ_are_no_gap_and_the_answer_says_by_how_much(
    command: Command, tmp_path: Path, unrendered: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    radii, tracks = RADIUS_SD * SHARES, TRACK_SD * SHARES[::-1]
    runs, out = write_drives(tmp_path / "runs", radii.tolist(), tracks.tolist()), tmp_path / "gap"
    assert command("gap", "rover", DIFFERENTIAL, str(runs), "--out", str(out)) == 0
    verdict = json.loads((out / VERDICT_NAME).read_text("utf-8"))
    assert verdict["verdict"] == "NO_GAP", verdict["sentence"]
    assert not verdict["effects"]
    (told,) = re.findall(r"parameters differ between runs \(radius_error by ([0-9.]+)", verdict["sentence"])
    assert float(told) == pytest.approx(RADIUS_SD, rel=0.4)
