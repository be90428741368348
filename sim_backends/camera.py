"""A simulated camera that looks back at the ground behind a wheel, where the wheel leaves its trace.

What it leaves out, besides what the scene leaves out: frames come at an exact rate and none is lost; there is
no motion blur, rolling shutter, automatic exposure, lens distortion or JPEG artefact.
"""

from typing import Annotated, Literal, Protocol

import numpy as np
from pydantic import Field

from drivers.camera.settings import CameraSettings
from drivers.clock import nanoseconds
from drivers.link import CameraImage
from drivers.samples import Image
from drivers.settings import Settings
from sim_backends.line import Line, serial_bits
from sim_backends.plant import Plant, Truth
from sim_backends.world import EmulatedDevice

USB_BITS_PER_S = 480e6


class CameraEmulatorSettings(Settings):
    """Where the simulated camera looks, and how well.

    The camera is above the point where a wheel touches the ground, by default the rear left one of the
    simulated four-wheeled rover, looks backwards and is tilted down. It sees about 0.6 m x 0.7 m of ground by
    default; the rear camera of the rover El-Dorado saw 0.6 m x 0.8 m.

    Attributes:
        wheel_x_m: Where the wheel touches the ground, forward of the rover's origin.
        wheel_y_m: The same, to the left.
        height_m: Height of the camera above the ground.
        tilt_deg: Angle of the optical axis below the horizontal.
        horizontal_view_deg: Angle of view over the width of the image.
        trace_width_m: Width of the wheel.
        noise_grey: Standard deviation of the noise of a pixel, in grey levels of 255.
        exposure_s: Time from the capture stamp to the end of exposure.
        transfer_s: Time from there to the arrival at the host.
    """

    type: Literal["camera"]
    wheel_x_m: Annotated[float, Field(ge=-5, le=5)] = -0.3
    wheel_y_m: Annotated[float, Field(ge=-5, le=5)] = 0.22
    height_m: Annotated[float, Field(ge=0.1, le=3)] = 0.5
    tilt_deg: Annotated[float, Field(gt=0, le=90)] = 60.0
    horizontal_view_deg: Annotated[float, Field(ge=10, le=120)] = 60.0
    trace_width_m: Annotated[float, Field(gt=0, le=1)] = 0.1
    noise_grey: Annotated[float, Field(ge=0, le=50)] = 3.0
    exposure_s: Annotated[float, Field(ge=0, le=0.1)] = 0.008
    transfer_s: Annotated[float, Field(gt=0, le=0.1)] = 0.006


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
        ConfigError: The horizon is in view.
    """
    from sim_backends.ground_scene import GroundScene

    scene = GroundScene(emulator, device.width, device.height, rng)
    to_host: Line[CameraImage] = Line(lambda image: 1.0, 1 / emulator.transfer_s)  # one frame is one bit
    first_frame_ns = start_ns + int(rng.integers(nanoseconds(1 / device.frame_rate_hz)))
    camera = CameraEmulator(device, emulator, scene, plant, to_host, first_frame_ns)
    return EmulatedDevice(name, camera, to_host, Line(serial_bits, USB_BITS_PER_S))
