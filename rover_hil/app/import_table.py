"""`rover-hil import table`: tables of any rover become logs."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rover_hil.app.import_contents import WriteDrive, import_files
from rover_hil.console.exit_codes import EXIT_OK
from rover_hil.console.json_text import print_json
from rover_hil.importing.table.columns import read_columns, rover_of
from rover_hil.importing.table.propose import proposal_text, propose
from rover_hil.importing.table.to_log import write_table_as_log
from rover_hil.pages.atomic_write import check_file, write_file
from rover_hil.terminal import Terminal


def import_tables(files: Sequence[Path], *, columns_path: Path, out: Path, force: bool, as_json: bool) -> int:
    """Turn tables into logs, all of them or none; returns the exit code.

    Args:
        files: One table per drive.
        columns_path: File of columns.
        out: The log of one table; the folder for the logs of several, each called as its table.
        force: Overwrite earlier logs.
        as_json: Print JSON.

    Raises:
        ConfigError: The file of columns or the rover is wrong, or a log exists or cannot be written.
        LogError: A table cannot be read, or does not fit the columns.
    """

    def make_write() -> WriteDrive:
        columns = read_columns(columns_path)
        rover = rover_of(columns, columns_path)
        return lambda file, part: write_table_as_log(file, columns, rover, part)

    import_files(files, out, make_write, what="rows", force=force, as_json=as_json)
    return EXIT_OK


def propose_columns(file: Path, *, out: Path, force: bool, as_json: bool) -> int:
    """Write what the columns of a table may hold; returns the exit code.

    Args:
        file: The table.
        out: The file of columns.
        force: Overwrite an earlier one.
        as_json: Print the guesses as JSON.

    Raises:
        ConfigError: The file exists or cannot be written.
        LogError: The table cannot be read, or has no time.
    """
    check_file(out, force=force, option="--propose")
    guesses = propose(file)
    write_file(out, proposal_text(file, guesses), option="--propose")
    if as_json:
        print_json([asdict(guess) for guess in guesses])
        return EXIT_OK
    console = Terminal(soft_wrap=True)
    for guess in guesses:
        doubt = "? " if guess.is_doubtful else ""
        console.print(f"{doubt}column {guess.column}: {guess.key}: {guess.reason}", markup=False)
    console.print(f"written: {out}; edit what follows '# ?', and enter the rover")
    return EXIT_OK
