"""Settings of the simulated wheel drives on a CAN bus, without the library that reads DBC files."""

from typing import Annotated, Literal

from pydantic import Field

from drivers.settings import Settings


class CanNodeSettings(Settings):
    """Rates, errors and watchdog of the drives; rounding to the resolution of the signals is added.

    Attributes:
        wheel_rate_hz: Messages about wheels, of each kind, per second; spread evenly over the period.
        status_rate_hz: All other messages per second, of each kind.
        encoder_ticks_per_revolution: Encoder counts per turn of the motor, where the mapping's unit is not
            ticks.
        speed_noise_rad_s: Standard deviation of each reported speed, at the wheel.
        current_noise_a: Standard deviation of each motor current.
        current_step_a: Resolution of the drive's current measurement; 0 for none.
        voltage_noise_v: Standard deviation of each supply voltage.
        yaw_rate_noise_rad_s: Standard deviation of each yaw rate, where the mapping has one.
        watchdog_s: A wheel stops when it gets no setpoint for this long.
    """

    type: Literal["can_wheels"] = "can_wheels"
    wheel_rate_hz: Annotated[float, Field(gt=0, le=1000)] = 100.0
    status_rate_hz: Annotated[float, Field(gt=0, le=100)] = 10.0
    encoder_ticks_per_revolution: Annotated[float, Field(gt=0, le=1e8)] = 8192.0
    speed_noise_rad_s: Annotated[float, Field(ge=0, le=10)] = 0.02
    current_noise_a: Annotated[float, Field(ge=0, le=10)] = 0.02
    current_step_a: Annotated[float, Field(ge=0, le=10)] = 0.008
    voltage_noise_v: Annotated[float, Field(ge=0, le=10)] = 0.02
    yaw_rate_noise_rad_s: Annotated[float, Field(ge=0, le=1)] = 0.002
    watchdog_s: Annotated[float, Field(gt=0, le=60)] = 0.2
