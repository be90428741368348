"""Writes summary and report of a run, made from its log alone."""

from pathlib import Path

from pydantic_core import from_json, to_json

from rover_hil.pages.add_page import add_page
from rover_hil.pages.atomic_write import write_files
from rover_hil.pages.render import render
from rover_hil.report.curves import run_curves, viewer_data
from rover_hil.report.figures.camera import camera_pictures
from rover_hil.report.read_run import read_run
from rover_hil.report.run_data import RunData
from rover_hil.report.summary import Summary, summarise
from rover_hil.report.verdict import facts, grade, tag, verdict

SUMMARY_NAME = "summary.json"
REPORT_NAME = "report.html"
STOPS_SHOWN = 8


def write_report(log_path: Path, folder: Path) -> str:
    """Write `summary.json`, then `report.html` of the log at `log_path` into `folder`.

    Returns:
        The summary as JSON text, as in the file.

    Raises:
        LogError: The log cannot be read, or holds no complete cycle.
        ConfigError: The folder cannot be made or written to. No half-written file is left behind.
    """
    run = read_run(log_path)
    summary = summarise(run)
    summary_json = to_json(summary, indent=2, inf_nan_mode="null").decode()
    write_files(folder, {SUMMARY_NAME: summary_json})
    add_page(folder / REPORT_NAME, lambda: _render(run, summary))
    return summary_json


def _render(run: RunData, summary: Summary) -> str:
    # Imported here because it brings matplotlib, a third of a second that the start of a run must not wait.
    from rover_hil.report.figures.listed import draw_report

    return render(
        "report/report.html",
        summary=summary,
        grade=grade(summary).value,
        tag=tag(summary),
        verdict=verdict(run, summary),
        facts=facts(summary),
        stops_shown=STOPS_SHOWN,
        viewer=viewer_data([run_curves(run, run.path.stem)]),
        frames=camera_pictures(run, summary),
        pictures=draw_report(run, summary),
        config_text=to_json(from_json(run.config_json), indent=2).decode(),
    )
