"""Folders of images: finished ones, and ones that another process fills."""

from collections.abc import Generator
from functools import partial
from itertools import count
from pathlib import Path

from drivers.camera.images import read_image
from drivers.camera.parameters import FrameSourceParameters
from drivers.camera.playback_link import NEWEST_FRAMES, PlaybackLink, RecordedFrame
from drivers.clock import NANOSECONDS_PER_SECOND, Clock
from drivers.errors import NotConnectedError
from drivers.link import CameraImage, LinkChange, LinkItem, Received

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".bmp"})


class FolderLink(PlaybackLink):
    """A finished folder of images.

    Where every file name is a time stamp in nanoseconds, as in `1234567890123.png`, the frames keep their
    spacing in time; otherwise they follow each other at the configured rate in the order of their names.
    """

    def _open_frames(self) -> Generator[RecordedFrame]:
        folder = Path(self._settings.path)
        paths = sorted(_find_images(folder))
        if not paths:
            raise NotConnectedError(
                f"frames folder {folder} holds no images ({', '.join(sorted(IMAGE_SUFFIXES))}): "
                "correct the camera's `path`"
            )
        offsets_ns = [index * self._period_ns for index in range(len(paths))]
        if all(_is_stamp(path) for path in paths):
            paths.sort(key=_stamp_ns)
            offsets_ns = [_stamp_ns(path) - _stamp_ns(paths[0]) for path in paths]
        return self._play(paths, offsets_ns)

    def _play(self, paths: list[Path], offsets_ns: list[int]) -> Generator[RecordedFrame]:
        round_ns = offsets_ns[-1] + self._period_ns
        for playing in count() if self._settings.loop else range(1):
            for path, offset_ns in zip(paths, offsets_ns, strict=True):
                yield RecordedFrame(playing * round_ns + offset_ns, partial(read_image, path))


class LiveFolderLink:
    """A folder that another process on this machine fills with images.

    Each file is renamed into place when it is complete, is called by its capture time in nanoseconds of the
    host's monotonic clock, e.g. `1234567890123.jpg`, and is removed by the writer after a while. Files that
    exist at `open` are old and stay unread.

    Args:
        settings: The camera's settings.
        clock: The host's clock.

    Attributes:
        dropped: Frames skipped because they were not received in time.
    """

    def __init__(self, settings: FrameSourceParameters, clock: Clock) -> None:
        self.dropped = 0
        self._folder = Path(settings.path)
        self._clock = clock
        self._seen: set[Path] = set()
        self._is_open = False
        self._is_up = False

    def open(self, timeout_s: float) -> None:
        """Remember the content of the folder.

        Raises:
            NotConnectedError: There is no such folder.
        """
        self._seen = _find_images(self._folder)
        self._is_open = True
        self._is_up = True

    def close(self) -> None:
        """Stop reading; may be called again."""
        self._is_open = False

    def receive(self) -> list[LinkItem[CameraImage]]:
        """Return the newest frames that have appeared since the last call, and a folder lost or found."""
        if not self._is_open:
            return []
        now_ns = self._clock.now_ns()
        items: list[LinkItem[CameraImage]] = []
        try:
            present = _find_images(self._folder)
        except NotConnectedError as error:
            if self._is_up:
                items.append(LinkChange(now_ns, up=False, reason=str(error)))
            self._is_up = False
            return items
        if not self._is_up:
            items.append(LinkChange(now_ns, up=True, reason="reopened"))
            self._is_up = True
        fresh = sorted(filter(_is_stamp, present - self._seen), key=_stamp_ns)
        self._seen = present
        self.dropped += max(0, len(fresh) - NEWEST_FRAMES)
        items.extend(
            Received(now_ns, CameraImage(read_image(path), _stamp_ns(path)))
            for path in fresh[-NEWEST_FRAMES:]
        )
        return items

    def send(self, payload: bytes) -> bool:
        """Return False: a folder accepts no data."""
        return False


def _find_images(folder: Path) -> set[Path]:
    try:
        return {path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES}
    except OSError as error:
        raise NotConnectedError(
            f"frames folder {folder} cannot be read ({error.strerror}): correct the camera's `path`, "
            "or start what fills the folder"
        ) from error


def _is_stamp(path: Path) -> bool:
    # Running numbers stay below: a time stamp in nanoseconds after the first second does not.
    return path.stem.isdecimal() and int(path.stem) >= NANOSECONDS_PER_SECOND


def _stamp_ns(path: Path) -> int:
    return int(path.stem)
