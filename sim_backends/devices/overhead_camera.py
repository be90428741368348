"""A simulated camera above the test site that sees the marker on the rover.

What it leaves out, besides what the scene leaves out: pictures come at an exact rate and none is lost; there
is no automatic exposure and no JPEG artefact.
"""

import numpy as np

from drivers.clock import nanoseconds
from drivers.errors import ConfigError
from drivers.link import CameraImage
from drivers.overhead_camera.settings import OverheadCameraSettings
from sim_backends.devices.camera import USB_BITS_PER_S, Scene
from sim_backends.overhead_scene.settings import OverheadCameraEmulatorSettings
from sim_backends.world.line import Line, serial_bits
from sim_backends.world.plant import Plant
from sim_backends.world.world import EmulatedDevice


class OverheadCameraEmulator:
    """Takes a picture per period, at a phase of its own, and sends it to the host.

    It acts in the middle of each exposure.

    Args:
        device: The camera as the host knows it.
        emulator: How it sees.
        scene: What it sees.
        plant: The simulated rover.
        to_host: Where pictures go; it takes the transfer time.
        first_ns: Middle of the first exposure.
    """

    def __init__(
        self,
        device: OverheadCameraSettings,
        emulator: OverheadCameraEmulatorSettings,
        scene: Scene,
        plant: Plant,
        to_host: Line[CameraImage],
        first_ns: int,
    ) -> None:
        self._period_ns = nanoseconds(1 / device.frame_rate_hz)
        self._half_exposure_ns = nanoseconds(emulator.exposure_s / 2)
        self._scene = scene
        self._plant = plant
        self._to_host: Line[CameraImage] = to_host
        self._next_ns = first_ns

    @property
    def next_event_ns(self) -> int:
        """When the next picture is taken."""
        return self._next_ns

    def act(self, t_ns: int) -> None:
        """Take a picture; it goes out at the end of the exposure."""
        image = CameraImage(self._scene.render(self._plant.truth()), t_ns - self._half_exposure_ns)
        self._to_host.put(t_ns + self._half_exposure_ns, image)
        self._next_ns += self._period_ns

    def hear(self, t_ns: int, payload: bytes) -> None:
        """Ignore it: the camera takes no commands."""


def make_overhead_camera(
    name: str,
    device: OverheadCameraSettings,
    emulator: OverheadCameraEmulatorSettings,
    plant: Plant,
    rng: np.random.Generator,
    start_ns: int,
) -> EmulatedDevice[CameraImage]:
    """Build the simulated camera called `name` and its bus; the first picture comes within a period.

    Raises:
        ConfigError: The transfer times contradict each other, or the marker is above the camera.
    """
    from sim_backends.overhead_scene.scene import OverheadScene

    shortest_s, longest_s = emulator.transfer_min_s, emulator.transfer_max_s
    if shortest_s > longest_s:
        msg = f"simulation.devices.{name}: transfer_min_s is greater than transfer_max_s; swap them"
        raise ConfigError(msg)
    if device.marker_height_m + emulator.marker_height_error_m >= emulator.height_m:
        msg = f"simulation.devices.{name}.height_m: the camera must hang above the marker; raise it"
        raise ConfigError(msg)
    scene_rng, time_rng = rng.spawn(2)
    scene = OverheadScene(device, emulator, scene_rng)
    # As many bits as seconds, one per second: each picture takes a time of its own.
    to_host: Line[CameraImage] = Line(lambda image: float(time_rng.uniform(shortest_s, longest_s)), 1.0)
    first_ns = start_ns + int(time_rng.integers(nanoseconds(1 / device.frame_rate_hz)))
    camera = OverheadCameraEmulator(device, emulator, scene, plant, to_host, first_ns)
    return EmulatedDevice(name, camera, to_host, Line(serial_bits, USB_BITS_PER_S))
