"""Fit slip maps of one wheel to windows of measured runs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.slip_map import Feature, MonotoneMap, PolynomialMap, TractionMap, WheelMap
from drivers.errors import ConfigError, LogError
from rover_hil.drives.arrays import Array
from rover_hil.identify.slip.parameters import SLIP_FIT
from rover_hil.identify.slip.run_data import RunWindows

POINT_DECIMALS = 4
LEAST_SPAN = 10.0 ** (1 - POINT_DECIMALS)


@dataclass(frozen=True, slots=True)
class WheelSamples:
    """Usable wheel windows of many runs: slip against each feature, positive where the motor drives."""

    slip: Array
    paper_torque_nm: Array
    current_a: Array
    wheel_torque_nm: Array

    def feature(self, name: Feature) -> Array:
        """Return one feature."""
        values: Array = getattr(self, name)
        return values


def collect_samples(runs: Sequence[RunWindows], m_per_px: float) -> WheelSamples:
    """Return the slip s = (w - w_eff) / max(|w|, |w_eff|, w_e) of every usable wheel and window.

    Raises:
        LogError: There are too few, or all have the same effort.
    """
    columns: list[Array] = []
    for run in runs:
        speed, effective = run.wheel_speed_rad_s, run.camera_wheel_speed_rad_s(m_per_px)
        greatest = np.maximum(np.maximum(np.abs(speed), np.abs(effective)), EFFORT.motor.slowest_rad_s)
        forward = np.sign(speed)
        # s is the share of the wheel's own motion that is lost: for a wheel that turns backwards too.
        slip = forward * (speed - effective) / greatest
        usable = run.usable & (np.abs(speed) >= EFFORT.motor.slowest_rad_s)
        features = (run.paper_torque_nm, run.current_a, run.wheel_torque_nm)
        columns.append(np.stack([slip[usable], *((forward * values)[usable] for values in features)]))
    table = np.concatenate(columns, axis=1)
    if table.shape[1] < SLIP_FIT.wheel.least_samples:
        raise LogError(
            f"{len(runs)} training runs hold {table.shape[1]} usable wheel windows, fewer than "
            f"{SLIP_FIT.wheel.least_samples}: give more runs, with currents below the sensor's end"
        )
    samples = WheelSamples(*table)
    for name in ("current_a", "paper_torque_nm", "wheel_torque_nm"):
        low, high = valid_range(getattr(samples, name))
        if high - low < LEAST_SPAN:
            raise LogError(
                f"the training runs all have a {name} of {low:.3g}: give runs with different efforts"
            )
    return samples


def fit_wheel_maps(samples: WheelSamples) -> dict[str, WheelMap]:
    """Return every form of map, by name; `linear_m` is the paper's.

    Raises:
        ConfigError: scikit-learn is not installed.
    """
    fits: Mapping[str, tuple[Callable[[WheelSamples, Feature], WheelMap], Feature]] = {
        "linear_m": (fit_support_vector_line, "paper_torque_nm"),
        "linear_i": (fit_line, "current_a"),
        "quadratic_m": (fit_parabola, "paper_torque_nm"),
        "isotonic_m": (fit_monotone, "paper_torque_nm"),
        "isotonic_torque": (fit_monotone, "wheel_torque_nm"),
        "traction_torque": (fit_traction, "wheel_torque_nm"),
    }
    return {name: fit(samples, feature) for name, (fit, feature) in fits.items()}


def fit_support_vector_line(samples: WheelSamples, feature: Feature) -> PolynomialMap:
    """Fit a line by support vector regression with a linear kernel, as in paper 003, section 2.2.

    Margin and penalty are a tenth of a robust standard deviation of the slip, and one of it: what the tool of
    the paper's authors takes by default.
    """
    try:
        from sklearn.svm import LinearSVR  # type: ignore[import-untyped]
    except ImportError as error:
        raise _scikit_missing() from error
    values, slip = samples.feature(feature), samples.slip
    centre, spread = float(values.mean()), float(values.std())
    deviation = float(np.subtract(*np.quantile(slip, (0.75, 0.25)))) / 1.349
    machine = LinearSVR(
        epsilon=0.1 * deviation,
        C=max(deviation, 0.01),
        max_iter=100_000,
        random_state=0,
        intercept_scaling=10.0,
    )
    machine.fit(((values - centre) / spread)[:, None], slip)
    slope = float(machine.coef_[0]) / spread
    return _polynomial(samples, feature, (float(machine.intercept_[0]) - slope * centre, slope))


def fit_line(samples: WheelSamples, feature: Feature) -> PolynomialMap:
    """Fit a line by least squares."""
    return _fit_polynomial(samples, feature, 1)


def fit_parabola(samples: WheelSamples, feature: Feature) -> PolynomialMap:
    """Fit a parabola by least squares."""
    return _fit_polynomial(samples, feature, 2)


def fit_monotone(samples: WheelSamples, feature: Feature) -> MonotoneMap:
    """Fit a curve that never falls (isotonic regression), kept at some quantiles of the feature."""
    values = samples.feature(feature)
    low, high = valid_range(values)
    points, slips = fit_rising_table(values, samples.slip)
    return MonotoneMap(feature=feature, valid_from=low, valid_to=high, points=points, slips=slips)


def fit_rising_table(values: Array, slip: Array) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return points and slips of the curve over `values` that never falls and fits best.

    Raises:
        ConfigError: scikit-learn is not installed.
    """
    try:
        from sklearn.isotonic import IsotonicRegression  # type: ignore[import-untyped]
    except ImportError as error:
        raise _scikit_missing() from error
    curve = IsotonicRegression(out_of_bounds="clip").fit(values, slip)
    tail = SLIP_FIT.wheel.tail
    # Rounded, so that points stay apart when they are written with few digits.
    points = np.unique(
        np.quantile(values, np.linspace(tail, 1.0 - tail, SLIP_FIT.wheel.table_points)).round(POINT_DECIMALS)
    )
    slips = np.maximum.accumulate(curve.predict(points))
    return tuple(points.tolist()), tuple(slips.tolist())


