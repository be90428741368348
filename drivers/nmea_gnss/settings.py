"""Settings of a GNSS receiver with NMEA 0183."""

from typing import Annotated, Literal

from pydantic import Field

from drivers.device_settings import SerialDeviceSettings
from drivers.driver import Codec
from drivers.nmea_gnss.parameters import NmeaGnssParameters


class NmeaGnssSettings(NmeaGnssParameters, SerialDeviceSettings):
    """A GNSS receiver that sends GGA, and GST where it can; or RMC alone.

    Attributes:
        max_age_s: The device counts as silent when its newest fix is older than this.
    """

    type: Literal["nmea_gnss"] = "nmea_gnss"
    baud_rate: Annotated[int, Field(ge=300, le=4_000_000)] = 9600
    max_age_s: Annotated[float, Field(gt=0, le=10)] = 2.5

    def make_codec(self, name: str) -> Codec[bytes]:
        """Build the codec."""
        from drivers.nmea_gnss.codec import NmeaGnssCodec

        return NmeaGnssCodec(name, self)
