"""Settings of the Robotino 1/2/XT board."""

from drivers.driver import DriveCodec
from drivers.robotino_board.parameters import RobotinoBoardParameters


class RobotinoBoardSettings(RobotinoBoardParameters):
    """The board that turns the three wheels and reports their encoders and motor currents."""

    def make_codec(self, name: str) -> DriveCodec:
        """Build the codec of the board called `name`."""
        from drivers.robotino_board.codec import RobotinoBoardCodec

        return RobotinoBoardCodec(name, self)
