"""Traverses as a model file of the side-slope rover predicts them: with the effects that were found."""

import itertools
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from drivers.errors import ConfigError
from rover_hil.gap.data.load import load_model
from rover_hil.gap.output.model_file import ExtendedModel, read_model_file
from rover_hil.terrain.table import number
from rover_hil.terrain.traverse import Traverse
from sim_backends.models.interface import Run

BASE = "side-slope"


def load_side_slope(path: Path) -> ExtendedModel:
    """Return the side-slope rover with the effects of a model file.

    Raises:
        ConfigError: It cannot be read, or is of another model.
    """
    file = read_model_file(path)
    if file.base != BASE:
        raise ConfigError(f"{path}: this is a model of {file.base}; a traverse needs one of {BASE}")
    return ExtendedModel(load_model(BASE), file)


def extended_traverses(
    model: ExtendedModel,
    slopes_deg: Sequence[float],
    rolls_deg: Sequence[float],
    masses_kg: Sequence[float],
) -> Iterator[Traverse]:
    """Yield what the model predicts for all combinations, the last list running fastest.

    Slip and slip angle are those that are measured: of the path, over the part of it that counts.
    Whether a state is on the boundary of the model's domain is unknown.

    Args:
        model: See `load_side_slope`.
        slopes_deg: 0 to 45.
        rolls_deg: -45 to 45.
        masses_kg: More than 0.
    """
    for slope_deg, roll_deg, mass_kg in itertools.product(slopes_deg, rolls_deg, masses_kg):
        conditions = {"slope_deg": slope_deg, "roll_deg": roll_deg, "mass_kg": mass_kg}
        table = model.predict([Run(name="asked", conditions=conditions)], {}, {})[0]
        slip, angle_deg = float(table["slip"][0]), float(table["slip_angle_deg"][0])
        up_mm, down_mm = float(table["sinkage_up_mm"][0]), float(table["sinkage_down_mm"][0])
        yield Traverse(
            slope_deg,
            roll_deg,
            mass_kg,
            number(slip),
            number(angle_deg),
            number(up_mm / 1000.0),
            number(down_mm / 1000.0),
            None,
            "the model has no steady state there" if math.isnan(slip) else "",
        )
