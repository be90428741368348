"""v4l2loopback, a camera of the kernel that sends what another program writes: here compressed frames."""

import fcntl
import os
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from drivers.clock import NANOSECONDS_PER_SECOND
from tests.kernel.system import CLOCK, is_done, load, wait_until
from tests.kernel.video import DEVICE, HEIGHT, WIDTH

MODULE = "v4l2loopback"
OUTPUT = 2
MJPG = int.from_bytes(b"MJPG", "little")
NO_FIELDS = 1
FORMAT = struct.Struct("=I4x5I180x")
"""Buffer type; width, height, pixel format, field, bytes per line; the rest is filled by the driver."""
PARAMETERS = struct.Struct("=I8xII184x")
"""Buffer type; period of a frame as a fraction of a second."""
SET_FORMAT, SET_PARAMETERS = 5, 22
PICTURES = 8

Damage = Callable[[bytes], bytes]


def plug_in() -> None:
    load(MODULE)
    wait_until(DEVICE.exists)


def unplug() -> None:
    """Remove the camera; waits until nobody has it open."""
    wait_until(lambda: is_done(f"rmmod {MODULE}"))


def pictures() -> list[bytes]:
    """Return compressed pictures of different brightness with the detail of a real one."""
    noise = np.random.default_rng(5).normal(0.0, 30.0, (HEIGHT, WIDTH, 3))
    detail = cv2.GaussianBlur(noise, (5, 5), 2.0)
    found = []
    for number in range(PICTURES):
        pixels = np.clip(60.0 + 15.0 * number + 3.0 * detail, 0, 255).astype(np.uint8)
        found.append(cv2.imencode(".jpg", pixels)[1].tobytes())
    return found


class Source:
    """Writes pictures into the camera at its rate, in a thread.

    Attributes:
        damage: What happens to the bytes of a frame.
        is_paused: Whether it writes nothing.
    """

    def __init__(self, camera: int, frames: list[bytes], rate_hz: int) -> None:
        self.damage: Damage = bytes
        self.is_paused = False
        self._camera = camera
        self._frames = frames
        self._period_ns = NANOSECONDS_PER_SECOND // rate_hz
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def start(self) -> None:
        self._thread.start()

    def end(self) -> None:
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        due_ns = CLOCK.now_ns()
        number = 0
        while not self._ending.is_set():
            if not self.is_paused:
                os.write(self._camera, self.damage(self._frames[number % len(self._frames)]))
                number += 1
            due_ns += self._period_ns
            CLOCK.sleep_until(due_ns)


@contextmanager
def source(frames: list[bytes], rate_hz: int) -> Iterator[Source]:
    """Yield a program that writes compressed frames into the camera."""
    camera = os.open(DEVICE, os.O_RDWR)
    try:
        fcntl.ioctl(
            camera,
            _request(SET_FORMAT, FORMAT.size),
            FORMAT.pack(OUTPUT, WIDTH, HEIGHT, MJPG, NO_FIELDS, 0),
        )
        fcntl.ioctl(camera, _request(SET_PARAMETERS, PARAMETERS.size), PARAMETERS.pack(OUTPUT, 1, rate_hz))
        writer = Source(camera, frames, rate_hz)
        writer.start()
        try:
            yield writer
        finally:
            writer.end()
    finally:
        os.close(camera)


def module_is_there(root: Path) -> bool:
    """Return whether the module was built into the unpacked kernel."""
    return any((root / "lib/modules").glob(f"*/extra/{MODULE}.ko"))


def _request(number: int, size: int) -> int:
    return 3 << 30 | size << 16 | ord("V") << 8 | number
