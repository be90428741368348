"""Images of a rear camera as the rover drives."""

import math
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.samples import Image
from sim_backends.arrays import Array
from sim_backends.rear_scene import kernels
from sim_backends.rear_scene.disturbances import CLEAR_SKY, STILL, Canopy, Vibration
from sim_backends.rear_scene.ground_kinds import SAND_TINT, TINTS
from sim_backends.rear_scene.ground_map import GroundMap, GroundSettings, Rut, Sun, WheelStep
from sim_backends.rear_scene.rig import Rig, Wheel

Boxes: TypeAlias = tuple[tuple[float, float, float, float, float, float], ...]

CURVE_SIZE = 2048
SHADE_SIZE = 384
SHADE_TEXEL_M = 0.006
SUN_WIDTH = 0.0093
MARGIN_M = 0.03
FARTHEST_M = 1.4
"""Limit of correct rendering; the map of the ground is about twice as wide."""
NOISE_SHIFT = 64
SUBPIXEL_BITS = 4
HARD = 0.05
"""Ground with less softness than this takes no mark."""
SKY_COLOUR = (1.10, 1.0, 0.92)
SUN_COLOUR = (0.94, 1.0, 1.05)
BODY: Boxes = (
    (-0.38, 0.38, -0.20, 0.20, 0.20, 0.40),
    (-0.34, -0.30, -0.02, 0.02, 0.40, 0.62),
    (-0.40, -0.20, 0.165, 0.275, 0.0, 0.184),
    (-0.40, -0.20, -0.275, -0.165, 0.0, 0.184),
)
"""Boxes that cast the rover's shadow, vehicle frame, m: body, mast, rear wheels."""
ROBOTINO: Boxes = (
    (-0.185, 0.185, -0.077, 0.077, 0.03, 0.21),
    (-0.131, 0.131, -0.131, 0.131, 0.03, 0.21),
    (-0.077, 0.077, -0.185, 0.185, 0.03, 0.21),
    (-0.20, -0.16, -0.02, 0.02, 0.21, 0.45),
)
"""The same of a Robotino: its round body as three boxes, and a mast for the camera."""


@dataclass(frozen=True, kw_only=True)
class Pose:
    """Pose and motion of the rover at one instant.

    Attributes:
        position_m: Origin of the vehicle frame in the world.
        vehicle_to_world: Rotation; the vehicle's x and y axes lie in the wheel-contact plane.
        rock_rad: Rotation of the body, with the camera, against that plane: about x, about y.
        yaw_rad: Heading.
        wheel_angle_rad: Angle that the wheels have turned.
        velocity_m_s: Velocity of the origin in the vehicle frame, x and y.
        yaw_rate_rad_s: Yaw rate of the vehicle.
        softness: Under each wheel of the rig: 0 on ground too hard to take a rut, 1 on ground that takes the
            full one.
        steering_rad: Steering angle of each wheel of the rig, counter-clockwise, beyond the rig's own.
        sinkage_m: Depth of the wheel-contact plane below the undisturbed ground; None for that of the watched
            wheel's rut.
        vibration: Fast rotation of the body, beyond `rock_rad`.
        canopy_m: How far the shadows of leaves or clouds have passed over the ground, x and y in the world.
    """

    position_m: Array
    vehicle_to_world: Array
    rock_rad: tuple[float, float] = (0.0, 0.0)
    yaw_rad: float = 0.0
    wheel_angle_rad: float = 0.0
    velocity_m_s: tuple[float, float] = (0.0, 0.0)
    yaw_rate_rad_s: float = 0.0
    softness: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    steering_rad: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    sinkage_m: float | None = None
    vibration: Vibration = STILL
    canopy_m: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Lens:
    """Image quality of the camera.

    Attributes:
        exposure_s: Exposure time of a line, that of the middle one centred on the frame's time.
        readout_s: Time from the first line to the last.
        blur_px: Standard deviation of the optical blur.
        noise_grey: Standard deviation of a pixel's noise, grey levels of 255.
        vignette: Loss of light in the corners, as a share.
        gamma: Exponent from light to grey.
        contrast: Share of the difference from medium grey that is left.
        dirt: Share of the light that the lens lets pass, BGR, 255 for all of it; None for a clean one.
    """

    exposure_s: float = 0.010
    readout_s: float = 0.0
    blur_px: float = 0.6
    noise_grey: float = 3.0
    vignette: float = 0.15
    gamma: float = 0.6
    contrast: float = 1.0
    dirt: Image | None = None


