"""A camera on a simulated rover: it renders a recipe along the way that the rover really takes.

It takes the place of the simulated camera of a configuration, so that driver and control loop receive its
pictures as they do those of a real one. The ground repeats itself after one to two metres.
"""

import math
from collections.abc import Iterable

import numpy as np

from drivers.clock import nanoseconds
from drivers.link import CameraImage
from sim_backends.devices.camera import CameraEmulator, Exposure
from sim_backends.world.line import Line
from sim_backends.world.plant import Truth
from sim_backends.world.world import World
from tests.nature.ambiguous_ground.cases import CASES
from tests.nature.ambiguous_ground.motion import integrate
from tests.nature.ambiguous_ground.picture import Frame, Numbers
from tests.nature.ambiguous_ground.recipe import Recipe, digital, generator

BEND_M = 0.3
"""Way over which the curvature of the ground is averaged."""
DELAY_S = 0.06
"""From the middle of an exposure to the arrival of its frame."""


def prepare_live(case: str, draw: int, frames: int, fps: float, travel: float) -> Recipe:
    """The recipe of a drive whose motion is not known before.

    Args:
        case: name of the case.
        draw: number of the draw.
        frames: greatest number of frames.
        fps: frames per second.
        travel: about how far the rover will drive between two frames, m.
    """
    recipe = Recipe(case, draw, frames)
    recipe.travel, recipe.heading = travel, 0.0
    nothing = np.zeros(frames)
    recipe.motion = integrate(fps, nothing, nothing, nothing, nothing, 0.0)
    CASES[case](recipe)
    return recipe


def along_ground(before: Truth, now: Truth) -> tuple[float, float, float]:
    """The motion between two states in the rover's axes, forward and left in m and the turn in rad.

    Truth is a plan view; the rover and its camera move along the ground, which may be inclined.
    """
    turned = now.yaw_rad - before.yaw_rad
    c, s = math.cos(before.yaw_rad + 0.5 * turned), math.sin(before.yaw_rad + 0.5 * turned)
    dx, dy = now.x_m - before.x_m, now.y_m - before.y_m
    pitch, roll = 0.5 * (before.pitch_rad + now.pitch_rad), 0.5 * (before.roll_rad + now.roll_rad)
    left = (c * dy - s * dx) / math.cos(roll)
    forward = (c * dx + s * dy - left * math.sin(pitch) * math.sin(roll)) / math.cos(pitch)
    tilted = math.tan(roll) / math.cos(pitch) * (now.pitch_rad - before.pitch_rad)
    return forward, left, (turned - tilted) * math.cos(pitch) * math.cos(roll)


def tilted(before: Truth, now: Truth) -> tuple[float, float]:
    """The rotation between two states about the rover's x and y axes, rad; none on a plane."""
    turned = now.yaw_rad - before.yaw_rad
    pitch, roll = 0.5 * (before.pitch_rad + now.pitch_rad), 0.5 * (before.roll_rad + now.roll_rad)
    about_x = now.roll_rad - before.roll_rad - turned * math.sin(pitch)
    about_y = (now.pitch_rad - before.pitch_rad) * math.cos(roll) + turned * math.cos(pitch) * math.sin(roll)
    return about_x, about_y


class LiveScene:
    """What the camera of a recipe sees; the recipe's `motion` is filled as the rover drives.

    Attributes:
        recipe: the recipe.
        truths: the true state at every frame so far.
    """

    def __init__(self, recipe: Recipe) -> None:
        self.recipe = recipe
        self.truths: list[Truth] = []
        self._noise = generator(recipe.case, recipe.draw, 1)

    def render(self, truth: Truth) -> Frame:
        """The frame at this state, later than the one before. The shutter is open around it."""
        frame = len(self.truths)
        self._move(truth, frame)
        self.truths.append(truth)
        picture = digital(self.recipe, frame, self._noise)
        for change in self.recipe.stream:
            [picture] = change([picture])
        return picture

    def track(self) -> Numbers:
        """Time, s, and pose along the ground, m, m, rad, at every frame so far, a row each."""
        count, motion = len(self.truths), self.recipe.motion
        times = [1e-9 * truth.t_ns for truth in self.truths]
        return np.column_stack((times, motion.x[:count], motion.y[:count], motion.psi[:count]))

    def _move(self, truth: Truth, frame: int) -> None:
        """Enter the pose of a frame, and where the rover will be at the next one if nothing changes."""
        motion = self.recipe.motion
        if frame == 0:
            motion.x[0], motion.y[0], motion.psi[0] = truth.x_m, truth.y_m, truth.yaw_rad
        else:
            step = along_ground(self.truths[-1], truth)
            self._step(frame - 1, step)
            self._bend(truth, step[0])
        ahead = (truth.velocity_x_m_s, truth.velocity_y_m_s, truth.yaw_rate_rad_s)
        self._step(frame, (speed / motion.fps for speed in ahead))

    def _bend(self, truth: Truth, forward: float) -> None:
        """Bend the ground as the rover tilts on its way: a gyro measures that, so pictures must show it."""
        view, (roll, pitch) = self.recipe.view, tilted(self.truths[-1], truth)
        view.curvature += (pitch - view.curvature * forward) / BEND_M
        view.twist += (roll - view.twist * forward) / BEND_M

    def _step(self, frame: int, step: Iterable[float]) -> None:
        motion, (forward, left, turn) = self.recipe.motion, step
        middle = motion.psi[frame] + 0.5 * turn
        c, s = math.cos(middle), math.sin(middle)
        motion.x[frame + 1] = motion.x[frame] + c * forward - s * left
        motion.y[frame + 1] = motion.y[frame] + s * forward + c * left
        motion.psi[frame + 1] = motion.psi[frame] + turn


def mount(world: World, device: str, scene: LiveScene, first_ns: int) -> None:
    """Put the scene in the place of a simulated camera; its frames arrive `DELAY_S` after their exposure.

    Args:
        world: the simulated rover.
        device: name of the camera.
        scene: what it sees.
        first_ns: time of the first exposure.
    """
    camera = world.image_devices[device]
    to_host: Line[CameraImage] = Line(lambda image: 1.0, 1.0 / DELAY_S)
    period_ns = nanoseconds(1.0 / scene.recipe.motion.fps)
    camera.to_host = to_host
    camera.emulator = CameraEmulator(scene, world.plant, to_host, period_ns, Exposure(0, 0), first_ns)
