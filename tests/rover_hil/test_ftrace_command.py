"""`rover-hil ftrace` on a rendered drive."""

import json
import math
import shutil
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

import rover_hil.ftrace.command as command
from drivers.camera.images import read_image
from drivers.errors import ConfigError
from rover_hil.app.app import app
from rover_hil.ftrace.command import trace_angles
from rover_hil.ftrace.run import HEADER, FrameAngle, estimate
from tests.rover_hil.ftrace_files import FRAMES, read_rows, write_drive, write_video


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_drive(tmp_path_factory.mktemp("ftrace") / "drive")


def run(drive: Path, out: Path, *, frames: Path | None = None, overlay: Path | None = None) -> int:
    return trace_angles(
        drive / "frames" if frames is None else frames,
        rig_path=drive / "rig.json",
        telemetry_path=drive / "telemetry.csv",
        out=out,
        overlay=overlay,
        method="fused",
        as_json=True,
    )


def test_angles_of_a_drive(drive: Path, tmp_path: Path) -> None:
    out = tmp_path / "angles.csv"
    result = CliRunner().invoke(
        app,
        [
            *("ftrace", str(drive / "frames"), "--rig", str(drive / "rig.json"), "--json"),
            *("--telemetry", str(drive / "telemetry.csv"), "--out", str(out)),
        ],
    )

    assert result.exit_code == 0, result.output
    assert out.read_text(encoding="utf-8").splitlines()[0] == HEADER
    rows, truth = read_rows(out), read_rows(drive / "truth.csv")
    assert len(rows) == FRAMES == len(truth)
    found = [(row, true) for row, true in zip(rows, truth, strict=True) if row["detected"] == "1"]
    assert len(found) >= 20
    for row, true in found:
        assert float(row["theta_t_deg"]) == pytest.approx(float(true["theta_t_deg"]), abs=3.0)
        assert float(row["d_t_m"]) == pytest.approx(float(true["d_t_m"]), abs=0.03)
        assert 0 < float(row["confidence"]) <= 1
    assert math.isnan(float(rows[0]["theta_t_deg"]))
    assert (rows[0]["confidence"], rows[0]["detected"]) == ("0.0000", "0")
    assert json.loads(result.stdout)["detected"] == len(found)


def test_a_video_gives_what_its_pictures_give(drive: Path, tmp_path: Path) -> None:
    video = write_video(drive / "frames", tmp_path / "drive.avi")

    run(drive, tmp_path / "pictures.csv")
    run(drive, tmp_path / "video.csv", frames=video)

    pictures, frames = read_rows(tmp_path / "pictures.csv"), read_rows(tmp_path / "video.csv")
    assert len(frames) == FRAMES
    assert float(frames[-1]["theta_t_deg"]) == pytest.approx(float(pictures[-1]["theta_t_deg"]), abs=0.5)


def test_without_telemetry_times_come_from_the_rig(drive: Path, tmp_path: Path) -> None:
    code = trace_angles(
        drive / "frames", rig_path=drive / "rig.json", telemetry_path=None, out=tmp_path / "a.csv",
        overlay=None, method="fused", as_json=True,
    )  # fmt: skip

    rows, truth = read_rows(tmp_path / "a.csv"), read_rows(drive / "truth.csv")
    assert code == 0
    assert float(rows[5]["t"]) == pytest.approx(1.0)
    assert float(rows[-1]["theta_t_deg"]) == pytest.approx(float(truth[-1]["theta_t_deg"]), abs=3.0)


