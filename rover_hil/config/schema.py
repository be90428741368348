"""The sections of a configuration, and what they must fulfil together."""

import re
from collections.abc import Callable, Iterator
from typing import Annotated, Literal, NamedTuple, Self

from pydantic import AfterValidator, Field, model_validator

from controllers.ground_motion.rig import RigFile
from controllers.motion.kinematics import make_kinematics
from controllers.roles import DeviceRoles
from controllers.settings import (
    ControlSettings,
    find_crab_conflicts,
    find_slip_conflicts,
    find_stall_conflicts,
)
from controllers.slip.effort.settings import SURFACES, YAW_PROBE
from drivers.camera.settings import CameraSettings
from drivers.device_settings import ByteDeviceSettings, DeviceSettings, DriveSettings
from drivers.errors import ConfigError
from drivers.inertial_settings import InertialSettings
from drivers.nmea_gnss.settings import NmeaGnssSettings
from drivers.overhead_camera.settings import OverheadCameraSettings
from drivers.registry import AnyDeviceSettings
from drivers.settings import Settings
from rover_hil.config.ros2_settings import POSE_FIX, Ros2Settings
from rover_hil.config.tune_settings import TuneSettings
from sim_backends.settings import SimulationSettings


def _check_device_name(name: str) -> str:
    # It is part of topics and of paths in the log.
    if not re.fullmatch(r"\w[\w-]{0,63}", name):
        raise ValueError(
            f"a device cannot be called '{name}', use letters, digits, _ and -, at most 64 of them"
        )
    return name


DeviceName = Annotated[str, AfterValidator(_check_device_name)]


MISSING_SIMULATION = "simulation: this key is missing; add the simulated rover as [simulation]"


class LoopSettings(Settings):
    """The control loop.

    Attributes:
        rate_hz: Cycles per second.
        time_limit_s: A run ends after this time, finished or not.
    """

    rate_hz: Annotated[float, Field(ge=1, le=1000)]
    time_limit_s: Annotated[float, Field(gt=0, le=86_400)] = 600.0


class BenchSettings(Settings):
    """What stops a run of `rover-hil bench` when the page cannot stop it any more.

    Attributes:
        server_timeout_s: The rover stops after this time without a heartbeat of the program that serves
            the page.
        page_required: The rover also stops when the script of the page in control does not answer. Without it
            a mission drives on without a page.
        page_timeout_s: It stops after this time without an answer of that script, which is asked every 0.1 s.
    """

    server_timeout_s: Annotated[float, Field(ge=0.2, le=1.0)] = 0.5
    page_required: bool = True
    page_timeout_s: Annotated[float, Field(ge=0.5, le=5.0)] = 0.5


class RoleSettings(Settings):
    """Which device the estimator uses for what; the rover stops when one of them sends nothing.

    Attributes:
        wheels: The device that reports wheel positions and takes setpoints.
        gyro: The device whose yaw rate is used; without one the yaw comes from the wheels.
        headings: The devices whose headings are used.
        fixes: The overhead cameras whose poses are used. What happens before the first one cannot be
            corrected: make `safety.settle_s` longer than their period.
        require_fixes: The rover also stops when one of them sends nothing, e.g. because it does not see the
            rover any more.
        camera: The camera that sees the ground, for [ground_motion], or the trace of the rear left wheel, for
            [scomp].
        require_camera: The rover also stops when this camera sends nothing or breaks. Otherwise slip is then
            not measured, and the estimate is less certain.
        required: Other devices that the rover needs: it also stops when one of them sends nothing. A
            calibration adds those that it reads.
    """

    wheels: str
    gyro: str | None = None
    headings: tuple[str, ...] = ()
    fixes: tuple[str, ...] = ()
    require_fixes: bool = False
    camera: str | None = None
    require_camera: bool = False
    required: tuple[str, ...] = ()

    def names(self) -> tuple[str, ...]:
        """Return the names of all devices that the rover needs for moving, each once."""
        candidates = (
            self.wheels,
            self.gyro,
            *self.headings,
            *(self.fixes if self.require_fixes else ()),
            self.camera if self.require_camera else None,
            *self.required,
        )
        return tuple(dict.fromkeys(name for name in candidates if name is not None))

    def assignments(self) -> Iterator[tuple[str, str]]:
        """Yield role and name of every device that has one."""
        for role in ROLE_KINDS:
            value: str | tuple[str, ...] | None = getattr(self, role)
            for name in (value,) if isinstance(value, str) else value or ():
                yield role, name


