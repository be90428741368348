"""What the hidden effects are called in the models, and their parameters there."""

import re
from collections.abc import Iterable, Mapping

from benchmarks.gap_machines.models import MODELS
from tests.nature.machines.case import Case

Cards = Mapping[str, Mapping[str, float]]
"""Card to parameter to true value; the first parameter is the one that is judged."""

FIRST_PARAMETERS = {
    "coulomb_friction": ("level", "coulomb_nm"),
    "rolling_friction": ("level", "rolling_n"),
    "contact_drop": ("level", "drop_v"),
    "quadratic_drag": ("coefficient", "drag"),
    "cubic_stiffness": ("coefficient", "stiffness_nm_rad3"),
    "dead_zone": ("half_width", "dead_zone"),
    "supply_sag": ("per_unit", "sag_per"),
    "input_delay": ("time", "delay_s"),
    "actuator_lag": ("time", "lag_s"),
    "sensor_lag": ("time", "sensor_lag_s"),
    "sensor_offset": ("offset", "offset"),
    "gain_error": ("share", "gain_error"),
}
"""Effects with one size: its name on the card, and how its name begins in the truth."""

STATES = {"load_angle_rad": "motor_angle_rad"}
"""Variables of the truth that have another name among the states of the models, up to a factor."""


def hidden_cards(case: Case) -> dict[str, dict[str, float]]:
    """Return the cards that explain a case; terms outside the catalogue have none."""
    outside = {term.name for term in case.terms}
    found: dict[str, dict[str, float]] = {}
    for name, values in case.effects.items():
        if name not in outside:
            found.update(_cards(name, values))
    return found


def _cards(name: str, values: Mapping[str, float]) -> dict[str, dict[str, float]]:
    if name in FIRST_PARAMETERS:
        label, begin = FIRST_PARAMETERS[name]
        return {name: {label: next(value for key, value in values.items() if key.startswith(begin))}}
    if name == "asymmetric_friction":
        level = values["coulomb_nm"]
        return {"coulomb_friction": {"level": level}, name: {"excess": level * values["asymmetry"]}}
    if name == "stribeck_friction":
        level = values["coulomb_nm"]
        excess = {"excess": level * values["stiction_share"], "speed": values["stribeck_rad_s"]}
        return {"coulomb_friction": {"level": level}, name: excess}
    if name == "presliding_friction":
        return {name: {"level": values["bristle_nm"], "distance": values["bristle_rad"]}}
    if name == "backlash":
        return {name: {"play": 20.0 * values["backlash_rad"], "load_share": values["load_share"]}}
    if name == "steering_backlash":
        return {name: {"half_play": 0.5 * values["play_rad"]}}
    if name == "cogging":
        return {name: {"amplitude": values["cogging_nm"], "phase": values["cogging_phase_rad"]}}
    if name in ("overflow", "saturation"):
        limit = next(value for key, value in values.items() if key.startswith(("rim", "limit")))
        return {name: {"limit": limit, "share": 1.0}}
    raise KeyError(name)


def variables(names: Iterable[str]) -> set[str]:
    """Return variables of the truth as states and inputs of the models."""
    return {STATES.get(name, name) for name in names}


def mentioned(family: str, equation: str) -> set[str]:
    """Return the states and inputs in the equation of a draft."""
    model = MODELS[family]()
    return set(re.findall(r"\w+", equation.partition("+= c")[2])) & {*model.states, *model.inputs}
