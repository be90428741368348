"""Cases in which something that is fixed in the picture, or comes late, may be taken for the ground."""

from tests.nature.ambiguous_ground.optics import FixedPattern, Specks
from tests.nature.ambiguous_ground.recipe import Recipe
from tests.nature.ambiguous_ground.stream import Repeats, Swapped


def dirt_many(recipe: Recipe) -> None:
    """Many specks on the lens while the rover moves."""
    recipe.lens.append(Specks(recipe.rng, recipe.count_from("specks", 100, 300)))


def dirt_arrives(recipe: Recipe) -> None:
    """Many specks come onto the lens at frame 20."""
    recipe.params["since_frame"] = 20
    recipe.lens.append(Specks(recipe.rng, recipe.count_from("specks", 100, 300), 20))


def fixed_pattern(recipe: Recipe) -> None:
    """The sensor's own pattern is stronger than what the ground shows."""
    recipe.contrast = recipe.draw_from("contrast", 0.4, 1.5)
    recipe.noise = recipe.draw_from("noise", 0.8, 1.5)
    columns = recipe.draw_from("share_of_columns", 0.0, 0.4)
    recipe.params["pattern_grey"] = 3.0
    recipe.after.append(FixedPattern(recipe.rng, 3.0, columns))


def stuck_dirty(recipe: Recipe) -> None:
    """The rover drives, then its wheels spin on the spot, behind a dirty lens."""
    recipe.stuck_from = 25
    recipe.params["specks"] = 150
    recipe.lens.append(Specks(recipe.rng, 150))


def stuck_dirty_from_start(recipe: Recipe) -> None:
    """The wheels spin on the spot in the whole drive, behind a dirty lens."""
    recipe.stuck_from = 0
    recipe.params["specks"] = 150
    recipe.lens.append(Specks(recipe.rng, 150))


def repeats(recipe: Recipe) -> None:
    """Some frames repeat the previous picture with a new time."""
    chance = recipe.draw_from("chance", 0.2, 0.5)
    repeated = [bool(r < chance) and i > 0 for i, r in enumerate(recipe.rng.random(recipe.frames))]
    recipe.params["repeated_frames"] = [i for i, r in enumerate(repeated) if r]
    again = recipe.count_from("jpeg_quality_of_repeats", 86, 94)
    recipe.params["jpeg_quality"] = 90
    recipe.stream.append(Repeats(repeated, 90, again))


def swapped(recipe: Recipe) -> None:
    """Pairs of frames have changed places: all of them in even draws."""
    share = 1.0 if recipe.draw % 2 == 0 else float(recipe.rng.uniform(0.3, 1.0))
    pairs = [bool(r < share) for r in recipe.rng.random(recipe.frames // 2)]
    recipe.params["swapped_first_frames"] = [2 * k for k, s in enumerate(pairs) if s]
    recipe.stream.append(Swapped(pairs))
