"""Settings of a VectorNav sensor."""

from typing import Annotated, Literal

from pydantic import Field

from drivers.driver import Codec
from drivers.inertial_settings import InertialSettings


class VectorNavSettings(InertialSettings):
    """A VectorNav inertial sensor that sends ASCII messages by itself; by default its z axis points down.

    Attributes:
        baud_rate: Line speed; the device leaves the factory at 115200 bit/s.
        heading_reference: What the device's yaw is measured against: "magnetic" for a VN-100 without a
            magnetic model; "true" for a sensor with GNSS, or with the world magnetic model switched on.
    """

    type: Literal["vectornav"] = "vectornav"
    baud_rate: Annotated[int, Field(ge=300, le=4_000_000)] = 115_200
    heading_reference: Literal["magnetic", "true"] = "magnetic"

    def make_codec(self, name: str) -> Codec[bytes]:
        """Build the codec."""
        from drivers.samples import HeadingReference
        from drivers.vectornav.codec import VectorNavCodec

        return VectorNavCodec(name, self.make_mounting(), HeadingReference(self.heading_reference))
