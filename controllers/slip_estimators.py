"""The slip estimator of a configuration."""

from controllers.estimation.slip_compensator import SlipEstimator
from controllers.motion.kinematics import Kinematics
from controllers.motion.rover_geometry import OmniRoverSettings
from controllers.roles import DeviceRoles
from controllers.settings import ControlSettings
from controllers.slip.effort.compensator import EffortCompensator, SlipReport
from controllers.slip.scomp.compensator import ScompCompensator, ScompReport
from controllers.slip.scomp.trace_reader import TraceFinder


def make_slip_estimator(
    settings: ControlSettings, kinematics: Kinematics, roles: DeviceRoles, finder: TraceFinder | None
) -> SlipEstimator[SlipReport | ScompReport] | None:
    """Return the estimator that [slip] or [scomp] configures; None without them.

    Args:
        settings: Of the rover; not both sections are valid for it.
        kinematics: Of its wheels.
        roles: Of its devices.
        finder: Finds the trace in the frames of the camera; None without one.
    """
    slip, scomp, rover = settings.slip, settings.scomp, settings.rover
    if slip is not None and isinstance(rover, OmniRoverSettings):
        travel_m_s = None if settings.mission is None else settings.mission.speed_m_s
        return EffortCompensator(slip, rover, kinematics, roles, travel_m_s)
    return None if scomp is None else ScompCompensator(scomp, roles, kinematics, finder)
