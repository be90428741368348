"""Cases in which a part of the picture moves otherwise than the ground."""

import numpy as np

from tests.nature.ambiguous_ground import textures
from tests.nature.ambiguous_ground.bodies import (
    MovingPart,
    Reflection,
    TurningWheel,
    Wheel,
    body_texture,
    edge_mask,
)
from tests.nature.ambiguous_ground.camera import HEIGHT, WIDTH
from tests.nature.ambiguous_ground.ground import Cloth, GroundView, SwayingView
from tests.nature.ambiguous_ground.picture import Numbers, Picture, sign
from tests.nature.ambiguous_ground.recipe import Recipe


def _turned(recipe: Recipe) -> Numbers:
    """How far the rim of the wheel has moved since the first frame, m."""
    total = np.cumsum(recipe.motion.wheel)
    rim: Numbers = total - total[0]
    return rim


def _surface(recipe: Recipe, lugs: int) -> Picture:
    mean, contrast = recipe.rng.uniform(60.0, 130.0), recipe.rng.uniform(15.0, 32.0)
    return body_texture(recipe.rng, lugs) * np.float32(contrast) + np.float32(mean)


def _band(recipe: Recipe, least: float, most: float, softness: float) -> Picture:
    """A band at the left or the right that covers a share of the width."""
    share = recipe.draw_from("share_of_width", least, most)
    lean = recipe.draw_from("lean_px", -15.0, 15.0)
    if recipe.rng.random() < 0.5:
        return edge_mask(-WIDTH, share * WIDTH, lean, softness)
    return edge_mask((1.0 - share) * WIDTH, 2.0 * WIDTH, lean, softness)


def _moving_part(recipe: Recipe, least: float, most: float) -> None:
    kind = str(recipe.rng.choice(["up_with_wheel", "down_with_wheel", "own"]))
    factor = {"up_with_wheel": -1.0, "down_with_wheel": 1.0}.get(kind)
    if factor is None:
        factor = sign(recipe.rng) * float(recipe.rng.uniform(0.3, 1.5))
    recipe.params["velocity"] = kind
    recipe.params["velocity_down_over_wheel_speed"] = round(factor, 4)
    nearness = recipe.draw_from("distance_over_distance_of_ground", 0.5, 0.95)
    pixels = 1.0 / (recipe.camera.metres_per_pixel() * nearness)
    places = factor * pixels * _turned(recipe)
    recipe.params["mean_px_per_frame_down"] = round(float(places[-1]) / max(recipe.frames - 1, 1), 3)
    lugs = recipe.count_from("lugs_per_512_px", 6, 20)
    mask = _band(recipe, least, most, 1.5)
    recipe.layers.append(MovingPart(mask, _surface(recipe, lugs), places))


def moving_part_small(recipe: Recipe) -> None:
    """A part of the rover covers 15 to 30 % of the width, and its surface moves."""
    _moving_part(recipe, 0.15, 0.3)


def moving_part_large(recipe: Recipe) -> None:
    """A part of the rover covers 30 to 50 % of the width, and its surface moves."""
    _moving_part(recipe, 0.3, 0.5)


def wheel_top(recipe: Recipe) -> None:
    """The upper side of a wheel is in 15 to 30 % of the width."""
    radius = recipe.draw_from("wheel_radius_m", 0.06, 0.1)
    if recipe.camera.position[2] < 0.4:
        height = float(recipe.rng.uniform(0.4, 0.9))
        recipe.change_camera(position=(*recipe.camera.position[:2], height))
    target = recipe.draw_from("wished_share_of_width", 0.16, 0.29)
    row = recipe.draw_from("row_of_axle", 0.6 * HEIGHT, 0.9 * HEIGHT)
    side = sign(recipe.rng)
    ends = recipe.camera.on_plane(np.array([0.0, WIDTH - 1.0]), np.array([row, row]), radius)
    x = float(ends[:, 0].mean())
    inside, outside = sorted((float(ends[0, 1]), float(ends[1, 1])), key=lambda y: -side * y)[::-1]
    for _ in range(9):
        middle = 0.5 * (inside + outside)
        wheel = Wheel(recipe.camera, radius, x, middle, side)
        inside, outside = (middle, outside) if wheel.share_of_width() > target else (inside, middle)
    recipe.params["share_of_width"] = round(wheel.share_of_width(), 3)
    lugs = recipe.count_from("lugs", 12, 30)
    recipe.layers.append(TurningWheel(wheel, _surface(recipe, lugs), _turned(recipe) / radius))


def reflection(recipe: Recipe) -> None:
    """A glossy ground mirrors what is above it."""
    height = recipe.draw_from("height_of_mirrored_m", 0.6, 3.0)
    moves = bool(recipe.rng.random() < 0.7)
    recipe.params["mirrored"] = "ceiling" if moves else "rover"
    kind = str(recipe.rng.choice(list(textures.KINDS)))
    recipe.params["mirrored_texture"] = kind
    larger = (height + recipe.camera.position[2]) / recipe.camera.position[2]
    heading = float(recipe.rng.uniform(-np.pi, np.pi))
    cloth = Cloth(textures.KINDS[kind](recipe.rng), recipe.finest() * larger, heading)
    view = GroundView(recipe.camera, cloth, -height)
    strength = recipe.draw_from("strength", 0.4, 0.85)
    mask = _band(recipe, 0.3, 0.9, 12.0) * np.float32(strength)
    contrast = recipe.draw_from("mirrored_contrast_grey", 18.0, 35.0)
    mean = float(recipe.rng.uniform(100.0, 150.0))
    recipe.layers.append(Reflection(mask, view, recipe.motion, moves, mean, contrast))


def grass_sways(recipe: Recipe) -> None:
    """Grass sways in the wind."""
    recipe.kind = "grass"
    reach = 0.001 * recipe.draw_from("sway_mm", 3.0, 20.0)
    recipe.view = SwayingView(recipe.camera, recipe.cloth, recipe.rng, reach)
