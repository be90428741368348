"""A link that delivers what a log or an imported file says, when it is told to."""

from collections import deque
from typing import Generic

from drivers.link import LinkItem, PayloadT


class ReplayLink(Generic[PayloadT]):
    """A link fed by hand; what is sent to it is kept for comparison and goes nowhere.

    Attributes:
        sent: What has been sent, until somebody clears it.
        outcomes: Whether each next `send` is to count as delivered; delivered when empty.
    """

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
