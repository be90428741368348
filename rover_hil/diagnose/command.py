"""`rover-hil diagnose`: what recorded drives are worth, what is wrong, what to do."""

import tomllib
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Annotated

import typer

from drivers.errors import ConfigError
from rover_hil.config import read_config_text, shipped_configs, validated
from rover_hil.config.entry import with_entry
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import LOG_SUFFIX, ForceOption, JsonOption, check_inputs, log_at, out_option
from rover_hil.console.steps import show_progress
from rover_hil.diagnose.answer import answer_of
from rover_hil.diagnose.diagnosis import Diagnosis, Report, diagnose
from rover_hil.diagnose.figures import drawings_of
from rover_hil.diagnose.sections import entries_of, error_notes, error_table, record_of, sections_of
from rover_hil.diagnose.twin import Twin, twin_of
from rover_hil.drives.formats.described_rover import columns_at, is_log, load_rover
from rover_hil.drives.formats.files import WriteDrive, import_file
from rover_hil.drives.formats.limits import LimitSettings
from rover_hil.drives.formats.table.columns import Columns, read_columns, rover_of
from rover_hil.drives.formats.table.to_log import write_table_as_log
from rover_hil.drives.presets import presets
from rover_hil.pages.add_page import add_page
from rover_hil.pages.atomic_write import refuse_overwrite, unfinished, write_file, write_files
from rover_hil.pages.picture import draw_pictures
from rover_hil.pages.render import render
from rover_hil.ready.procedure import Entry
from rover_hil.recording.text import strict_json
from rover_hil.terminal import Terminal

JSON_NAME, PAGE_NAME = "diagnosis.json", "diagnosis.html"


