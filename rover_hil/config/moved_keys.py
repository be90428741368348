"""Keys of configurations that moved or are called otherwise, and what answers them."""

import sys
from collections.abc import Mapping, MutableMapping, Sequence

from pydantic_core import from_json, to_json

from controllers.settings import OLD_SCOMP_KEY

SITE = 'the ground is a map now: remove this, and name one in [simulation.plant], e.g. site = "floor_table"'
AREA = (
    "the area of plan and rover is [safety.area] now: remove this, and write there, e.g., "
    'type = "polygon" and points_m = [[-0.5, -0.5], [2.5, -0.5], [2.5, 1.5], [-0.5, 1.5]]'
)
REMOVED: Mapping[tuple[str, ...], str] = {
    ("simulation", "plant", "floor"): SITE,
    ("simulation", "plant", "patches"): SITE,
    ("mission", "area"): AREA,
}
"""Keys, and what to do instead."""
RENAMED_VALUES: Mapping[tuple[str, ...], str] = {("simulation", "plant", "type", "four_wheel"): "el_dorado"}
"""Keys with an earlier value, and the value of today."""


def fix_of(key: Sequence[str | int]) -> str:
    """Return what to do about a key that was removed; empty for any other."""
    return REMOVED.get(tuple(map(str, key)), "")


def new_value(key: Sequence[str | int], value: object) -> str:
    """Return how a value of a key is called today; empty where it never was one."""
    return RENAMED_VALUES.get((*map(str, key), str(value)), "")


def rename_sections(table: MutableMapping[str, object]) -> None:
    """Accept sections under the names of the version before, with a note to the user."""
    if OLD_SCOMP_KEY in table and "scomp" not in table:
        _note(f"[{OLD_SCOMP_KEY}] is now called [scomp]: rename it")
        table["scomp"] = table.pop(OLD_SCOMP_KEY)
    if move_slip_keys(table):
        _note("filter.unsure_slip_sd is now slip_sd in [ground]: move it")
    mission, safety = table.get("mission"), table.get("safety", {})
    box = mission.get("area") if isinstance(mission, dict) else None
    points = _corners_of(box)
    if points and isinstance(mission, dict) and isinstance(safety, dict) and "area" not in safety:
        table["safety"] = {**safety, "area": {"type": "polygon", "points_m": points}}
        del mission["area"]
        _note(
            "mission.area is now [safety.area], which the rover must not leave either: replace it by "
            f'[safety.area] with type = "polygon" and points_m = {points}'
        )


def move_slip_keys(table: MutableMapping[str, object]) -> bool:
    """Move the slip that nothing measures from [filter] to [ground], as it acted; return whether."""
    noise = table.get("filter")
    if not isinstance(noise, dict) or "unsure_slip_sd" not in noise or "ground" in table:
        return False
    sd = noise.pop("unsure_slip_sd")
    numbers = (sd, noise.get("cross_slip_ratio", 1.0), noise.get("slip_distance_m", 0.5))
    if all(isinstance(number, int | float) for number in numbers):
        cross_sd = min(1.0, numbers[0] * numbers[1])
        table["ground"] = {
            "slip_sd": sd,
            "cross_slip_sd": cross_sd,
            "slip_distance_m": numbers[2],
            "local_slip_sd": 0.0,
        }
    else:
        table["ground"] = {"slip_sd": sd}
    _rename_tuned(table.get("tune"))
    return True


def _rename_tuned(tune: object) -> None:
    logs = tune.get("logs") if isinstance(tune, dict) else None
    tuned = logs.get("parameters") if isinstance(logs, dict) else None
    if isinstance(tuned, dict) and "filter.unsure_slip_sd" in tuned:
        tuned["ground.slip_sd"] = tuned.pop("filter.unsure_slip_sd")


def of_earlier_log(config_json: bytes) -> bytes:
    """Return the configuration of a log with today's keys, as it acted while the rover drove.

    It is without `mission.area`, which stopped nothing then.
    """
    try:
        table = from_json(config_json)
    except ValueError:
        return config_json
    if not isinstance(table, dict):
        return config_json
    has_moved = move_slip_keys(table)
    mission = table.get("mission")
    if isinstance(mission, dict) and "area" in mission:
        del mission["area"]
    elif not has_moved:
        return config_json
    return to_json(table, inf_nan_mode="constants")


def _corners_of(box: object) -> list[list[float]]:
    """Return the corners of a box of the version before; none where it is not valid."""
    keys = ("x_min_m", "x_max_m", "y_min_m", "y_max_m")
    if not isinstance(box, dict) or box.keys() != set(keys):
        return []
    left, right, bottom, top = (box[key] for key in keys)
    if not all(isinstance(value, int | float) for value in (left, right, bottom, top)):
        return []
    is_box = left < right and bottom < top
    return [[left, bottom], [right, bottom], [right, top], [left, top]] if is_box else []


def _note(text: str) -> None:
    print(f"{text}, the next version knows the new name only", file=sys.stderr)  # noqa: T201 - for the user
