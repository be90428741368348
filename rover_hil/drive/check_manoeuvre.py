"""Asks for the room of the check manoeuvre, and offers it after a stop."""

import sys
from typing import NamedTuple

from controllers.check_manoeuvre.path import Compared
from controllers.check_manoeuvre.plan import Room, compared_with, room_of
from controllers.motion.settings import WaypointsMission
from rover_hil.config import Config
from rover_hil.console.ask import ask_yes
from rover_hil.ready.room import require_room
from rover_hil.run.check_manoeuvre import without_check_manoeuvre

UNCONFIRMED = "the sources stay unconfirmed"
NOBODY = f"check manoeuvre not driven, {UNCONFIRMED}: nobody at a terminal confirms that the room is free"
REFUSED = f"check manoeuvre not driven, {UNCONFIRMED}"
OFFER = (
    "the sources may have changed: `rover-hil doctor` examines the devices, and a new run begins with the "
    "check manoeuvre"
)
FIX = "set check_manoeuvre = false in [safety]"


class Permission(NamedTuple):
    """Whether the check manoeuvre is driven.

    Attributes:
        config: The configuration to run.
        words: What is driven or not, for the user; empty where nothing is left to be stated.
    """

    config: Config
    words: str


def permit_check_manoeuvre(config: Config, *, virtual: bool) -> Permission:
    """State the room for the check manoeuvre, and ask whether it is free; a simulated rover has it.

    Without a terminal nobody is asked, and it is not driven.

    Raises:
        ConfigError: It leaves `safety.area`, or the input ends instead of an answer.
    """
    if not config.safety.check_manoeuvre or config.mission is None:
        return Permission(config, "")
    if not virtual and not sys.stdin.isatty():
        return Permission(without_check_manoeuvre(config), NOBODY)
    roles = config.device_roles()
    room = room_of(config, roles)
    _require_area(config, room)
    words = _room_words(config, room)
    if compared_with(config, roles) is Compared.NOTHING:
        words += "; no source measures travel or positions, so the direction of travel is not compared"
    if virtual:
        return Permission(config, words)
    if ask_yes(f"{words}. Is this room free?", default=False):
        return Permission(config, "")
    return Permission(without_check_manoeuvre(config), REFUSED)


def offer(config: Config, stops: int) -> str:
    """Return what to do after a run with stops where the configuration wants the manoeuvre; else empty."""
    return OFFER if stops and config.safety.check_manoeuvre else ""


def _require_area(config: Config, room: Room) -> None:
    """Check that the path stays in the area of the rover."""
    points_m = room.points_m[1:]
    if points_m and config.mission is not None:
        speed_m_s = config.mission.speed_m_s
        path = WaypointsMission(type="waypoints", points=points_m, speed_m_s=speed_m_s)
        require_room(config, [path], FIX)


def _room_words(config: Config, room: Room) -> str:
    """Return the room in words."""
    radius_m = config.safety.body_m(config.rover)
    body = "safety.area_body_m" if config.safety.area_body_m else "of its wheels; a wider body needs more"
    return (
        f"check manoeuvre: it needs {room.ahead_m:.2f} m ahead of the rover's origin, {room.behind_m:.2f} m "
        f"behind and {room.aside_m:.2f} m to each side (radius {radius_m:.2f} m, {body})"
    )
