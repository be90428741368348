"""Data files that a configuration names travel inside the log, so that a log replays anywhere."""

import contextlib
import re
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from pydantic import ValidationError

from controllers.settings import ControlSettings
from drivers.errors import ConfigError, LogError
from drivers.files import SETTINGS_BYTES, read_bytes
from rover_hil.config import Config, describe_validation_error
from rover_hil.config.moved_keys import of_earlier_log
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


@dataclass(frozen=True, slots=True)
class PackedConfig:
    """A configuration together with its data files, for another machine.

    Attributes:
        config: The configuration; paths in it are those of this machine.
        files: Content of its data files, as of `collect_data_files`.
    """

    config: Config
    files: Mapping[str, bytes]

    @classmethod
    def of(cls, config: Config) -> Self:
        """Return a configuration with the present content of its data files.

        Raises:
            ConfigError: A file cannot be read.
        """
        return cls(config, collect_data_files(config))

    @contextlib.contextmanager
    def unpacked(self) -> Iterator[Config]:
        """Give the configuration, its data files laid out in a temporary folder."""
        if not self.files:
            yield self.config
            return
        with tempfile.TemporaryDirectory(prefix="rover_hil_") as folder:
            yield _lay_out(self.config, self.files, Path(folder), "the packed configuration")


@contextlib.contextmanager
def restore_config(log: LogReader) -> Iterator[Config]:
    """Give the configuration of a log, its data files laid out in a temporary folder.

    Raises:
        LogError: The configuration in the log is not valid for this version.
    """
    with tempfile.TemporaryDirectory(prefix="rover_hil_") as folder:
        try:
            config = Config.model_validate_json(of_earlier_log(log.config_json))
        except ValidationError as error:
            raise LogError(describe_validation_error(f"{log.path}, its configuration", error, {})) from error
        yield _lay_out(config, log.attachments, Path(folder), str(log.path))


def _lay_out(config: Config, files: Mapping[str, bytes], folder: Path, source: str) -> Config:
    """Write data files into a folder; return the configuration with their paths.

    A path in the configuration of a log is that of another machine, and is never read.

    Raises:
        LogError: A file is missing, or has a name that is no bare file name.
    """
    devices = {
        device: settings.model_copy(
            update={
                key: str(_write_files(files, f"{FOLDER}/{device}/{key}/", folder / device / key, source))
                for key in settings.data_file_keys
                if getattr(settings, key) is not None
            }
        )
        for device, settings in config.devices.items()
    }
    return config.model_copy(update={"devices": devices})


def _write_files(files: Mapping[str, bytes], prefix: str, folder: Path, source: str) -> Path:
    """Write the data files of one key into a folder; return the path of the one that the key names."""
    paths: list[Path] = []
    for name, data in files.items():
        if not name.startswith(prefix):
            continue
        bare = name.removeprefix(prefix)
        if not BARE_NAME.fullmatch(bare) or len(bare.encode()) > MOST_NAME_BYTES:
            raise LogError(f"{source} is damaged: it names a data file {prefix}{bare!r}")
        folder.mkdir(parents=True, exist_ok=True)
        paths.append(folder / bare)
        paths[-1].write_bytes(data)
    if not paths:
        raise LogError(f"{source} is damaged: it does not hold its data file {prefix}*")
    return paths[0]


def with_controller_of(logged: Config, replacing: Config) -> Config:
    """Return the configuration of a log with every section of `ControlSettings` of another one.

    Devices and their roles stay: the log holds the data of these very devices. The mission changes only
    where the log has one. There is no area, and the check manoeuvre is there where the rover drove it: the
    drive is what it was.
    """
    sections = set(ControlSettings.model_fields)
    if logged.mission is None or replacing.mission is None:
        sections.remove("mission")
    controlled = logged.model_copy(update={name: getattr(replacing, name) for name in sections})
    driven = {"area": None, "check_manoeuvre": logged.safety.check_manoeuvre}
    if all(getattr(replacing.safety, key) == value for key, value in driven.items()):
        return controlled
    return controlled.model_copy(update={"safety": replacing.safety.model_copy(update=driven)})
