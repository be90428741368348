"""Data files that a configuration names travel inside the log, so that a log replays anywhere."""

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from pydantic import ValidationError

from controllers.settings import ControlSettings
from drivers.errors import ConfigError, LogError
from rover_hil.config import Config, describe_validation_error
from rover_hil.recording.reader import LogReader

FOLDER = "data"


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
                    files[f"{FOLDER}/{device}/{key}/{path.name}"] = path.read_bytes()
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
        main_files: dict[tuple[str, str], Path] = {}
        for name, data in log.attachments.items():
            parts = PurePosixPath(name).parts
            if len(parts) != 4 or parts[0] != FOLDER or ".." in parts:
                continue
            path = Path(folder).joinpath(*parts[1:])
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
            main_files.setdefault((parts[1], parts[2]), path)
        devices = dict(config.devices)
        for (device, key), path in main_files.items():
            if device in devices:
                devices[device] = devices[device].model_copy(update={key: str(path)})
        yield config.model_copy(update={"devices": devices})


def with_controller_of(logged: Config, other: Config) -> Config:
    """Return the configuration of a log with every section of `ControlSettings` of another one.

    Devices and their roles stay: the log holds the data of these very devices. The mission changes only
    where the log has one.
    """
    sections = set(ControlSettings.model_fields)
    if logged.mission is None or other.mission is None:
        sections.remove("mission")
    return logged.model_copy(update={name: getattr(other, name) for name in sections})
