"""The simulated device's end of a served bus."""

from abc import ABC, abstractmethod
from typing import Generic

from drivers.link import PayloadT


class Port(ABC, Generic[PayloadT]):
    """The simulator's end of a bus. No method blocks.

    Attributes:
        where: Name of the bus for messages.
    """

    where: str

    @abstractmethod
    def open(self) -> None:
        """Make the bus appear.

        Raises:
            NotConnectedError: It cannot; nothing is left behind.
        """

    @abstractmethod
    def close(self) -> None:
        """Make the bus vanish, as when the plug is pulled; may be called again."""

    @abstractmethod
    def read(self) -> list[bytes]:
        """Return what the host has sent since the last call; nothing when the port is closed."""

    @abstractmethod
    def has_listener(self) -> bool:
        """Return whether a host would receive what is written now."""

    @abstractmethod
    def write(self, payload: PayloadT) -> bool:
        """Send to the host; False when the payload, or part of it, was lost on the way."""
