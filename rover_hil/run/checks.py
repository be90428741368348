"""What a configuration must fulfil before a rover is put together, for run, simulate, tune and doctor."""

import math
from collections.abc import Iterator
from pathlib import Path

from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import OmniRoverSettings, WheelsRoverSettings
from controllers.settings import find_area_conflicts
from controllers.slip.effort.settings import YAW_PROBE
from drivers.can_wheels.settings import CanWheelsSettings
from drivers.device_settings import DriveSettings
from drivers.driver import SteeringCodec
from drivers.errors import ConfigError
from rover_hil.config import Config, Draft, Rule
from rover_hil.config.ros2_joints import find_command_conflicts, find_connection_conflicts
from rover_hil.config.schema import MISSING_SIMULATION, find_rigs
from rover_hil.run.composition import find_wheel_count_conflict
from sim_backends.build import find_simulation_conflicts
from sim_backends.serving.server import find_unservable

ROUNDING = 1.0 + 1e-9
ROUNDING_DEG = 0.1
"""A steering setpoint may miss a limit of the wheel by this much: signals count in coarse steps."""


def _find_shared_ports(draft: Draft) -> Iterator[str]:
    users: dict[Path, str] = {}
    for name, device in draft.config.devices.items():
        port = device.exclusive_port()
        if port is None:
            continue
        key, path = port
        user = users.setdefault(Path(path).resolve(), name)
        if user != name:
            yield (
                f"devices.{name}.{key}: '{path}' is already the port of device '{user}', and only one device "
                "can open it: correct one of them"
            )


def _find_data_file_mistakes(draft: Draft) -> Iterator[str]:
    for name, device in draft.config.devices.items():
        try:
            device.make_codec(name)
        except ConfigError as error:
            for line in str(error).splitlines():
                yield f"devices.{name}: {line}"


def _find_wheel_count_conflict(draft: Draft) -> Iterator[str]:
    name = draft.config.roles.wheels
    device = draft.config.devices.get(name)
    if not isinstance(device, DriveSettings):
        return
    try:
        wheel_count = device.make_codec(name).wheel_count
    except ConfigError:
        return  # reported with the data files
    conflict = find_wheel_count_conflict(draft.config.rover, name, wheel_count)
    if conflict:
        yield conflict


def _find_unmeasured_conflict(draft: Draft) -> Iterator[str]:
    name = draft.config.roles.wheels
    device = draft.config.devices.get(name)
    if not isinstance(device, DriveSettings):
        return
    rover = make_kinematics(draft.config.rover)
    without: frozenset[int] = frozenset()
    if isinstance(device, CanWheelsSettings):
        try:
            from drivers.can_wheels.mapping_file import load_mapping  # what reads DBC files loads slowly

            wheels = load_mapping(device.mapping).mapping.wheel
        except ConfigError:
            return  # reported with the data files
        without = frozenset(place for place, wheel in enumerate(wheels) if not wheel.measured)
    for wheel in sorted(without ^ rover.unmeasured):
        if wheel < rover.wheel_count:
            has, lacks = ("rover.wheels", name) if wheel in without else (f"device '{name}'", "rover.wheels")
            yield (
                f"wheel {wheel} has an encoder by {has}, and none by {lacks}: "
                "give measured = false in both, or in neither"
            )


