"""The joints of a rover, and what [ros2] must fulfil together with other sections."""

from collections.abc import Iterator
from importlib.util import find_spec

from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import RoverSettings, WheelsRoverSettings
from controllers.motion.settings import MissionSettings
from rover_hil.config.ros2_settings import Ros2Settings

MISSING_LIBRARY = (
    "ros2: this section needs the library cyclonedds: install it with `pip install rover-hil[ros2]`; on ARM "
    "build Cyclone DDS 11.0.1 first and set CYCLONEDDS_HOME (docs/how-to/connect_ros2.md)"
)


def steered_wheels(rover: RoverSettings) -> tuple[int, ...]:
    """Return the wheels that steer, from 0."""
    if not isinstance(rover, WheelsRoverSettings):
        return ()
    return tuple(number for number, wheel in enumerate(rover.wheels) if wheel.steering is not None)


def joint_names(rover: RoverSettings, settings: Ros2Settings) -> tuple[str, ...]:
    """Return the names of the joints: of all wheels, then the steering of those that steer."""
    if settings.joint_names:
        return settings.joint_names
    wheels = [f"wheel_{number}_joint" for number in range(make_kinematics(rover).wheel_count)]
    return (*wheels, *(f"steering_{number}_joint" for number in steered_wheels(rover)))


def find_connection_conflicts(rover: RoverSettings, settings: Ros2Settings | None) -> Iterator[str]:
    """Yield what hinders a connection with ROS 2, with the fix."""
    if settings is None:
        return
    if find_spec("cyclonedds") is None:
        yield MISSING_LIBRARY
    steered = len(steered_wheels(rover))
    wheels = make_kinematics(rover).wheel_count
    names = joint_names(rover, settings)
    if not len(names) == len(set(names)) == wheels + steered:
        steering = f" and of the steering of {steered}" if steered else ""
        yield f"ros2.joint_names: give {wheels + steered} different names, of {wheels} wheels{steering}"


def find_command_conflicts(mission: MissionSettings | None, settings: Ros2Settings | None) -> Iterator[str]:
    """Yield why velocities over ROS 2 cannot drive the rover, with the fix."""
    if settings is not None and settings.commands and (mission is None or mission.type != "by_hand"):
        yield (
            "ros2.commands: velocities on cmd_vel drive the rover only with mission.type = 'by_hand': choose "
            "it, or leave commands out"
        )
