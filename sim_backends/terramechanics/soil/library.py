"""Wheels and soils: their parameters and their data files."""

import math
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import Field, ValidationError

from drivers.errors import ConfigError
from drivers.files import parse_toml, read_text
from drivers.settings import Settings
from sim_backends.terramechanics.soil.quantity import quantity

SettingsT = TypeVar("SettingsT", bound=Settings)
Plain = quantity("1", 0.0, 1.0)


class WheelSettings(Settings):
    """A rigid wheel.

    Attributes:
        source: Origin of the numbers.
        radius_m: Radius of the rim, without lugs.
        width_m: Width of the rim.
        lug_height_m: Height of lugs or grousers; 0 for a smooth wheel.
        shearing_share: Share of the lugs' height in the radius at which soil is sheared (lambda_s of paper
            002, eq 8).
    """

    source: str
    radius_m: Annotated[float, quantity("m", 0.001, 5.0)]
    width_m: Annotated[float, quantity("m", 0.001, 5.0)]
    lug_height_m: Annotated[float, quantity("m", 0.0, 1.0)] = 0.0
    shearing_share: Annotated[float, Plain] = 0.0


class ReeceLaw(Settings):
    """Pressure over sinkage after Reece: p = (c k_c + rho g l k_phi) (z / l)^n (paper 001, eq 17).

    One of the moduli of either law may be negative, as some published ones; `wheel_contact` checks the sum.

    Attributes:
        k_c: Modulus of cohesion.
        k_phi: Modulus of weight.
        exponent: n.
    """

    law: Literal["reece"]
    k_c: Annotated[float, quantity("1", -1e6, 1e6)]
    k_phi: Annotated[float, quantity("1", -1e6, 1e6)]
    exponent: Annotated[float, quantity("1", 0.2, 4.0)]


class BekkerLaw(Settings):
    """Pressure over sinkage after Bekker: p = (k_c / l + k_phi) z^n.

    Attributes:
        k_c_pa_m: Modulus of cohesion, Pa / m^(n - 1).
        k_phi_pa: Modulus of friction, Pa / m^n.
        exponent: n.
    """

    law: Literal["bekker"]
    k_c_pa_m: Annotated[float, quantity("Pa/m^(n-1)", -1e12, 1e12)]
    k_phi_pa: Annotated[float, quantity("Pa/m^n", -1e12, 1e12)]
    exponent: Annotated[float, quantity("1", 0.2, 4.0)]


class SoilSettings(Settings):
    """A soil, with the parameters that depend on soil and wheel.

    Attributes:
        source: Origin of the numbers.
        cohesion_pa: c.
        friction_angle_deg: phi, angle of internal friction.
        density_kg_m3: rho, bulk density.
        pressure: Pressure over sinkage of a plate.
        shear_modulus_m: k, displacement over which the shear stress builds up (eq 19).
        greatest_stress: a_0 and a_1: angle of greatest stress over entry angle is a_0 + a_1 s (eq 18).
        exit_polynomial: lambda in powers 0, 1, 2 of the slip ratio (eq 16).
        wall_adhesion_pa: c_a, between soil and side wall (eqs 26, 28).
        wall_friction_deg: delta, between soil and side wall.
    """

    source: str
    cohesion_pa: Annotated[float, quantity("Pa", 0.0, 1e6)]
    friction_angle_deg: Annotated[float, quantity("deg", 1.0, 60.0)]
    density_kg_m3: Annotated[float, quantity("kg/m^3", 100.0, 10_000.0)]
    pressure: Annotated[ReeceLaw | BekkerLaw, Field(discriminator="law")]
    shear_modulus_m: Annotated[float, quantity("m", 1e-5, 1.0)]
    greatest_stress: tuple[
        Annotated[float, quantity("1", 0.0, 0.95)], Annotated[float, quantity("1", -0.95, 0.95)]
    ]
    exit_polynomial: tuple[float, float, float]
    wall_adhesion_pa: Annotated[float, quantity("Pa", 0.0, 1e6)] = 0.0
    wall_friction_deg: Annotated[float, quantity("deg", 0.0, 45.0)] = 0.0

    @property
    def friction_angle_rad(self) -> float:
        """Angle of internal friction, rad."""
        return math.radians(self.friction_angle_deg)

    @property
    def wall_friction_rad(self) -> float:
        """Angle of friction at the side wall, rad."""
        return math.radians(self.wall_friction_deg)


def load_wheel(name: str | Path) -> WheelSettings:
    """Return a wheel of the library by name, or of a file by path (ending in .toml).

    Raises:
        ConfigError: Unknown wheel, not TOML, or a number outside its range; names file, key, unit and range.
    """
    return _load(name, "wheels", WheelSettings)


def load_soil(name: str | Path) -> SoilSettings:
    """Return a soil of the library by name, or of a file by path (ending in .toml).

    Raises:
        ConfigError: Unknown soil, not TOML, or a number outside its range; names file, key, unit and range.
    """
    return _load(name, "soils", SoilSettings)


def library_names(kind: Literal["wheels", "soils"]) -> list[str]:
    """Return the names in the library."""
    folder = resources.files("sim_backends.terramechanics.soil") / "library" / kind
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name[0] != "_")


def _load(name: str | Path, kind: Literal["wheels", "soils"], form: type[SettingsT]) -> SettingsT:
    if str(name).endswith(".toml"):
        try:
            text = read_text(Path(name))
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError(f"{name}: cannot be read ({error}); give a readable TOML file.") from None
    elif str(name) in library_names(kind):
        library = resources.files("sim_backends.terramechanics.soil") / "library"
        text = (library / kind / f"{name}.toml").read_text("utf-8")
    else:
        known = ", ".join(library_names(kind))
        raise ConfigError(f"{kind}: no '{name}'; use one of {known}, or the path of a .toml file.")
    return parse_settings(text, str(name), form)


def parse_settings(text: str, origin: str, form: type[SettingsT]) -> SettingsT:
    """Return the settings in a TOML text.

    Args:
        text: TOML.
        origin: File or name, for messages.
        form: Class of the settings.

    Raises:
        ConfigError: Not TOML or not such settings; names the first wrong key, its value, unit and range.
    """
    try:
        return form.model_validate(parse_toml(text))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        if first["type"] == "value_error":
            raise ConfigError(f"{origin}: {first['msg'].removeprefix('Value error, ')}.") from None
        raise ConfigError(f"{origin}: {key}: {first['msg']} (given: {first['input']!r}).") from None
    except ValueError as error:
        raise ConfigError(f"{origin}: is not TOML ({error}); correct the file.") from None
