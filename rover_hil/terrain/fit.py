"""Soil numbers from plate tests and wheel tests, with 95 % confidence intervals."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import optimize, stats

from drivers.errors import ModelError
from rover_hil.drives.arrays import Array, rms
from rover_hil.parallel.calls import HERE, Calls
from rover_hil.terrain.fit_data import WheelTests
from sim_backends.terramechanics.soil.any_angle_wheel import (
    AnyAngleSoil,
    any_angle_at_load,
    any_angle_forces,
    deepest_sinkage_m,
)
from sim_backends.terramechanics.soil.library import WheelSettings
from sim_backends.terramechanics.soil.pressure_sinkage import Interval, PlateFit, PlateTest, fit_plates

FORCE_ERROR_N = 2.0
SINKAGE_ERROR_M = 0.005
"""How far the law may be off: the weights of forces and sinkage in the fit."""
NOT_CARRIED = 10.0
"""Misfit, in errors, of a trial whose load the soil can just not carry."""


class Free(NamedTuple):
    """A number that the fit may move.

    Attributes:
        lower: Least value.
        upper: Greatest value.
        spread: Standard deviation of what is known before, about the start value; a weak prior that keeps a
            fit to few cells from running off.
        logarithmic: Whether it is fitted in its logarithm; `spread` is then one of the logarithm.
    """

    lower: float
    upper: float
    spread: float
    logarithmic: bool = False


FREE: Mapping[str, Free] = {
    "plate_modulus_pa": Free(1e5, 1e9, 2.0, logarithmic=True),
    "plate_exponent": Free(0.5, 2.5, 0.5),
    "rim_friction_deg": Free(5.0, 45.0, 5.0),
    "shear_modulus_m": Free(5e-4, 0.1, 1.0, logarithmic=True),
    "greatest_stress": Free(0.02, 0.9, 0.2),
    "exit_share": Free(0.0, 0.95, 0.3),
    "slide_number": Free(0.1, 100.0, 1.0, logarithmic=True),
    "push_number": Free(0.1, 300.0, 1.0, logarithmic=True),
    "wake_rate": Free(0.1, 100.0, 1.0, logarithmic=True),
    "press_exponent": Free(0.2, 5.0, 0.5),
    "sideways_exponent": Free(0.05, 3.0, 0.5),
    "wall_number": Free(0.5, 300.0, 1.0, logarithmic=True),
    "wall_exponent": Free(0.0, 2.0, 0.3),
    "wall_friction": Free(0.0, 1.0, 0.2),
    "wall_drag": Free(-0.5, 0.5, 0.2),
}
"""All numbers that can be fitted to wheel tests, with their bounds."""


class SoilFit(NamedTuple):
    """Results of plate and wheel tests of a soil.

    Attributes:
        soil: Fitted numbers; those not fitted are the start's.
        intervals: 95 % confidence intervals of the fitted numbers, in their units. They hold if the law is
            right and cells err independently; where the law is wrong, the truth may lie outside.
        at_bound: Fitted numbers that ended at a bound: their intervals are not valid.
        plates: The fit of the plates alone.
        cells: How many wheel cells were used.
        residual: Root mean square of the weighted misfits; 1 where the law is as good as its stated errors.
    """

    soil: AnyAngleSoil
    intervals: dict[str, Interval]
    at_bound: tuple[str, ...]
    plates: PlateFit
    cells: int
    residual: float

    @property
    def of_tests(self) -> dict[str, Interval]:
        """Intervals of all numbers that are of tests: the fitted ones, and those of the plates."""
        return intervals_of_plates(self.plates) | self.intervals


def intervals_of_plates(plates: PlateFit) -> dict[str, Interval]:
    """Return the intervals of what plates determine, by key of the soil."""
    return {"plate_modulus_pa": plates.modulus_pa, "plate_exponent": plates.exponent}


def soil_of_plates(start: AnyAngleSoil, plates: PlateFit) -> AnyAngleSoil:
    """Return the start with k and n of the plates."""
    constants = {"plate_modulus_pa": plates.modulus_pa.value, "plate_exponent": plates.exponent.value}
    return start.model_copy(update=constants)


def fit_soil(
    plate_tests: Sequence[PlateTest],
    wheel_tests: WheelTests | None,
    wheel: WheelSettings,
    start: AnyAngleSoil,
    free: Sequence[str] = tuple(FREE),
    calls: Calls = HERE,
) -> SoilFit:
    """Fit a soil to plate tests and, where given, to wheel tests at their measured loads.

    The plates' k and n with their covariance count as a measurement, as do the wheel's forces and sinkages
    (means over replicates). The start values count as a weak prior (`Free.spread`).

    Args:
        plate_tests: At least 3.
        wheel_tests: Of one wheel; None fits the plates alone.
        wheel: That wheel.
        start: Start values, and the values of what is not fitted.
        free: Names out of `FREE`.
        calls: Makes the evaluations of each derivative.

    Raises:
        ModelError: Too few tests, an unknown name, or a number is out of range.
    """
    plates = fit_plates(plate_tests)
    begin = soil_of_plates(start, plates)
    if wheel_tests is None:
        return SoilFit(begin, intervals_of_plates(plates), (), plates, 0, float("nan"))
    unknown = sorted(set(free) - set(FREE))
    if unknown:
        raise ModelError(
            f"free: '{unknown[0]}' is no number that can be fitted; give some of {', '.join(FREE)}"
        )
    means = wheel_tests.means()
    if 3 * len(means.cell) <= len(free):
        raise ModelError(f"wheel tests: {len(means.cell)} cells are too few to fit {len(free)} numbers")
    solution = _least_squares(_make_misfit(means, wheel, begin, free, plates), begin, free, calls)
    return _result(solution, begin, free, plates, len(means.cell))


@dataclass(frozen=True, slots=True)
class _Misfit:
    """Misfits over the coordinates of the free numbers; a class, so that it can be sent to other machines.

    Attributes:
        root: Square root of the inverse covariance of `middle`.
        middle: Logarithm of the plates' modulus, and their exponent.
        start, spread: Of the prior.
    """

    tests: WheelTests
    wheel: WheelSettings
    begin: AnyAngleSoil
    free: Sequence[str]
    root: Array
    middle: Array
    start: Array
    spread: Array

    def __call__(self, coordinates: Array) -> Array:
        tests, wheel = self.tests, self.wheel
        soil = _soil(self.begin, self.free, coordinates)
        sinkage, forces = any_angle_at_load(wheel, soil, tests.motion, tests.load_n)
        lost = NOT_CARRIED + (tests.load_n - _greatest_load_n(wheel, soil, tests)) / FORCE_ERROR_N
        parts = (
            (forces.drawbar_n - tests.drawbar_n) / FORCE_ERROR_N,
            (forces.side_n - tests.side_n) / FORCE_ERROR_N,
            np.where(np.isnan(sinkage), lost, (sinkage - tests.sinkage_m) / SINKAGE_ERROR_M),
        )
        plate = self.root @ (np.array([np.log(soil.plate_modulus_pa), soil.plate_exponent]) - self.middle)
        prior = (coordinates - self.start) / self.spread
        return np.concatenate([*(np.nan_to_num(part, nan=NOT_CARRIED) for part in parts), plate, prior])


def _make_misfit(
    tests: WheelTests, wheel: WheelSettings, begin: AnyAngleSoil, free: Sequence[str], plates: PlateFit
) -> _Misfit:
    if not np.isfinite(np.linalg.cond(plates.covariance)):
        raise ModelError("plate tests: they do not differ enough to estimate their scatter; give other tests")
    return _Misfit(
        tests,
        wheel,
        begin,
        tuple(free),
        root=np.linalg.cholesky(np.linalg.inv(plates.covariance)).T,
        middle=np.array([np.log(plates.modulus_pa.value), plates.exponent.value]),
        start=np.array([_to(name, getattr(begin, name)) for name in free]),
        spread=np.array([FREE[name].spread for name in free]),
    )


def _greatest_load_n(wheel: WheelSettings, soil: AnyAngleSoil, tests: WheelTests) -> Array:
    deepest = np.full(tests.load_n.shape, deepest_sinkage_m(wheel))
    return any_angle_forces(wheel, soil, tests.motion, deepest).vertical_n


def _least_squares(
    misfit: Callable[[Array], Array], begin: AnyAngleSoil, free: Sequence[str], calls: Calls
) -> optimize.OptimizeResult:
    bounds = np.array([[_to(name, FREE[name].lower), _to(name, FREE[name].upper)] for name in free])
    values = np.array([_to(name, getattr(begin, name)) for name in free])
    inside = np.clip(values, bounds[:, 0] + 1e-6, bounds[:, 1] - 1e-6)
    return optimize.least_squares(
        misfit,
        inside,
        bounds=bounds.T,
        x_scale=0.1 * np.ptp(bounds, axis=1),
        diff_step=1e-5,
        max_nfev=100,
        workers=calls.map,
    )


def _result(
    solution: optimize.OptimizeResult, begin: AnyAngleSoil, free: Sequence[str], plates: PlateFit, cells: int
) -> SoilFit:
    spare = len(solution.fun) - 2 * len(free)
    variance = 2 * solution.cost / spare
    root = np.linalg.pinv(solution.jac)
    half = stats.t.ppf(0.975, spare) * np.sqrt(variance * np.sum(root**2, axis=1))
    intervals = {
        name: Interval(*(_from(name, value) for value in (middle, middle - reach, middle + reach)))
        for name, middle, reach in zip(free, solution.x, half, strict=True)
    }
    at_bound = tuple(name for name, active in zip(free, solution.active_mask, strict=True) if active)
    residual = rms(solution.fun)
    return SoilFit(_soil(begin, free, solution.x), intervals, at_bound, plates, cells, residual)


def _soil(begin: AnyAngleSoil, free: Sequence[str], coordinates: Array) -> AnyAngleSoil:
    update = {name: _from(name, value) for name, value in zip(free, coordinates, strict=True)}
    return begin.model_copy(update=update)


def _to(name: str, value: float) -> float:
    return float(np.log(value)) if FREE[name].logarithmic else float(value)


def _from(name: str, coordinate: float) -> float:
    return float(np.exp(coordinate)) if FREE[name].logarithmic else float(coordinate)
