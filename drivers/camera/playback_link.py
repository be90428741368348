"""Recorded frames played on the clock, without a thread."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator
from typing import NamedTuple

from drivers.camera.parameters import FrameSourceParameters
from drivers.clock import Clock, nanoseconds
from drivers.link import CameraImage, LinkChange, LinkItem, Received
from drivers.samples import Image

NEWEST_FRAMES = 4
"""A frame this many periods overdue is dropped, as a camera overwrites it: decoding never falls behind."""


class RecordedFrame(NamedTuple):
    """Time after the start at which a frame is due, and the function that reads its pixels."""

    offset_ns: int
    load: Callable[[], Image]


class PlaybackLink(ABC):
    """Delivers each recorded frame at its time after `open`, arrival and capture stamped with that time.

    At the end the link goes down for good, one period after the last frame.

    Args:
        settings: The camera's settings.
        clock: The clock to play on; on a virtual one playback is deterministic.

    Attributes:
        dropped: Frames skipped because they were not received in time.
    """

    def __init__(self, settings: FrameSourceParameters, clock: Clock) -> None:
        self.dropped = 0
        self._settings = settings
        self._period_ns = nanoseconds(1 / settings.frame_rate_hz)
        self._clock = clock
        self._frames: Generator[RecordedFrame] | None = None
        self._next: RecordedFrame | None = None
        self._start_ns = 0
        self._end_ns = 0

    @abstractmethod
    def _open_frames(self) -> Generator[RecordedFrame]:
        """Return the frames in order of time; closing the generator frees what it holds.

        Raises:
            NotConnectedError: There is nothing to play.
        """

    def open(self, timeout_s: float) -> None:
        """Find the recording and start playing it.

        Raises:
            NotConnectedError: There is nothing to play; the message names the place and the fix.
        """
        self._frames = self._open_frames()
        self._start_ns = self._end_ns = self._clock.now_ns()
        self._next = next(self._frames, None)

    def close(self) -> None:
        """Stop playing; may be called again."""
        if self._frames is not None:
            self._frames.close()
        self._frames = None
        self._next = None

    def receive(self) -> list[LinkItem[CameraImage]]:
        """Return the frames that have become due since the last call."""
        items: list[LinkItem[CameraImage]] = []
        if self._frames is None:
            return items
        now_ns = self._clock.now_ns()
        while self._next is not None and (due_ns := self._start_ns + self._next.offset_ns) <= now_ns:
            if now_ns - due_ns < NEWEST_FRAMES * self._period_ns:
                items.append(Received(due_ns, CameraImage(self._next.load(), due_ns)))
            else:
                self.dropped += 1
            self._end_ns = due_ns + self._period_ns
            self._next = next(self._frames, None)
        if self._next is None and now_ns >= self._end_ns:
            reason = f"end of {self._settings.source} {self._settings.path}"
            items.append(LinkChange(self._end_ns, up=False, reason=reason, gave_up=True))
            self.close()
        return items

    def send(self, payload: bytes) -> bool:
        """Return False: a recording accepts no data."""
        return False
