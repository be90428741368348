"""What the report says of slip compensation."""

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from controllers.control_loop import StepOutput
from controllers.slip.effort.compensator import SlipReport
from controllers.slip.effort.wheel_slips import WheelSlip
from rover_hil.report.figures.slip import draw_slip
from rover_hil.report.read_run import read_run
from rover_hil.report.summary import SlipSummary, summarise
from rover_hil.report.verdict import facts
from rover_hil.report.write import write_report
from tests.rover_hil.report.test_read_run import SLIP, WAIT_S, Drive, write_log


@dataclass(frozen=True, kw_only=True)
class CompensatedDrive(Drive):
    """The drive with estimated slip: right from second 6 on, and not valid before."""

    def output(self, t_s: float) -> StepOutput:
        is_valid = t_s > 6.0
        wheel = WheelSlip(
            current_a=0.5,
            paper_torque_nm=0.05,
            wheel_torque_nm=0.4,
            slip=SLIP if is_valid else SLIP + 0.3,
            valid=is_valid,
            reason="" if is_valid else f"direction {100.0 * t_s:.0f} deg is outside the training range",
        )
        told = SlipReport(
            map="surfaces", surface="lawn" if is_valid else None, drift_rad=0.0, wheels=(wheel,) * 3
        )
        return replace(super().output(t_s), slip=told)


def slip_summary(tmp_path: Path, drive: Drive) -> SlipSummary:
    slip = summarise(read_run(write_log(tmp_path / "run.mcap", drive))).slip
    assert slip is not None
    return slip


def test_numbers_of_what_was_told(tmp_path: Path) -> None:
    slip = slip_summary(tmp_path, CompensatedDrive())
    assert slip.map == "surfaces"
    # Over the angle turned, from second 1 to 11: half of it is right.
    assert slip.wheel_slip[0] == pytest.approx(SLIP + 0.15, abs=0.005)
    assert slip.valid_share[0] == pytest.approx(0.5, abs=0.01)
    assert slip.error_rms[0] == pytest.approx(0.3 * 0.5**0.5, rel=0.05)
    assert slip.wheel_slip[1] is None  # it does not turn
    assert slip.surface_share == pytest.approx({"unknown": 300 / 550, "lawn": 250 / 550})
    assert slip.invalid_cycles == {"direction ... deg is outside the training range": 300}


def test_without_the_truth_no_error_is_told(tmp_path: Path) -> None:
    slip = slip_summary(tmp_path, CompensatedDrive(has_truth=False))
    assert slip.error_rms == (None, None, None)
    assert slip.valid_share == pytest.approx((0.5,) * 3, abs=0.06)


def test_a_run_without_compensation_tells_nothing(tmp_path: Path) -> None:
    summary = summarise(read_run(write_log(tmp_path / "run.mcap", Drive())))
    assert summary.slip is None
    assert "estimated slip" not in [fact.name for fact in facts(summary)]


@pytest.mark.usefixtures("unrendered")
def test_the_page_shows_it(tmp_path: Path) -> None:
    log_path = write_log(tmp_path / "run.mcap", CompensatedDrive())
    summary = json.loads(write_report(log_path, tmp_path / "out"))
    assert summary["slip"]["map"] == "surfaces"
    html = (tmp_path / "out" / "report.html").read_text("utf-8")
    titles = re.findall(r"<h2>(.*?)</h2>", html)
    assert titles.index("Effort") == titles.index("Slip") + 1
    # Wheel 0 turns from second 1 on, wheel 2 all the time: valid for 5 of 10 and 5 of 11 seconds.
    words = "by surfaces, valid for 47.7 % of the distance; mostly: direction ... deg is"
    assert f"estimated slip</dt><dd>35.7 %<small>{words}" in html


def test_the_picture_marks_what_is_not_valid(tmp_path: Path) -> None:
    run = read_run(write_log(tmp_path / "run.mcap", CompensatedDrive()))
    figure = draw_slip(run, summarise(run))
    assert figure is not None
    first, _, _, strip = figure.axes
    estimate = next(line for line in first.lines if line.get_label() == "estimate")
    assert list(estimate.get_ydata())[-1] == pytest.approx(100.0 * SLIP)  # type: ignore[arg-type]
    (shaded,) = [patch for patch in first.patches if patch.get_label() == "not valid"]
    box = shaded.get_extents().transformed(first.transData.inverted())
    assert (box.x0, box.x1) == pytest.approx((0.0, 6.0), abs=0.05)
    assert [text.get_text() for text in strip.texts] == ["lawn"]
    (band,) = strip.patches
    assert band.get_extents().transformed(strip.transData.inverted()).x0 == pytest.approx(6.0, abs=0.05)
    assert first.get_legend_handles_labels()[1].count("not valid") == 1


def test_slip_is_drawn_without_a_truth(tmp_path: Path) -> None:
    run = read_run(write_log(tmp_path / "run.mcap", CompensatedDrive(has_truth=False)))
    figure = draw_slip(run, summarise(run))
    assert figure is not None
    assert "truth, smoothed" not in figure.axes[0].get_legend_handles_labels()[1]
    assert run.duration_s > WAIT_S
