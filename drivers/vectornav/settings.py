"""Settings of a VectorNav sensor."""

from typing import Annotated, Literal

from pydantic import Field

from drivers.device_settings import SerialDeviceSettings
from drivers.driver import Codec


class VectorNavSettings(SerialDeviceSettings):
    """A VectorNav inertial sensor, mounted flat with its z axis down, that sends ASCII messages by itself.

    Attributes:
        baud_rate: Line speed; the device leaves the factory at 115200 bit/s.
        mounting_yaw_deg: Direction of the sensor's x axis, counter-clockwise from the rover's forward axis.
        heading_reference: What the device's yaw is measured against: "magnetic" for a VN-100 without a
            magnetic model; "true" for a sensor with GNSS, or with the world magnetic model switched on.
    """

    type: Literal["vectornav"] = "vectornav"
    baud_rate: Annotated[int, Field(ge=300, le=4_000_000)] = 115_200
    mounting_yaw_deg: Annotated[float, Field(ge=-180, le=180)] = 0.0
    heading_reference: Literal["magnetic", "true"] = "magnetic"

    def make_codec(self, name: str) -> Codec[bytes]:
        """Build the codec."""
        from drivers.mounting import Mounting
        from drivers.samples import HeadingReference
        from drivers.vectornav.codec import VectorNavCodec

        mounting = Mounting.from_degrees(self.mounting_yaw_deg, 0.0)
        return VectorNavCodec(name, mounting, HeadingReference(self.heading_reference))
