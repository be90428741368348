"""Read files that others made: regular files only, and never more of them than their kind needs.

All limits are here; docs/reference/file_limits.md explains them. What a reader raises is an `OSError` with a
sentence in `strerror`, or a `ValueError`, as for any other file that cannot be read.
"""

import errno
import gzip
import io
import json
import os
import re
import stat
import tomllib
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

MEGABYTE = 2**20

SETTINGS_BYTES = 1 * MEGABYTE
"""Configurations, calibrations, rigs, maps, mappings, DBC files, model files."""
TABLE_BYTES = 64 * MEGABYTE
"""CSV tables, unpacked."""
TABLE_CELLS = 6_000_000
"""Cells of a CSV table; an hour of 16 columns at 100 Hz."""
TABLE_LINES = 1_000_000
"""Lines of a CSV table."""
FLIGHT_LOG_BYTES = 1024 * MEGABYTE
"""Log of an autopilot."""
TABLE_COLUMNS = 10_000
"""Columns of any table."""
CAN_LOG_BYTES = 4096 * MEGABYTE
"""Logs of a CAN bus, unpacked; ten hours of 2,000 frames/s as text are 3 GB."""
CAN_FRAMES = 80_000_000
"""Frames of a log of a CAN bus; eleven hours of 2,000 frames/s."""
CAN_LINE_CHARACTERS = 65_536
"""A line of a log of a CAN bus."""
CAN_CONTAINER_BYTES = 512 * 1024
"""A packed part of a log of a CAN bus; loggers pack 128 kB into one."""
IMAGE_BYTES = 64 * MEGABYTE
"""A picture, as it is stored."""
IMAGE_PIXELS = 2**26
"""Pixels of a picture: as many as the largest camera of a configuration has."""
RECORD_BYTES = 272 * MEGABYTE
"""A record of a log; the largest is a picture of `IMAGE_PIXELS` in colour that does not pack, in base64."""
LOG_COPY_BYTES = 256 * MEGABYTE
"""A log that travels with a call to another process or computer."""
MESSAGE_JSON_BYTES = 8 * MEGABYTE
"""A message of a log that holds JSON; the largest has the samples of a cycle in which all devices flood."""
ATTACHMENTS_BYTES = 16 * MEGABYTE
"""Configuration and data files in a log, together."""
CHUNK_BYTES = 32 * MEGABYTE
"""A compressed part of a log, unpacked."""
UNPACKED_BYTES = 64 * MEGABYTE
UNPACKED_PER_BYTE = 100
"""Compressed parts of a log may together be this large unpacked, and per byte of the file. The writer of a
log stays within it; a stranger's archive of 300 kB costs a reader 15 s, not minutes."""
UNPACKED_PIXELS = 2**26
UNPACKED_PIXELS_PER_BYTE = 2000
"""Pictures of a log may together have this many pixels, and per byte of the file. The writer stays within it:
a PNG file packs at most 1032 bytes into one, a JPEG file 512 pixels."""
UNIT_BYTES = 1024 * MEGABYTE
"""A functional mock-up unit, unpacked."""
UNIT_BYTES_FREE = 64 * MEGABYTE
UNIT_PER_BYTE = 100
"""A unit may always be `UNIT_BYTES_FREE` large unpacked; a larger one so much per byte of the file."""
UNIT_FILES = 10_000
"""Files in a unit."""
UNIT_DESCRIPTION_BYTES = 64 * MEGABYTE
"""The model description of a unit."""
LONGEST_NAME_BYTES = 255
"""A name between two slashes; what file systems allow."""
LONGEST_PATH = 4095
"""Characters of a path."""
NESTING = 64
"""Tables and lists inside each other, in TOML and JSON."""
LARGEST_WHOLE_NUMBER = 2**63 - 1

_DOTTED_KEY = re.compile(
    r"""(?<![\w-])(?:(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+)"""
    rf"{{{NESTING}}}"
)


