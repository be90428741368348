"""Pure computation: kinematics, estimation, path control, limits. No I/O, no threads, no clock."""

from typing import TYPE_CHECKING

from drivers.public_names import public_names

if TYPE_CHECKING:
    from controllers.control_loop import ControlLoop as ControlLoop
    from controllers.control_loop import StepOutput as StepOutput
    from controllers.estimation.pose_estimate import PoseEstimate as PoseEstimate
    from controllers.estimation.settings import FilterSettings as FilterSettings
    from controllers.motion.kinematics import make_kinematics as make_kinematics
    from controllers.motion.rover_geometry import OmniRoverSettings as OmniRoverSettings
    from controllers.motion.settings import LimitSettings as LimitSettings
    from controllers.operator import OperatorInput as OperatorInput
    from controllers.roles import DeviceRoles as DeviceRoles
    from controllers.safety import Mode as Mode
    from controllers.settings import ControlSettings as ControlSettings

__getattr__ = public_names(__name__)
