"""Pure computation: kinematics, estimation, path control, limits. No I/O, no threads, no clock."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from controllers.control_loop import ControlLoop, StepOutput
    from controllers.estimation.pose_estimate import PoseEstimate
    from controllers.estimation.settings import FilterSettings
    from controllers.motion.kinematics import make_kinematics
    from controllers.motion.rover_geometry import OmniRoverSettings
    from controllers.motion.settings import LimitSettings
    from controllers.operator import OperatorInput
    from controllers.roles import DeviceRoles
    from controllers.safety import Mode
    from controllers.settings import ControlSettings

__all__ = [
    "ControlLoop",
    "ControlSettings",
    "DeviceRoles",
    "FilterSettings",
    "LimitSettings",
    "Mode",
    "OmniRoverSettings",
    "OperatorInput",
    "PoseEstimate",
    "StepOutput",
    "make_kinematics",
]

_MODULES = {
    "ControlLoop": "controllers.control_loop",
    "ControlSettings": "controllers.settings",
    "DeviceRoles": "controllers.roles",
    "FilterSettings": "controllers.estimation.settings",
    "LimitSettings": "controllers.motion.settings",
    "Mode": "controllers.safety",
    "OmniRoverSettings": "controllers.motion.rover_geometry",
    "OperatorInput": "controllers.operator",
    "PoseEstimate": "controllers.estimation.pose_estimate",
    "StepOutput": "controllers.control_loop",
    "make_kinematics": "controllers.motion.kinematics",
}


def __getattr__(name: str) -> Any:
    """Return a public name; its module is loaded when it is first asked for."""
    module = _MODULES.get(name)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(module), name)
