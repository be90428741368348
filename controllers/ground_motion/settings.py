"""Settings of the ground motion that a camera measures, the section [ground_motion]."""

from typing import Annotated

from pydantic import Field

from controllers.ground_motion.rig import RigFile
from controllers.ground_motion.rig_tolerance import RigTolerance
from drivers.settings import Settings


class GroundMotionSettings(Settings):
    """How the motion over the ground is measured in the frames of `roles.camera`.

    Attributes:
        rig: Calibration of the camera, schema `rear-camera-rig/1`: name of a shipped file or path of one.
        tolerance: What is not known about the rig, and how deep the rover sinks.
        camera_delay_s: From the middle of an exposure to the time of its frame: the capture time where the
            camera reports it, else the arrival. Negative where the capture time is the exposure's beginning.
        greatest_age_s: Without a valid pair of frames for this long the wheels, and what else compensates
            their slip, are used again; the yaw excitation resumes.
    """

    rig: RigFile
    tolerance: RigTolerance = RigTolerance()
    camera_delay_s: Annotated[float, Field(ge=-0.1, le=1.0)] = 0.0
    greatest_age_s: Annotated[float, Field(ge=0.05, le=10.0)] = 0.5
