"""Cases in which the camera shows the ground well enough, and says the truth."""

import numpy as np

from tests.nature.ambiguous_ground.ground import to_pixels
from tests.nature.ambiguous_ground.optics import Defocus, Dust, Exposure, Specks
from tests.nature.ambiguous_ground.recipe import Recipe
from tests.nature.ambiguous_ground.weather import PassingShadow, Rain


def clean(recipe: Recipe) -> None:
    """Nothing is wrong."""


def blur(recipe: Recipe) -> None:
    """The lens is out of focus."""
    recipe.lens.append(Defocus(recipe.draw_from("blur_radius_px", 1.5, 4.0)))


def motion_blur(recipe: Recipe) -> None:
    """The shutter is open while the rover moves."""
    wish = recipe.draw_from("wished_blur_px", 2.0, 8.0)
    recipe.shutter = min(wish / recipe.pixels_per_frame(), 0.9)
    recipe.params["shutter_share_of_interval"] = round(recipe.shutter, 3)


def dark(recipe: Recipe) -> None:
    """Little light: little contrast, and more noise."""
    recipe.mean = recipe.draw_from("mean_grey", 14.0, 32.0)
    recipe.contrast = recipe.mean * recipe.draw_from("contrast_of_mean", 0.15, 0.3)
    recipe.noise = recipe.draw_from("noise", 2.0, 3.5)


def rain(recipe: Recipe) -> None:
    """Drops on the ground, and streaks in the air."""
    drops = recipe.count_from("drops_per_frame", 3, 15)
    streaks = recipe.count_from("streaks_per_frame", 5, 40)
    recipe.layers.append(Rain(recipe.rng, recipe.camera, recipe.motion, drops, streaks))


def exposure(recipe: Recipe) -> None:
    """The camera's gain steps."""
    gains = np.ones(recipe.frames)
    at, steps = int(recipe.rng.integers(4, 15)), []
    while at < recipe.frames:
        gain = float(recipe.rng.uniform(0.55, 1.5))
        gains[at:] = gain
        steps.append([at, round(gain, 3)])
        at += int(recipe.rng.integers(6, 20))
    recipe.params["steps_frame_gain"] = steps
    recipe.exposure = Exposure(gains * recipe.exposure.gains)


def dust(recipe: Recipe) -> None:
    """A thin film of dust on the lens."""
    smear = recipe.draw_from("smear_grey", 2.0, 6.0)
    recipe.lens.append(Dust(recipe.rng, smear, recipe.draw_from("contrast_kept", 0.45, 0.8)))


def dirt_few(recipe: Recipe) -> None:
    """A few specks on the lens."""
    recipe.lens.append(Specks(recipe.rng, recipe.count_from("specks", 10, 60)))


def standing(recipe: Recipe) -> None:
    """Rover and wheels stand; a shadow passes."""
    recipe.stands = True
    points, angle = recipe.view.points, recipe.rng.uniform(0.0, 2 * np.pi)
    along = to_pixels(points[..., 0] * np.cos(angle) + points[..., 1] * np.sin(angle))
    along -= along.min()
    width = recipe.draw_from("shadow_width_m", 0.1, 0.5)
    crossings = recipe.draw_from("shadow_crossings", 0.8, 1.5)
    shadow = PassingShadow(
        along=along,
        speed=crossings * (float(along.max()) + width) / recipe.frames,
        width=width,
        softness=recipe.draw_from("shadow_softness_m", 0.004, 0.05),
        depth=recipe.draw_from("shadow_depth", 0.2, 0.6),
    )
    recipe.layers.append(shadow)


def stuck_clean(recipe: Recipe) -> None:
    """The rover drives, then its wheels spin on the spot."""
    recipe.stuck_from = 25


def stuck_clean_from_start(recipe: Recipe) -> None:
    """The wheels spin on the spot in the whole drive."""
    recipe.stuck_from = 0
