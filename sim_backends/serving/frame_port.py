"""A camera as a folder that fills with frames."""

from pathlib import Path

from drivers.errors import NotConnectedError
from drivers.link import CameraImage
from sim_backends.serving.made_folders import MadeFolders
from sim_backends.serving.port import Port
from sim_backends.world.live_folder import LiveFolderWriter


class FramePort(Port[CameraImage]):
    """Writes each frame into the live folder; the folder is the plug.

    Args:
        folder: Where the host reads frames; it is made.
    """

    def __init__(self, folder: str) -> None:
        self.where = folder
        self._folder = Path(folder)
        self._writer: LiveFolderWriter | None = None
        self._folders = MadeFolders()

    def open(self) -> None:
        """Make the folder; does nothing when it is open."""
        if self._writer is not None:
            return
        try:
            self._folders.make(self._folder.parent)
            self._writer = LiveFolderWriter(self._folder)
        except OSError as error:
            self._folders.remove()
            raise NotConnectedError(f"cannot serve frames in {self.where}: {error}") from error

    def close(self) -> None:
        """Remove our frames, and the folders unless others use them."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None
        self._folders.remove()

    def read(self) -> list[bytes]:
        """Return nothing: a folder of frames takes no commands."""
        return []

    def has_listener(self) -> bool:
        """Return whether the folder is there; it cannot detect a reader."""
        return self._writer is not None

    def write(self, payload: CameraImage) -> bool:
        """Write a frame that has a capture time; False when that fails."""
        if self._writer is None or payload.t_capture_ns is None:
            return False
        try:
            self._writer.write(payload.image, payload.t_capture_ns)
        except OSError:
            return False
        return True
