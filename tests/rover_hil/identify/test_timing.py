"""`rover-hil calibrate time` on turns of which the offset of every device is known."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from drivers.samples import HeadingReference, HeadingSample, PoseFixSample, RateSample, Sample, WheelSample
from rover_hil.config import Config
from rover_hil.ready.time import calibration
from rover_hil.ready.time.fit import YawTrack, find_offsets, read_tracks
from rover_hil.recording.data_files import collect_data_files
from rover_hil.recording.writer import LogWriter
from tests.cases import first_often
from tests.rover_hil.command import Command, assert_one_sentence
from tests.rover_hil.identify.compass_logs import CONFIG, START_NS

GYRO_S, WHEELS_S, COMPASS_S, CAMERA_S = 0.01, 0.03, 0.42, 0.13
"""How much later than the truth each device stamps what it measured."""
RADIUS_M, TRACK_M = 0.1, 0.6
WAVES = ((0.8, 0.11, 0.3), (0.5, 0.23, 1.9), (0.3, 0.41, 4.0))
"""Amplitude in rad, frequency in Hz and phase of the yaw."""


def yaw_at(t_s: float, rate_rad_s: float) -> float:
    turning = sum(size * math.sin(math.tau * each * t_s + phase) for size, each, phase in WAVES)
    return rate_rad_s * t_s + (0.0 if rate_rad_s else turning)


def yaw_rate_at(t_s: float, rate_rad_s: float) -> float:
    return (yaw_at(t_s + 1e-4, rate_rad_s) - yaw_at(t_s - 1e-4, rate_rad_s)) / 2e-4


def write_log(
    path: Path, *, seed: int, seconds: float = 44.0, steady_rad_s: float = 0.0, sign: float = 1.0
) -> Path:
    """Write what the devices of a rover sent that turns back and forth, or steadily."""
    config, rng = Config.model_validate(CONFIG), np.random.default_rng(seed)
    events: list[tuple[int, Sample]] = []

    def stamp(t_s: float, late_s: float) -> int:
        return START_NS + round(1e9 * (t_s + late_s))

    for t in np.arange(1.0, seconds, 0.04).tolist():
        rate = 1.01 * yaw_rate_at(t, steady_rad_s) + 0.003 + rng.normal(0.0, 0.002)
        t_ns = stamp(t, GYRO_S)
        events.append((t_ns, RateSample(device="imu", t_ns=t_ns, rate_z_rad_s=sign * rate)))
        turned = 0.5 * TRACK_M * yaw_at(t, steady_rad_s) / RADIUS_M
        t_ns = stamp(t, WHEELS_S)
        for wheel, side in enumerate((-1.0, 1.0, -1.0, 1.0)):
            angle = side * turned + rng.normal(0.0, 0.001)
            events.append((t_ns, WheelSample(device="wheels", t_ns=t_ns, wheel=wheel, position_rad=angle)))
    for t in np.arange(1.0, seconds, 0.1).tolist():
        yaw, t_ns = yaw_at(t, steady_rad_s), stamp(t, COMPASS_S)
        shown = math.remainder(yaw + 0.05 * math.sin(yaw) + rng.normal(0.0, 0.006), math.tau)
        heading = HeadingSample(
            device="compass", t_ns=t_ns, heading_rad=shown, reference=HeadingReference.MAGNETIC
        )
        events.append((t_ns, heading))
        t_ns = stamp(t, CAMERA_S)
        fix = PoseFixSample(
            device="overhead", t_ns=t_ns + 40_000_000, t_capture_ns=t_ns, x_m=0.0, y_m=0.0,
            yaw_rad=math.remainder(yaw + rng.normal(0.0, 0.003), math.tau),
            position_std_m=0.01, yaw_std_rad=0.01,
        )  # fmt: skip
        events.append((t_ns + 40_000_000, fix))
    with LogWriter(
        path, START_NS, config.model_dump_json(by_alias=True).encode(), collect_data_files(config), "real"
    ) as log:
        for t_ns, sample in sorted(events, key=lambda each: each[0]):
            log.samples(t_ns, [sample])
    return path


@pytest.mark.parametrize("seed", first_often([31, 32]))
def test_the_offset_of_every_device_is_found(tmp_path: Path, seed: int) -> None:
    offsets = find_offsets(read_tracks(write_log(tmp_path / "turns.mcap", seed=seed)))
    found = {each.track.kind: each for each in offsets}
    expected = {"wheels": WHEELS_S, "heading": COMPASS_S, "fixes": CAMERA_S}
    assert set(found) == set(expected)
    for kind, late_s in expected.items():
        assert found[kind].problem == ""
        assert found[kind].offset_s == pytest.approx(late_s - GYRO_S, abs=max(0.003, 3.0 * found[kind].sd_s))
        assert found[kind].sd_s < 0.01
    assert found["wheels"].gain == pytest.approx(1.0 / 1.01, abs=0.005)


def test_the_command_writes_offsets_and_a_picture(command: Command, tmp_path: Path) -> None:
    write_log(tmp_path / "turns.mcap", seed=33)
    assert command("calibrate", "time", "turns.mcap", "--out", "times.toml", "--json") == 0
    record = json.loads(command.out)
    assert record["reference"] == "gyro 'imu'"
    assert record["offsets"]["compass 'compass'"]["offset_s"] == pytest.approx(COMPASS_S - GYRO_S, abs=0.01)
    assert "[[offset]]" in (tmp_path / "times.toml").read_text("utf-8")
    assert "one clear minimum" in (tmp_path / "times.html").read_text("utf-8")
    assert command("calibrate", "time", "turns.mcap", "--out", "times.toml") == 2
    assert_one_sentence(command.error, "times.toml exists", "--force")
    assert command("calibrate", "time", "nowhere.mcap") == 2
    assert_one_sentence(command.error, "cannot read log nowhere.mcap")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"steady_rad_s": 0.4}, "record turns that begin and end"),
        ({"seconds": 12.0}, "record turns that begin and end"),
        ({"sign": -1.0}, "of its turns are not those of the reference"),
    ],
    ids=["steady turns", "short log", "gyro upside down"],
)
def test_turns_that_show_no_offset_give_none(
    command: Command, tmp_path: Path, changes: dict[str, float], words: str
) -> None:
    write_log(tmp_path / "turns.mcap", seed=34, **changes)
    assert command("calibrate", "time", "turns.mcap", "--out", "times.toml") == 1
    assert command.out.count(words) == 3
    assert not (tmp_path / "times.toml").exists()


def test_a_camera_says_what_a_rolling_shutter_would_add(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    late_s = 0.05
    t_s = np.arange(1.0, 44.0, 0.1)
    yaws = [np.array([yaw_at(t, 0.0) for t in times.tolist()]) for times in (t_s, t_s - late_s)]
    gyro = YawTrack("gyro 'imu'", "gyro", "imu", t_s, yaws[0])
    camera = YawTrack("ground camera 'eye'", "ground", "eye", t_s, yaws[1], 0.7, 0.1)
    monkeypatch.setattr(calibration, "read_tracks", lambda path: [gyro, camera])
    assert command("calibrate", "time", "turns.mcap") == 0
    words = " ".join(command.out.split())
    assert "with a global shutter" in words
    assert "then subtract 0.70 of its readout, at most 0.0700" in words
    assert find_offsets([gyro, camera])[0].offset_s == pytest.approx(late_s, abs=0.005)