def _find_steering_mistakes(draft: Draft) -> Iterator[str]:
    name = draft.config.roles.wheels
    device = draft.config.devices.get(name)
    rover = draft.config.rover
    if not isinstance(rover, WheelsRoverSettings) or not isinstance(device, DriveSettings):
        return
    steering = {
        index: wheel.steering for index, wheel in enumerate(rover.wheels) if wheel.steering is not None
    }
    try:
        codec = device.make_codec(name)
    except ConfigError:
        return  # reported with the data files
    limits_rad = codec.steering_limits_rad if isinstance(codec, SteeringCodec) else {}
    missing = [str(wheel) for wheel in steering if wheel not in limits_rad]
    if missing:
        yield (
            f"rover.wheels: wheels {', '.join(missing)} steer, but device '{name}' has no steering "
            "setpoints for them: use can_wheels with a mapping that has steering_setpoint, "
            "or remove the steering"
        )
    for wheel, limits in steering.items():
        low_deg, high_deg = map(math.degrees, limits_rad.get(wheel, (-math.inf, math.inf)))
        if limits.low_deg < low_deg - ROUNDING_DEG or limits.high_deg > high_deg + ROUNDING_DEG:
            yield (
                f"rover.wheels.{wheel}.steering: the wheel steers from {limits.low_deg:g} to "
                f"{limits.high_deg:g} deg, but the steering setpoint of device '{name}' holds only "
                f"{low_deg:g} to {high_deg:g} deg: narrow low_deg and high_deg, or correct the signal's range"
            )


def _find_motor_field_mistakes(draft: Draft) -> Iterator[str]:
    fields = draft.config.filter.motor_fields
    if fields is None:
        return
    if fields.device not in draft.config.roles.headings:
        yield (
            f"filter.motor_fields: it is of the compass '{fields.device}', which is not in roles.headings: "
            "calibrate the compass of this rover with `rover-hil calibrate motors CONFIG`"
        )
    wheels = make_kinematics(draft.config.rover).wheel_count
    if len(fields.per_ampere) != wheels:
        yield (
            f"filter.motor_fields: per_ampere has {len(fields.per_ampere)} motors, the rover has {wheels} "
            "wheels: calibrate the compass of this rover with `rover-hil calibrate motors CONFIG`"
        )


def _find_missing_supply(draft: Draft) -> Iterator[str]:
    least_v = draft.config.safety.least_supply_v
    if least_v is None or draft.broken_devices:
        return
    try:
        if any(device.reports_supply() for device in draft.config.devices.values()):
            return
    except ConfigError:
        return  # reported with the data files
    yield (
        f"safety.least_supply_v is {least_v:g} V, but no device reports its supply voltage: remove the key, "
        "or map the voltage in [power] of a can_wheels mapping"
    )


def _find_mission_conflicts(draft: Draft) -> Iterator[str]:
    mission = draft.config.mission
    if mission is not None:
        yield from mission.conflicts(make_kinematics(draft.config.rover))


def _find_area_conflicts(draft: Draft) -> Iterator[str]:
    config = draft.config
    return find_area_conflicts(config.rover, config.mission, config.safety)


def find_too_fast(config: Config) -> Iterator[str]:
    """Yield which wheel speeds a mission needs that `limits` does not allow, with the fix.

    A curve or a correction that needs more for moments is driven more slowly; a whole leg is not as planned.
    """
    mission, limit_rad_s = config.mission, config.limits.wheel_speed_rad_s
    if mission is None:
        return
    kinematics = make_kinematics(config.rover)
    excited = _excitation_rad_s(config)
    fastest: dict[str, float] = {}
    for cause, motion in mission.motions(kinematics):
        speed_rad_s = max(map(abs, kinematics.wheel_speeds(*motion)))
        added_rad_s = excited if any(motion[:2]) else 0.0
        added = " and the yaw excitation" if added_rad_s else ""
        fastest[cause + added] = max(fastest.get(cause + added, 0.0), speed_rad_s + added_rad_s)
    for cause, speed_rad_s in fastest.items():
        if speed_rad_s > ROUNDING * limit_rad_s:
            verb = "need" if " and " in cause else "needs"
            yield (
                f"{cause} {verb} wheel speeds of {speed_rad_s:.3g} rad/s with the wheel radius of "
                f"{config.rover.wheel_radius_m:g} m, above limits.wheel_speed_rad_s = {limit_rad_s:g} rad/s: "
                "correct the geometry in [rover], drive more slowly, or raise the limit to what the drives do"
            )


