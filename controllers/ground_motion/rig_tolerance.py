"""What is not known about the rig of a camera; apart from its effect, which needs OpenCV."""

from typing import Annotated

from pydantic import Field

from drivers.settings import Settings

Deviation = Annotated[float, Field(ge=0)]


class RigTolerance(Settings):
    """What is not known about a rig: standard deviations, and how deep the rover sinks.

    Attributes:
        scale: True travel over that by the rig alone: `rover-hil calibrate scale CONFIG` finds it.
        scale_sd: Standard deviation of it; None where it is not calibrated. The deviations of height, pitch
            and focal length do not count beside it.
        scale_date: Day of the drive that it was found on, like 2026-11-27.
        height_sd_m: Of the height of the camera over the plane of the wheels' contacts.
        pitch_sd_deg: Of the angle between the camera's axis and the ground.
        focal_length_sd: Of the focal length, over itself.
        yaw_sd_deg: Of the yaw of the camera. Once the rover has driven on several headings without a
            contradiction, 0.75 deg at most.
        sinkage_m: Usual depth to which the wheels sink into the ground, with the camera.
        sinkage_sd_m: Standard deviation of it.
    """

    scale: Annotated[float, Field(gt=0.5, lt=2)] = 1.0
    scale_sd: Deviation | None = None
    scale_date: Annotated[str, Field(pattern=r"^\d{4}-\d\d-\d\d$")] | None = None
    height_sd_m: Deviation = 0.005
    pitch_sd_deg: Deviation = 0.2
    focal_length_sd: Deviation = 0.005
    yaw_sd_deg: Deviation = 3.0
    sinkage_m: Deviation = 0.0
    sinkage_sd_m: Deviation = 0.01
