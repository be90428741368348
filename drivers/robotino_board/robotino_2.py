"""The board of a Robotino 2 as delivered: the one behind the measured data sets."""

from drivers.robotino_board.scales import scales
from drivers.robotino_board.settings import RobotinoBoardSettings

ROBOTINO_BOARD = RobotinoBoardSettings(type="robotino_board", port="none", board="EA05")
ROBOTINO_SCALES = scales(ROBOTINO_BOARD)
"""At the wheel; at the motor angles and speeds are `ROBOTINO_BOARD.gear_ratio` times as large."""
