"""Cases in which the ground repeats itself, or hardly changes along the motion."""

import numpy as np

from tests.nature.ambiguous_ground import textures
from tests.nature.ambiguous_ground.picture import Picture
from tests.nature.ambiguous_ground.recipe import Recipe


def _ground(recipe: Recipe, pattern: Picture, detail: float) -> None:
    """Lay a pattern along the motion, with some of an ordinary ground in it."""
    ordinary = textures.KINDS[recipe.kind](recipe.rng)
    recipe.texture = textures.standard(pattern + np.float32(detail) * ordinary)
    misaligned = np.radians(recipe.draw_from("misaligned_deg", -5.0, 5.0))
    recipe.cloth_heading = recipe.heading + float(misaligned)
    recipe.turning *= 0.3


def _across(recipe: Recipe, low: float, high: float, least_travel: float) -> None:
    """Tiles, ribs or furrows across the motion; the camera is so near that it resolves them."""
    recipe.travel = float(recipe.rng.uniform(least_travel, 0.025))
    recipe.speed_variation = recipe.slip_variation = 0.01
    period = recipe.travel * recipe.draw_from("period_over_travel", low, high)
    position = recipe.camera.position
    nearer = period / (5.0 * recipe.camera.metres_per_pixel())
    if nearer < 1.0:
        height = max(position[2] * nearer, 0.25)
        recipe.change_camera(position=(*position[:2], height))
    recipe.params["period_mm"] = round(1000.0 * period, 3)
    recipe.params["period_px"] = round(period / recipe.camera.metres_per_pixel(), 2)
    periods = max(round(textures.SIZE * recipe.finest() / period), 1)
    recipe.texel = period * periods / textures.SIZE
    profile = str(recipe.rng.choice(["ribs", "tiles", "furrows"]))
    recipe.params["profile"] = profile
    lanes = max(round(periods * float(recipe.rng.uniform(0.3, 1.2))), 1)
    _ground(recipe, textures.ribs(profile, periods, lanes), recipe.draw_from("detail", 0.02, 0.15))


def tiles_long(recipe: Recipe) -> None:
    """The period is 1.2 to 4 times the travel per frame."""
    _across(recipe, 1.2, 4.0, 0.008)


def tiles_short(recipe: Recipe) -> None:
    """The period is 0.3 to 1.1 times the travel per frame."""
    _across(recipe, 0.3, 1.1, 0.015)


def furrows_along(recipe: Recipe) -> None:
    """Furrows along the motion, with weak detail."""
    _ground(recipe, textures.furrows_along(recipe.rng), recipe.draw_from("detail", 0.02, 0.1))
