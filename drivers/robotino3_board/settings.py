"""Settings of the Robotino 3/4 board."""

from drivers.driver import DriveCodec
from drivers.robotino3_board.parameters import Robotino3BoardParameters


class Robotino3BoardSettings(Robotino3BoardParameters):
    """The board of a Robotino 3 or 4 on its USB port."""

    def reports_supply(self) -> bool:
        """Return True."""
        return True

    def make_codec(self, name: str) -> DriveCodec:
        """Build the codec of the board called `name`."""
        from drivers.robotino3_board.codec import Robotino3BoardCodec

        return Robotino3BoardCodec(name, self)
