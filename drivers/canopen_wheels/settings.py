"""Settings of CANopen drives."""

from drivers.canopen_wheels.parameters import CanopenWheelsParameters
from drivers.driver import DriveCodec


class CanopenWheelsSettings(CanopenWheelsParameters):
    """CANopen drives with the profile CiA 402, one for each wheel."""

    def make_codec(self, name: str) -> DriveCodec:
        """Build the codec of the drives called `name`."""
        from drivers.canopen_wheels.codec import CanopenWheelsCodec

        return CanopenWheelsCodec(name, self)
