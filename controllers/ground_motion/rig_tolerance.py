"""What is not known about the rig of a camera; apart from its effect, which needs OpenCV."""

from typing import Annotated

from pydantic import Field

from drivers.settings import Settings

Deviation = Annotated[float, Field(ge=0)]


class RigTolerance(Settings):
    """What is not known about a rig: standard deviations, and how deep the rover sinks.

    Attributes:
        height_sd_m: Of the height of the camera over the plane of the wheels' contacts.
        pitch_sd_deg: Of the angle between the camera's axis and the ground.
        focal_length_sd: Of the focal length, over itself.
        sinkage_m: Usual depth to which the wheels sink into the ground, with the camera.
        sinkage_sd_m: Standard deviation of it.
    """

    height_sd_m: Deviation = 0.005
    pitch_sd_deg: Deviation = 0.2
    focal_length_sd: Deviation = 0.005
    sinkage_m: Deviation = 0.0
    sinkage_sd_m: Deviation = 0.01
