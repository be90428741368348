"""`rover-hil check`: every mistake of a configuration at once; no port is opened."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from controllers.control_loop import ControlLoop
from drivers.clock import date_of, wall_time_ns
from drivers.errors import ConfigError
from rover_hil.config import Config, Draft, Rule, load_config, read_config_table, schema_text
from rover_hil.config.schema import find_conflicts
from rover_hil.console.error_message import readable_line
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import ConfigArgument, ForceOption, JsonOption
from rover_hil.console.steps import show_steps
from rover_hil.doctor.configuration.config_consistency import check_consistency
from rover_hil.doctor.configuration.progress_sources import describe_progress
from rover_hil.doctor.configuration.slip_sources import describe_ground, describe_slip_sources
from rover_hil.doctor.finding import Finding, Level
from rover_hil.pages.atomic_write import check_file, write_file
from rover_hil.ready.ages import check_ages
from rover_hil.run.checks import RUN_CHECKS, SIMULATE_CHECKS, VIRTUAL_RUN_CHECKS
from rover_hil.terminal import Terminal
from rover_hil.tune.parameters import MISSING_TUNE, check_parameters
from sim_backends.build import check_world

MORE_CHECKS = {
    command: tuple(rule for rule in rules if rule not in RUN_CHECKS)
    for command, rules in (
        ("run", RUN_CHECKS),
        ("run --virtual", VIRTUAL_RUN_CHECKS),
        ("simulate", SIMULATE_CHECKS),
    )
}
"""What commands need besides `RUN_CHECKS`, which every configuration must fulfil."""


def check_config(
    name: ConfigArgument,
    *,
    schema: Annotated[
        Path | None,
        typer.Option(help="Also write the JSON schema of configurations to this file, for your editor."),
    ] = None,
    preview: Annotated[
        Path | None, typer.Option(help="Also write a page with the picture of the mission to this file.")
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Check a configuration: print every mistake at once, or which commands it is ready for.

    No port is opened; `doctor` also checks the devices. Exit code 1: the configuration has mistakes.

    Example: `rover-hil check robotino`
    """
    check_file(schema, force=force, option="--schema")
    check_file(preview, force=force, option="--preview")
    read_config_table(name)  # without a table there is nothing to check
    with show_steps(f"checking {name}"):
        examined = examine_config(name)
    config, mistakes, commands = examined.config, examined.mistakes, examined.lacks
    if schema is not None:
        write_file(schema, schema_text(), option="--schema")
    if preview is not None and config is not None:
        from rover_hil.report.mission_page import mission_page

        write_file(preview, mission_page(name, config.mission, config.safety.area), option="--preview")
    warnings = [finding for finding in examined.findings if finding.level is Level.WARNING]
    if as_json:
        record = {
            "verdict": "wrong" if mistakes else "valid",
            "mistakes": mistakes,
            "warnings": [f"{each.subject}: {each.what}: {each.fix}" for each in warnings],
            "commands": commands,
            "slip": "" if config is None else describe_slip_sources(config),
            "ground": "" if config is None else describe_ground(config),
            "entrapment": "" if config is None else describe_progress(config),
        }
        print_json(record)
        return EXIT_NO if mistakes else EXIT_OK
    console = Terminal(soft_wrap=True)
    for mistake in mistakes:
        console.print(readable_line(mistake))
    for each in warnings:
        console.print(readable_line(f"warning: {each.subject}: {each.what}; {each.fix}"))
    if config is None:
        count = f"{len(mistakes)} mistake{'s' if len(mistakes) > 1 else ''}"
        console.print(f"{count}: correct {'them' if len(mistakes) > 1 else 'it'} and check again")
        return EXIT_NO
    console.print(f"{name} is valid")
    for command, lack in commands.items():
        console.print(f"  {command}: {lack or 'yes'}")
    console.print(f"  slip: {describe_slip_sources(config)}")
    console.print(f"  ground: {describe_ground(config)}")
    console.print(f"  entrapment: {describe_progress(config)}")
    for option, path in (("schema", schema), ("preview", preview)):
        if path is not None:
            console.print(f"{option}: {path}")
    return EXIT_OK


class Examined(NamedTuple):
    """What is known of a configuration.

    Attributes:
        config: The configuration; None with mistakes.
        mistakes: Every mistake, in one line each.
        findings: Values that fit badly.
        lacks: What each command lacks, empty for nothing. A section that the configuration does not have and
            a command needs is no mistake. Empty with mistakes in the file itself.
    """

    config: Config | None
    mistakes: list[str]
    findings: list[Finding]
    lacks: dict[str, str]


def examine_config(name: str) -> Examined:
    """Return every mistake, the findings about values that fit badly, and per command what it lacks."""
    try:
        config = load_config(name, (*RUN_CHECKS, TUNE_RULE))
    except ConfigError as error:
        return Examined(None, list(dict.fromkeys(str(error).splitlines())), [], {})
    mistakes = [f"{name}: {mistake}" for mistake in _find_build_mistakes(config)]
    findings = [*check_consistency(config), *check_ages(config, date_of(wall_time_ns()))]
    mistakes += [
        f"{name}: {finding.subject}: {finding.what}: {finding.fix}"
        for finding in findings
        if finding.level is Level.PROBLEM
    ]
    draft = Draft.complete(config)
    lacks = {command: next(iter(find_conflicts(draft, rules)), "") for command, rules in MORE_CHECKS.items()}
    lacks["tune"] = lacks["run --virtual"] or ("" if config.tune else MISSING_TUNE.removeprefix("tune: "))
    return Examined(None if mistakes else config, mistakes, findings, lacks)


def _find_tune_mistakes(draft: Draft) -> Iterator[str]:
    config = draft.config
    if config.tune is None or config.mission is None or config.simulation is None:
        return
    try:
        check_parameters(config)
    except ConfigError as error:
        yield from str(error).splitlines()


TUNE_RULE = Rule(tuple(Config.model_fields), _find_tune_mistakes, is_last=True)


def _find_build_mistakes(config: Config) -> Iterator[str]:
    """Yield what only shows when controller and simulated rover are put together."""
    try:
        ControlLoop(config, config.device_roles())
        if config.simulation is not None:
            check_world(config.devices, config.simulation)
    except ConfigError as error:
        yield from str(error).splitlines()
