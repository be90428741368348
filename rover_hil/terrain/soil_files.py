"""The soil of a command: of the library, a file of one's own, or one that `terrain fit` wrote."""

from pathlib import Path
from typing import NamedTuple

from drivers.files import parse_toml, read_text
from sim_backends.terramechanics.soil.any_angle_wheel import load_any_angle_soil
from sim_backends.terramechanics.soil.library import SoilSettings, load_soil

OF_ANY_ANGLE = "plate_modulus_pa"
"""The key by which a file of the law for any slip angle is known."""
USED = (
    "plate_modulus_pa",
    "plate_exponent",
    "density_kg_m3",
    "friction_angle_deg",
    "shear_modulus_m",
    "greatest_stress",
    "exit_share",
    "wall_friction",
)
"""Keys of such a file that the law of paper 001 uses, too."""


class TerrainSoil(NamedTuple):
    """A soil for the law of paper 001.

    Attributes:
        soil: The soil.
        notes: What the user must know of a file that `terrain fit` wrote; none for others.
    """

    soil: SoilSettings
    notes: tuple[str, ...] = ()


def load_terrain_soil(name: str) -> TerrainSoil:
    """Return a soil by its name in the library, or by the path of a file (ending in .toml).

    Raises:
        ConfigError: Unknown soil, not TOML, or a number outside its range; names file, key, unit and range.
    """
    if not _is_of_any_angle(name):
        return TerrainSoil(load_soil(name))
    fitted = load_any_angle_soil(name)
    notes = [
        f"{name} is of `terrain fit`: its numbers of plates, shear, friction and walls are used in the law "
        "of paper 001, with its a_1 = 0.15 for the angle of greatest stress, without cohesion, and without "
        "rim_friction_deg, as that law shears soil on soil"
    ]
    not_fitted = [key for key in USED if key in fitted.not_fitted]
    if not_fitted:
        words = ", ".join(not_fitted)
        notes.append(f"{name}: {words} were not fitted, they are those of {fitted.not_fitted_from}")
    return TerrainSoil(fitted.for_rolling(), tuple(notes))


def _is_of_any_angle(name: str) -> bool:
    if not name.endswith(".toml"):
        return False
    try:
        return OF_ANY_ANGLE in parse_toml(read_text(Path(name)))
    except (OSError, ValueError):
        return False  # `load_soil` names the mistake
