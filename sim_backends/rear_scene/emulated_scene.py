"""The rear scene of a simulated rover, rendered as the plant drives."""

import math
from dataclasses import replace

import numpy as np

from drivers.errors import ConfigError
from drivers.samples import Image
from sim_backends.rear_scene.ground_map import GroundSettings, Rut, Sun
from sim_backends.rear_scene.rig import Rig, Wheel, looking_back
from sim_backends.rear_scene.scene import Lens, Pose, RearScene, rotations
from sim_backends.rear_scene.settings import CameraEmulatorSettings
from sim_backends.world.coloured_noise import ColouredNoise
from sim_backends.world.plant import Truth

FARTHEST_M = 1.3
"""Greatest distance of visible ground from the watched wheel; the scene stores the ground about this far."""
PRESSED_STEP_M = 0.01
ROCKING_TIME_S = 0.5
RIG_WHEELS = 4


def make_rig(emulator: CameraEmulatorSettings, width: int, height: int, fps: float) -> Rig:
    """Return the calibrated rig of a simulated camera.

    Raises:
        ConfigError: The horizon or ground too far away is in view.
    """
    focal_px = width / 2 / math.tan(math.radians(emulator.horizontal_view_deg) / 2)
    x_m, y_m = emulator.wheel_x_m, emulator.wheel_y_m

    def wheel(name: str, x_m: float, y_m: float) -> Wheel:
        return Wheel(name=name, x_m=x_m, y_m=y_m, width_m=emulator.trace_width_m)

    rig = Rig(
        width=width,
        height=height,
        fps=fps,
        camera_matrix=np.array([[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1]]),
        distortion=np.array(emulator.distortion),
        vehicle_from_camera=looking_back(emulator.tilt_deg),
        camera_m=np.array([x_m - emulator.behind_m, y_m, emulator.height_m]),
        wheel=wheel("rear_left", x_m, y_m),
        other_wheels=(
            wheel("front_left", -x_m, y_m),
            wheel("front_right", -x_m, -y_m),
            wheel("rear_right", x_m, -y_m),
        ),
    )
    _check_reach(rig)
    return rig


class EmulatedScene:
    """The ground behind a simulated rover, rendered from the true state of its plant.

    The plant's ground is the plane of the scene: x and y are positions on it, and neither its slope nor its
    mounds change the image. The body rocks slightly against it.

    Args:
        emulator: Pose, optics and scene of the camera.
        width: Width of the image in pixels.
        height: Height of the image in pixels.
        fps: Frames per second.
        rng: Source of the ground and of the pixel noise.
        start_ns: Start of the simulation.

    Raises:
        ConfigError: The horizon or ground too far away is in view.
    """

    def __init__(
        self,
        emulator: CameraEmulatorSettings,
        width: int,
        height: int,
        fps: float,
        rng: np.random.Generator,
        start_ns: int,
    ) -> None:
        self._rig = make_rig(emulator, width, height, fps)
        self._rut = Rut(depth_m=emulator.rut_depth_m)
        self._rock_rad = math.radians(emulator.rock_deg)
        self._rocking = ColouredNoise(2, ROCKING_TIME_S, rng, start_ns)
        self._scene = RearScene(
            self._rig,
            GroundSettings(kind=emulator.ground, stones_per_m2=emulator.stones_per_m2),
            Sun(azimuth_deg=emulator.sun_azimuth_deg, elevation_deg=emulator.sun_elevation_deg),
            self._rut,
            Lens(exposure_s=emulator.exposure_s, noise_grey=emulator.noise_grey),
            rng,
        )
        self._before: Pose | None = None

    def render(self, truth: Truth) -> Image:
        """Return the image, BGR, at the rover's true pose; the traces grow from call to call."""
        pose = self._pose(truth)
        before = self._before or pose
        self._before = pose
        distance_m = math.dist(before.position_m, pose.position_m) + abs(pose.yaw_rad - before.yaw_rad)
        steps = max(1, math.ceil(distance_m / PRESSED_STEP_M))
        for step in range(1, steps + 1):
            self._scene.drive(_interpolate(before, pose, step / steps))
        return self._scene.render(pose)

    def _pose(self, truth: Truth) -> Pose:
        rock = self._rocking.at(truth.t_ns)
        wheel_angles_rad = truth.wheel_position_rad
        return _with_rotation(
            Pose(
                position_m=np.array([truth.x_m, truth.y_m, -self._rut.depth_m]),
                vehicle_to_world=np.eye(3),
                rock_rad=(self._rock_rad * rock[0], self._rock_rad * rock[1]),
                yaw_rad=truth.yaw_rad,
                wheel_angle_rad=sum(wheel_angles_rad) / len(wheel_angles_rad) if wheel_angles_rad else 0.0,
                velocity_m_s=(truth.velocity_x_m_s, truth.velocity_y_m_s),
                yaw_rate_rad_s=truth.yaw_rate_rad_s,
                steering_rad=_steering_of_the_rig(truth),
            )
        )


def _steering_of_the_rig(truth: Truth) -> tuple[float, ...]:
    """Return the steering angles in the order of the rig: the watched wheel, rear left, is the last."""
    angles_rad = truth.steering_rad or ()
    if len(angles_rad) != RIG_WHEELS:
        return (0.0,) * RIG_WHEELS
    front_left, front_right, rear_left, rear_right = angles_rad
    return front_left, front_right, rear_right, rear_left


def _with_rotation(pose: Pose) -> Pose:
    """Return the pose with the rotation of its heading."""
    level = np.zeros(1)
    return replace(pose, vehicle_to_world=rotations(np.array([pose.yaw_rad]), level, level)[0])


def _interpolate(before: Pose, after: Pose, share: float) -> Pose:
    def mix(old: float, new: float) -> float:
        return old + share * (new - old)

    return _with_rotation(
        replace(
            after,
            position_m=before.position_m + share * (after.position_m - before.position_m),
            yaw_rad=mix(before.yaw_rad, after.yaw_rad),
            wheel_angle_rad=mix(before.wheel_angle_rad, after.wheel_angle_rad),
        )
    )


def _check_reach(rig: Rig) -> None:
    corners = rig.rays()[[0, 0, -1, -1], [0, -1, 0, -1]]
    rays = np.insert(corners, 2, 1.0, axis=1) @ rig.vehicle_from_camera.T
    pixels = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * [rig.width - 1, rig.height - 1]
    if not np.allclose(rig.project(rig.camera_m + rays), pixels, atol=0.5):
        raise ConfigError(
            "simulated camera's distortion folds the corners of its image: choose smaller coefficients"
        )
    with np.errstate(divide="ignore", invalid="ignore"):
        ground = rig.camera_m[:2] - rays[:, :2] * (rig.camera_m[2] / rays[:, 2:])
    from_wheel = np.hypot(ground[:, 0] - rig.wheel.x_m, ground[:, 1] - rig.wheel.y_m)
    if (rays[:, 2] >= 0).any() or from_wheel.max() > FARTHEST_M:
        raise ConfigError(
            f"simulated camera views ground more than {FARTHEST_M:g} m from its wheel, or the horizon: "
            f"raise its tilt_deg, lower its height_m or its horizontal_view_deg"
        )
