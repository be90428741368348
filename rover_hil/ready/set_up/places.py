"""Where devices may be: serial ports, CAN interfaces and cameras of this computer."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from rover_hil.doctor.finding import SystemPaths, read_text

SERIAL_PATTERNS = ("serial/by-id/*", "ttyUSB*", "ttyACM*")
CAMERA_PATTERNS = ("v4l/by-id/*-video-index0", "video*")
CAN_LINK_TYPE = "280"
"""ARPHRD_CAN of linux/if_arp.h."""
IMAGES = (".png", ".jpg", ".jpeg", ".npy")


@dataclass(frozen=True, slots=True)
class Places:
    """Paths of serial ports and cameras, and names of CAN interfaces."""

    serial: list[str] = field(default_factory=list)
    can: list[str] = field(default_factory=list)
    cameras: list[str] = field(default_factory=list)


def find_places(paths: SystemPaths, folder: Path | None) -> Places:
    """Return the ports of this computer, each once, under the name that survives a replug.

    Args:
        paths: Folders in which the system shows its devices.
        folder: Also look here, e.g. where `rover-hil simulate` serves its ports; None for nowhere.
    """
    serial = _each_once(paths.dev, SERIAL_PATTERNS)
    cameras = _each_once(paths.dev, CAMERA_PATTERNS)
    if folder is not None and folder.is_dir():
        for path in sorted(folder.iterdir()):
            if path.is_dir():
                cameras.append(str(path))
            elif path.is_char_device():
                serial.append(str(path))
    interfaces = sorted((paths.sys / "class/net").glob("*"))
    can = [each.name for each in interfaces if read_text(each / "type") == CAN_LINK_TYPE]
    return Places(serial, can, cameras)


def _each_once(dev: Path, patterns: Iterable[str]) -> list[str]:
    names: dict[Path, str] = {}
    for pattern in patterns:
        for path in sorted(dev.glob(pattern)):
            names.setdefault(path.resolve(), str(path))
    return list(names.values())
