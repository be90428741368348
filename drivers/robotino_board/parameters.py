"""Values of the settings of the Robotino 1/2/XT board; its codec reads them."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from drivers.device_settings import DriveSettings, SerialDeviceSettings

Board: TypeAlias = Literal["EA05", "EA09"]
Gain: TypeAlias = Annotated[int, Field(ge=0, le=255)]


class RobotinoBoardParameters(SerialDeviceSettings, DriveSettings):
    """The board that turns the three wheels and reports their encoders and motor currents.

    Attributes:
        board: Type of the board; scales of currents and battery depend on it. Replies of the other type are
            rejected.
        gear_ratio: Turns of the motor per turn of the wheel.
        ticks_per_motor_turn: Encoder counts per turn of the motor.
        kp, ki, kd: Gain of the board's speed loops; all three 255 selects the board's own defaults.
    """

    type: Literal["robotino_board"]
    baud_rate: Annotated[int, Field(ge=300, le=4_000_000)] = 115_200
    board: Board = "EA05"
    gear_ratio: Annotated[float, Field(gt=0, le=1000)] = 16.0
    ticks_per_motor_turn: Annotated[int, Field(ge=1, le=1_000_000)] = 2000
    kp: Gain = 255
    ki: Gain = 255
    kd: Gain = 255