def _excitation_rad_s(config: Config) -> float:
    """Return what the yaw excitation adds to the wheel speeds of a mission."""
    slip, mission, rover = config.slip, config.mission, config.rover
    if slip is None or slip.use != YAW_PROBE or mission is None or not isinstance(rover, OmniRoverSettings):
        return 0.0
    return slip.excitation.rim_m_s(mission.speed_m_s) / rover.wheel_radius_m


def _find_too_fast(draft: Draft) -> Iterator[str]:
    return find_too_fast(draft.config)


def _find_rig_mistakes(draft: Draft) -> Iterator[str]:
    rigs = find_rigs(draft.config)
    if not rigs:
        return
    # Imported here because it brings OpenCV, which a rover without a camera must not wait for.
    from controllers.ground_motion.ground_patch import GroundPatch

    for key, rig in rigs.items():
        try:
            GroundPatch(rig.geometry())
        except ConfigError as error:
            yield f"{key}: {error}"


def _find_simulation_conflicts(draft: Draft) -> Iterator[str]:
    simulation = draft.config.simulation
    if simulation is not None:
        devices = {**draft.config.devices, **dict.fromkeys(draft.broken_devices)}
        yield from find_simulation_conflicts(devices, simulation)


def _find_missing_mission(draft: Draft) -> Iterator[str]:
    mission = draft.config.mission
    if mission is None:
        yield "mission: this key is missing; add what the rover is to do"
    elif mission.type == "by_hand" and (draft.config.ros2 is None or not draft.config.ros2.commands):
        yield (
            "mission.type: 'by_hand' has no path and is driven on the page of `rover-hil bench`, or over ROS "
            "2 with ros2.commands = true; choose one of these, or a mission with a path"
        )


def _find_connection_conflicts(draft: Draft) -> Iterator[str]:
    return find_connection_conflicts(draft.config.rover, draft.config.ros2)


def _find_command_conflicts(draft: Draft) -> Iterator[str]:
    return find_command_conflicts(draft.config.mission, draft.config.ros2)


def _find_missing_simulation(draft: Draft) -> Iterator[str]:
    if draft.config.simulation is None:
        yield MISSING_SIMULATION


def _find_unservable(draft: Draft) -> Iterator[str]:
    return find_unservable(draft.config.devices)


ROVER_CHECKS = (
    Rule(("devices",), _find_shared_ports),
    Rule(("devices",), _find_data_file_mistakes),
    Rule(("rover", "roles", "devices"), _find_wheel_count_conflict),
    Rule(("rover", "roles", "devices"), _find_unmeasured_conflict),
    Rule(("rover", "roles", "devices"), _find_steering_mistakes),
    Rule(("rover", "roles", "filter"), _find_motor_field_mistakes),
    Rule(("safety", "devices"), _find_missing_supply),
    Rule(("rover", "mission"), _find_mission_conflicts),
    Rule(("rover", "mission", "safety"), _find_area_conflicts),
    Rule(("rover", "mission", "limits", "slip"), _find_too_fast, is_last=True),
    Rule(("scomp", "ground_motion"), _find_rig_mistakes),
    Rule(("devices", "simulation"), _find_simulation_conflicts),
)
"""What every command checks that drives a real or a simulated rover."""

CONNECTION_CHECKS = (Rule(("rover", "ros2"), _find_connection_conflicts),)
"""Of a run that may be connected with other programs."""

RUN_CHECKS = (
    *ROVER_CHECKS,
    Rule(("mission", "ros2"), _find_missing_mission),
    Rule(("mission", "ros2"), _find_command_conflicts),
    *CONNECTION_CHECKS,
)
"""For `run` on real devices, and for `doctor`."""

VIRTUAL_RUN_CHECKS = (*RUN_CHECKS, Rule(("simulation",), _find_missing_simulation))
"""For `run --virtual`."""

SIMULATE_CHECKS = (
    *ROVER_CHECKS,
    Rule(("simulation",), _find_missing_simulation),
    Rule(("devices",), _find_unservable),
)
"""For `simulate`."""
