"""The text of a new configuration, with a comment on what to change later."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from drivers.registry import AnyDeviceSettings
from rover_hil.config.loader import SCHEMA_NAME
from rover_hil.drives.toml_text import toml_text


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
        camera: Name of the camera that sees the ground, or None.
        ground_motion: The section [ground_motion] of that camera; empty without it.
        has_trace: Whether it also sees the trace of the rear left wheel.
        mass_kg: Of a rover whose yaw may be excited while the camera measures nothing; None for another.
        wheel_speed_rad_s: Greatest speed of the wheels.
        moves_sideways: Whether the rover can hold its heading.
        speed_m_s: Speed of the first mission.
        simulation: The section [simulation]; empty for none.
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
    camera: str | None = None
    ground_motion: Mapping[str, object] = field(default_factory=dict)
    has_trace: bool = False
    mass_kg: float | None = None


def config_text(answers: Answers) -> str:
    """Return the text of a configuration."""
    roles: dict[str, object] = {"wheels": answers.wheels}
    if answers.gyro is not None:
        roles["gyro"] = answers.gyro
    roles["headings"] = list(answers.headings)
    if answers.fixes:
        roles["fixes"] = list(answers.fixes)
    if answers.camera is not None:
        roles["camera"] = answers.camera
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
    parts += _slip_parts(answers)
    parts += [
        "# A first drive of half a metre; docs/reference/configuration.md has the other missions.\n"
        + toml_text({"mission": mission}),
        "[safety]\nsettle_s = 2.0              # at rest the gyro's bias is found\n"
        "check_manoeuvre = true      # `run` begins with a short motion that compares the sources\n",
        "# Greatest setpoints; raise them when the rover drives well.\n" + toml_text({"limits": limits}),
    ]
    if answers.simulation:
        parts.append(
            "# The simulated rover of `run --virtual`, `simulate` and `tune`. Mass, motors and what carries "
            "load beside\n# the wheels are assumed: correct them.\n"
            + toml_text({"simulation": answers.simulation})
        )
    return "\n".join(parts)


def _slip_parts(answers: Answers) -> list[str]:
    """Return the sections of the camera that sees the ground, and of what measures slip without it."""
    if answers.camera is None:
        return []
    parts = [
        "# The camera measures the slip. Its rig is of rulers only: next run `rover-hil calibrate scale`.\n"
        "# After greatest_age_s without a valid pair of frames the other sources are used.\n"
        + toml_text({"ground_motion": answers.ground_motion})
    ]
    if answers.has_trace:
        rig = {"rig": answers.ground_motion["rig"]}
        parts.append("# Slip angle by the trace of the rear left wheel.\n" + toml_text({"scomp": rig}))
    if answers.mass_kg is not None:
        slip = {"maps": "robotino", "use": "yaw_probe", "excitation": {"mass_kg": answers.mass_kg}}
        parts.append(
            "# Only while the camera measures nothing: slip by a small yaw excitation. On the real rover\n"
            "# it is off until `rover-hil commission CONFIG --enter`.\n" + toml_text({"slip": slip})
        )
    return parts
