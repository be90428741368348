"""Missions on random slippery ground, with samples that may be falsified.

Rovers: both shipped ones, and the Robotino of `tests/nature/omni_contact.py`, which shares no code with them.
"""

import math
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from controllers.control_loop import ControlLoop, StepOutput
from controllers.ground_motion.rig import RigFile
from controllers.ground_motion.settings import GroundMotionSettings
from controllers.safety import Mode
from drivers.clock import VirtualClock, nanoseconds, seconds
from drivers.link import NoTap
from drivers.samples import Sample
from rover_hil.config import Config, load_config
from rover_hil.run.composition import build_virtual_rig
from sim_backends.plants.robotino.settings import RobotinoPlantSettings
from sim_backends.plants.robotino.site import random_site
from sim_backends.world.plant import Plant
from sim_backends.world.world import World
from tests.nature.ground_camera import DEVICE, GroundCamera
from tests.nature.omni_contact import Floor, OmniContact

STEEPEST_DEG = 12.0
OVER = (Mode.FINISHED, Mode.EMERGENCY_STOP)

Falsify = Callable[[float, Sample], Sample | None]
"""From the time in s since the start and a sample to what the loop receives; None for nothing."""


def robotino(seed: int) -> Config:
    """Return the shipped Robotino on a random site, with noise of the same seed."""
    config = load_config("robotino")
    simulation = config.require_simulation()
    plant = RobotinoPlantSettings(type="robotino", site=random_site(np.random.default_rng(seed)))
    return config.model_copy(
        update={"simulation": simulation.model_copy(update={"seed": seed, "plant": plant})}
    )


def el_dorado(seed: int) -> Config:
    """Return the shipped El-Dorado without its camera, on a slope of up to 12 deg in any direction."""
    rng = np.random.default_rng(seed)
    table = load_config("el-dorado").model_dump(by_alias=True)
    del table["devices"]["camera"]
    table["roles"]["camera"] = table["scomp"]["rig"] = None
    table["simulation"]["seed"] = seed
    ground = table["simulation"]["plant"]["ground"]
    ground["inclination_deg"] = float(rng.uniform(0.0, STEEPEST_DEG))
    ground["uphill_deg"] = float(rng.uniform(-180.0, 180.0))
    table["mission"]["length_m"] = 1.5
    return Config.model_validate(table)


ROVERS = {"robotino": robotino, "el-dorado": el_dorado}

MakePlant = Callable[[int], Plant]
"""From the time of the first step to a rover that takes the place of the configured one."""

ChangeWorld = Callable[[World], None]
"""Changes the simulated rover and its devices before they run."""

MakeCamera = Callable[[Plant], GroundCamera]
"""From the rover to a camera that measures its motion over the ground."""


def slippery_floor(seed: int) -> Floor:
    """Return a slippery ground of the Robotino of `tests/nature`, with a relaxation length of 1 to 15 mm."""
    rng = np.random.default_rng(seed)
    return Floor.slippery(rng, rng.uniform(0.001, 0.015))


def with_drooping_drives(config: Config) -> Config:
    """Return the configuration that fits the drives of the Robotino of `tests/nature`.

    They droop by up to 1.6 rad/s under the greatest load of `Floor.slippery`: friction of 0.13 Nm and a
    contact that bears 0.4 of 46 N on 0.04 m, at 0.55 Nm per rad/s.
    """
    safety = config.safety.model_copy(update={"stall_set_point_rad_s": 1.7, "creep_rad": 20.0})
    return config.model_copy(update={"safety": safety})


def omni_contact(seed: int) -> MakePlant:
    """Return the Robotino of `tests/nature` on slippery ground."""
    return lambda start_ns: OmniContact(slippery_floor(seed), start_ns)


CAMERA = {
    "type": "overhead_camera",
    "source": "live_folder",
    "path": "frames",
    "max_age_s": 10.0,
    "marker_id": 7,
    "marker_size_m": 0.12,
    "marker_height_m": 0.22,
    "calibration": "simulated",
}


def with_fixes(config: Config, fixes_per_s: float) -> Config:
    """Return the rover with an overhead camera."""
    table = config.model_dump(by_alias=True)
    table["devices"]["overhead"] = {**CAMERA, "frame_rate_hz": fixes_per_s}
    table["roles"]["fixes"] = ["overhead"]
    return Config.model_validate(table)


def ground_camera(seed: int) -> MakeCamera:
    """Return a camera that measures the motion over the ground, with errors of `seed`."""
    return lambda rover: GroundCamera(rover, np.random.default_rng((seed, 1)))


def any_rig() -> RigFile:
    """Return a rig for a camera without pictures: the estimator looks at none."""
    rig = load_config("el-dorado").scomp
    assert rig is not None
    assert rig.rig is not None
    return rig.rig


