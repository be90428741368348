"""Drives of one rover that differ by what the model declares are no gap, and the answer tells by how much."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rover_hil.gap.machines.parameters import MACHINES
from rover_hil.gap.output.results import REPORT_NAME, VERDICT_NAME
from sim_backends.plants.wheels.settings import WheelsPlantSettings
from sim_backends.wheels_model.model import BASE_SCATTER, RADIUS_SCATTER, WheelsModel
from tests.nature.differential_drive import TrueDifferential, record
from tests.rover_hil.command import Command
from tests.rover_hil.gap.test_rover_of_wheels import DIFFERENTIAL, ROOT, write_log

SHARES = np.array([-1.3, 1.2, 0.6, -1.0, 1.1, -0.6])
"""Deviations of the drives, in standard deviations: their root mean square is 1."""
EXACT = TrueDifferential(pose_noise_m=0.00003, pose_noise_rad=0.0001, gyro_noise=0.0005)


class OneRover(WheelsModel):
    """The model without what differs between drives."""

    def __init__(self, settings: WheelsPlantSettings) -> None:
        super().__init__(settings)
        self.parameters = tuple(replace(one, scatter_sd=0.0) for one in self.parameters)


def write_drives(folder: Path, radii: Sequence[float], tracks: Sequence[float]) -> Path:
    """Write drives whose radius and track differ by these shares."""
    rng = np.random.default_rng(0)
    for number, (radius, track) in enumerate(zip(radii, tracks, strict=True)):
        rover = replace(
            EXACT, radius_m=EXACT.radius_m * (1.0 + radius), track_m=EXACT.track_m * (1.0 + track)
        )
        write_log(folder / f"{number}" / "run.mcap", record(rover, rng), "truth")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("is_declared", [True, False])
def test_drives_that_differ_as_declared_are_no_gap(
    command: Command,
    tmp_path: Path,
    unrendered: None,
    monkeypatch: pytest.MonkeyPatch,
    *,
    is_declared: bool,
) -> None:
    monkeypatch.chdir(ROOT)
    if not is_declared:
        monkeypatch.setattr("rover_hil.gap.command.find.WheelsModel", OneRover)
    radii, tracks = 1.5 * RADIUS_SCATTER * SHARES, 1.5 * BASE_SCATTER * SHARES[::-1]
    runs, out = write_drives(tmp_path / "runs", radii.tolist(), tracks.tolist()), tmp_path / "gap"
    assert command("gap", "rover", DIFFERENTIAL, str(runs), "--out", str(out)) == 0
    verdict = json.loads((out / VERDICT_NAME).read_text("utf-8"))
    assert verdict["verdict"] == "NO_GAP", verdict["sentence"]
    assert not verdict["effects"]
    assert (verdict["p_gap"] > MACHINES.tests.alpha) is is_declared, verdict["sentence"]
    if not is_declared:
        # The engine learns it, and says so, as long as the error is below the tolerance.
        assert "parameters differ between runs (radius_error by 0.00" in verdict["sentence"]
        return
    found = {one["name"]: one for one in verdict["base_parameters"]}
    assert found["radius_error"]["scatter_sd"] == RADIUS_SCATTER
    assert found["radius_error"]["scatter"] == pytest.approx(1.5 * RADIUS_SCATTER, rel=0.4)
    assert found["marker_x_m"]["scatter"] == 0.0
    told = f"{found['radius_error']['scatter']:.2g}"
    line = next(one for one in command.out.splitlines() if one.startswith("radius_error"))
    assert line.split()[-1] == told
    assert f"{told} ({RADIUS_SCATTER:.2g})" in (out / REPORT_NAME).read_text("utf-8")
