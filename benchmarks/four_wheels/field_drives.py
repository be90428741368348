"""Drives of the simulated El-Dorado over the sites of the two field tests, with what its sensors say."""

import math
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from drivers.clock import nanoseconds
from drivers.units import STANDARD_GRAVITY_M_S2
from sim_backends.plants.el_dorado.plant import ElDoradoPlant
from sim_backends.plants.el_dorado.settings import ElDoradoPlantSettings, Ground, Mound
from sim_backends.plants.el_dorado.wheel_table import WheelTable, build_table
from sim_backends.rear_scene.ground_map import GroundSettings, Rut, Sun, Terrain
from sim_backends.rear_scene.scene import Lens, rocking, rotations
from sim_backends.rear_scene.settings import GroundKind
from sim_backends.terramechanics.soil.library import load_soil, load_wheel
from sim_backends.world.plant import Truth
from sim_backends.world.sensor_errors import DirectionLag
from tests.rear_scene.draws import draw_errors, draw_rig, wander
from tests.rear_scene.motion import RATE_HZ, Motion
from tests.rear_scene.rig_file import CalibratedRig
from tests.rear_scene.sequence import Appearance, FrameSequence

Floats: TypeAlias = NDArray[np.float64]

SPEED_M_S = 0.1
REST_S = 2.0
LONGEST_S = 400.0
FRAME_RATE_HZ = 5.0
LOG_STEPS = 5
COMPASS_STEPS = 10
ROCK_DEG = 0.4
SOILS: tuple[GroundKind, ...] = ("coarse_sand", "patchy_sand", "sandy_gravel")


@dataclass(frozen=True, kw_only=True)
class Site:
    """A slope that rises along x, with mounds (x, y, height, radius)."""

    way_m: float
    inclination_deg: float
    mounds: tuple[tuple[float, float, float, float], ...]

    def drawn(self, rng: np.random.Generator) -> "Site":
        """Return a site like it."""
        mounds = tuple(
            (
                x + 0.15 * float(rng.standard_normal()),
                y + 0.05 * float(rng.standard_normal()),
                height * float(rng.uniform(0.9, 1.1)),
                radius,
            )
            for x, y, height, radius in self.mounds
        )
        inclination_deg = self.inclination_deg + float(rng.uniform(-0.4, 0.4))
        return replace(self, inclination_deg=inclination_deg, mounds=mounds)

    def terrain(self) -> Terrain:
        """Return its shape as the camera's scene takes it."""
        return Terrain(slope=(math.tan(math.radians(self.inclination_deg)), 0.0), mounds=self.mounds)


SIDEWAYS = Site(way_m=7.0, inclination_deg=5.0, mounds=((6.5, 1.85, 0.68, 1.35),))
MOUNDS = Site(
    way_m=13.0,
    inclination_deg=5.0,
    mounds=(
        (2.6, 0.75, 0.16, 0.60),
        (4.6, -0.7, 0.19, 0.65),
        (7.0, 0.85, 0.25, 0.75),
        (9.4, 0.8, 0.21, 0.70),
        (11.6, -0.9, 0.18, 0.70),
    ),
)


@dataclass(frozen=True, kw_only=True)
class Rover:
    """A rover on a soil, with its sensors; one for all drives of a seed.

    Attributes:
        plant: Body and wheels; without ground and start.
        table: Forces of the soil on its wheels.
        rig: Rear camera.
        compass_bias_deg: Constant error; `compass_deviation_deg` are factors of sin, cos, sin 2, cos 2.
        wheel_scale: Relative error of each wheel's speed.
        tilt_bias_deg: How far the inclinometer's zero is off, in pitch and in roll.
    """

    plant: ElDoradoPlantSettings
    table: WheelTable
    rig: CalibratedRig
    compass_bias_deg: float
    compass_deviation_deg: Floats
    wheel_scale: Floats
    tilt_bias_deg: Floats


@dataclass(frozen=True, kw_only=True)
class FieldDrive:
    """A drive: its frames with their truth, the log without the trace, the truth at the rows of the log."""

    sequence: FrameSequence
    log: dict[str, Floats]
    truth: dict[str, Floats]


def draw_rover(seed: int) -> Rover:
    """Return the rover of a seed, with another soil, geometry and camera for each."""
    rng = np.random.default_rng([seed, 1])
    rig = draw_rig(True, FRAME_RATE_HZ, rng)
    soil = load_soil("toyoura")
    soil = soil.model_copy(
        update={
            "friction_angle_deg": soil.friction_angle_deg + float(rng.normal(0, 1.0)),
            "shear_modulus_m": soil.shear_modulus_m * math.exp(0.08 * float(rng.standard_normal())),
        }
    )
    wheel = load_wheel("el_dorado").model_copy(update={"width_m": rig.wheel.width_m})
    plant = ElDoradoPlantSettings(
        track_m=2 * rig.wheel.y_m,
        wheel_base_m=2 * rig.b_m,
        wheel_radius_error=float(rng.normal(0, 0.004)),
        centre_height_m=float(rng.uniform(0.22, 0.30)),
    )
    deviation = rng.normal(0, 0.8, 4) * [1, 1, 0.5, 0.5]
    return Rover(
        plant=plant,
        table=build_table(wheel, soil, 0.25 * plant.mass_kg * STANDARD_GRAVITY_M_S2),
        rig=rig,
        compass_bias_deg=float(rng.normal(0, 1.0)),
        compass_deviation_deg=deviation,
        wheel_scale=rng.normal(0, 0.002, 4),
        tilt_bias_deg=rng.normal(0, 0.3, 2),
    )


