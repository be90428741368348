"""The configuration: a TOML file, validated to the last key, or the name of a shipped one."""

import re
import sys
import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from importlib import resources
from importlib.abc import Traversable
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails

from controllers.roles import DeviceRoles
from controllers.settings import OLD_SCOMP_KEY, ControlSettings
from controllers.slip.effort.settings import SURFACES, YAW_PROBE
from drivers.camera.settings import CameraSettings
from drivers.device_settings import DriveSettings, FrameDeviceSettings
from drivers.errors import ConfigError
from drivers.overhead_camera.settings import OverheadCameraSettings
from drivers.registry import AnyDeviceSettings
from drivers.settings import Settings
from rover_hil.tune.settings import TuneSettings
from sim_backends.settings import SimulationSettings


def _check_device_name(name: str) -> str:
    # It is part of topics and of paths in the log.
    if not re.fullmatch(r"\w[\w-]*", name):
        msg = f"a device cannot be called '{name}', use letters, digits, _ and -"
        raise ValueError(msg)
    return name


DeviceName = Annotated[str, AfterValidator(_check_device_name)]


class LoopSettings(Settings):
    """The cyclic executive.

    Attributes:
        rate_hz: Cycles per second.
        time_limit_s: A run that has not ended by then is ended.
    """

    rate_hz: Annotated[float, Field(ge=1, le=1000)]
    time_limit_s: Annotated[float, Field(gt=0, le=86_400)] = 600.0


class RoleSettings(Settings):
    """Which device the estimator takes what from; the rover stops when one of them falls silent.

    Attributes:
        wheels: The device that reports wheel positions and takes set-points.
        gyro: The device whose yaw rate is used, or None to take the yaw from the wheels.
        headings: The devices whose headings are used.
        fixes: The overhead cameras whose poses are used. What happens before the first one cannot be
            corrected: let `safety.settle_s` outlast their period.
        require_fixes: The rover stops also when one of them falls silent, e.g. because it left the view.
        camera: The camera that looks back at the trace of the rear left wheel, for [scomp].
    """

    wheels: str
    gyro: str | None = None
    headings: tuple[str, ...] = ()
    fixes: tuple[str, ...] = ()
    require_fixes: bool = False
    camera: str | None = None

    def names(self) -> tuple[str, ...]:
        """Return the names of all devices that the rover needs for moving, each once."""
        candidates = (self.wheels, self.gyro, *self.headings, *(self.fixes if self.require_fixes else ()))
        return tuple(dict.fromkeys(name for name in candidates if name is not None))


class Config(ControlSettings):
    """A rover: its devices, how it is estimated and controlled, and how it is simulated."""

    schema_name: Annotated[Literal["rover-hil-config/1"], Field(alias="schema")]
    loop: LoopSettings
    roles: RoleSettings
    devices: Annotated[dict[DeviceName, AnyDeviceSettings], Field(min_length=1)]
    simulation: SimulationSettings | None = None
    tune: TuneSettings | None = None

    def device_roles(self) -> DeviceRoles:
        """Return the roles as the controller needs them."""
        return DeviceRoles(
            wheels=self.roles.wheels,
            required={name: self.devices[name].max_age_s for name in self.roles.names()},
            gyro=self.roles.gyro,
            headings=self.roles.headings,
            fixes=self.roles.fixes,
            camera=self.roles.camera,
        )

    @model_validator(mode="after")
    def _check_roles(self) -> Self:
        camera = () if self.roles.camera is None else (self.roles.camera,)
        for name in (*self.roles.names(), *self.roles.fixes, *camera):
            if name not in self.devices:
                msg = f"roles name a device '{name}' that [devices] does not have"
                raise ValueError(msg)
        if not isinstance(self.devices[self.roles.wheels], DriveSettings):
            msg = f"roles.wheels is '{self.roles.wheels}', but a device of that type turns no wheels"
            raise ValueError(msg)
        for role in (self.roles.wheels, self.roles.gyro, *self.roles.headings):
            if role is not None and isinstance(self.devices[role], FrameDeviceSettings):
                msg = f"device '{role}' is a camera and can only be named in roles.fixes, if it is overhead"
                raise ValueError(msg)
        self._check_camera()
        if self.slip is not None and self.slip.use == YAW_PROBE and self.roles.gyro is None:
            msg = (
                f"slip.use is '{YAW_PROBE}', which needs a gyro: name one in roles.gyro, or use '{SURFACES}'"
            )
            raise ValueError(msg)
        for name in self.roles.fixes:
            if not isinstance(self.devices[name], OverheadCameraSettings):
                msg = f"roles.fixes names '{name}', but only a device of type 'overhead_camera' gives fixes"
                raise ValueError(msg)
        return self

    def _check_camera(self) -> None:
        camera = self.roles.camera
        if camera is not None and not isinstance(self.devices[camera], CameraSettings):
            msg = f"roles.camera is '{camera}', but only a device of type 'camera' looks back"
            raise ValueError(msg)
        has_rig = self.scomp is not None and self.scomp.rig is not None
        if has_rig != (camera is not None):
            msg = "name the camera in roles.camera if, and only if, scomp.rig holds its calibration"
            raise ValueError(msg)


