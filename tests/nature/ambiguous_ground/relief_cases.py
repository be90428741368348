"""Cases in which the ground is not flat, and the rig file is right."""

import numpy as np

from tests.nature.ambiguous_ground.optics import Defocus
from tests.nature.ambiguous_ground.recipe import Recipe
from tests.nature.ambiguous_ground.relief import ReliefView, mounds


def relief_known(recipe: Recipe) -> None:
    """Mounds of 10 to 40 mm. The plane of the wheels' contact is their mean, and the rover does not rock."""
    recipe.change_camera(depression_deg=float(recipe.rng.uniform(52.0, 66.0)))
    size = 0.001 * recipe.draw_from("peak_to_peak_mm", 10.0, 40.0)
    ground = mounds(recipe.rng, size, recipe.draw_from("steepest_slope", 0.2, 0.4))
    recipe.params["deviation_mm"] = round(1000.0 * float(ground.heights.std()), 2)
    low = np.radians(recipe.draw_from("sun_elevation_deg", 25.0, 70.0))
    around = recipe.rng.uniform(-np.pi, np.pi)
    sun = np.array([np.cos(low) * np.cos(around), np.cos(low) * np.sin(around), np.sin(low)])
    brightness = recipe.mean / recipe.contrast
    recipe.view = ReliefView(recipe.camera, recipe.cloth, ground, sun, brightness)


def blurred_relief(recipe: Recipe) -> None:
    """The same, and the lens is out of focus."""
    relief_known(recipe)
    recipe.lens.append(Defocus(recipe.draw_from("blur_radius_px", 1.5, 4.0)))
