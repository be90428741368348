import numpy as np
import pytest

from drivers.errors import ModelError
from sim_backends.terramechanics.soil.pressure_sinkage import (
    PlateTest,
    fit_plates,
    power_pressure_pa,
)

MODULUS_PA, EXPONENT = 5e6, 1.3


def plates(
    generator: np.random.Generator, count: int, scatter: float, diameter_m: float = 0.08
) -> list[PlateTest]:
    """Return tests whose strength scatters from one to the next, as in re-prepared sand."""
    tests = []
    for index in range(count):
        modulus = MODULUS_PA * np.exp(scatter * generator.normal())
        exponent = EXPONENT + 0.2 * scatter * generator.normal()
        sinkage = np.linspace(0.001, 0.03, 200)
        noise = 50.0 * generator.normal(size=200)
        tests.append(
            PlateTest(f"plate {index}", diameter_m, sinkage, modulus * sinkage**exponent + noise + 200.0)
        )
    return tests


def test_the_power_law_by_hand() -> None:
    assert power_pressure_pa([0.0, 0.01], 2e6, 1.0) == pytest.approx([0.0, 2e4])


def test_an_exact_law_is_found_exactly() -> None:
    sinkage = np.linspace(0.001, 0.03, 50)
    tests = [PlateTest(str(i), 0.06 + 0.01 * i, sinkage, MODULUS_PA * sinkage**EXPONENT) for i in range(4)]
    fit = fit_plates(tests)
    assert fit.modulus_pa.value == pytest.approx(MODULUS_PA, rel=1e-6)
    assert fit.exponent.value == pytest.approx(EXPONENT, rel=1e-6)
    assert fit.size_exponent is not None
    assert fit.size_exponent.value == pytest.approx(0.0, abs=1e-6)


def test_size_exponent_finds_pressure_in_proportion_to_diameter_at_the_common_sinkage() -> None:
    sinkage = np.linspace(0.001, 0.03, 50)
    exponents = {0.06: 1.2, 0.08: 1.6, 0.1: 1.3}
    tests = [
        PlateTest(str(size), size, sinkage, 1e6 * size * (sinkage / 0.03) ** n)
        for size, n in exponents.items()
    ]
    found = fit_plates(tests).size_exponent
    assert found is not None
    assert found.value == pytest.approx(1.0, abs=1e-6)
    assert fit_plates([tests[0]] * 3).size_exponent is None


def test_intervals_hold_the_truth_in_95_of_100_campaigns() -> None:
    generator = np.random.default_rng(4)
    held = []
    for _ in range(200):
        sinkage = np.linspace(0.001, 0.03, 40)
        tests = []
        for index in range(6):
            modulus = MODULUS_PA * np.exp(0.2 * generator.normal())
            exponent = EXPONENT + 0.05 * generator.normal()
            tests.append(PlateTest(str(index), 0.08, sinkage, modulus * sinkage**exponent))
        fit = fit_plates(tests)
        held.append(
            [
                fit.modulus_pa.lower <= MODULUS_PA <= fit.modulus_pa.upper,
                fit.exponent.lower <= EXPONENT <= fit.exponent.upper,
            ]
        )
    share = np.mean(held, axis=0)
    assert np.all((share > 0.91) & (share < 0.985)), share


def test_too_little_data_is_refused() -> None:
    tests = plates(np.random.default_rng(1), 3, 0.1)
    with pytest.raises(ModelError, match="at least 3"):
        fit_plates(tests[:2])
    short = tests[0]._replace(sinkage_m=tests[0].sinkage_m[:5])
    with pytest.raises(ModelError, match="plate 0: 5 sinkages"):
        fit_plates([short, *tests[1:]])
    wrong = tests[0]._replace(pressure_pa=-tests[0].pressure_pa)
    with pytest.raises(ModelError, match="pressure_pa"):
        fit_plates([wrong, *tests[1:]])


@pytest.mark.parametrize(
    ("sinkage", "modulus", "exponent"), [(-0.1, 1e6, 1.0), (0.1, -1.0, 1.0), (0.1, 1e6, -1.0)]
)
def test_numbers_out_of_range_are_refused(sinkage: float, modulus: float, exponent: float) -> None:
    with pytest.raises(ModelError, match="outside"):
        power_pressure_pa(sinkage, modulus, exponent)
