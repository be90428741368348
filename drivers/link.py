"""Transport of raw data: a link carries payloads, stamps their arrival and reports breaks."""

from dataclasses import dataclass
from typing import Generic, Protocol, TypeAlias, TypeVar

from drivers.record import record
from drivers.samples import Image


@dataclass(frozen=True, slots=True)
class CameraImage:
    """Payload of a camera link.

    Attributes:
        image: Pixels.
        t_capture_ns: The camera's own stamp of the exposure, monotonic time.
        jpeg: The compressed frame as the camera sent it, from which `image` was decoded; None where it sent
            pixels.
    """

    image: Image
    t_capture_ns: int | None
    jpeg: bytes | None = None


PayloadT = TypeVar("PayloadT", bytes, CameraImage)


@record(frozen=True, slots=True)
class Received(Generic[PayloadT]):
    """A payload and the host monotonic time at which its last byte arrived."""

    t_ns: int
    payload: PayloadT


@dataclass(frozen=True, slots=True)
class LinkChange:
    """The link came up or went down; after `gave_up` it will not try again by itself."""

    t_ns: int
    up: bool
    reason: str
    gave_up: bool = False


LinkItem: TypeAlias = Received[PayloadT] | LinkChange


class Link(Protocol[PayloadT]):
    """One port. Serial links carry byte chunks, CAN links 16-byte frames, camera links `CameraImage`.

    A link reconnects by itself with back-off after a break, and reports each break and each recovery
    once as a `LinkChange` in the stream.

    Attributes:
        dropped: Payloads that were lost because they were not received in time.
    """

    dropped: int

    def open(self, timeout_s: float) -> None:
        """Open the port.

        Raises:
            NotConnectedError: The port cannot be opened; no handle is left behind.
        """
        ...

    def close(self) -> None:
        """Close the port; may be called again."""
        ...

    def receive(self) -> list[LinkItem[PayloadT]]:
        """Return what has arrived since the last call, oldest first. Never blocks, never raises."""
        ...

    def send(self, payload: bytes) -> bool:
        """Hand bytes to the device from any thread; False when it is down or full. Never blocks long."""
        ...


class RawTap(Protocol):
    """Gets raw data before it is parsed; the recorder is one."""

    def received(self, device: str, item: LinkItem[bytes] | LinkItem[CameraImage]) -> None:
        """Note what arrived from `device`."""
        ...

    def sent(self, device: str, t_ns: int, payload: bytes, delivered: bool) -> None:
        """Note what was sent to `device`."""
        ...


class NoTap:
    """A tap that keeps nothing."""

    def received(self, device: str, item: LinkItem[bytes] | LinkItem[CameraImage]) -> None:
        """Ignore what arrived."""

    def sent(self, device: str, t_ns: int, payload: bytes, delivered: bool) -> None:
        """Ignore what was sent."""