def shipped_configs() -> tuple[str, ...]:
    """Return the names of the shipped configurations."""
    folder = resources.files("rover_hil") / "configs"
    return tuple(sorted(Path(item.name).stem for item in folder.iterdir() if item.name.endswith(".toml")))


def load_config(name_or_path: str) -> Config:
    """Read a configuration by the name of a shipped one or the path of a TOML file.

    Raises:
        ConfigError: No such file, no TOML, an unknown key, a value out of range; one sentence naming
            file, key and fix.
    """
    try:
        table = tomllib.loads(read_config_text(name_or_path))
    except tomllib.TOMLDecodeError as error:
        msg = f"{name_or_path} is no valid TOML: {error}"
        raise ConfigError(msg) from error
    _inline_slip_maps(table)
    _inline_scomp(table)
    try:
        return Config.model_validate(table)
    except ValidationError as error:
        raise ConfigError(describe_validation_error(name_or_path, error, table)) from error


def load_slip_map(name_or_path: str) -> dict[str, object]:
    """Return the content of a file of slip maps by the name of a shipped one or its path, not yet checked.

    Raises:
        ConfigError: No such file, or no TOML.
    """
    shipped = resources.files("rover_hil") / "slip_maps" / f"{name_or_path}.toml"
    return _load_toml(shipped, name_or_path, "slip map")


def _load_toml(shipped: Traversable, name_or_path: str, what: str) -> dict[str, object]:
    path = shipped if shipped.is_file() else Path(name_or_path)
    try:
        return tomllib.loads(path.read_text("utf-8"))
    except OSError as error:
        msg = f"cannot read {what} {name_or_path}: {error.strerror}; name a shipped one or a TOML file"
        raise ConfigError(msg) from error
    except ValueError as error:
        msg = f"{what} {name_or_path} is no valid TOML: {error}"
        raise ConfigError(msg) from error


def _inline_slip_maps(table: dict[str, object]) -> None:
    """Put the content of the file that slip.maps names in its place, so that a log holds all it needs."""
    slip = table.get("slip")
    if isinstance(slip, dict) and isinstance(slip.get("maps"), str):
        slip["maps"] = load_slip_map(slip["maps"])


