"""The section [ros2] of a configuration."""

import os
import re
from typing import Annotated

from pydantic import AfterValidator, Field

from drivers.settings import Settings

DOMAIN_VARIABLE = "ROS_DOMAIN_ID"
MOST_JOINTS = 100
POSE_FIX = "/pose_fix"
"""Name of the poses that arrive over ROS 2 instead of from a device: no device can be called so."""


def _check_name(text: str) -> str:
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*", text):
        raise ValueError(
            f"'{text}' is not a name of ROS: use letters, digits and _, "
            "parts separated by /, without one in front"
        )
    return text


def _check_namespace(text: str) -> str:
    return _check_name(text) if text else text


def _check_host(text: str) -> str:
    # It becomes a part of an XML text.
    if not re.fullmatch(r"[A-Za-z0-9.:_-]{1,253}", text):
        raise ValueError(f"'{text}' is not a network interface, a host or an address")
    return text


Name = Annotated[str, Field(max_length=200), AfterValidator(_check_name)]
Host = Annotated[str, AfterValidator(_check_host)]


class Ros2Settings(Settings):
    """What a run exchanges with programs of ROS 2, through DDS. No ROS need be installed.

    Whoever reaches the interface can read, and with `commands` drive: DDS here has no access control.

    Attributes:
        interface: Name of the one network interface that is used. `lo` reaches programs on this computer
            only.
        domain: Number of the domain; without it the environment variable ROS_DOMAIN_ID, or 0.
        peers: Addresses of other computers that multicast does not reach.
        namespace: Prefix of all topics; frames have none.
        odom_frame: Frame of the pose.
        base_frame: Frame of the rover's body.
        map_frame: Frame of pose fixes. What they correct is sent as transform from here to `odom_frame`.
        publish_tf: Whether transforms are sent; false where another program sends them.
        joint_names: Names of the joints as in the URDF: of all wheels, then the steering of the wheels that
            steer. Empty for wheel_0_joint, ..., steering_0_joint, ...
        commands: Whether velocities on `cmd_vel` drive the rover; only with a mission of type by_hand.
        pose_fixes: Whether poses on `pose_fix` correct the estimate, like those of a camera in `roles.fixes`.
            The clocks of both computers must agree.
        command_timeout_s: The rover rests this long after the arrival of the newest command.
    """

    interface: Host = "lo"
    domain: Annotated[int, Field(ge=0, le=101)] | None = None
    peers: Annotated[tuple[Host, ...], Field(max_length=32)] = ()
    namespace: Annotated[str, Field(max_length=200), AfterValidator(_check_namespace)] = ""
    odom_frame: Name = "odom"
    base_frame: Name = "base_link"
    map_frame: Name = "map"
    publish_tf: bool = True
    joint_names: Annotated[tuple[Name, ...], Field(max_length=MOST_JOINTS)] = ()
    commands: bool = False
    pose_fixes: bool = False
    command_timeout_s: Annotated[float, Field(ge=0.05, le=2.0)] = 0.5

    def domain_id(self) -> int | None:
        """Return the number of the domain; None where the environment variable holds no valid one."""
        if self.domain is not None:
            return self.domain
        text = os.environ.get(DOMAIN_VARIABLE, "") or "0"
        return int(text) if text.isdecimal() and int(text) <= 101 else None

    def topic(self, name: str) -> str:
        """Return the name of a topic in DDS."""
        return "/".join(filter(None, ("rt", self.namespace, name)))
