"""Pressure of a plate over its sinkage by the power law k z^n, and its fit to plate tests."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize, stats

from drivers.errors import ModelError
from sim_backends.arrays import Array
from sim_backends.terramechanics.soil.quantity import check_range

LEAST_POINTS = 10
"""Points of one plate test that its fit needs."""


def power_pressure_pa(sinkage_m: ArrayLike, modulus_pa: float, exponent: float) -> Array:
    """Return the pressure k z^n in Pa, shaped as the sinkage.

    Args:
        sinkage_m: At least 0.
        modulus_pa: k, above 0, Pa / m^n.
        exponent: n, 0.2 to 4.

    Raises:
        ModelError: A number is out of range.
    """
    check_range("sinkage_m", sinkage_m, "m", 0.0, 10.0)
    check_range("modulus_pa", modulus_pa, "Pa/m^n", 1e-3, 1e15)
    check_range("exponent", exponent, "1", 0.2, 4.0)
    pressure: Array = modulus_pa * np.asarray(sinkage_m, dtype=np.float64) ** exponent
    return pressure


class PlateTest(NamedTuple):
    """One plate pressed into level soil.

    Attributes:
        name: Name of the test.
        diameter_m: Diameter of the round plate.
        sinkage_m: Sinkage below the surface, one value per sample; above 0.
        pressure_pa: Force over area of the plate; above 0.
    """

    name: str
    diameter_m: float
    sinkage_m: Array
    pressure_pa: Array


class Interval(NamedTuple):
    """A value with its 95 % confidence interval, in the value's unit."""

    value: float
    lower: float
    upper: float


class PlateFit(NamedTuple):
    """The power law k z^n of a soil, from several plate tests.

    Attributes:
        modulus_pa: k, Pa / m^n; the geometric mean of the tests.
        exponent: n.
        size_exponent: Power of the plate's diameter with which the pressure at one sinkage grows; None where
            all plates have one size. Bekker's and Reece's laws with positive moduli cannot reproduce a value
            above 0.
        covariance: Covariance of the estimates of ln k and n, 2 x 2.
        moduli_pa: k of each test.
        exponents: n of each test.
    """

    modulus_pa: Interval
    exponent: Interval
    size_exponent: Interval | None
    covariance: Array
    moduli_pa: Array
    exponents: Array


def fit_plates(tests: Sequence[PlateTest]) -> PlateFit:
    """Return the power law k z^n with 95 % confidence intervals.

    Each test is fitted by least squares in pressure. Samples of one test are not independent, so the
    intervals come from the scatter between tests (Student's t).

    Args:
        tests: At least 3 tests.

    Raises:
        ModelError: Too few tests or points, or a number is out of range.
    """
    if len(tests) < 3:
        raise ModelError(f"plate tests: {len(tests)} given, at least 3 are needed for a confidence interval")
    single = np.array([_fit_one(test) for test in tests])
    mean = single.mean(axis=0)
    covariance = np.cov(single.T) / len(tests)
    half = stats.t.ppf(0.975, len(tests) - 1) * np.sqrt(np.diag(covariance))
    modulus = Interval(*(float(np.exp(value)) for value in (mean[0], mean[0] - half[0], mean[0] + half[0])))
    exponent = Interval(float(mean[1]), float(mean[1] - half[1]), float(mean[1] + half[1]))
    return PlateFit(
        modulus, exponent, _size_exponent(tests, single), covariance, np.exp(single[:, 0]), single[:, 1]
    )


def _fit_one(test: PlateTest) -> tuple[float, float]:
    """Return ln k and n of one test."""
    check_range(f"{test.name}: diameter_m", test.diameter_m, "m", 1e-3, 5.0)
    check_range(f"{test.name}: sinkage_m", test.sinkage_m, "m", 1e-9, 5.0)
    check_range(f"{test.name}: pressure_pa", test.pressure_pa, "Pa", 1e-9, 1e9)
    if len(test.sinkage_m) < LEAST_POINTS or len(test.sinkage_m) != len(test.pressure_pa):
        raise ModelError(
            f"{test.name}: {len(test.sinkage_m)} sinkages and {len(test.pressure_pa)} pressures given,"
            f" equally many and at least {LEAST_POINTS} are needed"
        )
    log_sinkage = np.log(test.sinkage_m)
    slope, level = np.polyfit(log_sinkage, np.log(test.pressure_pa), 1)
    scale = float(np.max(test.pressure_pa))

    def misfit(parameters: Array) -> Array:
        model = np.exp(parameters[0] + parameters[1] * log_sinkage)
        return np.asarray((model - test.pressure_pa) / scale, dtype=np.float64)

    fit = optimize.least_squares(misfit, np.array([level, slope]), x_scale=np.array([1.0, 0.1]))
    return float(fit.x[0]), float(fit.x[1])


def _size_exponent(tests: Sequence[PlateTest], single: Array) -> Interval | None:
    """Return the power of the plate's diameter in the pressure at the tests' common sinkage."""
    sizes = np.log([test.diameter_m for test in tests])
    if np.ptp(sizes) < 1e-6:
        return None
    common = np.log(min(float(np.max(test.sinkage_m)) for test in tests))
    line = stats.linregress(sizes, single[:, 0] + single[:, 1] * common)
    half = stats.t.ppf(0.975, len(tests) - 2) * line.stderr
    return Interval(float(line.slope), float(line.slope - half), float(line.slope + half))
