"""Values of the settings of the Robotino 3/4 board; its codec reads them."""

from typing import Annotated, Literal

from pydantic import Field

from drivers.device_settings import DriveSettings, SerialDeviceSettings


class Robotino3BoardParameters(SerialDeviceSettings, DriveSettings):
    """The board of a Robotino 3 or 4 (USB 1e29:040d, `/dev/ttyACM*`). Stop the daemon controld3 first.

    Attributes:
        baud_rate: Not used by the USB port; any value works.
        gear_ratio: Turns of the motor per turn of the wheel.
        ticks_per_motor_turn: Encoder counts per turn of the motor.
        rpm_limit: Largest speed of the motors in turns per minute: setpoints are clipped to it, and
            positions that move one and a half times as fast are rejected.
        emergency_bumper: The board itself stops the motors while the bumper is pressed.
    """

    type: Literal["robotino3_board"] = "robotino3_board"
    baud_rate: Annotated[int, Field(ge=300, le=4_000_000)] = 115_200
    gear_ratio: Annotated[float, Field(gt=0, le=1000)] = 32.0
    ticks_per_motor_turn: Annotated[int, Field(ge=1, le=1_000_000)] = 2000
    rpm_limit: Annotated[int, Field(ge=100, le=30_000)] = 3000
    emergency_bumper: bool = True
