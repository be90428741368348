"""Data files of wheels and soils: what is read, and what is refused with which words."""

from pathlib import Path

import pytest

from drivers.errors import ConfigError, ModelError
from sim_backends.terramechanics.soil.library import (
    SoilSettings,
    WheelSettings,
    library_names,
    load_soil,
    load_wheel,
    parse_settings,
)
from sim_backends.terramechanics.soil.quantity import check_range

WHEEL = 'source = "test"\nradius_m = 0.1\nwidth_m = 0.05\n'
SOIL = """source = "test"
cohesion_pa = 0.0
friction_angle_deg = 38.0
density_kg_m3 = 1490.0
shear_modulus_m = 0.0283
greatest_stress = [0.40, 0.15]
exit_polynomial = [0.82, -1.95, 2.10]
pressure = { law = "reece", k_c = 0.0, k_phi = 122.73, exponent = 1.703 }
"""


def test_paper_001_is_table_iii() -> None:
    wheel, soil = load_wheel("paper_001"), load_soil("toyoura")
    assert (wheel.radius_m, wheel.width_m) == (0.097, 0.100)
    assert soil == parse_settings(SOIL.replace('"test"', f'"{soil.source}"', 1), "text", SoilSettings)


def test_every_shipped_file_can_be_read_and_names_its_source() -> None:
    for name in library_names("wheels"):
        assert load_wheel(name).source
    for name in library_names("soils"):
        assert load_soil(name).source


def test_a_file_by_path(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(WHEEL, "utf-8")
    assert load_wheel(path).width_m == 0.05


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("0.1", "-0.1"), ["radius_m is -0.1 m", "0.001 .. 5 m"]),
        (("0.1", "nan"), ["radius_m", "finite"]),
        (("radius_m", "radius"), ["radius_m", "required"]),
        (("width_m", "colour = 1\nwidth_m"), ["colour", "not permitted"]),
        (("= 0.1", "="), ["TOML"]),
    ],
)
def test_a_wrong_wheel_is_named(change: tuple[str, str], words: list[str]) -> None:
    with pytest.raises(ConfigError) as raised:
        parse_settings(WHEEL.replace(*change), "mine.toml", WheelSettings)
    for word in ["mine.toml", *words]:
        assert word in str(raised.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("1.703", "-1.703"), ["exponent is -1.703", "0.2 .. 4"]),
        (("38.0", "0.66"), ["friction_angle_deg is 0.66 deg", "1 .. 60 deg"]),
        (("1490.0", "-1.0"), ["density_kg_m3 is -1 kg/m^3"]),
        (("0.0283", "28.3"), ["shear_modulus_m is 28.3 m"]),
        (('"reece"', '"newton"'), ["pressure", "newton"]),
    ],
)
def test_a_wrong_soil_is_named(change: tuple[str, str], words: list[str]) -> None:
    with pytest.raises(ConfigError) as raised:
        parse_settings(SOIL.replace(*change), "mine.toml", SoilSettings)
    for word in ["mine.toml", *words]:
        assert word in str(raised.value)


def test_unknown_names_list_the_known_ones() -> None:
    with pytest.raises(ConfigError, match=r"moon_cheese.*toyoura"):
        load_soil("moon_cheese")
    with pytest.raises(ConfigError, match="cannot be read"):
        load_wheel("nowhere/wheel.toml")


def test_degrees_for_radians_are_recognised() -> None:
    with pytest.raises(ModelError, match=r"slip_angle_rad is 20 rad.*degrees\? 20 deg is 0\.3491 rad"):
        check_range("slip_angle_rad", [0.1, 20.0], "rad", -1.5, 1.5)
    with pytest.raises(ModelError, match="nan"):
        check_range("load_n", float("nan"), "N", 0.0, 1.0)