def open_file(path: Path) -> BinaryIO:
    """Open a regular file for reading.

    Raises:
        OSError: There is none, or it is a pipe, a device or a folder; `strerror` states which.
    """
    try:
        # A pipe without a writer would block the open.
        number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except ValueError:
        raise OSError(errno.EINVAL, "a name of a file holds no NUL character", str(path)) from None
    mode = os.fstat(number).st_mode
    if stat.S_ISREG(mode):
        return os.fdopen(number, "rb")
    os.close(number)
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    raise OSError(errno.EINVAL, "it is a pipe or a device, not a file", str(path))


def read_bytes(path: Path, most_bytes: int) -> bytes:
    """Return the content of a regular file.

    Raises:
        OSError: It cannot be read, or is larger than `most_bytes`.
    """
    with open_file(path) as stream:
        return _read_all(stream, path, most_bytes)


def read_packed_bytes(path: Path, most_bytes: int) -> bytes:
    """Return the content of a regular file, unpacked where its name ends in `.gz`.

    Raises:
        OSError: It cannot be read or unpacked, or is larger than `most_bytes`, packed or unpacked.
    """
    with open_packed(path) as stream:
        return _read_all(stream, path, most_bytes)


@contextmanager
def open_packed(path: Path) -> Iterator[BinaryIO]:
    """Give a regular file for reading, unpacked on the way where its name ends in `.gz`.

    Raises:
        OSError: It cannot be read or unpacked; also while it is being read.
    """
    with open_file(path) as stream:
        if path.suffix != ".gz":
            yield stream
            return
        try:
            with gzip.open(stream) as unpacked:
                yield io.BufferedReader(unpacked)
        except (EOFError, zlib.error) as error:
            raise _not_whole(path) from error


def _not_whole(path: Path) -> OSError:
    what = f"it is not a whole .gz file, `gzip -dc {path.name} > {path.stem}` unpacks what is intact"
    return OSError(errno.EINVAL, what, str(path))


def read_text(path: Path, most_bytes: int = SETTINGS_BYTES) -> str:
    """Return the text of a regular file in UTF-8.

    Raises:
        OSError: It cannot be read, or is larger than `most_bytes`.
        UnicodeDecodeError: It is not UTF-8.
    """
    return read_bytes(path, most_bytes).decode("utf-8")


def is_file(path: Path) -> bool:
    """Return whether there is a regular file; False for a name that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def resolved(path: Path) -> Path:
    """Return the absolute path without links; with them where they form a loop."""
    try:
        return path.resolve()
    except (OSError, RuntimeError):
        return path.absolute()


def parse_json(text: str | bytes) -> object:
    """Return the content of JSON text.

    Raises:
        ValueError: It is not JSON, nested too deeply, or holds a whole number beyond 64 bits.
    """
    try:
        value = json.loads(text)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    _check_values(value)
    return value


def parse_toml(text: str) -> dict[str, object]:
    """Return the content of TOML text.

    Raises:
        ValueError: It is not TOML, nested too deeply, or holds a whole number beyond 64 bits.
    """
    # The parser takes quadratic time for long dotted keys.
    if _DOTTED_KEY.search(text):
        raise ValueError(_TOO_DEEP)
    try:
        table = tomllib.loads(text)
    except RecursionError:
        raise ValueError(_TOO_DEEP) from None
    _check_values(table)
    return table


_TOO_DEEP = f"it is nested deeper than {NESTING} levels"


def _read_all(stream: BinaryIO, path: Path, most_bytes: int) -> bytes:
    content = io.BytesIO()
    while part := stream.read(min(MEGABYTE, most_bytes + 1 - content.tell())):
        content.write(part)
    if content.tell() > most_bytes:
        limit = f"{most_bytes / MEGABYTE:g} MB"
        raise OSError(errno.EFBIG, f"it is larger than {limit}, the limit for such a file", str(path))
    return content.getvalue()


def _check_values(value: object) -> None:
    level = [value]
    for _ in range(NESTING + 1):
        inner: list[object] = []
        for item in level:
            if isinstance(item, dict):
                inner += item.values()
            elif isinstance(item, list):
                inner += item
            elif type(item) is int and not -LARGEST_WHOLE_NUMBER <= item <= LARGEST_WHOLE_NUMBER:
                raise ValueError("a whole number in it has more than 64 bits")
        if not inner:
            return
        level = inner
    raise ValueError(_TOO_DEEP)
