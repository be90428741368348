"""Records with dropped samples and a slow channel, through the whole command."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rover_hil.gap import Channel, StateModel
from sim_backends.models.interface import Array
from sim_backends.state_model.equations import Signal
from tests.rover_hil.command import Command
from tests.rover_hil.gap.small_machine import MODEL, small_runs

DROPPED = ("run0,2.9,", "run1,1.3,", "run1,1.4,")
EVERY = 3


def two_outputs(x: SimpleNamespace, _: SimpleNamespace, __: SimpleNamespace, ___: Signal) -> dict[str, Array]:
    return {"reading": x.warmth, "slow_reading": 2.0 * x.warmth}


def make() -> StateModel:
    """Return the small machine with a second, slow sensor; its times are in the data."""
    slow = Channel(name="slow_reading", unit="K", sigma=0.02)
    return replace(
        MODEL,
        step_s=None,
        channels=(*MODEL.channels, slow),
        output=two_outputs,
        port_effects=MODEL.port_effects[:1],
    )


def written(path: Path, gain: float) -> Path:
    """Write runs of a machine with another gain: three lost rows, the slow channel in every third one."""
    model = make()
    true = replace(model, parameters=(replace(model.parameters[0], nominal=gain), model.parameters[1]))
    lines = ["run,time [s],power [W],reading [K],slow_reading [K]"]
    for run in small_runs(true, count=6):
        for index, power in enumerate(run.inputs["power"]):
            slow = f"{run.measured['slow_reading'][index]:.5f}" if index % EVERY == 0 else ""
            row = f"{run.name},{0.1 * index:.6g},{power:.5f},{run.measured['reading'][index]:.5f},{slow}"
            if not row.startswith(DROPPED):
                lines.append(row)
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(("gain", "answer"), [(1.0, "NO_GAP"), (1.4, "NAMED")])
def test_dropped_rows_and_empty_cells_of_a_slow_channel_change_no_answer(
    command: Command, tmp_path: Path, unrendered: None, gain: float, answer: str
) -> None:
    data = written(tmp_path / "runs.csv", gain)
    assert command("gap", f"{__file__}:make", str(data), "--out", str(tmp_path / "out")) == 0
    verdict = json.loads((tmp_path / "out" / "verdict.json").read_text("utf-8"))
    assert verdict["verdict"] == answer, verdict["sentence"]
    fitted = {one["name"]: one for one in verdict["base_parameters"]}
    low, high = fitted["gain"]["ci95"]
    assert low < gain < high
    assert high - low < 0.05
    assert {(one["run"], one["series"], one["count"]) for one in verdict["missing"]} >= {
        ("run0", "power", 1),
        ("run0", "reading", 1),
        ("run1", "power", 2),
        ("run1", "reading", 2),
    }
    assert not np.any([one["count"] > 2 for one in verdict["missing"]])
