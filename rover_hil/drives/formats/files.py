"""What the import commands share: many drives in one call, and what they say of each."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TypeAlias

from drivers.clock import seconds
from drivers.errors import ConfigError
from rover_hil.console.json_text import print_json
from rover_hil.console.steps import show_steps
from rover_hil.drives.formats.drive import START_NS, Contents
from rover_hil.drives.formats.limits import LimitSettings
from rover_hil.drives.formats.reading_process import Report, read_in_child
from rover_hil.drives.quality.judge import drive_findings, with_causes
from rover_hil.drives.quality.oddities import Oddity
from rover_hil.pages.atomic_write import check_new_file, unfinished
from rover_hil.recording.findings import finding_lines
from rover_hil.terminal import Terminal

WriteDrive: TypeAlias = Callable[[Path, Path], Iterator[Contents]]
"""Writes the log of a file, cycle by cycle; yields what was used so far."""


def import_files(
    files: Sequence[Path],
    out: Path,
    make_write: Callable[[], WriteDrive],
    *,
    limits: LimitSettings,
    what: str,
    force: bool,
    as_json: bool,
) -> None:
    """Turn files into logs, all of them or none, and print what was used of each.

    Args:
        files: One per drive.
        out: The log of one file; the folder for the logs of several, each called as its file.
        make_write: Called in the child process of each file; reads what describes the drives, and returns
            what writes the log.
        limits: Of the reading of each file.
        what: A file consists of, in the plural.
        force: Overwrite earlier logs.
        as_json: Print JSON.

    Raises:
        ConfigError: A log exists or cannot be written.
        LogError: A file cannot be read, or not within its limits.
    """
    outs = _outs(files, out)
    for path in outs:
        check_new_file(path, force=force)
    done: list[Contents] = []
    with ExitStack() as stack:
        parts = [stack.enter_context(unfinished(path)) for path in outs]
        for file, part in zip(files, parts, strict=True):
            done.append(import_file(file, part, make_write, limits))
    if as_json:
        print_json(
            [
                {"log": str(path), "duration_s": seconds(contents.end_ns - START_NS), **asdict(contents)}
                for path, contents in zip(outs, done, strict=True)
            ]
        )
        return
    for path, contents in zip(outs, done, strict=True):
        print_contents(contents, path, what=what)


def import_file(
    file: Path, log: Path, make_write: Callable[[], WriteDrive], limits: LimitSettings
) -> Contents:
    """Write the log of a file in a child process, and return what was used.

    Args:
        file: The file.
        log: The log; must not exist.
        make_write: As for `import_files`.
        limits: Of the reading.

    Raises:
        LogError: The file cannot be read, or not within its limits.
    """

    def work(report: Report[str]) -> Contents:
        contents = Contents()
        write = make_write()
        report(f"importing {file.name}")
        for contents in write(file, log):
            report(f"importing {file.name}, {seconds(contents.end_ns - START_NS):.0f} s are done")
        if contents.has_estimate:
            causes = drive_findings(log)
            contents.findings, contents.doubts = with_causes(causes, contents.findings, contents.doubts)
        return contents

    return read_in_child(file, limits.of(file), work, show_steps(f"reading {file.name}"))


def _outs(files: Sequence[Path], out: Path) -> list[Path]:
    if len(files) == 1:
        return [out]
    if out.exists() and not out.is_dir():
        raise ConfigError(
            f"{out} is a file, but {len(files)} files have a log each: name a folder with --out"
        )
    outs = [out / f"{file.name.removesuffix('.gz').rsplit('.', 1)[0]}.mcap" for file in files]
    if len(set(outs)) < len(outs):
        raise ConfigError("two of the files have one name, so would their logs: import them one by one")
    return outs


def _table_of(oddities: Sequence[Oddity]) -> Iterator[str]:
    """Yield the lines of a table of the findings, which are not broken where the terminal is narrow."""
    if not oddities:
        return
    rows = [("data-quality finding", "where", "count", "what became of it")]
    rows += [(odd.what, odd.where, "" if odd.count is None else str(odd.count), odd.done) for odd in oddities]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for what, where, count, done in rows:
        yield f"{what:<{widths[0]}}  {where:<{widths[1]}}  {count:>{widths[2]}}  {done}".rstrip()


def without_estimate(log: Path) -> str:
    """Return the sentence on a log without an estimate."""
    return (
        "no estimate was made, and the sensors were not compared with each other: "
        f"`rover-hil replay {log} --out FOLDER` does both"
    )


def print_contents(contents: Contents, out: Path, *, what: str) -> None:
    """Print what was used, one line each.

    Args:
        contents: What was used.
        out: The log.
        what: The drive consists of, in the plural.
    """
    console = Terminal(soft_wrap=True)
    for section, count in contents.used.items():
        console.print(f"{section}: {count} {what}".removesuffix(f" {section}"))
    for line in _table_of(contents.oddities):
        console.print(line)
    for note in contents.notes:
        console.print(note)
    for finding in (*contents.findings, *contents.doubts):
        console.print("\n".join(finding_lines(finding)))
    if not contents.has_estimate:
        console.print(without_estimate(out))
    console.print(f"{seconds(contents.end_ns - START_NS):.1f} s: {out}")
