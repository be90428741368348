"""The rear scene of a simulated rover, rendered as the plant drives."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from drivers.clock import seconds
from drivers.errors import ConfigError
from drivers.samples import Image
from sim_backends.rear_scene.disturbances import Vibration, make_canopy, make_dirt
from sim_backends.rear_scene.ground_map import GroundSettings, Rut, Sun
from sim_backends.rear_scene.rig import Rig, Wheel, looking_back
from sim_backends.rear_scene.scene import BODY, ROBOTINO, Boxes, Lens, Pose, RearScene, rotations
from sim_backends.rear_scene.settings import CameraEmulatorSettings, ShadowOf
from sim_backends.world.coloured_noise import ColouredNoise
from sim_backends.world.plant import Truth

FARTHEST_M = 1.3
"""Greatest distance of visible ground from the watched wheel; the scene stores the ground about this far."""
PRESSED_STEP_M = 0.01
ROCKING_TIME_S = 0.5
GAIN_TIME_S = 0.5
RIG_WHEELS = 4
SINKING_RAD = 2.0
"""Turn of the wheels in which the sinkage approaches that of the present slip by 1 - 1/e; chosen."""
SHADOWS: Mapping[ShadowOf, Boxes] = {"four_wheels": BODY, "robotino": ROBOTINO, "nothing": ()}


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
        vehicle_from_camera=looking_back(emulator.tilt_deg, emulator.pan_deg, emulator.bank_deg),
        camera_m=np.array([x_m - emulator.behind_m, y_m, emulator.height_m]),
        wheel=wheel("rear_left", x_m, y_m),
        other_wheels=(
            wheel("front_left", -x_m, y_m),
            wheel("front_right", -x_m, -y_m),
            wheel("rear_right", x_m, -y_m),
        ),
        leaves_traces=emulator.leaves_traces,
    )
    _check_reach(rig)
    return rig


class EmulatedScene:
    """The ground behind a simulated rover, rendered from the true state of its plant.

    The plant's ground is the plane of the scene: x and y are positions on it, and neither its slope nor its
    mounds change the image. The body rocks slightly against it, and sinks into it with slip.

    Args:
        emulator: Pose, optics and scene of the camera.
        width: Width of the image in pixels.
        height: Height of the image in pixels.
        fps: Frames per second.
        rng: Source of the ground and of the pixel noise.
        start_ns: Start of the simulation.

    Attributes:
        shown: Pose of the rover in the last image, in the middle of its exposure; None before the first.

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
        # Streams of their own: a scene without disturbances does not depend on them.
        dirt_rng, canopy_rng, gain_rng, self._rng = rng.spawn(4)
        self._emulator = emulator
        self._start_ns = start_ns
        self._rock_rad = math.radians(emulator.rock_deg)
        self._rocking = ColouredNoise(2, ROCKING_TIME_S, rng, start_ns)
        self._gain = ColouredNoise(1, GAIN_TIME_S, gain_rng, start_ns)
        self._phase_rad = self._rng.uniform(0, 2 * math.pi, 2)
        self._scene = RearScene(
            make_rig(emulator, width, height, fps),
            GroundSettings(kind=emulator.ground, stones_per_m2=emulator.stones_per_m2),
            Sun(azimuth_deg=emulator.sun_azimuth_deg, elevation_deg=emulator.sun_elevation_deg),
            Rut(depth_m=emulator.rut_depth_m),
            Lens(
                exposure_s=emulator.exposure_s,
                readout_s=emulator.readout_s,
                blur_px=emulator.blur_px,
                noise_grey=emulator.noise_grey,
                contrast=emulator.contrast,
                dirt=make_dirt(emulator.dirt, width, height, dirt_rng),
            ),
            rng,
            body=SHADOWS[emulator.shadow_of],
            canopy=make_canopy(emulator.canopy, canopy_rng),
        )
        self._more_sinkage_m = 0.0
        self._wheel_angles_rad: tuple[float, ...] = ()
        self._image: Image | None = None
        self._before: Pose | None = None
        self.shown: Pose | None = None

    def render(self, truth: Truth) -> Image:
        """Return the image, BGR, at the rover's true pose; the traces grow from call to call."""
        pose = self._pose(truth)
        before = self._before or pose
        self._before = pose
        distance_m = math.dist(before.position_m, pose.position_m) + abs(pose.yaw_rad - before.yaw_rad)
        steps = max(1, math.ceil(distance_m / PRESSED_STEP_M)) if self._emulator.leaves_traces else 0
        for step in range(1, steps + 1):
            self._scene.drive(_interpolate(before, pose, step / steps))
        if self._image is not None and self._rng.random() < self._emulator.repeat_share:
            return self._image
        swing = self._emulator.gain_swing * self._gain.at(truth.t_ns)[0]
        self._image = self._scene.render(pose, self._emulator.gain * math.exp(swing))
        self.shown = pose
        return self._image

    def _pose(self, truth: Truth) -> Pose:
        rock = self._rocking.at(truth.t_ns)
        emulator, since_s = self._emulator, seconds(truth.t_ns - self._start_ns)
        wheel_angles_rad = truth.wheel_position_rad
        wheel_angle_rad = sum(wheel_angles_rad) / len(wheel_angles_rad) if wheel_angles_rad else 0.0
        sinkage_m = emulator.rut_depth_m + self._sink(truth)
        passed_m, towards = emulator.canopy.speed_m_s * since_s, math.radians(emulator.canopy.direction_deg)
        shake_rad = math.radians(emulator.vibration_deg)
        phase_rad = 2 * math.pi * emulator.vibration_hz * since_s + self._phase_rad
        return _with_rotation(
            Pose(
                position_m=np.array([truth.x_m, truth.y_m, -sinkage_m]),
                vehicle_to_world=np.eye(3),
                rock_rad=(self._rock_rad * rock[0], self._rock_rad * rock[1]),
                yaw_rad=truth.yaw_rad,
                wheel_angle_rad=wheel_angle_rad,
                velocity_m_s=(truth.velocity_x_m_s, truth.velocity_y_m_s),
                yaw_rate_rad_s=truth.yaw_rate_rad_s,
                softness=(sinkage_m / emulator.rut_depth_m,) * RIG_WHEELS,
                steering_rad=_steering_of_the_rig(truth),
                sinkage_m=sinkage_m,
                vibration=Vibration(
                    amplitude_rad=(shake_rad, shake_rad),
                    frequency_hz=emulator.vibration_hz,
                    phase_rad=(float(phase_rad[0]), float(phase_rad[1])),
                ),
                canopy_m=(passed_m * math.cos(towards), passed_m * math.sin(towards)),
            )
        )

    def _sink(self, truth: Truth) -> float:
        """Return the sinkage by slip, which grows and falls while the wheels turn."""
        angles_rad = truth.wheel_position_rad
        if not self._emulator.sinkage_per_slip_m or not truth.slip:
            return 0.0
        before_rad, self._wheel_angles_rad = self._wheel_angles_rad or angles_rad, angles_rad
        turned_rad = sum(abs(b - a) for a, b in zip(before_rad, angles_rad, strict=True)) / len(angles_rad)
        slip = sum(min(abs(each), 1.0) for each in truth.slip) / len(truth.slip)
        wanted_m = self._emulator.sinkage_per_slip_m * slip
        self._more_sinkage_m += (1 - math.exp(-turned_rad / SINKING_RAD)) * (wanted_m - self._more_sinkage_m)
        return self._more_sinkage_m


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
            "raise its tilt_deg, lower its height_m or its horizontal_view_deg"
        )
