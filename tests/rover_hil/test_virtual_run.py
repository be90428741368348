"""Whole virtual runs: deterministic, exactly replayable, and safe under faults."""

from pathlib import Path

import pytest

from controllers.safety import Mode
from drivers.clock import NANOSECONDS_PER_SECOND, nanoseconds
from drivers.errors import LogError
from rover_hil.config import Config, load_config
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.run.driving import run_virtual
from rover_hil.run.executive import End
from rover_hil.run.replay import ReplayResult, replay

FAULT_START_S = 2.0
FAULT_S = 1.0
DETECTION_LIMIT_S = 0.2
CYCLE_MARGIN_S = 0.021


def with_changes(name: str, **changes: object) -> Config:
    """Return a shipped configuration that settles fast, with dotted keys replaced; `__` is the dot."""
    table = load_config(name).model_dump(by_alias=True)
    table["safety"]["settle_s"] = 1.0
    for key, value in changes.items():
        place = table
        *parents, last = key.split("__")
        for parent in parents:
            place = place[parent]
        place[last] = value
    return Config.model_validate(table)


def records(path: Path, topic: str) -> list[dict[str, object]]:
    found = []
    for message in LogReader(path).messages():
        if message.topic == topic:
            record = message.json()
            assert isinstance(record, dict)
            found.append({**record, "logged_ns": message.t_ns})
    return found


def replay_file(path: Path) -> ReplayResult:
    log = LogReader(path)
    with restore_config(log) as config:
        return replay(log, config, lambda: None)


def content(path: Path) -> list[tuple[str, int, bytes]]:
    """Return all messages but those that hold measured computing times."""
    return [
        (message.topic, message.t_ns, message.data)
        for message in LogReader(path).messages()
        if message.topic != "/cycle"
    ]


