"""Folders that a port makes on its way and removes with itself."""

import contextlib
from pathlib import Path


class MadeFolders:
    """Remembers which folders it made."""

    def __init__(self) -> None:
        self._made: list[Path] = []

    def make(self, folder: Path) -> None:
        """Make a folder and those above it where they are missing.

        Raises:
            OSError: The system refuses.
        """
        missing = [path for path in (folder, *folder.parents) if not path.exists()]
        for path in reversed(missing):
            path.mkdir(exist_ok=True)
            self._made.append(path)

    def remove(self) -> None:
        """Remove the made folders that are empty, the deepest first."""
        for path in reversed(self._made):
            with contextlib.suppress(OSError):  # others use it, or have removed it
                path.rmdir()
        self._made = [path for path in self._made if path.exists()]
