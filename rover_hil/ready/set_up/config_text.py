"""The text of a new configuration, with a comment on what to change later."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from drivers.registry import AnyDeviceSettings
from rover_hil.config.loader import SCHEMA_NAME
from rover_hil.datasets.toml_text import toml_text


@dataclass(frozen=True, slots=True, kw_only=True)
class Answers:
    """What was found and answered.

    Attributes:
        rover: The section [rover].
        devices: Name, settings and what was heard of each device.
        wheels: Name of the drive.
        gyro: Name of the gyro, or None.
        headings: Names of the compasses whose headings are used.
        fixes: Names of the devices that give positions.
        wheel_speed_rad_s: Greatest speed of the wheels.
        moves_sideways: Whether the rover can hold its heading.
        speed_m_s: Speed of the first mission.
        simulation: The section [simulation].
    """

    rover: Mapping[str, object]
    devices: Sequence[tuple[str, AnyDeviceSettings, str]]
    wheels: str
    gyro: str | None
    headings: Sequence[str]
    fixes: Sequence[str]
    wheel_speed_rad_s: float
    moves_sideways: bool
    speed_m_s: float
    simulation: Mapping[str, object]


def config_text(answers: Answers) -> str:
    """Return the text of a configuration."""
    roles: dict[str, object] = {"wheels": answers.wheels}
    if answers.gyro is not None:
        roles["gyro"] = answers.gyro
    roles["headings"] = list(answers.headings)
    if answers.fixes:
        roles["fixes"] = list(answers.fixes)
    mission = {
        "type": "line",
        "length_m": 0.5,
        "speed_m_s": answers.speed_m_s,
        "heading": "hold" if answers.moves_sideways else "along_path",
    }
    limits = {
        "wheel_speed_rad_s": answers.wheel_speed_rad_s,
        "wheel_acceleration_rad_s2": 2.0 * answers.wheel_speed_rad_s,
    }
    parts = [
        f"#:schema ./{SCHEMA_NAME}\n"
        "# Made by `rover-hil init`. Check it with `rover-hil check`, the devices with `rover-hil doctor`.\n"
        'schema = "rover-hil-config/1"\n',
        "# Geometry; measure it with `rover-hil calibrate wheels`.\n" + toml_text({"rover": answers.rover}),
        "[loop]\nrate_hz = 50\ntime_limit_s = 60           # a run ends after this time, finished or not\n",
        "# What each device is used for; the rover stops when one of these sends nothing.\n"
        + toml_text({"roles": roles}),
    ]
    for name, settings, what in answers.devices:
        values = settings.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
        ordered = {"type": settings.type, **{key: value for key, value in values.items() if key != "type"}}
        parts.append(f"# {what}\n" + toml_text({"devices": {name: ordered}}))
    parts += [
        "# A first drive of half a metre; docs/reference/configuration.md has the other missions.\n"
        + toml_text({"mission": mission}),
        "[safety]\nsettle_s = 2.0              # at rest the gyro's bias is found\n"
        "check_manoeuvre = true      # `run` begins with a short motion that compares the sources\n",
        "# Greatest setpoints; raise them when the rover drives well.\n" + toml_text({"limits": limits}),
        "# The simulated rover of `run --virtual`, `simulate` and `tune`. Mass, motors and what carries "
        "load beside\n# the wheels are assumed: correct them.\n"
        + toml_text({"simulation": answers.simulation}),
    ]
    return "\n".join(parts)