def test_the_rectangle_is_finished_and_the_wheels_stand(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    result = run_virtual(load_config("robotino"), path, 60.0, None)
    assert result.end is End.FINISHED
    assert result.skipped == 0
    estimates = records(path, "/estimate")
    assert len(estimates) == result.cycles
    estimate = estimates[-1]["estimate"]
    assert isinstance(estimate, dict)
    assert abs(float(estimate["x_m"])) < 0.02
    assert abs(float(estimate["y_m"])) < 0.02
    truth = records(path, "/truth")
    assert max(float(str(record["x_m"])) for record in truth) > 0.5
    assert max(float(str(record["y_m"])) for record in truth) > 0.3


def test_the_same_seed_gives_the_same_log_and_another_one_does_not(tmp_path: Path) -> None:
    config = with_changes("robotino")
    for name in ("a", "b"):
        run_virtual(config, tmp_path / name, 4.0, None)
    run_virtual(with_changes("robotino", simulation__seed=99), tmp_path / "c", 4.0, None)
    assert content(tmp_path / "a") == content(tmp_path / "b")
    assert content(tmp_path / "a") != content(tmp_path / "c")


@pytest.mark.parametrize("name", ["robotino", "el-dorado"])
def test_replay_is_exact(name: str, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    result = run_virtual(with_changes(name), path, 3.0, None)
    replayed = replay_file(path)
    assert replayed.cycles == result.cycles
    assert replayed.differences == []


@pytest.mark.parametrize(("factor", "field"), [(1 + 1e-9, "estimate.exact"), (1.1, "estimate.odometry.x_m")])
def test_replay_notices_a_changed_estimate(tmp_path: Path, factor: float, field: str) -> None:
    path = tmp_path / "run.mcap"
    run_virtual(with_changes("robotino"), path, 2.0, None)
    log = LogReader(path)
    with restore_config(log) as config:
        table = config.model_dump(by_alias=True)
        table["rover"]["wheel_radius_m"] *= factor
        result = replay(log, Config.model_validate(table), lambda: None)
    assert field in {difference.field for difference in result.differences}


def test_replay_refuses_a_device_that_the_configuration_lacks(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    run_virtual(load_config("robotino"), path, 1.0, None)
    log = LogReader(path)
    with restore_config(log) as config:
        table = config.model_dump(by_alias=True)
        del table["devices"]["imu"]
        table["roles"]["gyro"] = table["slip"] = None
        with pytest.raises(LogError, match="device 'imu'"):
            replay(log, Config.model_validate(table), lambda: None)


@pytest.mark.parametrize("kind", ["unplug", "freeze"])
@pytest.mark.parametrize(
    ("name", "device"),
    [
        ("robotino", "board"),
        ("robotino", "imu"),
        pytest.param("el-dorado", "compass", marks=pytest.mark.nightly),
        pytest.param("el-dorado", "wheels", marks=pytest.mark.nightly),
        pytest.param("el-dorado", "imu", marks=pytest.mark.nightly),
    ],
)
def test_a_lost_device_stops_the_rover_and_a_returned_one_lets_it_go_on(
    name: str, device: str, kind: str, tmp_path: Path
) -> None:
    fault = {"type": kind, "device": device, "start_s": FAULT_START_S, "duration_s": FAULT_S}
    path = tmp_path / "run.mcap"
    run_virtual(with_changes(name, simulation__faults=[fault]), path, 4.5, None)
    start_ns = LogReader(path).start_ns
    begin_ns = start_ns + nanoseconds(FAULT_START_S)
    end_ns = begin_ns + nanoseconds(FAULT_S)
    modes = [(int(str(r["t_ns"])), str(r["mode"]), str(r["reason"])) for r in records(path, "/estimate")]
    stopped_ns, reason = next((t, why) for t, mode, why in modes if mode == Mode.SAFE_STOP)
    assert begin_ns <= stopped_ns <= begin_ns + nanoseconds(DETECTION_LIMIT_S + CYCLE_MARGIN_S)
    assert reason.startswith(device)
    resumed_ns = next(t for t, mode, _ in modes if t > stopped_ns and mode == Mode.RUNNING)
    assert end_ns < resumed_ns < end_ns + nanoseconds(1.0)
    commands = records(path, "/command")
    while_stopped = [c["speed_rad_s"] for c in commands if stopped_ns <= int(str(c["t_ns"])) < resumed_ns]
    assert while_stopped
    assert all(set(speeds) == {0.0} for speeds in while_stopped)  # type: ignore[call-overload]
    assert replay_file(path).differences == []


def test_the_first_set_points_after_a_stop_grow_from_standstill(tmp_path: Path) -> None:
    fault = {"type": "unplug", "device": "imu", "start_s": FAULT_START_S, "duration_s": 0.5}
    path = tmp_path / "run.mcap"
    config = with_changes("robotino", simulation__faults=[fault])
    run_virtual(config, path, 6.0, None)
    acceleration = config.limits.wheel_acceleration_rad_s2
    previous: tuple[int, list[float]] | None = None
    for record in records(path, "/estimate"):
        command = record["command"]
        assert isinstance(command, dict)
        t_ns, speeds = int(command["t_ns"]), command["speed_rad_s"]
        if previous is not None and record["mode"] == Mode.RUNNING:
            step_s = (t_ns - previous[0]) / NANOSECONDS_PER_SECOND
            for before, now in zip(previous[1], speeds, strict=True):
                assert abs(now) - abs(before) <= acceleration * step_s + 1e-9
        previous = (t_ns, speeds)


@pytest.mark.parametrize("kind", ["drop", "duplicate", "reorder", "corrupt"])
def test_a_bad_line_never_breaks_the_loop(kind: str, tmp_path: Path) -> None:
    faults = [
        {"type": kind, "device": device, "start_s": 1.5, "duration_s": 3.0, "probability": 0.3}
        for device in ("board", "imu")
    ]
    path = tmp_path / "run.mcap"
    result = run_virtual(with_changes("robotino", simulation__faults=faults), path, 6.0, None)
    assert result.cycles == 300
    for record in records(path, "/estimate"):
        estimate = record["estimate"]
        assert isinstance(estimate, dict)
        assert abs(float(estimate["x_m"])) < 2.0
    assert replay_file(path).differences == []


def test_the_bumper_ends_the_run_and_the_wheels_stand(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    result = run_virtual(with_changes("robotino", simulation__plant__bumper_x_m=0.2), path, 20.0, None)
    assert result.end is End.EMERGENCY_STOP
    assert result.reason == "board: bumper pressed"
    assert records(path, "/command")[-1]["speed_rad_s"] == [0.0, 0.0, 0.0]


def test_time_limit_ends_the_run(tmp_path: Path) -> None:
    result = run_virtual(with_changes("robotino"), tmp_path / "run.mcap", 2.0, None)
    assert result.end is End.TIME_OVER
    assert result.mode is Mode.RUNNING
