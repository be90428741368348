"""Settings of slip compensation by trace and tilt."""

from typing import Annotated

from pydantic import Field

from controllers.ground_motion.rig import RigFile
from controllers.slip.scomp.parameters import ScompParameters
from drivers.settings import Settings


class ScompSettings(Settings):
    """How slip and slip angle of a four-wheel rover are estimated and compensated.

    Attributes:
        parameters: Parameters of rover, ground and sensors: name of a shipped file or path of one by
            `rover-hil identify scomp`.
        rig: Calibration of the camera in `roles.camera`, schema `rear-camera-rig/1`: name of a shipped file
            or path of one. Without it the slip angle is predicted from the roll.
        frame_period_s: Frames that come sooner after the last processed one are skipped: processing takes
            some milliseconds of a cycle.
        trace_age_s: Without a trace for this long the slip angle is flagged as uncertain.
        steer_against_drift: Align the course over ground with the path, not the rover's longitudinal axis.
            Where `mission.heading` is `crab` the wheels are turned for it, else the body.
    """

    parameters: ScompParameters = ScompParameters()
    rig: RigFile | None = None
    frame_period_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.1
    trace_age_s: Annotated[float, Field(ge=0.1, le=60.0)] = 3.0
    steer_against_drift: bool = True
