"""Settings of VESC motor controllers."""

from drivers.driver import DriveCodec
from drivers.vesc.parameters import VescParameters


class VescSettings(VescParameters):
    """VESC motor controllers, one for each wheel."""

    def reports_supply(self) -> bool:
        """Return True."""
        return True

    def make_codec(self, name: str) -> DriveCodec:
        """Build the codec of the controllers called `name`."""
        from drivers.vesc.codec import VescCodec

        return VescCodec(name, self)
