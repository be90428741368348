"""Settings of an Xsens MTi sensor."""

from typing import Annotated, Literal

from pydantic import Field

from drivers.driver import Codec
from drivers.inertial_settings import InertialSettings


class XsensSettings(InertialSettings):
    """An Xsens MTi inertial sensor that sends MTData2 messages by itself; by default its z axis points up.

    Attributes:
        baud_rate: Line speed; the device leaves the factory at 115200 bit/s.
        yaw_zero_deg: Direction of the sensor's x axis, counter-clockwise from east, when it reports yaw 0 in
            its own frame: 0 with a filter profile that uses the magnetometer; unknown, so useless as a
            heading, with a VRU profile. The north-west-up frame is converted by the driver.
        heading_reference: What the yaw is measured against: "true" for a sensor with GNSS, or with the
            magnetic declination set in the device.
    """

    type: Literal["xsens"] = "xsens"
    baud_rate: Annotated[int, Field(ge=300, le=4_000_000)] = 115_200
    yaw_zero_deg: Annotated[float, Field(ge=-180, le=180)] = 0.0
    heading_reference: Literal["magnetic", "true"] = "magnetic"

    def make_codec(self, name: str) -> Codec[bytes]:
        """Build the codec."""
        from drivers.samples import HeadingReference
        from drivers.xsens.codec import XsensCodec

        mounting = self.make_mounting(self.yaw_zero_deg)
        return XsensCodec(name, mounting, HeadingReference(self.heading_reference))
