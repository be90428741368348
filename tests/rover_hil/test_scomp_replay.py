"""`rover-hil scomp LOG`: the cycles of a log run again, and smoothed."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from controllers.slip.scomp.parameters import ScompParameters
from drivers.errors import LogError
from rover_hil.config import Config, load_config
from rover_hil.drives.drive import read_drive
from rover_hil.recording.data_files import collect_data_files, restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.recording.writer import LogWriter
from rover_hil.run.driving import run_virtual
from rover_hil.scomp.command import run_scomp
from rover_hil.scomp.drive import Track
from rover_hil.scomp.files import log_truth, parameters_text
from rover_hil.scomp.odometry import Result
from rover_hil.scomp.replayed import replay_track


@dataclass(frozen=True)
class Replays:
    """The same log as the rover knew it then, and by the whole drive."""

    log: Path
    online: Result
    whole: Result


@pytest.fixture(scope="module")
def replays(el_dorado_log: Path) -> Replays:
    reader = LogReader(el_dorado_log)
    with restore_config(reader) as config:
        online, whole = (
            replay_track(LogReader(el_dorado_log), config, online=flag) for flag in (True, False)
        )
    return Replays(el_dorado_log, online, whole)


def recorded(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return times of the wheels and slips of the estimates in a log."""
    reader = LogReader(path)
    records = [json.loads(each.data) for each in reader.messages() if each.topic == "/estimate"]
    rows = [(each["estimate"]["t_ns"], each["drift"]["slip"]) for each in records if each["drift"]]
    t_ns, slip = np.array(rows).T
    return (t_ns - reader.start_ns) / 1e9, slip


def off_m(track: Track, log: Path) -> np.ndarray:
    """Return the error of the position at the times of the ground truth."""
    path = log_truth(read_drive(log))
    use = (path.t_s >= track.t_s[0]) & (path.t_s <= track.t_s[-1])
    t_s = path.t_s[use]
    x_m, y_m = np.interp(t_s, track.t_s, track.x_m), np.interp(t_s, track.t_s, track.y_m)
    off: np.ndarray = np.hypot(x_m - path.x_m[use], y_m - path.y_m[use])
    return off


def test_online_the_slip_is_the_one_that_the_run_recorded(replays: Replays) -> None:
    t_s, slip = recorded(replays.log)
    track = replays.online.track
    at = np.searchsorted(t_s, track.t_s)
    assert t_s[at] == pytest.approx(track.t_s)
    moves = track.slip != 0.0
    assert moves.sum() > 100
    # A step linearises the slip law every 0.1 s; the recorded slip is that of the last one.
    assert np.median(np.abs(slip[at] - track.slip)[moves]) < 0.003


def test_smoothed_the_path_ends_as_online_and_is_no_less_right(replays: Replays) -> None:
    online, whole = replays.online.track, replays.whole.track
    assert (whole.x_m[-1], whole.y_m[-1]) == pytest.approx((online.x_m[-1], online.y_m[-1]))
    online_m, whole_m = (float(np.sqrt(np.mean(off_m(each, replays.log) ** 2))) for each in (online, whole))
    assert whole_m < 1.05 * online_m
    middle = len(whole.t_s) // 2
    assert whole.sigma_x_m[middle] <= online.sigma_x_m[middle]
    assert off_m(whole, replays.log)[-1] < 3.0 * np.hypot(whole.sigma_x_m[-1], whole.sigma_y_m[-1])


def test_every_trace_that_the_run_used_is_used_with_its_confidence(replays: Replays) -> None:
    records = [json.loads(m.data) for m in LogReader(replays.log).messages() if m.topic == "/estimate"]
    used = [i for each in records for i in each["innovations"] if i["name"].startswith("trace")]
    again = [i for i in replays.whole.innovations if i.name.startswith("trace")]
    assert len(used) > 10
    assert [i.variance for i in again] == pytest.approx([i["variance"] for i in used], rel=1e-5)


@pytest.mark.slow
def test_without_parameters_those_of_the_log_are_used(
    el_dorado_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.toml"
    other.write_text(parameters_text(ScompParameters()), "utf-8")
    found = []
    for params in (None, other):
        out = tmp_path / "path.csv"
        assert run_scomp(el_dorado_log, params=params, out=out, force=True, as_json=True) == 0
        found.append(json.loads(capsys.readouterr().out))
    note = "no --params: those of [scomp] and [filter] in the log are used"
    assert [note in each["notes"] for each in found] == [True, False]
    assert abs(found[0]["mean_slip"] - found[1]["mean_slip"]) > 0.005


@pytest.mark.slow
def test_a_rover_that_drove_without_scomp_is_replayed_with_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = load_config("el-dorado").model_dump(by_alias=True)
    camera, table["roles"]["camera"], table["scomp"] = table["roles"]["camera"], None, None
    table["roles"]["require_camera"] = False
    for devices in (table["devices"], table["simulation"]["devices"]):
        devices.pop(camera, None)
    run_virtual(Config.model_validate(table), tmp_path / "run.mcap", 12.0, None)
    assert run_scomp(tmp_path / "run.mcap", out=tmp_path / "path.csv", as_json=True) == 0
    found = json.loads(capsys.readouterr().out)
    assert "no --params: lunar soil simulant is assumed" in found["notes"]
    path = log_truth(read_drive(tmp_path / "run.mcap"))
    assert abs(found["x_m"] - path.x_m[-1]) < 3.0 * found["sigma_x_m"]
    assert found["mean_slip"] > 0.01


@pytest.mark.parametrize("has_params", [False, True])
def test_a_rover_with_three_wheels_is_refused(robotino_log: Path, tmp_path: Path, has_params: bool) -> None:
    params = tmp_path / "sand.toml"
    params.write_text(parameters_text(ScompParameters()), "utf-8")
    with pytest.raises(LogError, match="sComp needs four wheels"):
        run_scomp(robotino_log, params=params if has_params else None, out=tmp_path / "path.csv")


def test_a_log_without_cycles_is_refused(tmp_path: Path) -> None:
    config, path = load_config("el-dorado"), tmp_path / "run.mcap"
    content = config.model_dump_json(by_alias=True).encode()
    with LogWriter(path, 1_000_000_000, content, collect_data_files(config), "virtual"):
        pass
    with pytest.raises(LogError, match="fewer than two cycles"):
        run_scomp(path, out=tmp_path / "path.csv")
