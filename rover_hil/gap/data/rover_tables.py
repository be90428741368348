"""Tables of a rover as logs for an analysis: the importer of `import table` converts them."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from drivers.errors import ConfigError
from rover_hil.config import Config
from rover_hil.console.options import LOG_SUFFIX
from rover_hil.drives.formats.files import WriteDrive, import_file
from rover_hil.drives.formats.limits import LimitSettings
from rover_hil.drives.formats.table.columns import Columns
from rover_hil.drives.formats.table.to_log import write_table_as_log
from rover_hil.recording.findings import finding_lines


def check_wheels_measured(columns: Columns, source: str) -> None:
    """Check that the columns hold the wheels themselves.

    Raises:
        ConfigError: They hold the motion of the rover, from which the angles of the wheels would be computed.
    """
    if not columns.wheel:
        paths = ("increments", "body", "tricycle")
        computed = next(name for name in paths if getattr(columns, name) is not None)
        raise ConfigError(
            f"gap rover {source}: [{computed}] holds no angles of the wheels of [rover], and angles computed "
            "from it would agree with any radius: describe each wheel by a [[wheel]]; a wheel without an "
            "encoder has an empty one, and driven = false, measured = false in [rover]"
        )


@contextmanager
def tables_as_logs(
    paths: Sequence[Path], columns: Columns, rover: Config, note: Callable[[str], None]
) -> Iterator[list[Path]]:
    """Give a log for each table, in a temporary folder; logs and folders of logs are given as they are.

    Args:
        paths: Tables, logs and folders of logs.
        columns: What the columns of the tables hold.
        rover: Its configuration.
        note: Called with each finding about a table.

    Raises:
        ConfigError: Two tables would have the same log.
        LogError: A table cannot be read, or does not fit the rover.
    """

    def make_write() -> WriteDrive:
        return lambda file, part: write_table_as_log(file, columns, rover, part)

    tables = [path for path in paths if not path.is_dir() and path.suffix != LOG_SUFFIX]
    with TemporaryDirectory(prefix="rover_hil_") as folder:
        # Below the folder as they are on the disk, so that runs are named as those of logs beside the tables.
        logs = {
            table: Path(folder, *table.resolve().parts[1:-1], f"{_stem(table)}{LOG_SUFFIX}")
            for table in tables
        }
        if len(set(logs.values())) < len(logs):
            raise ConfigError("two of the tables have one name: rename one of them")
        for table, log in logs.items():
            log.parent.mkdir(parents=True, exist_ok=True)
            contents = import_file(table, log, make_write, LimitSettings())
            for finding in contents.findings:
                note(f"{table}: {finding_lines(finding)[0]}")
        yield [logs.get(path, path) for path in paths]


def _stem(path: Path) -> str:
    return path.name.removesuffix(".gz").rsplit(".", 1)[0]
