"""Whether a drive that a command makes by itself stays in the area of the rover."""

from collections.abc import Sequence

from controllers.motion.settings import MissionSettings
from controllers.settings import find_area_conflicts
from drivers.errors import ConfigError
from rover_hil.config import Config


def require_room(config: Config, missions: Sequence[MissionSettings | None], fix: str) -> None:
    """Check that the rover stays in `safety.area` of the configuration on missions, where it is set.

    Args:
        config: The rover.
        missions: What is to be driven, each from the start; None drives nothing.
        fix: What the user can do, in words.

    Raises:
        ConfigError: One leaves it.
    """
    conflicts = [find_area_conflicts(config.rover, mission, config.safety) for mission in missions]
    if not any(map(list, conflicts)):
        return
    corners = [corner for mission in missions if mission for corner in mission.corners()]
    (left, right), (bottom, top) = ((min(values), max(values)) for values in zip(*corners, strict=True))
    raise ConfigError(
        f"the drives need x {left:g} to {right:g} m and y {bottom:g} to {top:g} m, and around that the body "
        f"of the rover, more than safety.area: {fix}, or correct the area"
    )
