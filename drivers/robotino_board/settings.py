"""Settings of the Robotino 1/2/XT board."""

from drivers.driver import DriveCodec
from drivers.robotino_board.parameters import RobotinoBoardParameters

REPLY_DELAY_S = 0.005
"""Measured, 4 to 6 ms."""
REPLY_BYTES = 101
BITS_PER_BYTE = 10


class RobotinoBoardSettings(RobotinoBoardParameters):
    """The board that turns the three wheels and reports their encoders and motor currents."""

    def wheel_age_s(self, request_period_s: float) -> float:
        """Return the age of the positions in a reply: an EA05 answers with those of the request before."""
        reply_s = REPLY_DELAY_S + BITS_PER_BYTE * REPLY_BYTES / self.baud_rate
        return reply_s + (request_period_s if self.board == "EA05" else 0.0)

    def reports_supply(self) -> bool:
        """Return True."""
        return True

    def make_codec(self, name: str) -> DriveCodec:
        """Build the codec of the board called `name`."""
        from drivers.robotino_board.codec import RobotinoBoardCodec

        return RobotinoBoardCodec(name, self)
