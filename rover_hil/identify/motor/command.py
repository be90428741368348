"""`rover-hil identify motor`: parameters of the motors, with intervals and what cannot be known."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from drivers.clock import wall_time_text
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import ClusterOption, ForceOption, JsonOption, check_inputs, out_option
from rover_hil.console.steps import show_progress
from rover_hil.drives.toml_text import toml_text
from rover_hil.identify.motor.identify import Record, find_logs, identify, read_records
from rover_hil.identify.motor.report import Estimate, MotorReport
from rover_hil.pages.atomic_write import check_file, write_file
from rover_hil.parallel.calls import open_calls
from rover_hil.terminal import Terminal


def identify_motor(
    logs: Annotated[list[Path], typer.Argument(help="Logs, measured CSV files or folders.")],
    *,
    out: Annotated[Path | None, out_option("Write the parameters to this TOML file.")] = None,
    cluster: ClusterOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Fit motor, friction and speed loop, with intervals, and list what the data cannot determine.

    Exit code 1: nothing was determined.

    Example: `rover-hil identify motor runs/first/run.mcap`

    Data: `rover-hil sample runs` writes such a log; a whole run is
    `rover-hil run robotino --virtual --out runs/first`.
    """
    check_file(out, force=force)
    check_inputs(*logs)
    files = find_logs(logs)
    with open_calls(cluster) as calls, show_progress() as progress:
        task = progress.add_task("reading", total=len(files))
        records: list[Record] = []
        for of_file in calls.map_files(read_records, files):
            records += of_file
            progress.advance(task)
        motors = {record.motor for record in records}
        task = progress.add_task("fitting", total=len(motors))
        reports = identify(records, lambda: progress.advance(task), calls)
    source = [str(file) for file in files]
    if as_json:
        print_json({"logs": source, "motors": [dataclasses.asdict(report) for report in reports]})
    else:
        _print(reports, len(files))
    if out is not None:
        write_file(out, _toml(reports, source))
    return EXIT_OK if any(item.determined for report in reports for item in report.estimates) else EXIT_NO


def _print(reports: Sequence[MotorReport], files: int) -> None:
    console = Terminal()
    for report in reports:
        title = f"motor {report.motor}, {files} log{'s' if files > 1 else ''}"
        table = Table(title=title, title_justify="left", box=None, padding=(0, 1, 0, 0))
        for name in ("parameter", "value", "95 % interval", "data sheet", "known"):
            table.add_column(name, no_wrap=True)
        for item in report.estimates:
            table.add_row(*_row(item))
        console.print(table)
        for why in dict.fromkeys(item.why for item in report.estimates if item.why):
            names = ", ".join(item.name for item in report.estimates if item.why == why)
            console.print(f"  {names}: {why}", soft_wrap=True)
        for words in report.undetermined:
            console.print(f"  not determined: {words}", soft_wrap=True)
        for note in report.notes:
            console.print(f"  note: {note}", soft_wrap=True)
        if report.fitted is not None:
            line = f"  rms fitted: {report.fitted.speed_rad_s:.2f} rad/s, {report.fitted.current_a:.4f} A"
            if report.data_sheet is not None:
                sheet = report.data_sheet
                line += f"; data sheet: {sheet.speed_rad_s:.2f} rad/s, {sheet.current_a:.4f} A"
            console.print(line)


def _row(item: Estimate) -> tuple[str, ...]:
    interval = "" if item.low is None or item.high is None else f"{item.low:.4g} .. {item.high:.4g}"
    verdict = "yes" if item.determined else "no"
    if item.value is not None and not item.determined:
        verdict = "given Kt"
    return (
        item.name,
        "-" if item.value is None else f"{item.value:.4g}",
        interval,
        "" if item.data_sheet is None else f"{item.data_sheet:.4g}",
        verdict,
    )


def _toml(reports: Sequence[MotorReport], source: Sequence[str]) -> str:
    motors = [
        {
            "number": report.motor,
            "speed_range_rad_s": report.speed_range_rad_s,
            "current_range_a": report.current_range_a,
            "undetermined": report.undetermined,
            **{item.name: _record(item) for item in report.estimates},
        }
        for report in reports
    ]
    return toml_text(
        {"schema": "rover-hil-motor/1", "date": wall_time_text(), "source": source, "motor": motors}
    )


def _record(item: Estimate) -> dict[str, object]:
    names = ("unit", "determined", "value", "low", "high", "why")
    record = {name: getattr(item, name) for name in names}
    return {name: value for name, value in record.items() if value not in (None, "")}