def diagnose_drives(
    drives: Annotated[
        list[Path],
        typer.Argument(help="Logs, folders of runs, or tables with --columns; all of one rover."),
    ],
    *,
    columns_path: Annotated[
        Path | None,
        typer.Option(
            "--columns", help="TOML file: which column of the tables holds what; or a known data set."
        ),
    ] = None,
    out: Annotated[Path, out_option("Folder for diagnosis.json, the page, and the logs of tables.")] = Path(
        "diagnosis"
    ),
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", help="Do not replay drives again without each sensor, and do not ask `gap rover`."
        ),
    ] = False,
    config_name: Annotated[
        str | None,
        typer.Option("--config", help="Configuration, or file of columns, that --enter writes into."),
    ] = None,
    enter: Annotated[bool, typer.Option("--enter", help="Enter what was accepted into --config.")] = False,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Say what recorded drives are worth, what is wrong with them, and what to do.

    Exit code 1: measurements of a drive contradict each other; the finding states why.

    Example: `rover-hil diagnose runs/first runs/second`

    Data: `rover-hil sample runs` writes such runs; tables of other rovers are imported with `--columns`,
    docs/how-to/diagnose_drives.md.
    """
    check_inputs(*drives)
    target = _target(config_name, enters=enter)
    refuse_overwrite(out / JSON_NAME, out / PAGE_NAME, force=force)
    logs = _logs(drives, columns_path, out, force=force)
    with _shown(logs) as report:
        diagnosis = diagnose(logs, report, is_quick=quick)
    columns = None if target is None else columns_at(target)
    config = diagnosis.drives[0].drive.config if target is None or columns is not None else load_rover(target)
    twin = twin_of(diagnosis, config)
    entries = entries_of(diagnosis, columns)
    if twin is not None and target is not None and columns is None:
        entries += twin.entries(config.require_simulation())
    edited = "" if target is None or not enter else _edited(target, entries, columns)
    entered = _entered(target, entries, columns, enters=enter)
    record = record_of(diagnosis, twin)
    write_files(out, {JSON_NAME: strict_json(record, indent=2).decode() + "\n"})
    if target is not None and entries and enter:
        write_file(Path(target), edited, option="--config")
    add_page(out / PAGE_NAME, lambda: _page(diagnosis, twin))
    if as_json:
        print_json(record)
    else:
        _print(diagnosis, twin, out, entered)
    return EXIT_NO if diagnosis.causes else EXIT_OK


def _target(config_name: str | None, *, enters: bool) -> str | None:
    """Return the file that takes what was accepted; None without one.

    Raises:
        ConfigError: There is none to enter into, or it cannot be edited.
    """
    if not enters:
        return config_name
    if config_name is None:
        raise ConfigError("--enter: name with --config the TOML file that it writes into")
    if config_name in (*shipped_configs(), *presets()) or is_log(config_name):
        raise ConfigError(f"--enter: {config_name} cannot be edited: name a TOML file of yours")
    load_rover(config_name)  # to fail now rather than after the replays
    return config_name


def _logs(drives: Sequence[Path], columns_path: Path | None, out: Path, *, force: bool) -> list[Path]:
    """Return the logs of the drives; tables become logs in the folder `out`, all of them or none.

    Raises:
        ConfigError: Tables are given without their columns, or two drives have one name.
        LogError: A table cannot be read.
    """
    tables = [path for path in drives if not (path.is_dir() or path.suffix == LOG_SUFFIX)]
    if tables and columns_path is None:
        raise ConfigError(
            f"{tables[0]} is no log: name with --columns the file that says which column holds what, or turn "
            "it into a log with `rover-hil import`"
        )
    logs = {path: out / f"{path.name.removesuffix('.gz').rsplit('.', 1)[0]}{LOG_SUFFIX}" for path in tables}
    paths = [logs[path] if path in logs else log_at(path) for path in drives]
    if len({path.resolve() for path in paths}) < len(paths):
        raise ConfigError("two of the drives are one, or would have one log: give each drive once")
    refuse_overwrite(*logs.values(), force=force)
    with ExitStack() as stack:
        for table, log in logs.items():
            part = stack.enter_context(unfinished(log))
            import_file(table, part, lambda: _writer(columns_path), LimitSettings(None, None))
    return paths


def _writer(columns_path: Path | None) -> WriteDrive:
    assert columns_path is not None  # noqa: S101 tables are given with it
    columns = read_columns(columns_path)
    rover = rover_of(columns, columns_path)
    return lambda file, part: write_table_as_log(file, columns, rover, part, with_estimate=False)


@contextmanager
def _shown(logs: Sequence[Path]) -> Iterator[Report]:
    """Give the function that shows the progress, with the time that is left.

    A log counts again where it is replayed again.
    """
    sizes = {path: path.stat().st_size for path in logs if path.is_file()}
    with show_progress() as progress:
        task = progress.add_task("replaying", total=max(sum(sizes.values()), 1))
        finished, total, last = 0, sum(sizes.values()), ("", 0)
        counted = 0

        def report(words: str, path: Path, done: int) -> None:
            nonlocal finished, total, last, counted
            if words != last[0]:
                finished += last[1]
                counted += sizes.get(path, 0)
                total = max(total, counted)
            last = (words, done)
            progress.update(task, description=words, completed=finished + done, total=total)

        yield report


def _edited(target: str, entries: Sequence[Entry], columns: Columns | None) -> str:
    """Return the text of the file with the entries.

    Raises:
        ConfigError: It would not be valid: another section needs what is replaced.
    """
    kinematics = next((each.value for each in entries if each[:2] == ("rover", "kinematics")), None)
    if columns is None and kinematics is not None:
        config = load_rover(target)
        if config.slip is not None and kinematics != config.rover.kinematics:
            raise ConfigError(
                f"--enter: radii of the wheels differ, which needs kinematics = '{kinematics}', but [slip] "
                f"of {target} needs '{config.rover.kinematics}': leave --enter out"
            )
    text = read_config_text(target)
    for section, key, value in entries:
        text = with_entry(text, section, key, value)
    if columns is not None:
        validated(Columns, tomllib.loads(text), f"{target}, with the numbers of --enter")
    return text


def _entered(target: str | None, entries: Sequence[Entry], columns: Columns | None, *, enters: bool) -> str:
    """Return what is entered, each number before and after; to be called before the file is written."""
    if target is None or not enters:
        return "--config FILE --enter enters what was accepted" if entries else ""
    if not entries:
        what = (
            "nothing was accepted"
            if columns is None
            else "no number of the wheels was accepted, and a file of columns takes no others"
        )
        return f"{what}: {target} is unchanged"
    names = ", ".join(dict.fromkeys(f"[{each.section}]" for each in entries))
    # Those of the wheels are in the part about the geometry.
    changes = [
        f"\n  [{each.section}] {each.key}: {_value_at(target, each)} -> {each.value}"
        for each in entries
        if isinstance(each.value, int | float) and each.section != "rover"
    ]
    return f"entered into {target}: {names}{''.join(changes)}"


def _value_at(target: str, entry: Entry) -> object:
    """Return the value of a file that an entry replaces."""
    table: object = tomllib.loads(read_config_text(target))
    for name in (*entry.section.split("."), entry.key):
        table = table.get(name, "default") if isinstance(table, dict) else "default"
    return table


def _page(diagnosis: Diagnosis, twin: Twin | None) -> str:
    return render(
        "diagnose/page.html",
        grade="attention" if diagnosis.causes else "good",
        answer=answer_of(diagnosis),
        sections=sections_of(diagnosis, twin),
        pictures=draw_pictures(drawings_of(diagnosis)),
    )


def _print(diagnosis: Diagnosis, twin: Twin | None, out: Path, entered: str) -> None:
    console = Terminal(soft_wrap=True)
    answer = answer_of(diagnosis)
    for sentence in (answer.worth, answer.cause, answer.next_step):
        console.print(sentence)
    table = error_table(diagnosis)
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for row in table:  # not broken where the terminal is narrow
        console.print("  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip())
    for line in error_notes(diagnosis):
        console.print(line)
    for number, section in enumerate(sections_of(diagnosis, twin), start=2):
        console.print(f"{number}. {section.title}")
        for line in section.lines:
            console.print(f"   {line}")
        if section.text:
            console.print(section.text)
    if entered:
        console.print(entered)
    console.print(f"page: {out / PAGE_NAME}, numbers: {out / JSON_NAME}")