ROLE_KINDS: dict[str, tuple[type[DeviceSettings] | tuple[type[DeviceSettings], ...], str]] = {
    "wheels": (DriveSettings, "turns no wheels"),
    "gyro": (ByteDeviceSettings, "is a camera and measures no yaw rate"),
    "headings": (ByteDeviceSettings, "is a camera and measures no heading"),
    "fixes": ((OverheadCameraSettings, NmeaGnssSettings), "is neither an overhead_camera nor an nmea_gnss"),
    "camera": (CameraSettings, "is not a camera that looks back"),
    "required": (DeviceSettings, "is no device"),
}
"""Per role the kind of device it needs, and what any other device lacks."""


class Config(ControlSettings):
    """A rover: its devices, how it is estimated and controlled, and how it is simulated.

    Attributes:
        schema_name: Version of the file format.
        loop: The control loop.
        roles: Which device is used for what.
        devices: The devices by name.
        simulation: The simulated rover; needed by `simulate`, `tune` and `run --virtual`.
        tune: What `tune` may change, and to what end.
        bench: What stops a run of `bench` when the page is lost.
        ros2: What `run` and `bench` exchange with programs of ROS 2; without it nothing.
    """

    schema_name: Annotated[Literal["rover-hil-config/1"], Field(alias="schema")]
    loop: LoopSettings
    roles: RoleSettings
    devices: Annotated[dict[DeviceName, AnyDeviceSettings], Field(min_length=1)]
    simulation: SimulationSettings | None = None
    tune: TuneSettings | None = None
    bench: BenchSettings = BenchSettings()
    ros2: Ros2Settings | None = None

    @property
    def fix_sources(self) -> tuple[str, ...]:
        """Names of the devices whose poses are used, and of those that arrive over ROS 2."""
        over_ros2 = self.ros2 is not None and self.ros2.pose_fixes
        return (*self.roles.fixes, *((POSE_FIX,) if over_ros2 else ()))

    def device_roles(self) -> DeviceRoles:
        """Return the roles as the controller needs them."""
        wheels = self.devices[self.roles.wheels]
        gyro = None if self.roles.gyro is None else self.devices[self.roles.gyro]
        kinematics = make_kinematics(self.rover)
        return DeviceRoles(
            wheels=self.roles.wheels,
            wheel_age_s=(
                wheels.wheel_age_s(1.0 / self.loop.rate_hz) if isinstance(wheels, DriveSettings) else None
            ),
            required={name: self.devices[name].max_age_s for name in self.roles.names()},
            gyro=self.roles.gyro,
            gyro_rate_hz=gyro.rate_hz if isinstance(gyro, InertialSettings) else None,
            headings=self.roles.headings,
            fixes=self.fix_sources,
            camera=self.roles.camera,
            unmeasured_wheels=kinematics.unmeasured,
            undriven_wheels=kinematics.undriven,
            supplies=(
                ()
                if self.safety.least_supply_v is None
                else tuple(name for name, device in self.devices.items() if device.reports_supply())
            ),
        )

    def require_simulation(self) -> SimulationSettings:
        """Return the simulated rover.

        Raises:
            ConfigError: There is none.
        """
        if self.simulation is None:
            raise ConfigError(MISSING_SIMULATION)
        return self.simulation

    @model_validator(mode="after")
    def _check_sections_together(self) -> Self:
        conflicts = find_conflicts(Draft.complete(self), SCHEMA_RULES)
        if conflicts:
            raise ValueError("\n".join(conflicts))
        return self


class Draft(NamedTuple):
    """A configuration of which perhaps only some sections are valid.

    Attributes:
        config: The valid sections, devices without mistakes among them; it lacks all others.
        sections: Names of the valid sections, among them those left out that have a default.
        broken_devices: Names of the devices with mistakes.
    """

    config: Config
    sections: frozenset[str]
    broken_devices: frozenset[str]

    @classmethod
    def complete(cls, config: Config) -> Self:
        """Return the draft of a configuration without mistakes."""
        return cls(config, frozenset(Config.model_fields), frozenset())


