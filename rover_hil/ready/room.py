"""Whether a drive that a command makes by itself stays in the free place of the rover."""

from collections.abc import Sequence

from controllers.motion.settings import MissionSettings
from drivers.errors import ConfigError
from rover_hil.config import Config


def require_room(config: Config, missions: Sequence[MissionSettings | None], fix: str) -> None:
    """Check that all corners of missions lie in `mission.area` of the configuration, where it is set.

    Args:
        config: The rover.
        missions: What is to be driven, each from the start; None drives nothing.
        fix: What the user can do, in words.

    Raises:
        ConfigError: One lies outside.
    """
    area = None if config.mission is None else config.mission.area
    corners = [corner for mission in missions if mission for corner in mission.corners()]
    if area is None or all(area.holds(*corner) for corner in corners):
        return
    (left, right), (bottom, top) = ((min(values), max(values)) for values in zip(*corners, strict=True))
    raise ConfigError(
        f"the drives need x {left:g} to {right:g} m and y {bottom:g} to {top:g} m, more than mission.area: "
        f"{fix}, or correct the area"
    )
