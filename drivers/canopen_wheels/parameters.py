"""Values of the settings of CANopen drives; their codec reads them."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from drivers.device_settings import CanDeviceSettings, DriveSettings, check_nodes
from drivers.settings import Settings


class CanopenWheel(Settings):
    """One wheel.

    Attributes:
        node: CANopen node number of its drive.
        sign: -1 where the drive counts backwards when the rover drives forwards.
    """

    node: Annotated[int, Field(ge=1, le=127)]
    sign: Literal[1, -1] = 1


class CanopenWheelsParameters(CanDeviceSettings, DriveSettings):
    """CANopen drives with the profile CiA 402 in a velocity mode, one for each wheel.

    The driver configures PDOs, heartbeats and mode of each drive by SDO before it moves; nothing is saved in
    the drive. The drive stops by itself when it misses the host's heartbeat: it must support the objects
    1016h and 6007h.

    Attributes:
        wheel: In the rover's order, e.g. front left, front right, rear left, rear right.
        mode: Mode of operation: "profile_velocity" (3) or "cyclic_velocity" (9).
        counts_per_motor_turn: Counts of the position (6064h) per turn of the motor.
        gear_ratio: Turns of the motor per turn of the wheel.
        velocity_units_per_rpm: Size of 1 rpm at the motor in the velocity unit of the drive (60FFh, 606Ch).
        rpm_limit: Largest speed of the motors: setpoints are clipped to it, and positions that move one and
            a half times as fast are rejected.
        rated_current_a: Rated current of the motors (6075h), the unit of 6078h; without it no current is
            read.
        pdo_period_ms: Time between two messages of each kind from a drive.
        heartbeat_timeout_ms: A drive stops when it gets no heartbeat for this long.
        host_node: Node number under which this program sends its heartbeat.
        fault_resets: How often a fault of a drive is reset, or a restarted drive is configured again, after
            the link came up; then the drive stays off. A fault is reset only while zero speeds are
            commanded, a second after it occurred, and at most three times in a run.
    """

    type: Literal["canopen_wheels"] = "canopen_wheels"
    wheel: Annotated[tuple[CanopenWheel, ...], Field(min_length=1)]
    mode: Literal["profile_velocity", "cyclic_velocity"] = "profile_velocity"
    counts_per_motor_turn: Annotated[int, Field(ge=1, le=100_000_000)]
    gear_ratio: Annotated[float, Field(gt=0, le=1000)]
    velocity_units_per_rpm: Annotated[float, Field(gt=0, le=1e6)] = 1.0
    rpm_limit: Annotated[int, Field(ge=1, le=100_000)] = 5000
    rated_current_a: Annotated[float, Field(gt=0, le=1000)] | None = None
    pdo_period_ms: Annotated[int, Field(ge=1, le=1000)] = 10
    heartbeat_timeout_ms: Annotated[int, Field(ge=20, le=1000)] = 150
    host_node: Annotated[int, Field(ge=1, le=127)] = 127
    fault_resets: Annotated[int, Field(ge=0, le=100)] = 3

    @model_validator(mode="after")
    def _check_nodes(self) -> Self:
        check_nodes([wheel.node for wheel in self.wheel], host_node=self.host_node)
        return self