class Rule(NamedTuple):
    """Something that sections must fulfil together.

    Attributes:
        sections: What the rule needs; it is not applied when one of them is not valid.
        find: Yields each conflict as key, what is wrong and how to fix it.
        is_last: It is applied only where no device has mistakes and no other rule found a conflict.
    """

    sections: tuple[str, ...]
    find: Callable[[Draft], Iterator[str]]
    is_last: bool = False


def find_conflicts(draft: Draft, rules: tuple[Rule, ...]) -> list[str]:
    """Return every conflict in the valid sections of a draft."""
    conflicts: list[str] = []
    for rule in sorted(rules, key=lambda each: each.is_last):
        if not draft.sections.issuperset(rule.sections):
            continue
        if not rule.is_last or not (conflicts or draft.broken_devices):
            conflicts.extend(rule.find(draft))
    return conflicts


def _find_unfit_devices(draft: Draft) -> Iterator[str]:
    devices = draft.config.devices
    for role, name in draft.config.roles.assignments():
        kind, lack = ROLE_KINDS[role]
        if name in draft.broken_devices or isinstance(devices.get(name), kind):
            continue
        fitting = [each for each, device in devices.items() if isinstance(device, kind)]
        fix = f"name one of {', '.join(fitting)}" if fitting else "add a device that does, or remove the role"
        if name in devices:
            yield f"roles.{role}: device '{name}' {lack}: {fix}"
        else:
            yield f"roles.{role}: [devices] has no '{name}': {fix}"


def _find_missing_gyro(draft: Draft) -> Iterator[str]:
    slip = draft.config.slip
    if slip is not None and slip.use == YAW_PROBE and draft.config.roles.gyro is None:
        yield f"slip.use is '{YAW_PROBE}', which needs a gyro: name one in roles.gyro, or use '{SURFACES}'"


def _find_slip_conflicts(draft: Draft) -> Iterator[str]:
    config = draft.config
    return find_slip_conflicts(config.rover, config.slip, config.scomp)


def _find_stall_conflicts(draft: Draft) -> Iterator[str]:
    config = draft.config
    return find_stall_conflicts(config.rover, config.mission, config.safety)


def _find_crab_conflicts(draft: Draft) -> Iterator[str]:
    return find_crab_conflicts(draft.config.mission, draft.config.scomp)


def _find_rig_conflicts(draft: Draft) -> Iterator[str]:
    config, name = draft.config, draft.config.roles.camera
    rigs = find_rigs(config)
    if not rigs and name is not None:
        yield (
            "roles.camera: its calibration is missing: add ground_motion.rig or scomp.rig, or remove the role"
        )
    camera = None if name is None else config.devices.get(name)
    for key, rig in rigs.items():
        if name is None:
            yield f"{key}: it calibrates no camera: add roles.camera, or remove the rig"
        conflict = (
            rig.size_conflict(camera.width, camera.height) if isinstance(camera, CameraSettings) else ""
        )
        if conflict:
            yield conflict


def find_rigs(config: ControlSettings) -> dict[str, RigFile]:
    """Return the calibrations of the camera in a configuration, by their keys."""
    rigs: dict[str, RigFile] = {}
    if config.scomp is not None and config.scomp.rig is not None:
        rigs["scomp.rig"] = config.scomp.rig
    if config.ground_motion is not None:
        rigs["ground_motion.rig"] = config.ground_motion.rig
    return rigs


SCHEMA_RULES = (
    Rule(("roles", "devices"), _find_unfit_devices),
    Rule(("roles", "slip"), _find_missing_gyro),
    Rule(("rover", "slip", "scomp"), _find_slip_conflicts),
    Rule(("rover", "mission", "safety"), _find_stall_conflicts),
    Rule(("mission", "scomp"), _find_crab_conflicts),
    Rule(("roles", "devices", "scomp", "ground_motion"), _find_rig_conflicts),
)
"""What every configuration fulfils, also one read from a log."""