def _inline_scomp(table: dict[str, object]) -> None:
    """Put the content of the files that scomp names in its place, likewise."""
    if OLD_SCOMP_KEY in table:
        note = f"[{OLD_SCOMP_KEY}] is now called [scomp]: rename it, the next version knows the new name only"
        print(note, file=sys.stderr)  # noqa: T201 - a note to the user
    scomp = table.get("scomp", table.get(OLD_SCOMP_KEY))
    if not isinstance(scomp, dict):
        return
    parameters, rig = scomp.get("parameters"), scomp.get("rig")
    if isinstance(parameters, str):
        shipped = resources.files("rover_hil") / "scomp_parameters" / f"{parameters}.toml"
        scomp["parameters"] = _load_toml(shipped, parameters, "parameters")
    if isinstance(rig, str):
        from rover_hil.ftrace.rig_file import read_rig  # it needs this module

        shipped = resources.files("rover_hil") / "rigs" / f"{rig}.json"
        with resources.as_file(shipped) as path:
            found = read_rig(path if path.is_file() else Path(rig))
        scomp["rig"] = found.model_dump(mode="json", by_alias=True)


def read_config_text(name_or_path: str) -> str:
    """Return the text of a configuration, given as for `load_config`.

    Raises:
        ConfigError: No such file, or one that cannot be read.
    """
    if name_or_path in shipped_configs():
        return (resources.files("rover_hil") / "configs" / f"{name_or_path}.toml").read_text("utf-8")
    return _read_text(Path(name_or_path))


def _read_text(path: Path) -> str:
    if path.is_dir():
        msg = f"{path} is a folder; give the TOML file in it"
        raise ConfigError(msg)
    try:
        return path.read_text("utf-8")
    except FileNotFoundError:
        msg = f"no configuration {path}: give a TOML file or one of {', '.join(shipped_configs())}"
        raise ConfigError(msg) from None
    except (OSError, UnicodeDecodeError) as error:
        msg = f"cannot read configuration {path}: {error}"
        raise ConfigError(msg) from error


def describe_validation_error(source: str, error: ValidationError, table: Mapping[str, object]) -> str:
    """Return one sentence about the first thing wrong: file, key, what, fix."""
    details = error.errors()
    # A mistyped key is reported twice, as missing and as unknown; the latter tells more.
    first = next((detail for detail in details if detail["type"] == "extra_forbidden"), details[0])
    key = ".".join(str(part) for part in _toml_path(first, table)) or "the file"
    sentence = f"{source}: {key}: {_explain(first)}"
    if len(details) > 1:
        sentence += f" (and {len(details) - 1} more)"
    return sentence


def _toml_path(detail: ErrorDetails, table: Mapping[str, object]) -> list[str | int]:
    """Drop the parts of pydantic's location that name a union's branch rather than a key."""
    path: list[str | int] = []
    place: object = table
    for index, part in enumerate(detail["loc"]):
        is_last = index == len(detail["loc"]) - 1
        if isinstance(place, Mapping):
            if part in place or (is_last and detail["type"] == "missing"):
                path.append(part)
                place = place.get(str(part))
        elif isinstance(place, list) and isinstance(part, int) and part < len(place):
            path.append(part)
            place = place[part]
    return path


def _explain(detail: ErrorDetails) -> str:
    kind = detail["type"]
    if kind == "missing":
        return "this key is missing; add it"
    if kind == "extra_forbidden":
        return f"unknown key; {_suggest_key(str(detail['loc'][-1]))}"
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        tag = detail.get("ctx", {}).get("discriminator", "'type'")
        expected = detail.get("ctx", {}).get("expected_tags", "")
        return f"{tag} must be one of {expected}" if expected else f"the key {tag} is missing; add it"
    message = detail["msg"].removeprefix("Value error, ")
    if kind == "value_error":
        return message
    return f"{message[0].lower()}{message[1:]}, got {detail['input']!r}"


def _suggest_key(key: str) -> str:
    known: set[str] = set()
    kinds: list[type[Settings]] = [Settings]
    while kinds:
        kind = kinds.pop()
        known.update(kind.model_fields)
        kinds.extend(kind.__subclasses__())
    close = get_close_matches(key, known - {key}, n=1, cutoff=0.6)
    return f"did you mean {close[0]}?" if close and key not in known else "it does not belong here, remove it"