def put(world: World, plant: Plant) -> None:
    """Put another rover in the place of the configured one, also where the emulators see it."""
    world.plant = plant
    emulators = [device.emulator for device in world.byte_devices.values()]
    emulators += [device.emulator for device in world.image_devices.values()]
    for emulator in emulators:
        vars(emulator)["_plant"] = plant


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """One cycle: its output and the true pose x, y, yaw, relative to the start.

    Attributes:
        t_s: Since the start of the run.
        age_s: How old the estimate is: the time since the wheel positions that it is based on.
    """

    t_s: float
    age_s: float
    output: StepOutput
    truth: tuple[float, float, float]

    @property
    def error(self) -> NDArray[np.float64]:
        """Estimate minus truth: x, y in m and yaw in rad."""
        estimate, (x_m, y_m, yaw_rad) = self.output.estimate, self.truth
        turned_rad = math.remainder(estimate.yaw_rad - yaw_rad, math.tau)
        return np.array([estimate.x_m - x_m, estimate.y_m - y_m, turned_rad])

    @property
    def nees(self) -> float:
        """Normalised estimation error squared of the pose; 3 on average where the covariance is right."""
        xx, xy, xt, yy, yt, tt = self.output.estimate.covariance
        covariance = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]])
        return float(self.error @ np.linalg.solve(covariance + 1e-12 * np.eye(3), self.error))


@dataclass(slots=True)
class Driven:
    """A mission that was driven, cycle by cycle."""

    moments: list[Moment] = field(default_factory=list)

    @property
    def mode(self) -> Mode:
        """The last mode."""
        return self.moments[-1].output.mode

    def stops(self) -> list[Moment]:
        """Return the first cycle of every stop."""
        pairs = zip(self.moments, self.moments[1:], strict=False)
        stopped = (Mode.SAFE_STOP, Mode.EMERGENCY_STOP)
        return [
            after
            for before, after in pairs
            if before.output.mode is Mode.RUNNING and after.output.mode in stopped
        ]


def drive(
    config: Config,
    falsify: Falsify = lambda _, sample: sample,
    *,
    paused_s: tuple[float, float] = (0.0, 0.0),
    limit_s: float = 120.0,
    make_plant: MakePlant | None = None,
    make_camera: MakeCamera | None = None,
    change_world: ChangeWorld = lambda _: None,
) -> Driven:
    """Run the loop on the simulated rover of `config` to its end.

    Args:
        config: With [mission] and [simulation].
        falsify: What reaches the loop of each sample.
        paused_s: From when until when the process does not run; the world goes on.
        limit_s: The run ends after this time.
        make_plant: Makes a rover that takes the place of the simulated one of `config`.
        make_camera: Makes a camera that measures the motion over the ground; None for a rover without.
        change_world: Changes the simulated rover of `config`, or the one in its place.
    """
    clock = VirtualClock()
    rig, world = build_virtual_rig(config, clock, NoTap())
    start_ns = now_ns = clock.now_ns()
    if make_plant is not None:
        put(world, make_plant(start_ns))
    change_world(world)
    camera = None if make_camera is None else make_camera(world.plant)
    if camera is not None:
        roles = replace(config.device_roles(), camera=DEVICE)
        config = config.model_copy(update={"ground_motion": GroundMotionSettings(rig=any_rig())})
        rig = replace(rig, loop=ControlLoop(config, roles, meter=camera))
    begin = world.plant.truth()
    driven = Driven()
    rig.connect(timeout_s=1.0)
    with closing(rig):
        while not driven.moments or (driven.mode not in OVER and driven.moments[-1].t_s < limit_s):
            now_ns += nanoseconds(1.0 / config.loop.rate_hz)
            if paused_s[0] <= seconds(now_ns - start_ns) < paused_s[1]:
                now_ns = start_ns + nanoseconds(paused_s[1])
            clock.sleep_until(now_ns)
            t_s = seconds(now_ns - start_ns)
            received = [falsify(t_s, sample) for sample in rig.poll()]
            received += [] if camera is None else camera.frames(now_ns)
            output = rig.loop.step(now_ns, [sample for sample in received if sample is not None])
            rig.drive.command(output.command)
            truth = world.plant.truth()
            way = complex(truth.x_m - begin.x_m, truth.y_m - begin.y_m)
            turned = way * complex(math.cos(begin.yaw_rad), -math.sin(begin.yaw_rad))
            pose = (turned.real, turned.imag, truth.yaw_rad - begin.yaw_rad)
            age_s = seconds(now_ns - output.estimate.t_ns)
            driven.moments.append(Moment(t_s=t_s, age_s=age_s, output=output, truth=pose))
    return driven
