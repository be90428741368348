"""Cases in which the camera is not mounted as the rig file says. All are long, with one slow rotation."""

from dataclasses import replace

from tests.nature.ambiguous_ground.picture import sign
from tests.nature.ambiguous_ground.recipe import Recipe
from tests.nature.ambiguous_ground.stream import mirrored as mirror
from tests.nature.ambiguous_ground.stream import upside_down as turn_over


def rig_right(recipe: Recipe) -> None:
    """The rig file is right: what the other cases are to be compared with."""
    rng, n = recipe.rng, recipe.frames
    recipe.travel = float(rng.uniform(0.0208, 0.025))
    recipe.slip, recipe.slip_variation, recipe.speed_variation = float(rng.uniform(0.0, 0.1)), 0.01, 0.03
    recipe.sideways_deg = 0.0
    recipe.turning *= 0.2
    length = round(n * float(rng.uniform(0.27, 0.4)))
    start = round(n * float(rng.uniform(0.25, 0.4)))
    degrees = sign(rng) * recipe.draw_from("rotation_deg", 50.0, 75.0)
    recipe.rotation = (start, length, degrees)
    recipe.params["rotation_deg"] = round(degrees, 3)
    recipe.params["rotation_frames"] = [start, start + length]


def spot_right(recipe: Recipe) -> None:
    """The rig file is right, and the rotation is one on the spot, about a point near the vehicle's origin."""
    rig_right(recipe)
    assert recipe.rotation is not None
    recipe.rotation = (recipe.rotation[0], round(0.3 * recipe.frames), recipe.rotation[2])
    centre = recipe.draw_from("centre_x_m", -0.01, 0.01), recipe.draw_from("centre_y_m", -0.01, 0.01)
    recipe.centre = centre


def spot_height_low(recipe: Recipe) -> None:
    """The same, and the real height is 0.9 of that in the rig file."""
    spot_right(recipe)
    _lower(recipe)


def focal_long(recipe: Recipe) -> None:
    """The real focal length is 1.2 times that in the rig file."""
    rig_right(recipe)
    recipe.camera = replace(recipe.told, focal=1.2 * recipe.told.focal)
    recipe.params["real_focal_over_told"] = 1.2


def height_low(recipe: Recipe) -> None:
    """The real height is 0.9 of that in the rig file."""
    rig_right(recipe)
    _lower(recipe)


def _lower(recipe: Recipe) -> None:
    x, y, z = recipe.told.position
    recipe.camera = replace(recipe.told, position=(x, y, 0.9 * z))
    recipe.params["real_height_over_told"] = 0.9


def pitch_off(recipe: Recipe) -> None:
    """The real camera looks 3 deg further down, or less."""
    rig_right(recipe)
    off = 3.0 * sign(recipe.rng)
    recipe.camera = replace(recipe.told, depression_deg=recipe.told.depression_deg + off)
    recipe.params["real_minus_told_depression_deg"] = off


def yaw_off(recipe: Recipe) -> None:
    """The real camera is turned about the vertical by 3 deg; by 10 deg in draw 9."""
    rig_right(recipe)
    off = (10.0 if recipe.draw == 9 else 3.0) * sign(recipe.rng)
    recipe.camera = replace(recipe.told, yaw_deg=recipe.told.yaw_deg + off)
    recipe.params["real_minus_told_yaw_deg"] = off


def mirrored(recipe: Recipe) -> None:
    """Left and right of the picture are exchanged."""
    rig_right(recipe)
    recipe.stream.append(mirror)


def upside_down(recipe: Recipe) -> None:
    """The picture is turned by 180 deg."""
    rig_right(recipe)
    recipe.stream.append(turn_over)