def make_plant(rover: Rover, site: Site, rng: np.random.Generator) -> ElDoradoPlant:
    """Return the rover at the start of a site."""
    mounds = [Mound(x_m=x, y_m=y, height_m=top, radius_m=radius) for x, y, top, radius in site.mounds]
    ground = Ground(inclination_deg=site.inclination_deg, mounds=tuple(mounds))
    settings = rover.plant.model_copy(update={"ground": ground})
    return ElDoradoPlant(settings, rng, 0, rover.table)


def wheel_speed_rad_s(t_s: float) -> float:
    """Return the speed that the driver asks of all wheels."""
    return SPEED_M_S / 0.092 * min(max(t_s - REST_S, 0.0), 1.0)


def field_drive(rover: Rover, site: Site, seed: int) -> FieldDrive:
    """Drive a site with equal wheel speeds and nobody at the steering."""
    rng = np.random.default_rng([seed, 2, len(site.mounds)])
    site = site.drawn(rng)
    plant = make_plant(rover, site, rng)
    truths = [plant.truth()]
    way_m = 0.0
    while way_m < site.way_m and len(truths) < LONGEST_S * RATE_HZ:
        speed = wheel_speed_rad_s(len(truths) / RATE_HZ)
        plant.set_wheel_speeds((speed * (1.0 + rover.wheel_scale)).tolist())
        plant.advance(nanoseconds(len(truths) / RATE_HZ))
        truths.append(plant.truth())
        way_m += math.dist((truths[-1].x_m, truths[-1].y_m), (truths[-2].x_m, truths[-2].y_m))
    appearance = draw_look(site, rng, math.ceil(len(truths) / RATE_HZ * FRAME_RATE_HZ))
    rock = np.radians(ROCK_DEG) * np.stack(
        [wander(len(truths), 0.35 * RATE_HZ, rng) for _ in range(2)], axis=1
    )
    motion = motion_of(truths, rover, site.terrain(), rock, appearance.rut.depth_m)
    sequence = FrameSequence("field test", seed, rover.rig, motion, appearance, draw_errors(rng))
    truth = _truth(truths)
    return FieldDrive(sequence=sequence, log=_log(truths, motion, rover, rng), truth=truth)


def draw_look(site: Site, rng: np.random.Generator, frames: int) -> Appearance:
    """Return how a drive on a site looks."""
    return Appearance(
        ground=GroundSettings(
            kind=SOILS[int(rng.integers(len(SOILS)))],
            terrain=site.terrain(),
            tile_turn_deg=float(rng.uniform(0, 360)),
            stones_per_m2=float(rng.uniform(0, 6)),
        ),
        sun=Sun(azimuth_deg=float(rng.uniform(-150, 150)), elevation_deg=float(rng.uniform(35, 60))),
        rut=Rut(
            depth_m=float(rng.uniform(0.010, 0.018)),
            berm_m=float(rng.uniform(0.003, 0.007)),
            tone=float(rng.uniform(0.75, 1.05)),
        ),
        lens=Lens(noise_grey=float(rng.uniform(2, 4)), exposure_s=float(rng.uniform(0.006, 0.02))),
        gain=tuple(np.clip(1 + 0.05 * wander(frames, 10, rng), 0.7, 1.3).tolist()),
    )


