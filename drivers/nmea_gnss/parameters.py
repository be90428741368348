"""What the codec of a GNSS receiver needs: antenna, origin and deviations."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from drivers.settings import Settings

Deviation = Annotated[float, Field(gt=0, le=100)]
Place = Annotated[float, Field(ge=-10, le=10)]


class NmeaGnssParameters(Settings):
    """Place of the antenna, origin of the frame, and how certain positions are.

    Attributes:
        antenna_x_m: Place of the antenna, ahead of the origin of the rover.
        antenna_y_m: Place of the antenna, to the left of it.
        latency_s: Age of a position at the arrival of its sentence.
        origin_latitude_deg: Origin of the local frame, x to the east and y to the north; without it and the
            longitude the first fix is the origin.
        origin_longitude_deg: Origin of the local frame.
        single_m: Standard deviation of a position without corrections, east and north, at HDOP 1. This and
            the next three hold where the receiver sends no GST.
        differential_m: The same with differential corrections.
        float_m: The same of RTK without whole cycles.
        fixed_m: The same of RTK with whole cycles.
        least_std_m: No fix is more certain than this, whatever the receiver says.
        correlation_s: Time over which errors of successive fixes are alike. Fixes that follow faster are
            less certain by it, so that many of them do not pass for independent ones. Chosen by hand.
    """

    antenna_x_m: Place = 0.0
    antenna_y_m: Place = 0.0
    latency_s: Annotated[float, Field(ge=0, le=1)] = 0.1
    origin_latitude_deg: Annotated[float, Field(ge=-89, le=89)] | None = None
    origin_longitude_deg: Annotated[float, Field(ge=-180, le=180)] | None = None
    single_m: Deviation = 3.0
    differential_m: Deviation = 1.0
    float_m: Deviation = 0.4
    fixed_m: Deviation = 0.02
    least_std_m: Deviation = 0.01
    correlation_s: Annotated[float, Field(ge=0, le=600)] = 3.0

    @model_validator(mode="after")
    def _check_origin(self) -> Self:
        if (self.origin_latitude_deg is None) != (self.origin_longitude_deg is None):
            raise ValueError("give both origin_latitude_deg and origin_longitude_deg, or neither")
        return self
