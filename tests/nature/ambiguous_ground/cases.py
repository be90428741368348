"""All cases by name."""

from collections.abc import Callable

from tests.nature.ambiguous_ground import body_cases as body
from tests.nature.ambiguous_ground import mounting_cases as mounting
from tests.nature.ambiguous_ground import pattern_cases as pattern
from tests.nature.ambiguous_ground import picture_cases as picture
from tests.nature.ambiguous_ground import relief_cases as relief
from tests.nature.ambiguous_ground import sound_cases as sound
from tests.nature.ambiguous_ground.recipe import Recipe

Case = Callable[[Recipe], None]


def _named(*cases: Case) -> dict[str, Case]:
    return {case.__name__: case for case in cases}


SOUND = _named(
    sound.clean, sound.blur, sound.motion_blur, sound.dark, sound.rain, sound.exposure, sound.dust,
    sound.dirt_few, sound.standing, sound.stuck_clean, sound.stuck_clean_from_start,
)  # fmt: skip
AMBIGUOUS = _named(
    picture.dirt_many, picture.dirt_arrives, picture.fixed_pattern, picture.stuck_dirty,
    picture.stuck_dirty_from_start, picture.repeats, picture.swapped, pattern.tiles_long,
    pattern.tiles_short, pattern.furrows_along, body.reflection, body.moving_part_small,
    body.moving_part_large, body.wheel_top, body.grass_sways,
)  # fmt: skip
GEOMETRY = _named(
    mounting.rig_right, mounting.focal_long, mounting.height_low, mounting.pitch_off, mounting.yaw_off,
    mounting.mirrored, mounting.upside_down, mounting.spot_right, mounting.spot_height_low,
)  # fmt: skip
RELIEF = _named(relief.relief_known, relief.blurred_relief)
GROUPS = {"sound": SOUND, "ambiguous": AMBIGUOUS, "geometry": GEOMETRY, "relief": RELIEF}
CASES = {name: case for group in GROUPS.values() for name, case in group.items()}


def prepare(case: str, draw: int, frames: int) -> Recipe:
    """The recipe of one drive. A drive that shows how the camera is mounted is 2.5 times as long."""
    recipe = Recipe(case, draw, round(2.5 * frames) if case in GEOMETRY else frames)
    recipe.params["group"] = next(name for name, group in GROUPS.items() if case in group)
    CASES[case](recipe)
    return recipe
