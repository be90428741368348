"""Settings of [safety]: every threshold of every stop rule."""

from typing import Annotated

from pydantic import Field

from drivers.settings import Settings


class SafetySettings(Settings):
    """When the rover stops, and when it moves again.

    Attributes:
        expiry_s: A command holds for this long after its cycle.
        settle_s: All required devices must be fresh for this long before the first motion.
        recover_s: And for this long before motion resumes after a stop.
        bumper_stops: A pressed bumper stops the rover until restart.
        contradiction_s: The rover stops when every value of a measurement has been rejected for this long.
            A gap between two rejections counts for at most half of it, so three rejections are needed.
        stall_s: The rover stops when a wheel has not followed its set-points for this long.
        stall_set_point_rad_s: Least set-point that every wheel follows under its greatest load. Friction and
            the droop of the drive's speed loop may take up smaller ones, so they are no evidence. 288 runs of
            a Robotino on four surfaces: a set-point of 0.43 rad/s turns every wheel.
        stall_ratio: A wheel follows when it turns faster than this share of its set-point.
        identical_stops: The rover stays stopped until restart when it stops this many times for the same
            cause: driving may bring back a cause that cannot be seen at rest.
        forget_stops_m: Stops for a cause are forgotten after this distance without a sign of that cause.
    """

    expiry_s: Annotated[float, Field(ge=0.01, le=1.0)] = 0.15
    settle_s: Annotated[float, Field(ge=0.0, le=60.0)] = 1.0
    recover_s: Annotated[float, Field(ge=0.0, le=60.0)] = 0.5
    bumper_stops: bool = True
    contradiction_s: Annotated[float, Field(ge=0.1, le=60.0)] = 2.0
    stall_s: Annotated[float, Field(ge=0.1, le=10.0)] = 1.0
    stall_set_point_rad_s: Annotated[float, Field(ge=0.01, le=50.0)] = 0.5
    stall_ratio: Annotated[float, Field(ge=0.01, le=0.9)] = 0.1
    identical_stops: Annotated[int, Field(ge=1, le=100)] = 3
    forget_stops_m: Annotated[float, Field(ge=0.01, le=1000.0)] = 1.0
