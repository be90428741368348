"""Settings of the simulated rear camera and of the ground in its view."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from drivers.settings import Settings

LensCoefficient: TypeAlias = Annotated[float, Field(ge=-1, le=1)]
GroundKind: TypeAlias = Literal[
    "fine_sand", "coarse_sand", "rippled_sand", "patchy_sand", "gravel", "grass", "brick", "sandy_gravel"
]


class CameraEmulatorSettings(Settings):
    """Where the simulated camera looks, and how well.

    The camera is above and a little behind the point where a wheel touches the ground, by default the rear
    left one of the simulated four-wheeled rover, looks backwards and is tilted down. It sees about
    0.7 m x 0.7 m of ground by default; the rear camera of the rover El-Dorado saw 0.6 m x 0.8 m. The other
    three wheels mirror this one about the rover's axes.

    Attributes:
        wheel_x_m: Contact point of the wheel, forward of the rover's origin.
        wheel_y_m: Contact point of the wheel, to the left of the rover's origin.
        behind_m: Distance of the camera behind that point.
        height_m: Height of the camera above the floor of the trace.
        tilt_deg: Angle of the optical axis below the horizontal.
        horizontal_view_deg: Angle of view over the width of the image.
        distortion: k1, k2, p1, p2, k3 of the lens, as OpenCV defines them.
        trace_width_m: Width of the wheels.
        rut_depth_m: Sinkage of the wheels.
        ground: Appearance of the ground.
        stones_per_m2: Number of loose stones per square metre.
        sun_azimuth_deg: Direction to the sun in the world, counter-clockwise from x.
        sun_elevation_deg: Elevation of the sun above the ground.
        rock_deg: Standard deviation of the body's rocking, about x and about y.
        noise_grey: Standard deviation of the noise of a pixel, in grey levels of 255.
        exposure_s: Time from the capture stamp to the end of the exposure.
        transfer_s: Time from the end of the exposure to the arrival at the host.
    """

    type: Literal["camera"]
    wheel_x_m: Annotated[float, Field(ge=-5, le=5)] = -0.3
    wheel_y_m: Annotated[float, Field(ge=-5, le=5)] = 0.22
    behind_m: Annotated[float, Field(ge=-0.5, le=1)] = 0.02
    height_m: Annotated[float, Field(ge=0.1, le=3)] = 0.5
    tilt_deg: Annotated[float, Field(gt=0, le=90)] = 60.0
    horizontal_view_deg: Annotated[float, Field(ge=10, le=120)] = 60.0
    distortion: tuple[LensCoefficient, LensCoefficient, LensCoefficient, LensCoefficient, LensCoefficient] = (
        -0.12,
        0.01,
        0.0,
        0.0,
        0.0,
    )
    trace_width_m: Annotated[float, Field(gt=0, le=0.3)] = 0.11
    rut_depth_m: Annotated[float, Field(ge=0.001, le=0.03)] = 0.014
    ground: GroundKind = "fine_sand"
    stones_per_m2: Annotated[float, Field(ge=0, le=100)] = 3.0
    sun_azimuth_deg: Annotated[float, Field(ge=-360, le=360)] = 75.0
    sun_elevation_deg: Annotated[float, Field(ge=15, le=90)] = 50.0
    rock_deg: Annotated[float, Field(ge=0, le=5)] = 0.2
    noise_grey: Annotated[float, Field(ge=0, le=50)] = 3.0
    exposure_s: Annotated[float, Field(ge=0, le=0.1)] = 0.008
    transfer_s: Annotated[float, Field(gt=0, le=0.1)] = 0.006
