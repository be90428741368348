"""Settings of the simulated overhead camera."""

from typing import Annotated, Literal

from pydantic import Field

from drivers.settings import Settings


class OverheadCameraEmulatorSettings(Settings):
    """Pose and image quality of the simulated camera.

    Attributes:
        camera_x_m: Position of the lens in the world.
        camera_y_m: Position of the lens in the world.
        height_m: Height of the lens above the floor.
        turn_deg: Direction of the image's x axis in the world, counter-clockwise from x.
        tilt_x_deg: Tilt of the optical axis from straight down towards the image's right.
        tilt_y_deg: Tilt of the optical axis from straight down towards the image's upper edge.
        horizontal_view_deg: Angle of view over the width of the image.
        exposure_s: Duration of the exposure; the image is stamped at its beginning.
        transfer_min_s: Shortest time from the end of the exposure to the arrival at the host.
        transfer_max_s: Longest time from the end of the exposure to the arrival at the host.
        blur_px: Standard deviation of the optical blur.
        noise_grey: Standard deviation of the noise of a pixel, in grey levels of 255.
        marker_height_error_m: True height of the marker minus the configured one.
        marker_yaw_error_deg: True yaw of the marker minus the configured one.
    """

    type: Literal["overhead_camera"]
    camera_x_m: float = 0.45
    camera_y_m: float = 0.2
    height_m: Annotated[float, Field(ge=0.5, le=10)] = 2.5
    turn_deg: float = 0.0
    tilt_x_deg: Annotated[float, Field(ge=-30, le=30)] = 1.5
    tilt_y_deg: Annotated[float, Field(ge=-30, le=30)] = -1.0
    horizontal_view_deg: Annotated[float, Field(ge=10, le=100)] = 36.0
    exposure_s: Annotated[float, Field(ge=0, le=0.1)] = 0.010
    transfer_min_s: Annotated[float, Field(gt=0, le=1)] = 0.015
    transfer_max_s: Annotated[float, Field(gt=0, le=1)] = 0.050
    blur_px: Annotated[float, Field(ge=0, le=10)] = 0.6
    noise_grey: Annotated[float, Field(ge=0, le=50)] = 3.0
    marker_height_error_m: Annotated[float, Field(ge=-0.1, le=0.1)] = 0.003
    marker_yaw_error_deg: Annotated[float, Field(ge=-10, le=10)] = 0.1
