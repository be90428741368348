"""The yaw excitation in whole missions: what the stop rules see of it, and logs of earlier versions."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.safety.missions import drive
from controllers.safety import Mode
from controllers.safety.reasons import Cycle
from controllers.safety.stall_monitor import StallMonitor
from drivers.errors import LogError
from rover_hil.config import Config, load_config
from rover_hil.drive.replay import refuse_old_excitation

RIM_RAD_S = 0.2 * 0.15 / 0.04
"""Swing of each wheel: a fifth of the travel."""


def test_a_wheel_at_rest_that_swings_has_no_set_point_for_the_stall_monitor(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: list[tuple[float, ...]] = []
    check = StallMonitor.check

    def watched(monitor: StallMonitor, cycle: Cycle) -> object:
        seen.append(cycle.wheels.set.speed_rad_s)
        return check(monitor, cycle)

    monkeypatch.setattr(StallMonitor, "check", watched)
    driven = drive(load_config("robotino"), limit_s=10.5)
    # After the turn back and forth in place.
    moments = [moment for moment in driven.moments if moment.output.mode is Mode.RUNNING and moment.t_s > 9.0]
    sent = np.array([moment.output.command.speed_rad_s for moment in moments])
    # Ahead on the first side: wheel 1 is the one behind, which does not roll.
    assert np.ptp(sent[:, 1]) > 1.6 * RIM_RAD_S
    assert np.ptp(np.array(seen)[-len(moments) :, 1]) < 0.5 * RIM_RAD_S


def test_a_log_whose_slip_was_read_by_fitted_constants_is_refused_in_one_sentence() -> None:
    table = json.loads(load_config("robotino").model_dump_json(by_alias=True))
    refuse_old_excitation(Config.model_validate(table), Path("new.mcap"))
    del table["slip"]["excitation"]
    old = Config.model_validate(table)
    with pytest.raises(LogError, match="replay it with the version that made it"):
        refuse_old_excitation(old, Path("old.mcap"))
    table["slip"]["use"] = "surfaces"
    refuse_old_excitation(Config.model_validate(table), Path("old.mcap"))
