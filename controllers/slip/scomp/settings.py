"""Settings of slip compensation by trace and tilt."""

from typing import Annotated

from pydantic import Field

from controllers.ftrace.rig import RigFile
from controllers.slip.scomp.parameters import ScompParameters
from drivers.settings import Settings


class ScompSettings(Settings):
    """Slip compensation of a four-wheel rover by tilt and the rear wheel's trace.

    Attributes:
        parameters: Of rover, ground and sensors; in a configuration file the name of a shipped file or the
            path of one by `rover-hil identify scomp`.
        rig: Calibration of the camera in `roles.camera`, schema `rear-camera-rig/1`; in a configuration file
            the name of a shipped file or the path of one. Without it the slip angle is the one expected from
            the roll.
        frame_period_s: Frames that arrive sooner after the last evaluated one are skipped: the evaluation
            takes some milliseconds of a cycle.
        trace_age_s: Without a trace for this time the slip angle is flagged as uncertain.
        steer_against_drift: Steer the course over ground along the path, not the heading.
    """

    parameters: ScompParameters = ScompParameters()
    rig: RigFile | None = None
    frame_period_s: Annotated[float, Field(ge=0.05, le=10.0)] = 0.1
    trace_age_s: Annotated[float, Field(ge=0.1, le=60.0)] = 3.0
    steer_against_drift: bool = True
