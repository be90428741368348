"""The composition root: the only place that chooses between real, simulated and replayed devices."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from controllers.control_loop import ControlLoop, StepOutput
from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import RoverSettings
from controllers.slip.scomp.trace_reader import TraceFinder
from drivers.camera.settings import CameraSettings
from drivers.clock import Clock, VirtualClock
from drivers.device_settings import FrameDeviceSettings
from drivers.driver import AnyDriver, Health, WheelDrive
from drivers.errors import ConfigError
from drivers.link import CameraImage, RawTap
from drivers.samples import Sample, SentCommand
from rover_hil.config import Config
from rover_hil.run.replay_link import ReplayLink
from sim_backends.build import build_world
from sim_backends.world.loopback import LoopbackLink
from sim_backends.world.world import World

if TYPE_CHECKING:
    from controllers.ground_motion.live_ground_motion import LiveGroundMotion


@dataclass(frozen=True, slots=True)
class Rig:
    """Drivers and control loop, put together; nothing is connected yet.

    Attributes:
        drive: The one of the drivers that turns the wheels.
        required: Names of the devices without which the rover stops.
    """

    clock: Clock
    drivers: dict[str, AnyDriver]
    drive: WheelDrive
    loop: ControlLoop
    required: frozenset[str]

    def connect(self, timeout_s: float) -> None:
        """Connect every device, or none.

        Raises:
            NotConnectedError: One of them cannot be opened; those before it are closed again.
        """
        try:
            for driver in self.drivers.values():
                driver.connect(timeout_s)
        except BaseException:
            self.close()
            raise

    def poll(self) -> list[Sample]:
        """Return the samples of all devices since the last call, device by device."""
        samples: list[Sample] = []
        for driver in self.drivers.values():
            samples.extend(driver.poll())
        return samples

    def cycle(
        self, now_ns: int, others: Sequence[Sample] = ()
    ) -> tuple[list[Sample], StepOutput, SentCommand]:
        """Run one cycle: poll all devices, step the loop, command the wheels.

        Args:
            now_ns: Time of the cycle.
            others: Samples that came from elsewhere.
        """
        samples = [*self.poll(), *others]
        output = self.loop.step(now_ns, samples)
        return samples, output, self.drive.command(output.command)

    def healths(self) -> list[Health]:
        """Return the health facts of all devices."""
        return [driver.health() for driver in self.drivers.values()]

    def close(self) -> None:
        """Close every device; may be called again."""
        for driver in self.drivers.values():
            driver.close()


@dataclass(frozen=True, slots=True)
class ReplayLinks:
    """Links fed by the caller, by device name."""

    bytes_links: dict[str, ReplayLink[bytes]] = field(default_factory=dict)
    image_links: dict[str, ReplayLink[CameraImage]] = field(default_factory=dict)


def build_real_rig(config: Config, clock: Clock, tap: RawTap) -> Rig:
    """Put the rover of `config` together on its real ports."""
    drivers: dict[str, AnyDriver] = {}
    for name, settings in config.devices.items():
        if isinstance(settings, FrameDeviceSettings):
            drivers[name] = settings.make_driver(name, settings.make_link(clock), clock, tap)
        else:
            drivers[name] = settings.make_driver(name, settings.make_link(clock), clock, tap)
    return _assemble(config, clock, drivers)


def build_virtual_rig(config: Config, clock: VirtualClock, tap: RawTap) -> tuple[Rig, World]:
    """Put the rover of `config` together on a simulated one, in lockstep with `clock`.

    Raises:
        ConfigError: The configuration has no [simulation], or one that does not fit its devices.
    """
    world = build_world(config.devices, config.require_simulation(), clock.now_ns())
    drivers: dict[str, AnyDriver] = {}
    for name, settings in config.devices.items():
        if isinstance(settings, FrameDeviceSettings):
            image_link = LoopbackLink(world, world.image_devices[name], clock)
            drivers[name] = settings.make_driver(name, image_link, clock, tap)
        else:
            byte_link = LoopbackLink(world, world.byte_devices[name], clock)
            drivers[name] = settings.make_driver(name, byte_link, clock, tap)
    return _assemble(config, clock, drivers), world


def build_replay_rig(config: Config, clock: VirtualClock, tap: RawTap) -> tuple[Rig, ReplayLinks]:
    """Put the rover of `config` together on links that the caller feeds."""
    links = ReplayLinks()
    drivers: dict[str, AnyDriver] = {}
    for name, settings in config.devices.items():
        if isinstance(settings, FrameDeviceSettings):
            image_link = links.image_links[name] = ReplayLink()
            drivers[name] = settings.make_driver(name, image_link, clock, tap)
        else:
            byte_link = links.bytes_links[name] = ReplayLink()
            drivers[name] = settings.make_driver(name, byte_link, clock, tap)
    return _assemble(config, clock, drivers), links


def find_wheel_count_conflict(rover: RoverSettings, drive: str, drive_wheel_count: int) -> str:
    """Return why a drive does not fit the rover; "" when it does."""
    wheel_count = make_kinematics(rover).wheel_count
    if drive_wheel_count == wheel_count:
        return ""
    return (
        f"rover.kinematics is '{rover.kinematics}', which has {wheel_count} wheels, but device "
        f"'{drive}' has {drive_wheel_count}: correct one of them"
    )


def make_finder(config: Config, meter: "LiveGroundMotion | None" = None) -> TraceFinder | None:
    """Return the trace estimator of a configuration; None without a rear camera.

    Args:
        config: The configuration.
        meter: Measures the motion over the ground for it too, where it looks at the same ground.

    Raises:
        ConfigError: The camera does not see the ground behind the wheel, or its frames have another size.
    """
    camera = None if config.roles.camera is None else config.devices[config.roles.camera]
    if config.scomp is None or config.scomp.rig is None or not isinstance(camera, CameraSettings):
        return None
    # Imported here because it brings OpenCV, which a rover without a camera must not wait for.
    from controllers.ftrace.estimator import TraceEstimator

    conflict = config.scomp.rig.size_conflict(camera.width, camera.height)
    if conflict:
        raise ConfigError(conflict)
    ground = config.ground_motion
    if ground is None or ground.rig != config.scomp.rig:
        return TraceEstimator(config.scomp.rig.geometry())
    # With a negative delay a frame counts for the ground motion as exposed after it does for the trace.
    pairs = None if meter is None or ground.camera_delay_s < 0.0 else meter.pairs
    return TraceEstimator(config.scomp.rig.geometry(), tolerance=ground.tolerance, pairs=pairs)


def _make_meter(config: Config) -> "LiveGroundMotion | None":
    camera = None if config.roles.camera is None else config.devices[config.roles.camera]
    if config.ground_motion is None or not isinstance(camera, CameraSettings):
        return None
    # Imported here because it brings OpenCV, which a rover without a camera must not wait for.
    from controllers.ground_motion.live_ground_motion import LiveGroundMotion

    skids = make_kinematics(config.rover).skids_in_rotations
    return LiveGroundMotion(config.ground_motion, camera, rotates_about_origin=not skids)


def _assemble(config: Config, clock: Clock, drivers: dict[str, AnyDriver]) -> Rig:
    drive = drivers[config.roles.wheels]
    if not isinstance(drive, WheelDrive):
        raise ConfigError(f"device '{config.roles.wheels}' turns no wheels")
    conflict = find_wheel_count_conflict(config.rover, drive.name, drive.wheel_count)
    if conflict:
        raise ConfigError(conflict)
    roles = replace(config.device_roles(), wheel_wraps_rad=drive.wheel_wraps_rad)
    meter = _make_meter(config)
    loop = ControlLoop(config, roles, make_finder(config, meter), meter)
    return Rig(clock, drivers, drive, loop, frozenset(config.roles.names()))