def fit_traction(samples: WheelSamples, feature: Feature) -> TractionMap:
    """Fit the two parameters of the traction curve by least squares in slip."""
    from scipy.optimize import least_squares

    values = samples.feature(feature)
    low, high = valid_range(values)
    inside = np.clip(values, low, high)

    def residuals(logarithms: Array) -> Array:
        greatest, slip_scale = np.exp(logarithms)
        # Beyond the greatest torque the curve has no slip; 1 is the most there is.
        remaining = np.maximum(1.0 - inside / greatest, np.exp(-1.0 / slip_scale))
        misfit: Array = np.minimum(-slip_scale * np.log(remaining), 1.0) - samples.slip
        return misfit

    fit = least_squares(residuals, np.log([1.5 * high, 0.3]))
    greatest, slip_scale = np.exp(fit.x).tolist()
    return TractionMap(
        feature=feature, valid_from=low, valid_to=high, greatest=greatest, slip_scale=slip_scale
    )


def valid_range(values: Array) -> tuple[float, float]:
    """Return the range that holds nearly all training values."""
    tail = SLIP_FIT.wheel.tail
    low, high = np.quantile(values, (tail, 1.0 - tail)).tolist()
    return low, high


def _fit_polynomial(samples: WheelSamples, feature: Feature, degree: int) -> PolynomialMap:
    factors = np.polynomial.Polynomial.fit(samples.feature(feature), samples.slip, degree).convert().coef
    return _polynomial(samples, feature, tuple(factors.tolist()))


def _polynomial(samples: WheelSamples, feature: Feature, factors: tuple[float, ...]) -> PolynomialMap:
    low, high = valid_range(samples.feature(feature))
    return PolynomialMap(feature=feature, valid_from=low, valid_to=high, coefficients=factors)


def _scikit_missing() -> ConfigError:
    return ConfigError("scikit-learn is not installed: install the extra with `pip install rover-hil[fit]`")
