"""The rover that a command is about: of a configuration, of a log, or of a file of columns."""

from pathlib import Path

from rover_hil.config import Config, Rule, load_config, read_config_table, shipped_configs
from rover_hil.console.options import LOG_SUFFIX, log_at
from rover_hil.drives.formats.table.columns import Columns, read_columns, rover_of
from rover_hil.drives.presets import presets
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader

OF_COLUMNS = ("time", "wheel", "increments", "body", "tricycle")
"""Keys of a file of columns that no configuration has."""


def load_rover(source: str, rules: tuple[Rule, ...] = ()) -> Config:
    """Return the configuration of a rover.

    Args:
        source: A configuration, given as for `load_config`; a log, or the folder of its run; or a file of
            columns of `import table`. The devices of a log are those of the drive; a file of columns has
            none.
        rules: What a configuration must fulfil in addition to the schema.

    Raises:
        ConfigError: The file cannot be read, or holds mistakes; one line per mistake.
        LogError: The log cannot be read.
    """
    if is_log(source):
        with restore_config(LogReader(log_at(Path(source)))) as config:
            return config
    columns = columns_at(source)
    return load_config(source, rules) if columns is None else rover_of(columns, Path(source))


def is_log(source: str) -> bool:
    """Return whether a source is a log, or a folder, in which logs are."""
    return source not in shipped_configs() and (source.endswith(LOG_SUFFIX) or Path(source).is_dir())


def is_configuration(source: str) -> bool:
    """Return whether a source is a configuration, with the devices of a rover.

    Raises:
        ConfigError: The file cannot be read.
    """
    return not is_log(source) and columns_at(source) is None


def columns_at(source: str) -> Columns | None:
    """Return the content of a file of columns; None for a configuration.

    Raises:
        ConfigError: The file cannot be read, or is a file of columns with mistakes.
    """
    if source in presets():
        return read_columns(Path(source))
    table = read_config_table(source)
    if "schema" in table or table.keys().isdisjoint(OF_COLUMNS):
        return None
    return read_columns(Path(source))