class RearScene:
    """The ground behind the rover, deformed by its wheels, as imaged by its rear camera.

    Args:
        rig: Camera and wheels.
        ground: Composition of the ground.
        sun: The light; fixed to the world.
        rut: Shape of the ruts.
        lens: Image quality of the camera.
        rng: Source of ground and noise.
        earlier_steps: Steps of earlier traces.
        body: Boxes that cast the rover's shadow.
        canopy: Shadows of leaves or clouds.

    Attributes:
        ground: The ground with the ruts pressed so far.
    """

    def __init__(
        self,
        rig: Rig,
        ground: GroundSettings,
        sun: Sun,
        rut: Rut,
        lens: Lens,
        rng: np.random.Generator,
        earlier_steps: tuple[WheelStep, ...] = (),
        body: Boxes = BODY,
        canopy: Canopy = CLEAR_SKY,
    ) -> None:
        self._rig = rig
        self._sun_to = sun.direction()
        self._rut = rut
        self._lens = lens
        self._rng = rng
        self._corners = [_corners(box) for box in body]
        self._canopy = canopy
        self.ground = GroundMap(ground, sun, earlier_steps, rut, rng)
        self._rays = _lit_rays(rig, lens)
        self._edge = _edge_rays(self._rays)
        light = np.linspace(0, 1, CURVE_SIZE)
        grey = 0.5 + lens.contrast * (light**lens.gamma - 0.5)
        self._curve = np.round(255 * grey).astype(np.uint8)
        self._tint = np.array([SKY_COLOUR, SUN_COLOUR]) * TINTS.get(ground.kind, SAND_TINT)
        noise = rng.normal(0, lens.noise_grey, (rig.height + NOISE_SHIFT, rig.width + NOISE_SHIFT, 3))
        self._noise = np.round(noise).astype(np.int16)
        self._image = np.empty((rig.height, rig.width, 3), np.uint8)
        self._before: Pose | None = None

    def drive(self, pose: Pose) -> None:
        """Press the ruts between the last pose and this one; a few mm to cm apart."""
        before, self._before = self._before, pose
        if before is None:
            return
        for wheel, softness, steering_rad in zip(
            self._rig.wheels, pose.softness, pose.steering_rad, strict=True
        ):
            start, end = _contact(wheel, before), _contact(wheel, pose)
            pitch_rad = 2 * math.pi / wheel.lug_count
            lugs = before.wheel_angle_rad / pitch_rad, pose.wheel_angle_rad / pitch_rad
            heading = pose.yaw_rad + math.radians(wheel.steer_deg) + steering_rad
            if math.dist(start, end) > 0 and softness > HARD:
                roll = WheelStep(
                    start_m=start,
                    end_m=end,
                    heading_rad=heading,
                    lugs=lugs,
                    width_m=wheel.width_m,
                    softness=softness,
                )
                self.ground.press(roll, self._rut)

    def render(self, pose: Pose, gain: float = 1.0) -> Image:
        """Return the image, BGR, from this pose; `gain` is the exposure relative to the nominal one."""
        cameras, turns = self._line_poses(pose)
        middle = self._rig.height // 2
        plane = self._plane(pose)
        self._prepare(cameras[middle], turns[middle].reshape(3, 3), plane)
        rock = body_rock(pose)
        shade, shade_frame = self._shade(pose, rock)
        per_m = 1 / self._canopy.texel_m
        view = kernels.View(
            rays=self._rays,
            cameras=cameras,
            turns=turns,
            plane=tuple(plane.tolist()),
            shade=shade,
            shade_frame=tuple(shade_frame.tolist()),
            canopy=self._canopy.tile,
            canopy_frame=(per_m, -per_m * pose.canopy_m[0], -per_m * pose.canopy_m[1]),
            tint=tuple((gain * self._tint).ravel().tolist()),
            curve=self._curve,
        )
        kernels.render(self._image, self.ground.maps, view)
        self._draw_wheel(rock, gain)
        blurred = cv2.filter2D(self._image, -1, self._blur(pose), borderType=cv2.BORDER_REPLICATE)
        if self._lens.dirt is not None:
            blurred = cv2.multiply(blurred, self._lens.dirt, scale=1 / 255)
        row, column = self._rng.integers(0, NOISE_SHIFT, 2)
        noise = self._noise[row : row + self._rig.height, column : column + self._rig.width]
        return np.asarray(cv2.add(blurred, noise, dtype=cv2.CV_8U), np.uint8)

    def _line_poses(self, pose: Pose) -> tuple[Array, Array]:
        """Return position and rotation of the camera, (h, 3) and (h, 9), as it exposes each line."""
        lines = self._rig.height
        later_s = self._lens.readout_s * (np.arange(lines) / (lines - 1) - 0.5)
        rock_rad = np.array(pose.rock_rad) + pose.vibration.rock_rad(later_s)
        zero = np.zeros(lines)
        spin = rotations(pose.yaw_rate_rad_s * later_s, zero, zero)
        turns = spin @ pose.vehicle_to_world @ rotations(zero, rock_rad[:, 1], rock_rad[:, 0])
        moved = later_s[:, None] * (pose.vehicle_to_world @ np.array([*pose.velocity_m_s, 0.0]))
        cameras = pose.position_m + moved + turns @ self._rig.camera_m
        return cameras, (turns @ self._rig.vehicle_from_camera).reshape(lines, 9)

    def _sinkage_m(self, pose: Pose) -> float:
        return self._rut.depth_m * pose.softness[-1] if pose.sinkage_m is None else pose.sinkage_m

    def _plane(self, pose: Pose) -> Array:
        """Return a, b, c of the undisturbed ground z = a x + b y + c around the rover."""
        normal = pose.vehicle_to_world[:, 2]
        a, b = -normal[0] / normal[2], -normal[1] / normal[2]
        x, y, z = pose.position_m
        return np.array([a, b, z - a * x - b * y + self._sinkage_m(pose)])

    def _prepare(self, camera: Array, turn: Array, plane: Array) -> None:
        directions = self._edge @ turn.T
        fall = np.maximum(plane[0] * directions[:, 0] + plane[1] * directions[:, 1] - directions[:, 2], 0.3)
        distance = (camera[2] - plane[0] * camera[0] - plane[1] * camera[1] - plane[2]) / fall
        points = camera + distance[:, None] * directions
        first = np.maximum(points.min(axis=0) - MARGIN_M, camera - FARTHEST_M)
        last = np.minimum(points.max(axis=0) + MARGIN_M, camera + FARTHEST_M)
        self.ground.prepare((first[0], last[0]), (first[1], last[1]))

    def _shade(self, pose: Pose, rock: Array) -> tuple[NDArray[np.float32], Array]:
        """Return the rover's shadow on the ground, and the transformation from the world to it."""
        sun = pose.vehicle_to_world.T @ self._sun_to
        level = np.array([self._rig.wheel.x_m - 0.45, self._rig.wheel.y_m])
        shade = np.zeros((SHADE_SIZE, SHADE_SIZE), np.uint8)
        middle = 0.5 * SHADE_SIZE
        for corners in self._corners:
            points = corners @ rock.T
            above = points[:, 2:] - self._sinkage_m(pose)
            ground = points[:, :2] - above * sun[:2] / max(sun[2], 0.1)
            texels = (ground - level) / SHADE_TEXEL_M + middle
            hull = cv2.convexHull(np.round(texels[:, ::-1] * 2**SUBPIXEL_BITS).astype(np.int32))
            cv2.fillConvexPoly(shade, hull, 255, cv2.LINE_AA, SUBPIXEL_BITS)
        soft = cv2.GaussianBlur(shade, (0, 0), 0.4 * SUN_WIDTH / SHADE_TEXEL_M + 0.5)
        world_to_vehicle = pose.vehicle_to_world.T[:2, :2] / SHADE_TEXEL_M
        offset = middle - level / SHADE_TEXEL_M - world_to_vehicle @ pose.position_m[:2]
        to_sun = self._sun_to[:2] / max(self._sun_to[2], 0.1)
        frame = np.array([*world_to_vehicle[0], offset[0], *world_to_vehicle[1], offset[1], *to_sun])
        return np.asarray(soft / 255, np.float32), frame

    def _draw_wheel(self, rock: Array, gain: float) -> None:
        """Draw the watched wheel where it occludes the ground."""
        outline = self._rig.wheel_outline(rock)
        if outline is None:
            return
        hull = np.round(outline * 2**SUBPIXEL_BITS).astype(np.int32)
        grey = int(self._curve[min(CURVE_SIZE - 1, round(0.06 * gain * CURVE_SIZE))])
        cv2.fillConvexPoly(self._image, hull, (grey, grey, grey), cv2.LINE_AA, SUBPIXEL_BITS)

    def _blur(self, pose: Pose) -> Array:
        """Return the kernel of optical blur and of the motion at the middle of the image."""
        rig, exposure = self._rig, self._lens.exposure_s
        axis = rig.vehicle_from_camera[:, 2]
        middle = rig.camera_m - axis * rig.camera_m[2] / axis[2]
        vx, vy = pose.velocity_m_s
        spin = pose.yaw_rate_rad_s
        moved = 0.5 * exposure * np.array([-vx + spin * middle[1], -vy - spin * middle[0], 0.0])
        first, now, last = pose.vibration.rock_rad(exposure * np.array([-0.5, 0.0, 0.5]))
        seen = (middle - moved) @ rocking(*(first - now)), (middle + moved) @ rocking(*(last - now))
        ends = rig.project(np.stack(seen))
        return blur_kernel(ends[1] - ends[0], self._lens.blur_px)


