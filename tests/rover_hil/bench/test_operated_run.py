"""A run that someone operates is logged with every input, and replays exactly."""

import json
from collections.abc import Mapping
from pathlib import Path

import pytest

from controllers.control_loop import ControlLoop
from controllers.motion.settings import WaypointsMission
from controllers.operator import OperatorInput, check_gains, gain_ranges
from controllers.safety import Mode
from drivers.clock import seconds
from drivers.errors import ConfigError
from rover_hil.config import Config, load_config
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.run.driving import run_virtual
from rover_hil.run.executive import CycleView, End
from rover_hil.run.replay import replay
from tests.rover_hil.bench.rovers import by_hand, quick

PLAN: Mapping[int, OperatorInput] = {
    40: OperatorInput(gains={"lookahead_m": 0.5, "heading_gain_per_s": 3.0}),
    60: OperatorInput(is_paused=True),
    80: OperatorInput(is_paused=False, gains={"speed_m_s": 0.3}),
}


class Script:
    """Operates by the number of the cycle, and keeps what it is shown."""

    def __init__(self, plan: Mapping[int, OperatorInput], end_at: int) -> None:
        self.views: list[CycleView] = []
        self._plan = plan
        self._end_at = end_at

    def wanted(self) -> OperatorInput | None:
        return self._plan.get(len(self.views))

    def end(self) -> tuple[End, str] | None:
        return (End.EMERGENCY_STOP, "pressed") if len(self.views) >= self._end_at else None

    def show(self, view: CycleView) -> None:
        self.views.append(view)


def drive(config: Config, folder: Path, script: Script) -> Path:
    path = folder / "run.mcap"
    result = run_virtual(config, path, 30.0, None, operator=script)
    assert (result.end, result.reason) == (End.EMERGENCY_STOP, "pressed")
    return path


def operator_records(path: Path) -> list[dict[str, object]]:
    return [
        json.loads(message.data) for message in LogReader(path).messages() if message.topic == "/operator"
    ]


def differences(path: Path) -> list[str]:
    log = LogReader(path)
    with restore_config(log) as config:
        return [difference.field for difference in replay(log, config, lambda: None).differences]


def test_a_pause_rests_and_a_new_gain_acts_and_all_replays(tmp_path: Path) -> None:
    script = Script(PLAN, 120)
    path = drive(quick(), tmp_path, script)
    modes = [view.output.mode for view in script.views]
    assert modes[59] is Mode.RUNNING
    assert modes[60] is Mode.PAUSED
    assert not any(any(view.sent.speed_rad_s) for view in script.views[60:80])
    assert modes[81] is Mode.RUNNING
    assert any(script.views[-1].sent.speed_rad_s)
    assert differences(path) == []


def test_while_the_operator_is_lost_the_rover_rests_and_then_drives_on_and_all_replays(
    tmp_path: Path,
) -> None:
    lost = "page: the script of the page in control did not answer for 0.5 s"
    plan = {60: OperatorInput(stop_reason=lost), 80: OperatorInput(stop_reason="", is_confirmed=True)}
    script = Script(plan, 130)
    path = drive(quick(), tmp_path, script)
    outputs = [view.output for view in script.views]
    assert outputs[59].mode is Mode.RUNNING
    assert all((outputs[n].mode, outputs[n].reason) == (Mode.SAFE_STOP, lost) for n in range(60, 80))
    assert not any(any(view.sent.speed_rad_s) for view in script.views[60:80])
    assert outputs[110].mode is Mode.RUNNING  # recover_s later
    assert any(script.views[-1].sent.speed_rad_s)
    assert differences(path) == []
    records = operator_records(path)
    assert ["is_confirmed" in record for record in records] == [False, True]
    assert records[1]["is_confirmed"] is True


def test_a_replay_passes_a_confirmation_to_the_loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = {40: OperatorInput(is_confirmed=True), 50: OperatorInput(is_paused=True)}
    path = drive(quick(), tmp_path, Script(plan, 60))
    seen = list[bool]()
    operate = ControlLoop.operate

    def note(loop: ControlLoop, now_ns: int, wanted: OperatorInput) -> None:
        seen.append(wanted.is_confirmed)
        operate(loop, now_ns, wanted)

    monkeypatch.setattr(ControlLoop, "operate", note)
    assert differences(path) == []
    assert seen == [True, False]


def test_logs_from_before_the_operator_could_be_lost_replay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def old_record(wanted: OperatorInput) -> dict[str, object]:
        return {"is_paused": wanted.is_paused, "motion": wanted.motion, "gains": wanted.gains}

    monkeypatch.setattr("rover_hil.run.executive.operator_record", old_record)
    assert differences(drive(quick(), tmp_path, Script(PLAN, 120))) == []


def test_without_the_records_of_the_operator_the_replay_differs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = drive(quick(), tmp_path, Script(PLAN, 120))
    records = operator_records(path)
    assert [record["gains"] for record in records] == [PLAN[n].gains for n in (40, 60, 80)]
    monkeypatch.setattr("rover_hil.run.replay.Replayer._operate", lambda *arguments: None)
    assert "estimate.mode" in differences(path)


def test_by_hand_the_rover_moves_while_told_and_stops_300_ms_after_the_last_word(tmp_path: Path) -> None:
    words = {cycle: OperatorInput(motion=(0.1, 0.0, 0.2)) for cycle in range(30, 70, 3)}
    script = Script(words, 120)
    path = drive(by_hand(), tmp_path, script)
    moving = [index for index, view in enumerate(script.views) if any(view.sent.speed_rad_s)]
    assert moving[0] <= 32
    last_word_ns, stopped_ns = (script.views[index].output.t_ns for index in (max(words), moving[-1] + 1))
    assert seconds(stopped_ns - last_word_ns) <= 0.3
    assert differences(path) == []


def test_a_gain_outside_its_range_is_refused_with_one_sentence() -> None:
    ranges = gain_ranges(load_config("robotino"))
    with pytest.raises(ConfigError, match=r"mission.lookahead_m is 9, outside 0.02 .. 5 m"):
        check_gains(ranges, {"lookahead_m": 9.0})
    with pytest.raises(ConfigError, match=r"mission.length_m cannot be changed while the rover runs"):
        check_gains(ranges, {"length_m": 1.0})
    low_m_s, _ = ranges["speed_m_s"]
    assert low_m_s == pytest.approx(0.5 * 0.04)  # slower, no stall could be noticed


def test_a_speed_that_no_leg_is_driven_with_cannot_be_changed() -> None:
    """Else someone would lower it, and the rover would not slow down."""
    config = load_config("robotino")
    legs = {"type": "waypoints", "points": ((1.0, 0.0),)}
    for speeds_m_s, is_allowed in (((), True), ((0.15,), False)):
        mission = WaypointsMission.model_validate({**legs, "speeds_m_s": speeds_m_s})
        ranges = gain_ranges(config.model_copy(update={"mission": mission}))
        assert ("speed_m_s" in ranges) == is_allowed
        assert "lookahead_m" in ranges
