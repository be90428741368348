"""The simulator's end of a served bus."""

from abc import ABC, abstractmethod
from typing import Generic

from drivers.link import PayloadT


class Port(ABC, Generic[PayloadT]):
    """A port on which an emulated device is served. No method blocks.

    Attributes:
        where: Name of the bus in messages.
    """

    where: str

    @abstractmethod
    def open(self) -> None:
        """Create the bus, or join it.

        Raises:
            NotConnectedError: The bus cannot be created; nothing is left behind.
        """

    @abstractmethod
    def close(self) -> None:
        """Remove the bus, as when the plug is pulled; may be called again."""

    @abstractmethod
    def read(self) -> list[bytes]:
        """Return what the host has sent since the last call; nothing when the port is closed."""

    @abstractmethod
    def has_listener(self) -> bool:
        """Return whether a host would receive what is written now."""

    @abstractmethod
    def write(self, payload: PayloadT) -> bool:
        """Send to the host; return False when the payload, or part of it, was lost."""
