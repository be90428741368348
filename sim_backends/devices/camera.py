"""A simulated camera that looks back at the ground behind a wheel, where the wheel leaves its trace.

Not modelled, in addition to what the scene omits (docs/explanation/rear_scene.md): jitter of the frame rate,
JPEG artefacts. Lost frames are a fault, `drop`, of [[simulation.faults]].
"""

from typing import NamedTuple, Protocol

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
        """Return the image at the rover's true pose; called in order of time."""
        ...


class Exposure(NamedTuple):
    """How long the shutter is open before and after the instant at which the scene is rendered, in ns."""

    before_ns: int
    after_ns: int


class CameraEmulator:
    """Takes a frame per period, at a phase of its own, and sends it to the host.

    The capture stamp is the beginning of the exposure; the frame goes out at its end.

    Args:
        scene: What the camera sees.
        plant: The simulated rover.
        to_host: Line to the host; it takes the transfer time.
        period_ns: Time between frames.
        exposure: Exposure about the instant of rendering.
        first_ns: When the first frame is rendered.
    """

    def __init__(
        self,
        scene: Scene,
        plant: Plant,
        to_host: Line[CameraImage],
        period_ns: int,
        exposure: Exposure,
        first_ns: int,
    ) -> None:
        self._scene = scene
        self._plant = plant
        self._to_host: Line[CameraImage] = to_host
        self._period_ns = period_ns
        self._exposure = exposure
        self.next_event_ns = first_ns

    def act(self, t_ns: int) -> None:
        """Render a frame and send it at the end of the exposure."""
        image = CameraImage(self._scene.render(self._plant.truth()), t_ns - self._exposure.before_ns)
        self._to_host.put(t_ns + self._exposure.after_ns, image)
        self.next_event_ns += self._period_ns

    def receive(self, t_ns: int, payload: bytes) -> None:
        """Ignore the payload: a camera takes no commands."""


def check_camera(device: CameraSettings, emulator: CameraEmulatorSettings) -> None:
    """Check the pose and optics of a simulated camera; no ground is made.

    Raises:
        ConfigError: The horizon or ground too far away is in view.
    """
    from sim_backends.rear_scene.emulated_scene import make_rig

    make_rig(emulator, device.width, device.height, device.frame_rate_hz)


def make_emulator(
    name: str,
    device: CameraSettings,
    emulator: CameraEmulatorSettings,
    plant: Plant,
    rng: np.random.Generator,
    start_ns: int,
) -> EmulatedDevice[CameraImage]:
    """Build the simulated camera called `name` and its bus; the first frame comes within a period.

    Raises:
        ConfigError: The horizon or ground too far away is in view.
    """
    from sim_backends.rear_scene.emulated_scene import EmulatedScene  # numba takes a second to load

    scene = EmulatedScene(emulator, device.width, device.height, device.frame_rate_hz, rng, start_ns)
    to_host: Line[CameraImage] = Line(lambda image: 1.0, 1 / emulator.transfer_s)  # one frame is one bit
    period_ns = nanoseconds(1 / device.frame_rate_hz)
    # A frame is the scene in the middle of its exposure, from the first line's begin to the last line's end.
    half_ns = nanoseconds((emulator.exposure_s + emulator.readout_s) / 2)
    first_ns = start_ns + half_ns + int(rng.integers(period_ns))
    exposure = Exposure(half_ns, half_ns)
    camera = CameraEmulator(scene, plant, to_host, period_ns, exposure, first_ns)
    return EmulatedDevice(name, camera, to_host, Line(serial_bits, USB_BITS_PER_S))