def test_old_names_of_methods(drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def run_method(method: str) -> int:
        return trace_angles(
            drive / "frames", rig_path=drive / "rig.json", telemetry_path=None, out=tmp_path / "a.csv",
            overlay=None, method=method, as_json=True,
        )  # fmt: skip

    assert run_method("ftrace") == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["method"] == "hough"
    assert "--method ftrace is now called hough" in printed.err
    with pytest.raises(ConfigError, match="--method memory was removed, it was a part of fused: use"):
        run_method("memory")
    with pytest.raises(ConfigError, match="--method best is unknown: use fused, or hough"):
        run_method("best")


def test_overlay_pictures_show_the_trace(drive: Path, tmp_path: Path) -> None:
    run(drive, tmp_path / "a.csv", overlay=tmp_path / "pictures")

    pictures = sorted((tmp_path / "pictures").iterdir())
    assert len(pictures) == FRAMES
    first, last = (read_image(path) for path in (pictures[0], pictures[-1]))
    green = [((picture[..., 1] > 180) & (picture[..., 0] < 60)).sum() for picture in (first, last)]
    assert green[0] == 0
    assert green[1] > 200


def test_an_overlay_is_not_overwritten(drive: Path, tmp_path: Path) -> None:
    (tmp_path / "pictures").mkdir()

    with pytest.raises(ConfigError, match="--overlay"):
        run(drive, tmp_path / "a.csv", overlay=tmp_path / "pictures")


def test_a_frame_of_another_size_leaves_nothing_behind(drive: Path, tmp_path: Path) -> None:
    frames = tmp_path / "frames"
    frames.mkdir()
    for number in range(3):
        shutil.copy(drive / "frames" / f"{number:05d}.png", frames)
    cv2.imwrite(str(frames / "00003.png"), np.zeros((100, 100), np.uint8))

    with pytest.raises(ConfigError, match="frame 3 has 100 x 100 pixels, the rig 640 x 480"):
        run(drive, tmp_path / "a.csv", frames=frames, overlay=tmp_path / "pictures")

    assert sorted(path.name for path in tmp_path.iterdir()) == ["frames"]


def test_a_frame_without_telemetry(drive: Path, tmp_path: Path) -> None:
    frames = tmp_path / "frames"
    frames.mkdir()
    shutil.copy(drive / "frames" / "00000.png", frames / "00900.png")

    with pytest.raises(ConfigError, match="no row for frame 900"):
        run(drive, tmp_path / "a.csv", frames=frames)


@pytest.mark.parametrize("kind", ["black", "broken", "upside_down"])
def test_frames_that_show_no_trace_give_no_angle(drive: Path, tmp_path: Path, kind: str) -> None:
    frames = tmp_path / "frames"
    frames.mkdir()
    for path in sorted((drive / "frames").iterdir()):
        if kind == "broken":
            (frames / path.name).write_bytes(path.read_bytes()[:300])
            continue
        picture = read_image(path)
        changed = picture[::-1, ::-1] if kind == "upside_down" else np.zeros_like(picture)
        cv2.imwrite(str(frames / path.name), changed, [cv2.IMWRITE_PNG_COMPRESSION, 1])

    assert run(drive, tmp_path / "a.csv", frames=frames) == 0

    rows = read_rows(tmp_path / "a.csv")
    assert len(rows) == FRAMES
    assert {row["detected"] for row in rows} == {"0"}
    assert {row["theta_t_deg"] for row in rows} == {"nan"}


def test_interrupted_keeps_what_was_found(
    drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*given: object) -> Iterator[FrameAngle]:
        for number, item in enumerate(estimate(*given)):  # type: ignore[arg-type]
            if number == 4:
                raise KeyboardInterrupt
            yield item

    monkeypatch.setattr(command, "estimate", interrupted)

    assert run(drive, tmp_path / "a.csv", overlay=tmp_path / "pictures") == 130

    assert len(read_rows(tmp_path / "a.csv")) == 4
    assert len(list((tmp_path / "pictures").iterdir())) == 4


def test_the_output_cannot_be_written(drive: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--out"):
        run(drive, tmp_path / "no" / "folder" / "a.csv")


def test_help_has_an_example() -> None:
    result = CliRunner().invoke(app, ["ftrace", "--help"])

    assert "rover-hil ftrace frames/" in " ".join(result.output.split())


@pytest.mark.parametrize(
    ("quarter_turns", "words"),
    [
        (1, "in no frame does the ground move as the wheels do"),
        (2, "check that the camera is not upside down"),
        (3, "in no frame does the ground move as the wheels do"),
    ],
)
def test_a_camera_that_is_turned_gives_no_angle_and_a_note(
    drive: Path, tmp_path: Path, quarter_turns: int, words: str
) -> None:
    turned = tmp_path / "frames"
    turned.mkdir()
    for path in sorted((drive / "frames").iterdir())[:15]:
        image = read_image(path)
        other = cv2.resize(np.rot90(image, quarter_turns).copy(), image.shape[1::-1])
        cv2.imwrite(str(turned / path.name), other)
    result = CliRunner().invoke(
        app,
        [
            *("ftrace", str(turned), "--rig", str(drive / "rig.json")),
            *("--telemetry", str(drive / "telemetry.csv"), "--out", str(tmp_path / "angles.csv")),
        ],
    )
    assert result.exit_code == 0, result.output
    assert "trace in 0 of 15 frames" in result.output
    assert words in result.output
