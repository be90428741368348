"""The page: complete, in one file, and never half written."""

import base64
import json
import re
from pathlib import Path

import pytest
from pydantic_core import to_json

from drivers.errors import ConfigError
from rover_hil.drive.run import run_rover
from rover_hil.report.write import write_report
from tests.rover_hil.report.test_read_run import PERIOD_S, Drive, open_log, write_cycle, write_log


def page_of(log_path: Path) -> str:
    folder = log_path.parent / "out"
    write_report(log_path, folder)
    return (folder / "report.html").read_text("utf-8")


@pytest.mark.slow
def test_a_log_without_truth_says_so(tmp_path: Path) -> None:
    log_path = write_log(tmp_path / "run.mcap", Drive(has_truth=False, origin="real"))
    summary = json.loads(write_report(log_path, tmp_path / "out"))
    missing = ("final_truth", "distance_truth_m", "estimate_error", "encoders_error", "slip_ratio")
    assert [summary[key] for key in missing] == [None] * 5
    assert summary["wheel_slip"] == [None, None, None]
    html = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "The true pose was not recorded" in html
    assert "<h2>Distance from the truth</h2>" not in html
    assert "<h2>Slip</h2>" not in html


@pytest.mark.parametrize("t_s", [0.0, PERIOD_S])
@pytest.mark.slow
def test_a_single_cycle_is_enough(tmp_path: Path, t_s: float) -> None:
    with open_log(tmp_path / "run.mcap", "virtual") as log:
        write_cycle(log, Drive(), t_s)
    assert "ended after 0.0 s without saying why" in page_of(tmp_path / "run.mcap")


@pytest.mark.slow
def test_numbers_that_are_not_finite_never_reach_the_summary(tmp_path: Path) -> None:
    log_path = write_log(tmp_path / "run.mcap", Drive(estimate_is_nan=True, duration_s=6.0))
    summary = json.loads(write_report(log_path, tmp_path / "out"), parse_constant=pytest.fail)
    assert summary["final_estimate"] == pytest.approx({"x_m": 0.32, "y_m": 0.003, "yaw_rad": 0.0})
    assert (tmp_path / "out" / "summary.json").read_text("utf-8") == to_json(summary, indent=2).decode()


@pytest.mark.slow
def test_the_page_is_complete_and_needs_nothing_else(tmp_path: Path) -> None:
    html = page_of(write_log(tmp_path / "run.mcap", Drive(stop=(4.0, 6.0), origin="<b>odd</b> & co")))
    titles = re.findall(r"<h2>(.*?)</h2>", html)
    assert titles == [
        "Look closer",
        "Path",
        "Distance from the truth",
        "Headings",
        "Slip",
        "Motor currents",
        "Wheel speeds",
        "Time-line",
        "Innovations",
        "Timing",
        "Devices at the end",
        "Log",
    ]
    pictures = re.findall(r'<img class="drawn" src="data:image/svg\+xml;base64,([^"]+)"', html)
    assert len(pictures) == html.count("<img") == 9
    for picture in pictures:
        assert re.fullmatch(r"<\?xml.*<svg.*</svg>\s*", base64.b64decode(picture).decode(), re.DOTALL)
    assert "http:" not in html
    assert "https:" not in html
    assert "default-src 'none'; img-src data:;" in html
    assert "<b>odd" not in html
    assert "and one safety stop." in html
    assert "imu: silent" in html
    assert "&lt;reopened&gt;" in html
    assert "3 checksum" in html
    assert '"base_radius_m": 0.125' in html.replace("&#34;", '"')


@pytest.mark.slow
def test_the_same_log_gives_the_same_page(tmp_path: Path) -> None:
    log_path = write_log(tmp_path / "run.mcap", Drive(duration_s=3.0))
    pages = []
    for name in ("first", "second"):
        write_report(log_path, tmp_path / name)
        pages.append((tmp_path / name / "report.html").read_bytes())
    assert pages[0] == pages[1]


@pytest.mark.usefixtures("unrendered")
def test_a_folder_that_cannot_be_made_is_one_sentence(tmp_path: Path) -> None:
    log_path = write_log(tmp_path / "run.mcap", Drive(duration_s=2.0))
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(ConfigError, match=r"cannot write the report into .*choose another --out"):
        write_report(log_path, tmp_path / "file" / "out")


@pytest.mark.usefixtures("unrendered")
def test_a_full_disk_keeps_the_summary_and_leaves_no_part_of_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log_path = write_log(tmp_path / "run.mcap", Drive(duration_s=2.0))
    write_text = Path.write_text

    def fail_on_report(path: Path, text: str, encoding: str) -> int:
        if "report" not in path.name:
            return write_text(path, text, encoding)
        write_text(path, text[:100], encoding)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", fail_on_report)
    with pytest.raises(ConfigError, match="No space left"):
        write_report(log_path, tmp_path / "out")
    (left,) = (tmp_path / "out").iterdir()
    assert json.loads(left.read_text("utf-8"))["is_complete"]


@pytest.mark.usefixtures("unrendered")
def test_a_virtual_run_has_a_report(tmp_path: Path) -> None:
    run_rover("robotino", virtual=True, duration_s=9.5, out=tmp_path / "out", realtime=False, as_json=True)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["cycles"], summary["skipped"], summary["duration_s"]) == (475, 0, 9.5)
    assert [device["device"] for device in summary["devices"]] == ["board", "imu"]
    # The patch at the start is a textile on which the wheels slip by a third.
    assert 0.2 < summary["distance_truth_m"] < summary["distance_encoders_m"] < 0.9
    assert 0.15 < summary["slip_ratio"] < 0.45
    assert 0.15 < summary["wheel_slip"][0] < 0.45
    html = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "Rectangle of 0.9 m × 0.4 m on the simulated rover" in html
