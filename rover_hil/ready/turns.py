"""Turns of a rover for a calibration, and the firm ground that a simulated one turns on."""

import math

from controllers.motion.kinematics import make_kinematics
from controllers.motion.settings import WaypointsMission, WholeTurnsMission
from drivers.device_settings import FrameDeviceSettings
from drivers.nmea_compass.settings import NmeaCompassSettings
from drivers.witmotion.settings import WitMotionSettings
from rover_hil.config import Config
from sim_backends.devices.witmotion import FrameKind, ImuEmulatorSettings
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.plants.robotino.site import load_site
from sim_backends.settings import SimulationSettings

DEFAULT_SPEED_M_S = 0.15
"""Of a rover whose configuration has no mission."""
FIRM_SITE = "floor_table"
SPARE_S = 30.0
"""In addition to the turns: settling, rests, stops."""
TURN_RATE_RAD_S = 0.6
LIMIT_SHARE = 0.6
"""Of the greatest wheel speed."""
SKID_FACTOR = 4.0
CORNERS = 12
"""Of the ring that a rover drives which cannot turn on the spot."""


def on_firm_floor(simulation: SimulationSettings) -> SimulationSettings:
    """Return the simulation with firm ground everywhere: a user, too, has to choose such a place."""
    if not isinstance(simulation.plant, RobotinoPlantSettings):
        return simulation
    plant = simulation.plant.model_copy(update={"site": load_site(FIRM_SITE)})
    return simulation.model_copy(update={"plant": plant})


def turning_config(config: Config, device: str, turns: int) -> Config:
    """Return a configuration that turns on the spot, and uses no heading, no slip compensation and no camera.

    A rover that cannot turn on the spot drives rings of about twice its least radius instead.
    """
    kinematics = make_kinematics(config.rover)
    mission: WholeTurnsMission | WaypointsMission
    if kinematics.turns_on_spot:
        wheel_rad_s = max(map(abs, kinematics.wheel_speeds(0.0, 0.0, 1.0)))
        rate = min(TURN_RATE_RAD_S, LIMIT_SHARE * config.limits.wheel_speed_rad_s / wheel_rad_s)
        mission = WholeTurnsMission(
            type="whole_turns", turns=turns, heading="along_path", turn_rate_rad_s=max(0.05, rate)
        )
        # Wheels that skid turn the rover by less than they roll.
        time_s = SKID_FACTOR * 2.0 * turns * math.tau / mission.turn_rate_rad_s + 3.0 * mission.rest_s
    else:
        speed_m_s = 0.2 if config.mission is None else config.mission.speed_m_s
        points = _rings(2.0 * kinematics.turn_radius_m, turns)
        mission = WaypointsMission(
            type="waypoints",
            points=points,
            heading="along_path",
            speed_m_s=speed_m_s,
            position_tolerance_m=0.1,
        )
        time_s = 4.0 * turns * math.tau * 2.0 * kinematics.turn_radius_m / speed_m_s
    kept = {
        name: settings
        for name, settings in config.devices.items()
        if not isinstance(settings, FrameDeviceSettings) or name in config.roles.fixes
    }
    roles = config.roles.model_copy(update={"headings": (), "camera": None, "require_camera": False})
    loop = config.loop.model_copy(update={"time_limit_s": config.safety.settle_s + 1.5 * time_s + SPARE_S})
    simulation = config.simulation
    if simulation is not None:
        simulation = simulation.model_copy(
            update={
                "devices": {name: each for name, each in simulation.devices.items() if name in kept},
                "faults": tuple(fault for fault in simulation.faults if fault.device in kept),
            }
        )
    settings = kept[device]
    if isinstance(settings, NmeaCompassSettings | WitMotionSettings):
        settings = settings.model_copy(update={"calibration": None})
    devices = {**kept, device: settings}
    changes = {"mission": mission, "slip": None, "scomp": None, "roles": roles, "loop": loop}
    return config.model_copy(update={**changes, "devices": devices, "simulation": simulation})


def with_frames(
    config: Config, device: str, simulation: SimulationSettings, *frames: FrameKind
) -> SimulationSettings:
    """Return the simulation with a WitMotion sensor that also sends some kinds of frames."""
    if not isinstance(config.devices[device], WitMotionSettings):
        return simulation
    errors = simulation.devices.get(device)
    sensor = errors if isinstance(errors, ImuEmulatorSettings) else ImuEmulatorSettings()
    sensor = sensor.model_copy(update={"frames": tuple(dict.fromkeys((*sensor.frames, *frames)))})
    return simulation.model_copy(update={"devices": {**simulation.devices, device: sensor}})


def _rings(radius_m: float, turns: int) -> tuple[tuple[float, float], ...]:
    """Return corners of rings to the left, then as many to the right, both through the start."""
    points = []
    for side in (1.0, -1.0):
        for corner in range(1, CORNERS * turns + 1):
            angle = math.tau * corner / CORNERS
            points.append((radius_m * math.sin(angle), side * radius_m * (1.0 - math.cos(angle))))
    return tuple(points)


def with_gains(mission: WaypointsMission, config: Config) -> WaypointsMission:
    """Return a mission that is followed with the gains of the configuration's own."""
    if config.mission is None:
        return mission
    names = {"heading_gain_per_s", "yaw_rate_limit_rad_s", "lookahead_m"}
    return mission.model_copy(update=config.mission.model_dump(include=names))
