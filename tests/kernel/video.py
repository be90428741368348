"""The kernel's virtual camera, vivid: settings of the link, and its controls by their names."""

import fcntl
import os
import struct
from pathlib import Path

from drivers.camera.settings import CameraSettings
from drivers.camera.v4l2_link import V4l2Link
from drivers.link import CameraImage, LinkItem
from tests.kernel.system import CLOCK, wait_until, write

DEVICE = Path("/dev/video0")
DRIVER = Path("/sys/bus/platform/drivers/vivid")
PLATFORM_DEVICE = "vivid.0"
WIDTH, HEIGHT = 320, 180
CONTROL_DESCRIPTION = struct.Struct("=II32s4iI8x")
CONTROL_VALUE = struct.Struct("=Ii")
NEXT_CONTROL = 0x80000000


def make_settings(**changes: object) -> CameraSettings:
    """Return settings of the camera, raw pixels at 25 Hz unless changed."""
    settings: dict[str, object] = {
        "type": "camera",
        "source": "v4l2",
        "path": str(DEVICE),
        "width": WIDTH,
        "height": HEIGHT,
        "frame_rate_hz": 25,
        "fourcc": "YUYV",
        "reconnect_limit_s": 60.0,
    }
    return CameraSettings.model_validate(settings | changes)


def make_link(**changes: object) -> V4l2Link:
    """Return the link to the camera, settings as for `make_settings`."""
    return V4l2Link(make_settings(**changes), CLOCK)


def unplug() -> None:
    write(DRIVER / "unbind", PLATFORM_DEVICE)


def plug_in() -> None:
    write(DRIVER / "bind", PLATFORM_DEVICE)
    wait_until(DEVICE.exists)


def set_control(name: str, value: int) -> None:
    """Set the control whose name, as `v4l2-ctl --list-ctrls` prints it, is `name`."""
    device = os.open(DEVICE, os.O_RDWR)
    try:
        request = CONTROL_VALUE.pack(_find_control(device, name), value)
        fcntl.ioctl(device, _request(28, CONTROL_VALUE.size), request)
    finally:
        os.close(device)


def collect(
    link: V4l2Link, count: int, kind: type | tuple[type, ...], limit_s: float = 20.0
) -> list[LinkItem[CameraImage]]:
    """Return the first so many items of one kind."""
    found: list[LinkItem[CameraImage]] = []

    def is_done() -> bool:
        found.extend(item for item in link.receive() if isinstance(item, kind))
        return len(found) >= count

    wait_until(is_done, limit_s)
    return found


def _find_control(device: int, wanted: str) -> int:
    number = 0
    while True:
        empty = bytearray(CONTROL_DESCRIPTION.size)
        struct.pack_into("=I", empty, 0, number | NEXT_CONTROL)
        fcntl.ioctl(device, _request(36, CONTROL_DESCRIPTION.size), empty)
        number, _, name, *_ = CONTROL_DESCRIPTION.unpack(empty)
        if name.rstrip(b"\0").decode() == wanted:
            return int(number)


def _request(number: int, size: int) -> int:
    """Return the number of an ioctl of V4L2 that reads and writes, as the macro _IOWR makes it."""
    return 3 << 30 | size << 16 | ord("V") << 8 | number
