"""A simulated camera that looks back at the ground behind a wheel, where the wheel leaves its trace.

What it leaves out, besides what the scene leaves out (docs/rear_scene.md): frames come at an exact rate and
none is lost; there is no rolling shutter, automatic exposure or JPEG artefact.
"""

from typing import Annotated, Literal, Protocol, TypeAlias

import numpy as np
from pydantic import Field

from drivers.camera.settings import CameraSettings
from drivers.clock import nanoseconds
from drivers.link import CameraImage
from drivers.samples import Image
from drivers.settings import Settings
from sim_backends.world.line import Line, serial_bits
from sim_backends.world.plant import Plant, Truth
from sim_backends.world.world import EmulatedDevice

USB_BITS_PER_S = 480e6

Lens: TypeAlias = Annotated[float, Field(ge=-1, le=1)]
GroundKind: TypeAlias = Literal[
    "fine_sand", "coarse_sand", "rippled_sand", "patchy_sand", "gravel", "grass", "brick", "sandy_gravel"
]


class CameraEmulatorSettings(Settings):
    """Where the simulated camera looks, and how well.

    The camera is above and a little behind the point where a wheel touches the ground, by default the rear
    left one of the simulated four-wheeled rover, looks backwards and is tilted down. It sees about
    0.7 m x 0.7 m of ground by default; the rear camera of the rover El-Dorado saw 0.6 m x 0.8 m. The other
    three wheels mirror this one about the rover's axes.

    Attributes:
        wheel_x_m: Contact point of the wheel, forward of the rover's origin.
        wheel_y_m: Contact point of the wheel, to the left of the rover's origin.
        behind_m: Distance of the camera behind that point.
        height_m: Height of the camera above the floor of the trace.
        tilt_deg: Angle of the optical axis below the horizontal.
        horizontal_view_deg: Angle of view over the width of the image.
        distortion: k1, k2, p1, p2, k3 of the lens, as OpenCV defines them.
        trace_width_m: Width of the wheels.
        rut_depth_m: Sinkage of the wheels.
        ground: Appearance of the ground.
        stones_per_m2: Number of loose stones per square metre.
        sun_azimuth_deg: Direction to the sun in the world, counter-clockwise from x.
        sun_elevation_deg: Elevation of the sun above the ground.
        rock_deg: Standard deviation of the body's rocking, about x and about y.
        noise_grey: Standard deviation of the noise of a pixel, in grey levels of 255.
        exposure_s: Time from the capture stamp to the end of the exposure.
        transfer_s: Time from the end of the exposure to the arrival at the host.
    """

    type: Literal["camera"]
    wheel_x_m: Annotated[float, Field(ge=-5, le=5)] = -0.3
    wheel_y_m: Annotated[float, Field(ge=-5, le=5)] = 0.22
    behind_m: Annotated[float, Field(ge=-0.5, le=1)] = 0.02
    height_m: Annotated[float, Field(ge=0.1, le=3)] = 0.5
    tilt_deg: Annotated[float, Field(gt=0, le=90)] = 60.0
    horizontal_view_deg: Annotated[float, Field(ge=10, le=120)] = 60.0
    distortion: tuple[Lens, Lens, Lens, Lens, Lens] = (-0.12, 0.01, 0.0, 0.0, 0.0)
    trace_width_m: Annotated[float, Field(gt=0, le=0.3)] = 0.11
    rut_depth_m: Annotated[float, Field(ge=0.001, le=0.03)] = 0.014
    ground: GroundKind = "fine_sand"
    stones_per_m2: Annotated[float, Field(ge=0, le=100)] = 3.0
    sun_azimuth_deg: Annotated[float, Field(ge=-360, le=360)] = 75.0
    sun_elevation_deg: Annotated[float, Field(ge=15, le=90)] = 50.0
    rock_deg: Annotated[float, Field(ge=0, le=5)] = 0.2
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
        ConfigError: The horizon is in view, or ground too far away.
    """
    from sim_backends.rear_scene.emulated_scene import EmulatedScene  # numba takes a second to load

    scene = EmulatedScene(emulator, device.width, device.height, device.frame_rate_hz, rng, start_ns)
    to_host: Line[CameraImage] = Line(lambda image: 1.0, 1 / emulator.transfer_s)  # one frame is one bit
    first_frame_ns = start_ns + int(rng.integers(nanoseconds(1 / device.frame_rate_hz)))
    camera = CameraEmulator(device, emulator, scene, plant, to_host, first_frame_ns)
    return EmulatedDevice(name, camera, to_host, Line(serial_bits, USB_BITS_PER_S))
