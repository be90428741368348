"""Find the programs that have a device open."""

import contextlib
import os
from pathlib import Path
from typing import NamedTuple

from rover_hil.doctor.finding import read_text


class PortUser(NamedTuple):
    """A process that has the device open."""

    pid: int
    name: str


def find_users(device: Path, proc: Path) -> list[PortUser]:
    """Return the other processes that have `device` open, as far as this user may see them."""
    target = str(device.resolve())
    users: list[PortUser] = []
    for process in proc.iterdir():
        if not process.name.isdecimal() or int(process.name) == os.getpid():
            continue
        if target in _open_files(process / "fd"):
            users.append(PortUser(int(process.name), read_text(process / "comm") or "?"))
    return sorted(users)


def describe(users: list[PortUser]) -> str:
    """Return names and numbers of processes for a message."""
    return ", ".join(f"{user.name} (process {user.pid})" for user in users)


def _open_files(folder: Path) -> set[str]:
    files: set[str] = set()
    with contextlib.suppress(OSError):  # the process has ended, or belongs to somebody else
        for entry in folder.iterdir():
            with contextlib.suppress(OSError):  # it has just closed this one
                files.add(str(entry.readlink()))
    return files
