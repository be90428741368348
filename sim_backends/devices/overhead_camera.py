"""A simulated camera above the test site that sees the marker on the rover.

What it leaves out, besides what the scene leaves out: pictures come at an exact rate and none is lost; there
is no automatic exposure and no JPEG artefact.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from drivers.clock import nanoseconds
from drivers.errors import ConfigError
from drivers.link import CameraImage
from drivers.overhead_camera.settings import OverheadCameraSettings
from drivers.settings import Settings
from sim_backends.devices.camera import USB_BITS_PER_S, Scene
from sim_backends.world.line import Line, serial_bits
from sim_backends.world.plant import Plant
from sim_backends.world.world import EmulatedDevice


class OverheadCameraEmulatorSettings(Settings):
    """Pose and image quality of the simulated camera.

    Attributes:
        camera_x_m: Position of the lens in the world.
        camera_y_m: Position of the lens in the world.
        height_m: Height of the lens above the floor.
        turn_deg: Direction of the image's x axis in the world, counter-clockwise from x.
        tilt_x_deg: Tilt of the optical axis from straight down towards the image's right.
        tilt_y_deg: Tilt of the optical axis from straight down towards the image's upper edge.
        horizontal_view_deg: Angle of view over the width of the image.
        exposure_s: Duration of the exposure; the image is stamped at its beginning.
        transfer_min_s: Shortest time from the end of the exposure to the arrival at the host.
        transfer_max_s: Longest time from the end of the exposure to the arrival at the host.
        blur_px: Standard deviation of the optical blur.
        noise_grey: Standard deviation of the noise of a pixel, in grey levels of 255.
        marker_height_error_m: True height of the marker minus the configured one.
        marker_yaw_error_deg: True yaw of the marker minus the configured one.
    """

    type: Literal["overhead_camera"]
    camera_x_m: float = 0.45
    camera_y_m: float = 0.2
    height_m: Annotated[float, Field(ge=0.5, le=10)] = 2.5
    turn_deg: float = 0.0
    tilt_x_deg: Annotated[float, Field(ge=-30, le=30)] = 1.5
    tilt_y_deg: Annotated[float, Field(ge=-30, le=30)] = -1.0
    horizontal_view_deg: Annotated[float, Field(ge=10, le=100)] = 36.0
    exposure_s: Annotated[float, Field(ge=0, le=0.1)] = 0.010
    transfer_min_s: Annotated[float, Field(gt=0, le=1)] = 0.015
    transfer_max_s: Annotated[float, Field(gt=0, le=1)] = 0.050
    blur_px: Annotated[float, Field(ge=0, le=10)] = 0.6
    noise_grey: Annotated[float, Field(ge=0, le=50)] = 3.0
    marker_height_error_m: Annotated[float, Field(ge=-0.1, le=0.1)] = 0.003
    marker_yaw_error_deg: Annotated[float, Field(ge=-10, le=10)] = 0.1


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
    from sim_backends.devices.overhead_scene import OverheadScene

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
