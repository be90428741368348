"""One wheel of a rover that is described by a list of its wheels: [[rover.wheels]]."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from drivers.settings import Settings

WheelRadius = Annotated[float, Field(ge=0.005, le=1.0)]

LEAST_STEERING_DEG = 1.0
LEAST_ROLLER_DEG = 5.0


class SteeringSettings(Settings):
    """How far and how fast a wheel steers.

    Attributes:
        low_deg: Least steering angle, counter-clockwise from the wheel's `angle_deg`.
        high_deg: Greatest steering angle.
        rate_deg_s: Greatest speed of the steering drive. Where the drive does not report its angle, the
            controller assumes that it moves from 0 to its setpoints at this speed.
    """

    low_deg: Annotated[float, Field(ge=-360.0, le=0.0)]
    high_deg: Annotated[float, Field(ge=0.0, le=360.0)]
    rate_deg_s: Annotated[float, Field(ge=1.0, le=1000.0)] = 90.0

    @model_validator(mode="after")
    def _check_range(self) -> Self:
        if self.high_deg - self.low_deg < LEAST_STEERING_DEG:
            raise ValueError(
                f"the wheel steers by less than {LEAST_STEERING_DEG:g} deg: widen low_deg and high_deg, or "
                "leave the steering out"
            )
        return self


class WheelMotorSettings(Settings):
    """Torque-speed line of the motor of a wheel, at the wheel and at the supply's voltage.

    Attributes:
        stall_torque_nm: Torque at rest.
        no_load_rad_s: Speed of the wheel without load.
        stall_current_a: Current at rest.
    """

    stall_torque_nm: Annotated[float, Field(gt=0.0, le=10_000.0)]
    no_load_rad_s: Annotated[float, Field(gt=0.0, le=1000.0)]
    stall_current_a: Annotated[float, Field(gt=0.0, le=1000.0)] = 5.0


class WheelSettings(Settings):
    """One wheel that a device measures or steers. No swivelling castors: they do not constrain the motion.

    Attributes:
        x_m: Contact point, forward of the origin of the body frame.
        y_m: Contact point, to the left of it.
        radius_m: Radius of the wheel.
        angle_deg: Direction in which the wheel rolls when it turns forwards, counter-clockwise from x; with
            steering, the direction at steering angle 0.
        driven: False where no motor turns the wheel.
        measured: False where the wheel has no encoder: what it turns is not known, but it rolls without side
            slip in its direction, like the others.
        roller_deg: Angle from the wheel's axle (pointing to the left of its direction) to the axle of the
            roller on the ground, counter-clockwise seen from above: 90 for an omnidirectional wheel, 45 or
            -45 for a mecanum wheel. Without it the wheel has no rollers.
        steering: Limits of the steering; without it the wheel does not steer.
        motor: Motor constants, for the simulated rover.
    """

    x_m: Annotated[float, Field(ge=-10.0, le=10.0)]
    y_m: Annotated[float, Field(ge=-10.0, le=10.0)]
    radius_m: WheelRadius
    angle_deg: Annotated[float, Field(ge=-360.0, le=360.0)] = 0.0
    driven: bool = True
    measured: bool = True
    roller_deg: Annotated[float, Field(ge=-90.0, le=90.0)] | None = None
    steering: SteeringSettings | None = None
    motor: WheelMotorSettings | None = None

    @model_validator(mode="after")
    def _check_rollers(self) -> Self:
        if self.roller_deg is not None and abs(self.roller_deg) < LEAST_ROLLER_DEG:
            raise ValueError(
                f"roller_deg is {self.roller_deg:g}: the rollers lie along the axle, so nothing turns the "
                f"wheel and it moves nothing; give an angle of at least {LEAST_ROLLER_DEG:g} deg"
            )
        if self.roller_deg is not None and self.steering is not None:
            raise ValueError("a wheel with rollers does not steer: remove steering or roller_deg")
        return self
