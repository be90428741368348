"""`rover-hil import table`: tables of any rover become logs."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from drivers.errors import ConfigError
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.console.options import ForceOption, JsonOption, out_option
from rover_hil.console.steps import show_steps
from rover_hil.drives.formats.files import WriteDrive, import_files
from rover_hil.drives.formats.limits import EstimateOption, LimitSettings, MemoryOption, TimeOption
from rover_hil.drives.formats.reading_process import read_in_child
from rover_hil.drives.formats.table.columns import read_columns, rover_of
from rover_hil.drives.formats.table.propose import proposal_text, propose
from rover_hil.drives.formats.table.to_log import write_table_as_log
from rover_hil.pages.atomic_write import check_file, write_file
from rover_hil.terminal import Terminal


def import_tables(
    files: Annotated[
        list[Path],
        typer.Argument(help="Tables, one per drive: .csv or other text, .gz, .npy, .npz, .mat, .parquet."),
    ],
    *,
    columns_path: Annotated[
        Path | None, typer.Option("--columns", help="TOML file: which column holds what.")
    ] = None,
    out: Annotated[
        Path | None, out_option("The log to write; for several tables the folder of their logs.")
    ] = None,
    propose_to: Annotated[
        Path | None,
        typer.Option(
            "--propose",
            help="Write to this file what the columns of the tables may hold, to be edited.",
        ),
    ] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    most_memory_gb: MemoryOption = None,
    most_minutes: TimeOption = None,
    no_estimate: EstimateOption = False,
) -> int:
    """Turn tables into logs, which replay exactly: all of them, or none where one is wrong.

    Wheels, increments of distance and yaw, steering, angular rate, currents and true poses are used.

    Example: `rover-hil import table table.csv --columns columns.toml --out table.mcap`

    Data: `rover-hil sample table` writes the table and the file of columns; for yours,
    docs/how-to/import_a_table.md names the keys.
    """
    limits = LimitSettings(most_memory_gb, most_minutes)
    if propose_to is not None:
        return _propose_columns(files, limits, out=propose_to, force=force, as_json=as_json)
    if columns_path is None or out is None:
        raise ConfigError(
            "--columns and --out are needed: name the file that says which column holds what, and the log; "
            "--propose columns.toml writes such a file"
        )

    def make_write() -> WriteDrive:
        columns = read_columns(columns_path)
        rover = rover_of(columns, columns_path)
        return lambda file, part: write_table_as_log(
            file, columns, rover, part, with_estimate=not no_estimate
        )

    import_files(files, out, make_write, limits=limits, what="rows", force=force, as_json=as_json)
    return EXIT_OK


def _propose_columns(
    files: Sequence[Path], limits: LimitSettings, *, out: Path, force: bool, as_json: bool
) -> int:
    """Write what the columns of tables may hold; returns the exit code."""
    file = files[0]
    check_file(out, force=force, option="--propose")
    guesses = read_in_child(
        file, limits.of(file), lambda _: propose(file, files[1:]), show_steps(f"reading {file.name}")
    )
    write_file(out, proposal_text(file, guesses), option="--propose")
    if as_json:
        print_json([asdict(guess) for guess in guesses])
        return EXIT_OK
    console = Terminal(soft_wrap=True)
    for guess in guesses:
        doubt = "? " if guess.is_doubtful else ""
        key = f"{guess.key}: " if guess.key else ""
        console.print(f"{doubt}column {guess.column}: {key}{guess.reason}", markup=False)
    console.print(f"written: {out}; edit what follows '# ?', and enter the rover")
    return EXIT_OK
