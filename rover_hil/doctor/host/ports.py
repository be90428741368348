"""Check device files: present, permitted, with a name that stays."""

import grp
import os
import pwd
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from drivers.camera.settings import FrameSourceSettings
from drivers.device_settings import CanDeviceSettings, SerialDeviceSettings
from drivers.registry import AnyDeviceSettings
from rover_hil.doctor.finding import Finding, SystemPaths, ok, problem, read_text, warning
from rover_hil.doctor.host.port_users import describe, find_users


@dataclass(frozen=True, slots=True)
class PortKind:
    """Facts about a kind of device file.

    Attributes:
        check: Name of the check.
        links: Folders below /dev with names that survive a replug, best first.
        moving_names: Beginnings of names that do not.
        group: The group that may usually open it.
    """

    check: str
    links: tuple[str, str]
    moving_names: tuple[str, ...]
    group: str


SERIAL = PortKind("serial port", ("serial/by-id", "serial/by-path"), ("ttyUSB", "ttyACM"), "dialout")
CAMERA = PortKind("camera", ("v4l/by-id", "v4l/by-path"), ("video",), "video")


class Port(NamedTuple):
    """A device file in the configuration, and its key."""

    kind: PortKind
    key: str
    path: Path


def port_of(settings: AnyDeviceSettings) -> Port | None:
    """Return the device file that a device needs, or None when it needs none."""
    if isinstance(settings, SerialDeviceSettings):
        return Port(SERIAL, "port", Path(settings.port))
    if isinstance(settings, CanDeviceSettings) and settings.interface == "slcan":
        return Port(SERIAL, "channel", Path(settings.channel))
    if isinstance(settings, FrameSourceSettings) and settings.source == "v4l2":
        return Port(CAMERA, "path", Path(settings.path))
    return None


def check_port(device: str, port: Port, paths: SystemPaths) -> list[Finding]:
    """Check a device file without opening it."""
    check, path = port.kind.check, port.path
    try:
        status = path.stat()
    except OSError as error:
        return [_missing(device, port, paths, error.strerror or str(error))]
    if not stat.S_ISCHR(status.st_mode):
        return [
            problem(
                check,
                device,
                f"{path} is not a device file",
                f"a file or folder is in the place of the {check}",
                _set_key(device, port, paths),
            )
        ]
    if not os.access(path, os.R_OK | os.W_OK):
        return [no_permission(device, port, status, _user_name())]
    findings = [ok(check, device, f"{path} exists and may be opened")]
    findings += _check_name(device, port, paths)
    if port.kind is SERIAL:
        findings += _check_free(device, port, paths)
    return findings


def no_permission(device: str, port: Port, status: os.stat_result, user: str) -> Finding:
    """Return what a user without permission must do, by owner and bits of the device file."""
    path = port.path
    bits = stat.filemode(status.st_mode)
    try:
        owner = grp.getgrgid(status.st_gid)
        group, members = owner.gr_name, owner.gr_mem
    except KeyError:
        group, members = str(status.st_gid), []
    what = f"user {user} may not open {path} ({bits}, group {group})"
    group_may = status.st_mode & 0o060 == 0o060 and group != "root"
    if group_may and user in members and status.st_gid not in os.getgroups():
        cause = f"{user} has joined the group {group} since this login"
        fix = "log out and in again"
    elif group_may:
        cause = f"{user} is not in the group {group}"
        fix = f"sudo usermod -aG {group} {user}  (then log out and in again)"
    else:
        cause = "there is no group with permission to read and write it: a udev rule is missing"
        fix = f"sudo chgrp {port.kind.group} {path}; sudo chmod 660 {path}  (until the next replug)"
    return problem(port.kind.check, device, what, cause, fix)


def busy(device: str, port: Port, paths: SystemPaths, what: str) -> Finding:
    """Return what to do about an existing port that cannot be opened."""
    users = find_users(port.path, paths.proc)
    if users:
        pids = " ".join(str(user.pid) for user in users)
        cause = f"it is in use by {describe(users)}"
        fix = f"end that program, e.g. `kill {pids}`"
    else:
        cause = "another program has it open, it is another kind of device, or it rejects the settings"
        fix = f"sudo fuser -v {port.path}  (shows who has it open; end that program)"
    return problem(port.kind.check, device, what, cause, fix)


def check_latency_timer(device: str, port: Port, paths: SystemPaths) -> list[Finding]:
    """Check the latency timer of an FTDI adapter; it shows its value only while the port is open."""
    name = port.path.resolve().name
    timer = paths.sys / "bus/usb-serial/devices" / name / "latency_timer"
    text = read_text(timer)
    if port.kind is not SERIAL or text is None or not text.isdecimal() or int(text) <= 1:
        return []
    return [
        warning(
            "latency timer",
            device,
            f"the adapter delays bytes by up to {text} ms",
            "the FTDI adapter collects bytes before it sends them on, which adds to the age of every sample",
            f"echo 1 | sudo tee {timer}",
        )
    ]


def _user_name() -> str:
    try:
        return pwd.getpwuid(os.getuid()).pw_name
    except KeyError:  # a container may run under a number that has no name
        return str(os.getuid())


def _missing(device: str, port: Port, paths: SystemPaths, reason: str) -> Finding:
    path = port.path
    what = f"{path} cannot be found: {reason.lower()}"
    if path.is_symlink():
        cause = (
            f"it is a link to {path.readlink()}, which does not exist: unplugged, or its simulator has ended"
        )
    elif not path.is_absolute():
        cause = f"the path is relative to {Path.cwd()}, and `rover-hil simulate` does not serve it there"
    else:
        cause = "the device is not plugged in or not powered, or it has another name"
    return problem(port.kind.check, device, what, cause, _set_key(device, port, paths))


def _set_key(device: str, port: Port, paths: SystemPaths) -> str:
    names = _stable_names(port, paths)
    if not names:
        return (
            f"plug the device in and find its name with `ls {paths.dev / port.kind.links[0]}`; "
            "for the simulated rover start `rover-hil simulate CONFIG` in this folder first"
        )
    choices = " or ".join(f'"{name}"' for name in names)
    return f"in [devices.{device}] set {port.key} = {choices}"


def _check_name(device: str, port: Port, paths: SystemPaths) -> list[Finding]:
    path = port.path
    if not path.name.startswith(port.kind.moving_names):
        return []
    target = path.resolve()
    stable = next((name for name in _stable_names(port, paths) if name.resolve() == target), None)
    if stable is None:
        return []
    return [
        warning(
            port.kind.check,
            device,
            f"{path} may name another device after a replug or a restart",
            "the kernel numbers devices in the order in which they appear",
            f'in [devices.{device}] set {port.key} = "{stable}"',
        )
    ]


def _check_free(device: str, port: Port, paths: SystemPaths) -> list[Finding]:
    if not find_users(port.path, paths.proc):
        return []
    return [busy(device, port, paths, f"{port.path} is already open: two readers would share the bytes")]


def _stable_names(port: Port, paths: SystemPaths) -> list[Path]:
    """Return the names by serial number, or, where no device has one, those by socket."""
    for links in port.kind.links:
        folder = paths.dev / links
        if folder.is_dir() and (names := sorted(folder.iterdir())):
            return names
    return []