def blur_kernel(motion_px: Array, sigma_px: float) -> Array:
    """Return a kernel of a Gaussian of `sigma_px` drawn along a motion (columns, rows) in pixels."""
    half = math.ceil(0.5 * float(np.abs(motion_px).max()) + 2.5 * sigma_px)
    rows, columns = np.mgrid[-half : half + 1, -half : half + 1]
    shares = np.linspace(-0.5, 0.5, 9)
    square = (columns[..., None] - shares * motion_px[0]) ** 2 + (
        rows[..., None] - shares * motion_px[1]
    ) ** 2
    weights = np.exp(-0.5 * square / sigma_px**2).sum(axis=-1)
    return np.asarray(weights / weights.sum())


def _contact(wheel: Wheel, pose: Pose) -> tuple[float, float]:
    x, y, _ = pose.position_m + pose.vehicle_to_world @ np.array([wheel.x_m, wheel.y_m, 0.0])
    return float(x), float(y)


def body_rock(pose: Pose) -> Array:
    """Return the rotation of the body against the contact plane at the pose's instant, with its vibration."""
    roll, pitch = np.array(pose.rock_rad) + pose.vibration.rock_rad(np.zeros(1))[0]
    return rocking(roll, pitch)


def rocking(roll: float, pitch: float) -> Array:
    """Return the rotation of the body against the contact plane: roll about x, then pitch about y."""
    about_x = np.array([[1, 0, 0], [0, math.cos(roll), -math.sin(roll)], [0, math.sin(roll), math.cos(roll)]])
    about_y = np.array(
        [[math.cos(pitch), 0, math.sin(pitch)], [0, 1, 0], [-math.sin(pitch), 0, math.cos(pitch)]]
    )
    return np.asarray(about_y @ about_x)


def rotations(yaw: Array, pitch: Array, roll: Array) -> Array:
    """Return vehicle to world, Rz(yaw) Ry(pitch) Rx(roll); pitch is positive nose down, roll left side up."""
    cy, sy, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    cr, sr = np.cos(roll), np.sin(roll)
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _corners(box: tuple[float, float, float, float, float, float]) -> Array:
    x0, x1, y0, y1, z0, z1 = box
    return np.array([(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (z0, z1)])


def _lit_rays(rig: Rig, lens: Lens) -> NDArray[np.float32]:
    rays = rig.rays()
    square = (rays**2).sum(axis=2)
    light = 1 - lens.vignette * square / square.max()
    return np.asarray(np.concatenate([rays, light[..., None]], axis=2), np.float32)


def _edge_rays(rays: NDArray[np.float32]) -> Array:
    edge = np.concatenate([rays[0, ::16], rays[-1, ::16], rays[::16, 0], rays[::16, -1]]).astype(np.float64)
    edge[:, 2] = 1
    return edge
