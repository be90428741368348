"""What several files of tests read is computed once, for all workers of a session.

Each worker of pytest-xdist is a process of its own; the first that needs a result makes it below the
temporary folder of the session, and the others wait for it.
"""

import fcntl
import functools
import hashlib
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

_folders: list[Path] = []


def share_in(folder: Path) -> None:
    """Set the folder that all workers of this session have in common."""
    _folders[:] = [folder]


def made_once(name: str, make: Callable[[Path], object]) -> Path:
    """Return the path with a name; the first who asks for it writes it.

    Args:
        name: Of the file or folder, and of no other that tests share.
        make: Writes to the path it is given, once in a session.
    """
    (folder,) = _folders
    path = folder / name
    with (folder / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not path.exists():
            part = folder / f"part_{name}"
            make(part)
            part.rename(path)
    return path


def computed_once(function: Callable[P, T]) -> Callable[P, T]:
    """Return a function whose result for each set of arguments is computed once in a session.

    Args:
        function: Its result can be pickled, its arguments are distinguished by their text.
    """

    known: dict[str, T] = {}

    @functools.wraps(function)
    def shared(*arguments: P.args, **options: P.kwargs) -> T:
        call = f"{function.__module__} {function.__qualname__} {arguments} {sorted(options.items())}"
        name = f"{function.__name__}_{hashlib.sha256(call.encode()).hexdigest()[:16]}"
        if name not in known:
            path = made_once(
                name, lambda part: part.write_bytes(pickle.dumps(function(*arguments, **options)))
            )
            known[name] = pickle.loads(path.read_bytes())  # noqa: S301 - written by this session
        return known[name]

    return shared
