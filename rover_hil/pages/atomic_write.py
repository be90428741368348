"""Write result files whole or not at all, and never over earlier ones unless forced."""

import shutil
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from drivers.errors import ConfigError


def refuse_overwrite(*paths: Path, force: bool, option: str = "--out") -> None:
    """Check that no path exists, unless forced.

    Args:
        paths: Files or folders to be written.
        force: Allow it.
        option: Where the user named them, for the message.

    Raises:
        ConfigError: One exists, or is a pipe or a device, which nothing may replace.
    """
    for path in paths:
        _refuse_device(path, option)
        if not force and path.exists():
            raise ConfigError(
                f"{path} exists and is never overwritten without --force: add it or choose another {option}"
            )


def check_file(path: Path | None, *, force: bool, option: str = "--out") -> None:
    """Check that a file, if one is wanted, can be made: its folder exists, and it does not, unless forced.

    Raises:
        ConfigError: There is no such folder, the path is a folder, or the file exists.
    """
    if path is None:
        return
    if not path.parent.is_dir():
        raise ConfigError(f"no folder {path.parent}: make it, or choose another {option}")
    check_new_file(path, force=force, option=option)


def check_new_file(path: Path, *, force: bool, option: str = "--out") -> None:
    """Check that a file can be made, whose folder `unfinished` makes where it is missing.

    Raises:
        ConfigError: The path is a folder, or the file exists and `force` is not set.
    """
    if path.is_dir():
        raise ConfigError(f"{path} is a folder: name a file with {option}")
    refuse_overwrite(path, force=force, option=option)


def write_files(folder: Path, texts: Mapping[str, str]) -> None:
    """Write text files by name into a folder, all of them or none; the folder is made if missing.

    Raises:
        ConfigError: The folder cannot be made or written to.
    """
    with _failure_names(f"the report into {folder}"):
        folder.mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:
            parts = {name: stack.enter_context(unfinished(folder / name)) for name in texts}
            for name, part in parts.items():
                part.write_text(texts[name], "utf-8")


def write_file(path: Path, text: str, *, option: str = "--out") -> None:
    """Write one text file, whole or not at all.

    Args:
        path: The file.
        text: Its content.
        option: Where the user named it, for messages.

    Raises:
        ConfigError: It cannot be written.
    """
    check_file(path, force=True, option=option)
    with _failure_names(path, option), unfinished(path, option=option) as part:
        part.write_text(text, "utf-8")


@contextmanager
def unfinished(path: Path, *, option: str = "--out") -> Iterator[Path]:
    """Give a temporary path; the file or folder made there moves to `path` when the block ends well.

    When the block ends with an exception, or makes nothing, an earlier `path` stays, and folders that had to
    be made for it are removed if they are empty.

    Args:
        path: File or folder to be made.
        option: Where the user named it, for messages.

    Raises:
        ConfigError: The folder of `path` cannot be made or written to, or `path` is a pipe or a device.
    """
    _refuse_device(path, option)
    missing = [folder for folder in path.parents if not folder.exists()]
    is_made = False
    try:
        with _failure_names(path, option):
            path.parent.mkdir(parents=True, exist_ok=True)
            temporary = TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent)
        with temporary as name:
            part = Path(name) / path.name
            yield part
            is_made = part.exists()
            if is_made:
                with _failure_names(path, option):
                    if path.is_dir():
                        shutil.rmtree(path)
                    part.replace(path)
    finally:
        for folder in () if is_made else missing:
            with suppress(OSError):
                folder.rmdir()


def _refuse_device(path: Path, option: str) -> None:
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise ConfigError(f"{path} is a pipe or a device: name a file or a folder with {option}")


@contextmanager
def _failure_names(what: object, option: str = "--out") -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise ConfigError(f"cannot write {what}: {error.strerror}; choose another {option}") from error
