"""Whether anything in a mission would notice a yaw that is wrong."""

from typing import NamedTuple

from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import OmniRoverSettings
from controllers.roles import DeviceRoles
from controllers.settings import ControlSettings
from controllers.slip.effort.settings import YAW_PROBE


class UnwatchedYaw(NamedTuple):
    """That nothing would notice a wrong yaw.

    Attributes:
        what: What would not be noticed.
        help: What would watch the yaw.
    """

    what: str
    help: str

    def __str__(self) -> str:
        """Return both in words."""
        return f"yaw unwatched: {self.what}; {self.help}"


def find_unwatched_yaw(settings: ControlSettings, roles: DeviceRoles) -> UnwatchedYaw | None:
    """Return that nothing would notice a wrong yaw, and what would; None where something does.

    The turn by the gyro is compared with pose fixes, a heading device, the yaw excitation, and with turns of
    the mission on the spot. Straight ahead with none of them a gyro without a signal looks like a rover that
    keeps its heading. Without a gyro only fixes and headings remain. Without a mission nothing is at stake.

    Args:
        settings: As run: on a real rover without an excitation that has not been commissioned.
        roles: Of the devices.
    """
    mission, slip = settings.mission, settings.slip
    if mission is None or roles.fixes or roles.headings:
        return None
    if roles.gyro is None:
        return UnwatchedYaw(
            "nothing compares the turn by the wheels", "a gyro, a compass or pose fixes would watch it"
        )
    kinematics = make_kinematics(settings.rover)
    if (slip is not None and slip.use == YAW_PROBE) or mission.turns_beside_travel(kinematics):
        return None
    excitation = ""
    if isinstance(settings.rover, OmniRoverSettings):
        excitation = f"the yaw excitation ([slip] use = '{YAW_PROBE}', commissioned on a real rover), "
    return UnwatchedYaw(
        f"nothing in this mission would notice that {roles.gyro} measures no turns",
        f"{excitation}a compass, pose fixes or a mission that turns on the spot would watch it",
    )
