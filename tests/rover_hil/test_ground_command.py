"""`rover-hil ground` on a rendered drive, on a video, and on a log."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from drivers.camera.images import read_image
from drivers.errors import ConfigError
from rover_hil.app.app import app
from rover_hil.ground.command import ground_motion
from rover_hil.ground.run import HEADER
from rover_hil.recording.reader import LogReader
from tests.nature.ambiguous_ground.cases import prepare
from tests.nature.ambiguous_ground.drive_files import write
from tests.rover_hil.ftrace_files import read_rows, write_video

FRAMES = 24
COLUMNS = """\
time = { column = "t" }

[[wheel]]
speed = { column = "wheel_speed_mps", unit = "m/s" }

[[wheel]]
speed = { column = "wheel_speed_mps", unit = "m/s" }

[imu]
yaw_rate = { column = "gyro_yaw_dps", unit = "deg/s" }

[truth]
file = "motion.csv"
x = { column = "x_m" }
y = { column = "y_m" }
yaw = { column = "yaw_rad" }

[rover]
kinematics = "wheels"
wheels = [
  { x_m = 0.0, y_m = -0.2, radius_m = 0.1 },
  { x_m = 0.0, y_m = 0.2, radius_m = 0.1 },
]

[limits]
wheel_speed_rad_s = 60
wheel_acceleration_rad_s2 = 500
"""


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ground") / "drive"
    write(prepare("clean", 0, FRAMES), folder)
    return folder


def run(drive: Path, out: Path, *options: str, frames: Path | None = None) -> dict[str, object]:
    """Return the printed summary."""
    given = (str(frames or drive / "frames"), "--rig", str(drive / "rig.json"), "--out", str(out), *options)
    result = CliRunner().invoke(app, ["ground", *given, "--json"])
    assert result.exit_code == 0, result.output
    summary: dict[str, object] = json.loads(result.stdout)
    return summary


def telemetry(drive: Path) -> tuple[str, str]:
    return "--telemetry", str(drive / "telemetry.csv")


def test_motion_and_slip_are_those_of_the_ground_truth(drive: Path, tmp_path: Path) -> None:
    out = tmp_path / "motion.csv"
    summary = run(drive, out, *telemetry(drive))

    assert out.read_text(encoding="utf-8").splitlines()[0] == HEADER
    rows, truth = read_rows(out), read_rows(drive / "truth.csv")
    assert len(rows) == FRAMES == len(truth)
    assert (summary["pairs"], summary["valid"]) == (FRAMES - 1, FRAMES - 1)
    for row, true in zip(rows[1:], truth[1:], strict=True):
        assert float(row["slip"]) == pytest.approx(float(true["slip"]), abs=0.03)
        assert float(row["slip_sd"]) > 0.0
    x, y = (np.array([float(row[axis]) for row in truth]) for axis in "xy")
    travelled_m = float(np.hypot(x[-1] - x[0], y[-1] - y[0]))
    assert float(rows[-1]["x_m"]) == pytest.approx(travelled_m, rel=0.04)  # of another point
    assert summary["slip"] == pytest.approx(np.mean([float(row["slip"]) for row in truth[1:]]), abs=0.02)


def test_a_picture_shows_points_that_follow_the_ground(drive: Path, tmp_path: Path) -> None:
    run(drive, tmp_path / "motion.csv", *telemetry(drive), "--overlay", str(tmp_path / "pictures"))

    last = read_image(tmp_path / "motion.png")
    assert ((last[..., 1] > 180) & (last[..., 0] < 60) & (last[..., 2] < 60)).sum() > 200
    assert len(list((tmp_path / "pictures").iterdir())) == FRAMES


def test_without_wheels_there_is_a_motion_but_no_slip(drive: Path, tmp_path: Path) -> None:
    summary = run(drive, tmp_path / "motion.csv")

    assert summary["slip"] is None
    assert summary["valid"] == FRAMES - 1
    assert {row["slip"] for row in read_rows(tmp_path / "motion.csv")} == {""}


def test_a_video_gives_what_its_pictures_give(drive: Path, tmp_path: Path) -> None:
    video = write_video(drive / "frames", tmp_path / "drive.avi")

    by_pictures = run(drive, tmp_path / "pictures.csv", *telemetry(drive))
    by_video = run(drive, tmp_path / "video.csv", *telemetry(drive), frames=video)

    assert by_video["forward_m"] == pytest.approx(by_pictures["forward_m"], rel=0.005)


def test_the_motion_is_imported_as_ground_truth_of_the_wheels(drive: Path, tmp_path: Path) -> None:
    run(drive, tmp_path / "motion.csv", *telemetry(drive))
    table = tmp_path / "telemetry.csv"
    table.write_bytes((drive / "telemetry.csv").read_bytes())
    (tmp_path / "columns.toml").write_text(COLUMNS, encoding="utf-8")

    log = tmp_path / "drive.mcap"
    given = ("import", "table", str(table), "--columns", str(tmp_path / "columns.toml"), "--out", str(log))
    result = CliRunner().invoke(app, given)

    assert result.exit_code == 0, result.output
    assert sum(message.topic == "/truth" for message in LogReader(log).messages()) == FRAMES


def test_nothing_is_overwritten(drive: Path, tmp_path: Path) -> None:
    (tmp_path / "motion.png").write_bytes(b"mine")

    with pytest.raises(ConfigError, match=r"motion\.png"):
        ground_motion(drive / "frames", rig_path=drive / "rig.json", out=tmp_path / "motion.csv")

    assert (tmp_path / "motion.png").read_bytes() == b"mine"


def test_the_table_must_not_have_the_name_of_the_picture(drive: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"motion\.png is the name of the picture"):
        ground_motion(drive / "frames", rig_path=drive / "rig.json", out=tmp_path / "motion.png")

    assert list(tmp_path.iterdir()) == []


def test_a_folder_of_pictures_needs_a_rig(drive: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--rig is missing"):
        ground_motion(drive / "frames", out=tmp_path / "motion.csv")


def test_a_log_holds_its_rig_and_its_wheels(
    el_dorado_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ground_motion(el_dorado_log, out=tmp_path / "motion.csv", as_json=True) == 0

    summary = json.loads(capsys.readouterr().out)
    assert summary["pairs"] == summary["frames"] - 1
    assert summary["valid"] > 0.8 * summary["pairs"]
    assert 0.0 < summary["slip"] < 0.6
