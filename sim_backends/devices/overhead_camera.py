"""A simulated camera above the test site that observes the marker on the rover.

Not modelled, in addition to what the scene omits: jitter of the frame rate, lost frames, automatic exposure,
JPEG artefacts.
"""

import numpy as np

from drivers.clock import nanoseconds
from drivers.errors import ConfigError
from drivers.link import CameraImage
from drivers.overhead_camera.settings import OverheadCameraSettings
from sim_backends.devices.camera import USB_BITS_PER_S, CameraEmulator, Exposure
from sim_backends.overhead_scene.settings import OverheadCameraEmulatorSettings
from sim_backends.world.line import Line, serial_bits
from sim_backends.world.plant import Plant
from sim_backends.world.world import EmulatedDevice


def make_emulator(
    name: str,
    device: OverheadCameraSettings,
    emulator: OverheadCameraEmulatorSettings,
    plant: Plant,
    rng: np.random.Generator,
    start_ns: int,
) -> EmulatedDevice[CameraImage]:
    """Build the simulated camera called `name` and its bus; the first frame comes within a period.

    Raises:
        ConfigError: transfer_min_s exceeds transfer_max_s, or the marker is above the camera.
    """
    from sim_backends.overhead_scene.scene import OverheadScene

    shortest_s, longest_s = emulator.transfer_min_s, emulator.transfer_max_s
    if shortest_s > longest_s:
        raise ConfigError(
            f"simulation.devices.{name}: transfer_min_s is greater than transfer_max_s; swap them"
        )
    if device.marker_height_m + emulator.marker_height_error_m >= emulator.height_m:
        raise ConfigError(
            f"simulation.devices.{name}.height_m: the camera must hang above the marker; raise it"
        )
    scene_rng, time_rng = rng.spawn(2)
    scene = OverheadScene(device, emulator, scene_rng)
    # One bit per second of transfer at 1 bit/s: each frame has its own transfer time.
    to_host: Line[CameraImage] = Line(lambda image: float(time_rng.uniform(shortest_s, longest_s)), 1.0)
    period_ns = nanoseconds(1 / device.frame_rate_hz)
    first_ns = start_ns + int(time_rng.integers(period_ns))
    half_ns = nanoseconds(emulator.exposure_s / 2)
    camera = CameraEmulator(scene, plant, to_host, period_ns, Exposure(half_ns, half_ns), first_ns)
    return EmulatedDevice(name, camera, to_host, Line(serial_bits, USB_BITS_PER_S))
