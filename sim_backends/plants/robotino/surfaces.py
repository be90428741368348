"""Ground under a wheel: traction, resistance and sinkage of the coverings of a test site."""

import math
import tomllib
from importlib import resources
from typing import Annotated, Literal, NamedTuple

from pydantic import Field, TypeAdapter

from drivers.settings import Settings

ROLLER_RADIUS_M = 0.026
"""Effective radius for sideways motion through soft ground; fitted to the runs on red, not measured."""
WINKLER = 0.75
"""Rolling resistance per load of a rigid wheel on an elastic bed: 3/4 sqrt(sinkage / diameter)."""

InnerLayer = Literal["firm", "soft"]


class Surface(Settings):
    """A covering on a firm ground.

    Attributes:
        friction: Largest traction per wheel load.
        stiffness: Traction per wheel load and slip ratio, while both are small.
        drag_along: Resistance per wheel load against rolling.
        drag_across: Resistance per wheel load of the rollers against sideways motion.
    """

    friction: Annotated[float, Field(gt=0, le=3)]
    stiffness: Annotated[float, Field(gt=0, le=200)]
    drag_along: Annotated[float, Field(ge=0, le=2)]
    drag_across: Annotated[float, Field(ge=0, le=2)]


class SoftGroundResistance(NamedTuple):
    """Resistance per wheel load of soft ground alone, at the rover's mean wheel load."""

    along: float
    across: float


def soft_ground_resistance(sinkage_m: float, wheel_radius_m: float) -> SoftGroundResistance:
    """Return the resistance of soft ground: that of a rigid wheel on an elastic (Winkler) bed.

    The load is the integral of the bed's pressure over the contact, the resistance the work of pressing it
    down per distance; their quotient is 3/4 sqrt(sinkage / diameter). Sinkage grows with load to the power
    2/3, hence the quotient with load to the power 1/3.

    Args:
        sinkage_m: Sinkage at the rover's mean wheel load, at least 0.
        wheel_radius_m: Radius of the wheel; sideways `ROLLER_RADIUS_M` applies.
    """
    return SoftGroundResistance(
        WINKLER * math.sqrt(sinkage_m / (2 * wheel_radius_m)),
        WINKLER * math.sqrt(sinkage_m / (2 * ROLLER_RADIUS_M)),
    )


def shipped_surfaces() -> dict[str, Surface]:
    """Return the fitted surfaces of `surfaces.toml` by name."""
    text = (resources.files("sim_backends.plants.robotino") / "surfaces.toml").read_text("utf-8")
    return TypeAdapter(dict[str, Surface]).validate_python(tomllib.loads(text)["surfaces"])
