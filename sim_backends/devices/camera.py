"""A simulated camera that looks back at the ground behind a wheel, where the wheel leaves its trace.

What it leaves out, besides what the scene leaves out (docs/rear_scene.md): frames come at an exact rate and
none is lost; there is no rolling shutter, automatic exposure or JPEG artefact.
"""

from typing import Protocol

import numpy as np

from drivers.camera.settings import CameraSettings
from drivers.clock import nanoseconds
from drivers.link import CameraImage
from drivers.samples import Image
from sim_backends.rear_scene.settings import CameraEmulatorSettings
from sim_backends.world.line import Line, serial_bits
from sim_backends.world.plant import Plant, Truth
from sim_backends.world.world import EmulatedDevice

USB_BITS_PER_S = 480e6


class Scene(Protocol):
    """What the camera sees."""

    def render(self, truth: Truth) -> Image:
        """Return the picture from where the rover is; called in order of time."""
        ...


class CameraEmulator:
    """Exposes a frame per period, at a phase of its own, and sends it to the host.

    Args:
        device: Settings of the camera as the host knows it.
        emulator: Settings of the simulated camera.
        scene: What it sees.
        plant: The simulated rover.
        to_host: Where frames go; it takes the transfer time.
        first_frame_ns: When the first frame is exposed.
    """

    def __init__(
        self,
        device: CameraSettings,
        emulator: CameraEmulatorSettings,
        scene: Scene,
        plant: Plant,
        to_host: Line[CameraImage],
        first_frame_ns: int,
    ) -> None:
        self._period_ns = nanoseconds(1 / device.frame_rate_hz)
        self._exposure_ns = nanoseconds(emulator.exposure_s)
        self._scene = scene
        self._plant = plant
        self._to_host: Line[CameraImage] = to_host
        self._next_ns = first_frame_ns

    @property
    def next_event_ns(self) -> int:
        """When the next frame is exposed."""
        return self._next_ns

    def act(self, t_ns: int) -> None:
        """Expose a frame; it goes out at the end of the exposure."""
        image = self._scene.render(self._plant.truth())
        self._to_host.put(t_ns + self._exposure_ns, CameraImage(image, t_ns))
        self._next_ns += self._period_ns

    def hear(self, t_ns: int, payload: bytes) -> None:
        """Ignore it: the camera takes no commands."""


def make_camera(
    name: str,
    device: CameraSettings,
    emulator: CameraEmulatorSettings,
    plant: Plant,
    rng: np.random.Generator,
    start_ns: int,
) -> EmulatedDevice[CameraImage]:
    """Build the simulated camera called `name` and its bus; the first frame is within a period of the start.

    Raises:
        ConfigError: The horizon is in view, or ground too far away.
    """
    from sim_backends.rear_scene.emulated_scene import EmulatedScene  # numba takes a second to load

    scene = EmulatedScene(emulator, device.width, device.height, device.frame_rate_hz, rng, start_ns)
    to_host: Line[CameraImage] = Line(lambda image: 1.0, 1 / emulator.transfer_s)  # one frame is one bit
    first_frame_ns = start_ns + int(rng.integers(nanoseconds(1 / device.frame_rate_hz)))
    camera = CameraEmulator(device, emulator, scene, plant, to_host, first_frame_ns)
    return EmulatedDevice(name, camera, to_host, Line(serial_bits, USB_BITS_PER_S))
