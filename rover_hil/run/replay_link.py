"""A link that delivers the payloads of a log or an imported file on request."""

from collections import deque
from typing import Generic

from drivers.link import LinkItem, PayloadT


class ReplayLink(Generic[PayloadT]):
    """A link fed by the caller; sent payloads are kept for comparison and go nowhere.

    Attributes:
        sent: Sent payloads; the caller clears them.
        outcomes: Whether each next `send` counts as delivered; delivered when empty.
    """

    dropped = 0

    def __init__(self) -> None:
        self._pending: deque[LinkItem[PayloadT]] = deque()
        self.sent: list[bytes] = []
        self.outcomes: deque[bool] = deque()

    def feed(self, item: LinkItem[PayloadT]) -> None:
        """Let `item` arrive at the next `receive`."""
        self._pending.append(item)

    def open(self, timeout_s: float) -> None:
        """Do nothing: there is no port."""

    def close(self) -> None:
        """Do nothing: there is no port."""

    def receive(self) -> list[LinkItem[PayloadT]]:
        """Return what has been fed since the last call."""
        items = list(self._pending)
        self._pending.clear()
        return items

    def send(self, payload: bytes) -> bool:
        """Keep the payload and return the outcome that was set for it."""
        self.sent.append(payload)
        return self.outcomes.popleft() if self.outcomes else True
