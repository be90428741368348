"""Values of the settings of VESC motor controllers; their codec reads them."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from drivers.device_settings import CanDeviceSettings, DriveSettings, check_nodes
from drivers.settings import Settings


class VescWheel(Settings):
    """One wheel.

    Attributes:
        node: VESC ID of its controller (VESC Tool, App Settings, General).
        sign: -1 where the controller counts backwards when the rover drives forwards.
    """

    node: Annotated[int, Field(ge=0, le=254)]
    sign: Literal[1, -1] = 1


class VescParameters(CanDeviceSettings, DriveSettings):
    """VESC motor controllers, one for each wheel, in CAN mode "VESC".

    Each must send status messages 1 and 5 (VESC Tool, App Settings, General, CAN Status Messages). Its
    Timeout there is what stops the wheel when this computer fails: 0 switches it off, 200 ms are advised,
    with a Timeout Brake Current. Below its Minimum ERPM (Motor Settings, PID Controllers) a VESC brakes
    instead of controlling the speed; set it to fit the slowest motion.

    Attributes:
        wheel: In the rover's order, e.g. front left, front right, rear left, rear right.
        pole_pairs: Pairs of magnetic poles of the motors.
        gear_ratio: Turns of the motor per turn of the wheel.
        erpm_limit: Largest electrical speed of the motors, in turns per minute: setpoints are clipped to it,
            and positions that move faster are rejected. Enter the Max ERPM of VESC Tool.
        host_id: VESC ID under which this program asks for faults; no controller may have it.
    """

    type: Literal["vesc"] = "vesc"
    wheel: Annotated[tuple[VescWheel, ...], Field(min_length=1)]
    pole_pairs: Annotated[int, Field(ge=1, le=100)]
    gear_ratio: Annotated[float, Field(gt=0, le=1000)]
    erpm_limit: Annotated[int, Field(ge=100, le=1_000_000)] = 100_000
    host_id: Annotated[int, Field(ge=0, le=254)] = 254

    @model_validator(mode="after")
    def _check_nodes(self) -> Self:
        check_nodes([wheel.node for wheel in self.wheel], host_id=self.host_id)
        return self
