"""Everything that is drawn for one drive; a case changes what it is about, then the drive is rendered."""

import zlib
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from tests.nature.ambiguous_ground import textures
from tests.nature.ambiguous_ground.camera import HEIGHT, WHEEL_CONTACT, WIDTH, Camera
from tests.nature.ambiguous_ground.ground import Cloth, GroundView
from tests.nature.ambiguous_ground.motion import Motion, integrate
from tests.nature.ambiguous_ground.optics import Exposure, Vignette, digitise
from tests.nature.ambiguous_ground.picture import Frame, Layer, Params, Picture, Stream, slow, uniform

FPS = 10.0
STOPPING = 8
"""Frames over which a vehicle stops, or starts."""


def generator(case: str, draw: int, part: int) -> np.random.Generator:
    """The random numbers of one part of one drive."""
    return np.random.default_rng([zlib.crc32(case.encode()), draw, part])


class Recipe:
    """The wishes for one drive. Set them before the first use of `motion` or `view`."""

    def __init__(self, case: str, draw: int, frames: int) -> None:
        self.case, self.draw, self.frames = case, draw, frames
        self.params: Params = {}
        rng = self.rng = generator(case, draw, 0)
        self.travel = uniform(rng, 0.005, 0.025)
        self.slip = uniform(rng, 0.0, 0.6)
        self.speed_variation, self.slip_variation = 0.06, 0.05
        self.turning = min(uniform(rng, 0.0, np.radians(0.4)), self.travel / 0.8)
        self.sideways_deg = uniform(rng, 0.0, 3.0)
        self.heading = uniform(rng, -1.0, 1.0)
        self.stuck_from: int | None = None
        self.stands = False
        self.rotation: tuple[int, int, float] | None = None
        self.centre: tuple[float, float] | None = None
        self.camera = Camera(
            focal=uniform(rng, 260.0, 380.0),
            centre=((WIDTH - 1) / 2 + uniform(rng, -4.0, 4.0), (HEIGHT - 1) / 2 + uniform(rng, -4.0, 4.0)),
            distortion=(uniform(rng, -0.08, 0.0), uniform(rng, 0.0, 0.02)),
            depression_deg=uniform(rng, 42.0, 66.0),
            yaw_deg=uniform(rng, -3.0, 3.0),
            roll_deg=uniform(rng, -1.5, 1.5),
            position=(uniform(rng, -0.4, -0.3), uniform(rng, 0.05, 0.25), uniform(rng, 0.25, 0.9)),
        )
        self.told = self.camera
        self.kind = str(rng.choice(list(textures.KINDS)))
        self.mean, self.contrast = uniform(rng, 85.0, 140.0), uniform(rng, 14.0, 32.0)
        self.noise = uniform(rng, 1.0, 2.0)
        self.cloth_heading = uniform(rng, -np.pi, np.pi)
        self.texel: float | None = None
        self.texture: Picture | None = None
        self.shutter = 0.0
        drift = 1.0 + uniform(rng, 0.0, 0.03) * slow(rng, frames)
        self.exposure = Exposure(drift)
        self.layers: list[Layer] = []
        self.lens: list[Layer] = [Vignette(uniform(rng, 0.0, 0.35))]
        self.after: list[Layer] = []
        self.stream: list[Stream] = []

    @cached_property
    def motion(self) -> Motion:
        """The drive."""
        rng, n = self.rng, self.frames
        wheel = self.travel * (1.0 + self.speed_variation * slow(rng, n)) / (1.0 - self.slip)
        slip = np.clip(self.slip + self.slip_variation * slow(rng, n), 0.0, 0.65)
        turn = self.turning * slow(rng, n)
        theta = np.radians(self.sideways_deg) * slow(rng, n)
        if self.stuck_from is not None:
            over = int(rng.integers(3, 8))
            self.params["stuck_ramp_frames"] = over if self.stuck_from else 0
            done = (np.arange(n) - self.stuck_from + 1) / over if self.stuck_from else np.ones(n)
            slip += (1.0 - slip) * np.clip(done, 0.0, 1.0)
        if self.stands:
            wheel, slip = np.zeros(n), np.zeros(n)
        turn *= wheel * (1.0 - slip) / self.travel
        if self.rotation is not None:
            start, length, degrees = self.rotation
            bell = 1.0 - np.cos(2 * np.pi * (np.arange(length) + 0.5) / length)
            turned = np.radians(degrees) * bell / bell.sum()
            turn[start : start + length] += turned
            if self.centre is not None:
                # The watched wheel is dragged around the centre, and rolls as far as that is along it.
                x, y = np.array(WHEEL_CONTACT) - self.centre
                rotates = slice(start, start + length)
                away = np.maximum(start - np.arange(n), np.arange(n) - (start + length - 1))
                stops = np.clip(away / STOPPING, 0.0, 1.0)
                wheel, turn = stops * wheel, stops * turn
                turn[rotates] = turned
                wheel[rotates], slip[rotates], theta[rotates] = -turned * y, 0.0, np.arctan2(-x, y)
        return integrate(FPS, wheel, slip, theta, turn, self.heading)

    @cached_property
    def cloth(self) -> Cloth:
        """The ground's texture; its texels are about as large as the nearest pixels see, unless wished."""
        texture = textures.KINDS[self.kind](self.rng) if self.texture is None else self.texture
        texel = self.finest() if self.texel is None else self.texel
        origin = self.rng.uniform(0.0, textures.SIZE, 2)
        return Cloth(texture, texel, self.cloth_heading, (float(origin[0]), float(origin[1])))

    @cached_property
    def view(self) -> GroundView:
        """The ground, as the real camera sees it."""
        return GroundView(self.camera, self.cloth)

    def finest(self) -> float:
        """A size of texels that suits the nearest pixels, m."""
        ends = self.camera.on_plane(np.array([159.0, 160.0]), np.array([HEIGHT - 1.0] * 2))
        return 0.8 * float(np.hypot(*(ends[1] - ends[0])))

    def pixels_per_frame(self) -> float:
        """How far the ground moves in the middle of the picture in a frame, about."""
        foreshortened = np.sin(np.radians(self.camera.depression_deg))
        return float(self.travel / self.camera.metres_per_pixel() * foreshortened)

    def change_camera(self, **changes: Any) -> None:
        """Change the real camera and the one in the rig file alike."""
        self.camera = self.told = replace(self.camera, **changes)

    def draw_from(self, name: str, low: float, high: float) -> float:
        """Draw a parameter of the case, and keep it for scene.json."""
        value = uniform(self.rng, low, high)
        self.params[name] = round(value, 5)
        return value

    def count_from(self, name: str, low: int, high: int) -> int:
        """Draw a whole number from `low` to `high`, and keep it for scene.json."""
        value = int(self.rng.integers(low, high + 1))
        self.params[name] = value
        return value


def pictures(recipe: Recipe) -> list[Frame]:
    """The frames of the drive."""
    noise = generator(recipe.case, recipe.draw, 1)
    frames = [digital(recipe, i, noise) for i in range(recipe.frames)]
    for change in recipe.stream:
        frames = change(frames)
    return frames


def digital(recipe: Recipe, frame: int, noise: np.random.Generator) -> Frame:
    """A frame as the sensor hands it out."""
    picture = ground_picture(recipe, frame)
    for layer in (*recipe.layers, *recipe.lens, recipe.exposure, *recipe.after):
        picture = layer(picture, frame)
    return digitise(picture, recipe.noise, noise)


def ground_picture(recipe: Recipe, frame: int) -> Picture:
    """The ground alone, in grey levels; the mean over the time that the shutter is open."""
    times = [float(frame)]
    if recipe.shutter > 0.0:
        times = [frame + recipe.shutter * ((k + 0.5) / 8 - 0.5) for k in range(8)]
    total = np.zeros((HEIGHT, WIDTH), dtype=np.float32)
    for time in times:
        total += recipe.view.see(recipe.motion.pose(time), time / FPS)
    return total * np.float32(recipe.contrast / len(times)) + np.float32(recipe.mean)
