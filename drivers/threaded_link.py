"""Links to real devices: one reader thread per port that stamps, counts and hands over, nothing else."""

import threading
from abc import ABC, abstractmethod
from collections import deque
from typing import Generic

from drivers.clock import NANOSECONDS_PER_SECOND, Clock, nanoseconds
from drivers.errors import NotConnectedError
from drivers.link import LinkChange, LinkItem, PayloadT, Received

FIRST_RETRY_NS = 50_000_000
LAST_RETRY_NS = NANOSECONDS_PER_SECOND
QUEUE_LIMIT = 65_536
JOIN_TIMEOUT_S = 2.0


class ThreadedLink(ABC, Generic[PayloadT]):
    """A port read by its own thread, reopened with back-off after a break.

    Subclasses open, read, write and close the handle; everything about threads and retries is here.

    Args:
        where: Name of the port for messages.
        clock: The host's clock.
        reconnect_limit_s: Stop trying this long after a break.

    Attributes:
        queue_limit: How many items wait to be received; beyond it the oldest payload is lost, never a break
            or recovery.
        dropped: Number of payloads lost in this way, or known to be lost before they were read.
    """

    queue_limit = QUEUE_LIMIT

    def __init__(self, where: str, clock: Clock, reconnect_limit_s: float) -> None:
        self.where = where
        self._clock = clock
        self._reconnect_limit_ns = nanoseconds(reconnect_limit_s)
        self.dropped = 0
        self._items: deque[LinkItem[PayloadT]] = deque()
        self._items_lock = threading.Lock()
        self._stopping = threading.Event()
        self._handle_lock = threading.Lock()
        self._is_up = False
        self._write_error: Exception | None = None
        self._thread: threading.Thread | None = None

    @abstractmethod
    def _open_handle(self) -> None:
        """Open the port; raise any exception with the reason, leaving no handle."""

    @abstractmethod
    def _close_handle(self) -> None:
        """Close the port; must not raise and may be called again."""

    @abstractmethod
    def _read(self) -> Received[PayloadT] | None:
        """Wait at most about 50 ms for data; None when there was none; raise when the port broke."""

    @abstractmethod
    def _write(self, payload: bytes) -> bool:
        """Send one payload within about 50 ms; False when the port is full; raise when it broke."""

    def open(self, timeout_s: float) -> None:
        """Open the port, trying again until `timeout_s`, and start the reader thread.

        Raises:
            NotConnectedError: The port cannot be opened.
        """
        deadline_ns = self._clock.now_ns() + nanoseconds(timeout_s)
        while True:
            try:
                self._require_no_reader()
                self._open_anew()
                break
            except Exception as error:  # any library may raise anything here
                if self._clock.now_ns() >= deadline_ns:
                    raise NotConnectedError(f"cannot open {self.where}: {error}") from error
            self._clock.sleep_until(min(deadline_ns, self._clock.now_ns() + FIRST_RETRY_NS))
        self._items.clear()
        self._stopping.clear()
        self._is_up = True
        self._thread = threading.Thread(target=self._run, name=f"reader {self.where}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the thread and close the port; may be called again."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join(JOIN_TIMEOUT_S)
        self._take_down()

    def receive(self) -> list[LinkItem[PayloadT]]:
        """Return what has arrived since the last call, oldest first."""
        with self._items_lock:
            items = list(self._items)
            self._items.clear()
        return items

    def send(self, payload: bytes) -> bool:
        """Send from any thread; False when the link is down or full."""
        with self._handle_lock:
            if not self._is_up:
                return False
            try:
                return self._write(payload)
            except Exception as error:  # noqa: BLE001 - every break of the port must be reported
                # The reader reports it: a kernel may give the error of a break to one caller only.
                self._write_error = error
                return False

    def _run(self) -> None:
        try:
            while not self._stopping.is_set() and self._read_once():
                pass
        finally:
            self._take_down()  # also what a slow reopening opened after `close` had stopped waiting

    def _read_once(self) -> bool:
        try:
            received = self._read()
            if self._write_error is not None:
                raise self._write_error
        except Exception as error:  # noqa: BLE001 - every break of the port must be reported
            self._take_down()
            reason = str(error) or repr(error)
            self._report(up=False, reason=reason)
            return self._reopen(reason)
        if received is not None:
            self._append(received)
        return True

    def _reopen(self, reason: str) -> bool:
        retry_ns = FIRST_RETRY_NS
        give_up_ns = self._clock.now_ns() + self._reconnect_limit_ns
        while self._clock.now_ns() < give_up_ns:
            if self._stopping.wait(retry_ns / NANOSECONDS_PER_SECOND):
                return False
            try:
                self._open_anew()
            except Exception as error:  # noqa: BLE001 - any library may raise anything here
                reason = str(error) or repr(error)
                retry_ns = min(2 * retry_ns, LAST_RETRY_NS)
                continue
            self._is_up = True
            self._report(up=True, reason="reopened")
            return True
        self._report(up=False, reason=f"gave up: {reason}", gave_up=True)
        return False

    def _open_anew(self) -> None:
        self._write_error = None
        self._open_handle()

    def _require_no_reader(self) -> None:
        # A reader that hangs in the library outlives `close`; two would share one handle.
        if self._thread is not None and self._thread.is_alive():
            raise NotConnectedError("it is open, or still being closed; try again later")

    def _take_down(self) -> None:
        with self._handle_lock:
            self._is_up = False
            self._close_handle()

    def _report(self, *, up: bool, reason: str, gave_up: bool = False) -> None:
        self._append(LinkChange(self._clock.now_ns(), up, reason, gave_up))

    def _append(self, item: LinkItem[PayloadT]) -> None:
        with self._items_lock:
            if len(self._items) >= self.queue_limit:
                self._drop_oldest_payload()
            self._items.append(item)

    def _drop_oldest_payload(self) -> None:
        for index, item in enumerate(self._items):
            if isinstance(item, Received):
                del self._items[index]
                self.dropped += 1
                return
