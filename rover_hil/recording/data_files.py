"""Data files that a configuration names travel inside the log, so that a log replays anywhere."""

import contextlib
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

from pydantic import ValidationError

from controllers.settings import ControlSettings
from drivers.errors import ConfigError, LogError
from drivers.files import SETTINGS_BYTES, read_bytes
from rover_hil.config import Config, describe_validation_error
from rover_hil.recording.reader import LogReader

FOLDER = "data"
MOST_NAME_BYTES = 255
BARE_NAME = re.compile(r"(?!\.{1,2}$)[^/\x00-\x1f]+")


def collect_data_files(config: Config) -> dict[str, bytes]:
    """Return the content of every data file that `config` names, by its name in the log.

    Raises:
        ConfigError: A file cannot be read.
    """
    files: dict[str, bytes] = {}
    for device, settings in config.devices.items():
        for key, paths in settings.data_files().items():
            for path in paths:
                try:
                    files[f"{FOLDER}/{device}/{key}/{path.name}"] = read_bytes(path, SETTINGS_BYTES)
                except OSError as error:
                    raise ConfigError(
                        f"devices.{device}.{key}: cannot read {path}: {error.strerror}"
                    ) from error
    return files


@contextlib.contextmanager
def restore_config(log: LogReader) -> Iterator[Config]:
    """Give the configuration of a log, its data files laid out in a temporary folder.

    Raises:
        LogError: The configuration in the log is not valid for this version.
    """
    with tempfile.TemporaryDirectory(prefix="rover_hil_") as folder:
        try:
            config = Config.model_validate_json(log.config_json)
        except ValidationError as error:
            raise LogError(describe_validation_error(f"{log.path}, its configuration", error, {})) from error
        devices = {
            device: settings.model_copy(
                update={
                    key: str(_restore_files(log, f"{FOLDER}/{device}/{key}/", Path(folder) / device / key))
                    for key in settings.data_file_keys
                    if getattr(settings, key) is not None
                }
            )
            for device, settings in config.devices.items()
        }
        yield config.model_copy(update={"devices": devices})


def _restore_files(log: LogReader, prefix: str, folder: Path) -> Path:
    """Write the data files of one key into a folder; return the path of the one that the key names.

    A path in the configuration of a log is that of another machine, and is never read.

    Raises:
        LogError: The log does not hold the file, or one with a name that is no bare file name.
    """
    paths: list[Path] = []
    for name, data in log.attachments.items():
        if not name.startswith(prefix):
            continue
        bare = name.removeprefix(prefix)
        if not BARE_NAME.fullmatch(bare) or len(bare.encode()) > MOST_NAME_BYTES:
            raise LogError(f"{log.path} is damaged: it names a data file {prefix}{bare!r}")
        folder.mkdir(parents=True, exist_ok=True)
        paths.append(folder / bare)
        paths[-1].write_bytes(data)
    if not paths:
        raise LogError(f"{log.path} is damaged: it does not hold its data file {prefix}*")
    return paths[0]


def with_controller_of(logged: Config, other: Config) -> Config:
    """Return the configuration of a log with every section of `ControlSettings` of another one.

    Devices and their roles stay: the log holds the data of these very devices. The mission changes only
    where the log has one.
    """
    sections = set(ControlSettings.model_fields)
    if logged.mission is None or other.mission is None:
        sections.remove("mission")
    return logged.model_copy(update={name: getattr(other, name) for name in sections})