def motion_of(
    truths: list[Truth], rover: Rover, terrain: Terrain, rock_rad: Floats, depth_m: float
) -> Motion:
    """Return the plant's way, one entry per step, as the camera's scene takes it."""
    x, y, yaw, pitch, roll = (
        np.array([getattr(truth, name) for truth in truths])
        for name in ("x_m", "y_m", "yaw_rad", "pitch_rad", "roll_rad")
    )
    turn = rotations(yaw, pitch, roll)
    position = np.stack([x, y, _height_m(rover.rig, terrain, x, y, yaw) - depth_m], axis=1)
    contact = position + turn @ np.array([rover.rig.wheel.x_m, rover.rig.wheel.y_m, 0.0])
    body = turn @ np.stack([rocking(a, b) for a, b in rock_rad.tolist()])
    spin = np.einsum("nji,njk->nik", body, np.gradient(body, 1 / RATE_HZ, axis=0))
    forward, left = (np.array([getattr(t, f"velocity_{axis}_m_s") for t in truths]) for axis in "xy")
    rate = np.array([truth.yaw_rate_rad_s for truth in truths])
    contact_velocity = np.stack(
        [forward - rate * rover.rig.wheel.y_m, left + rate * rover.rig.wheel.x_m], axis=1
    )
    rim = np.array([np.mean(truth.wheel_speed_rad_s) for truth in truths]) * 0.092
    return Motion(
        t_s=np.arange(len(truths)) / RATE_HZ,
        position_m=position,
        vehicle_to_world=turn,
        yaw_rad=yaw,
        pitch_rad=pitch,
        roll_rad=roll,
        rock_rad=rock_rad,
        wheel_angle_rad=np.array([truth.wheel_position_rad[2] for truth in truths]),
        rim_speed_m_s=rim,
        slip=np.array([truth.slip[2] for truth in truths]),
        slip_angle_rad=np.arctan2(left, forward),
        yaw_rate_rad_s=rate,
        softness=np.ones((len(truths), 4)),
        contact_m=contact,
        contact_velocity_m_s=contact_velocity,
        velocity_m_s=np.stack([forward, left], axis=1),
        body_rate_rad_s=np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1),
    )


def _height_m(rig: CalibratedRig, terrain: Terrain, x: Floats, y: Floats, yaw: Floats) -> Floats:
    """Return the mean height of the ground under the wheels."""
    heights = [
        terrain.height_m(
            x + np.cos(yaw) * wheel.x_m - np.sin(yaw) * wheel.y_m,
            y + np.sin(yaw) * wheel.x_m + np.cos(yaw) * wheel.y_m,
        )
        for wheel in rig.wheels
    ]
    return np.asarray(np.mean(heights, axis=0))


def _truth(truths: list[Truth]) -> dict[str, Floats]:
    rows = truths[::LOG_STEPS]
    forward = np.array([truth.velocity_x_m_s for truth in rows])
    left = np.array([truth.velocity_y_m_s for truth in rows])
    rim = 0.092 * np.array([np.mean(truth.wheel_speed_rad_s) for truth in rows])
    return {
        "t_s": np.arange(len(rows)) * LOG_STEPS / RATE_HZ,
        "x_m": np.array([truth.x_m for truth in rows]),
        "y_m": np.array([truth.y_m for truth in rows]),
        "yaw_rad": np.array([truth.yaw_rad for truth in rows]),
        "slip": 1.0 - forward / np.maximum(rim, 1e-9),
        "slip_angle_rad": np.arctan2(left, np.maximum(forward, 1e-9)),
    }


def _log(truths: list[Truth], motion: Motion, rover: Rover, rng: np.random.Generator) -> dict[str, Floats]:
    """Return what encoders, compass, gyro and inclinometer say, at 20 Hz."""
    rows = slice(None, None, LOG_STEPS)
    turned = np.array([truth.wheel_position_rad for truth in truths])[rows]
    count = len(turned)
    body_pitch, body_roll = motion.pitch_rad + motion.rock_rad[:, 1], motion.roll_rad + motion.rock_rad[:, 0]
    gyro = np.degrees(motion.body_rate_rad_s[rows, 2])
    return {
        "t_s": np.arange(count) * LOG_STEPS / RATE_HZ,
        **{f"position{i + 1}_rad": np.round(turned[:, i] / 1e-3) * 1e-3 for i in range(4)},
        "heading_deg": _compass_deg(motion.yaw_rad, rover, rng)[rows],
        "yaw_rate_deg_s": gyro + float(rng.normal(0, 0.15)) + 0.12 * rng.standard_normal(count),
        "pitch_deg": rover.tilt_bias_deg[0] - np.degrees(body_pitch)[rows] + 0.3 * rng.standard_normal(count),
        "roll_deg": rover.tilt_bias_deg[1] + np.degrees(body_roll)[rows] + 0.3 * rng.standard_normal(count),
    }


def compass_error_deg(heading_rad: float, rover: Rover) -> float:
    """Return bias and deviation of the rover's compass at a heading."""
    turns = (heading_rad, 2 * heading_rad)
    waves = [wave(turn) for turn in turns for wave in (math.sin, math.cos)]
    return rover.compass_bias_deg + float(rover.compass_deviation_deg @ np.array(waves))


def _compass_deg(yaw_rad: Floats, rover: Rover, rng: np.random.Generator) -> Floats:
    """Return a fluxgate compass at 10 Hz: lag, bias, error over the heading, noise; held in between."""
    lag = DirectionLag(0.45, COMPASS_STEPS / RATE_HZ)
    lag.settle(float(yaw_rad[0]))
    shown = []
    for heading in yaw_rad[::COMPASS_STEPS].tolist():
        lagged = lag.step(heading)
        error = compass_error_deg(lagged, rover) + 0.4 * float(rng.standard_normal())
        shown.append(round(math.degrees(lagged) + error, 1))
    return np.repeat(shown, COMPASS_STEPS)[: len(yaw_rad)]
