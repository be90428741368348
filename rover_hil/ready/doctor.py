"""`rover-hil doctor`: check a rover before it drives, and report cause and fix."""

from collections.abc import Sequence

from rich.table import Table
from rich.text import Text

from drivers.clock import SystemClock, date_of, wall_time_ns
from rover_hil.config import load_config
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import ConfigArgument, JsonOption
from rover_hil.console.steps import show_progress
from rover_hil.doctor.examination import examine_computer, examine_rover
from rover_hil.doctor.finding import Finding, Level, SystemPaths
from rover_hil.ready.ages import check_ages
from rover_hil.run.checks import RUN_CHECKS
from rover_hil.terminal import Terminal, printable

LISTEN_S = 2.0
STYLES = {Level.OK: "green", Level.WARNING: "yellow", Level.PROBLEM: "bold red"}


def examine(config_name: ConfigArgument, *, as_json: JsonOption = False) -> int:
    """Check devices, permissions, rates, clocks and calibration; print cause and fix.

    Exit code 1: something needs a fix.

    Example: `rover-hil doctor robotino`
    """
    config = load_config(config_name, RUN_CHECKS)
    paths = SystemPaths()
    with show_progress() as progress:
        task = progress.add_task("looking at the computer and the ports", total=LISTEN_S)

        def show(listened_s: float) -> None:
            progress.update(task, completed=listened_s, description="listening to all devices")

        findings = [*examine_computer(paths), *check_ages(config, date_of(wall_time_ns()))]
        findings += examine_rover(config, paths, SystemClock(), listen_s=LISTEN_S, on_progress=show)
    if as_json:
        print_json(record_of(findings))
    else:
        print_findings(findings, Terminal())
    return EXIT_OK if is_ready(findings) else EXIT_NO


def is_ready(findings: Sequence[Finding]) -> bool:
    """Return whether no finding is a problem."""
    return not any(finding.level is Level.PROBLEM for finding in findings)


def record_of(findings: Sequence[Finding]) -> dict[str, object]:
    """Return verdict and findings for a script."""
    return {"verdict": "ready" if is_ready(findings) else "needs a fix", "findings": findings}


def print_findings(findings: Sequence[Finding], console: Terminal) -> None:
    """Print everything that was looked at as a table, then cause and fix of what is not well."""
    table = Table("", "of", "check", "what was seen")
    for finding in findings:
        mark = Text(finding.level.value, style=STYLES[finding.level])
        table.add_row(mark, Text(finding.subject), Text(finding.check), Text(finding.what))
    console.print(table)
    # Outside of the table, so that a command can be copied from the terminal in one piece.
    for level in (Level.PROBLEM, Level.WARNING):
        for finding in findings:
            if finding.level is level:
                _print_advice(finding, console)
    count = sum(finding.level is Level.PROBLEM for finding in findings)
    console.print(f"\n{count} to be fixed before driving" if count else "\nready to drive")


def _print_advice(finding: Finding, console: Terminal) -> None:
    heading = Text(printable(f"\n{finding.level.value}: "), style=STYLES[finding.level])
    console.print(
        heading + Text(printable(f"{finding.subject}: {finding.what}"), style="bold"), soft_wrap=True
    )
    console.print(Text(printable(f"  cause: {finding.cause}")), soft_wrap=True)
    console.print(Text(printable(f"  fix:   {finding.fix}")), soft_wrap=True)
