"""Scale and bias of the gyro, against the measured yaw, else against the yaw by the corrected wheels."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from rover_hil.drives.arrays import Array
from rover_hil.ready.wheels.geometry import BASES, DELAY
from rover_hil.ready.wheels.trajectory_fit import CONFIDENCE, TrajectoryFit, TrajectoryProblem, deviation

LEAST_SEGMENTS = 3
WIDEST = 0.02
"""Half of the interval of a scale that is shown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroFit:
    """Scale and bias.

    Attributes:
        scale: Rotation by the gyro over that of the reference.
        half_width: Of the 95 % interval of the scale.
        bias_rad_s: Of each drive with a gyro.
        reference: What it was compared with.
    """

    scale: float
    half_width: float
    bias_rad_s: Array
    reference: str

    @property
    def is_shown(self) -> bool:
        """Whether the scale is known well enough to be used."""
        return self.half_width <= WIDEST


def fit_gyro(problem: TrajectoryProblem, fit: TrajectoryFit) -> GyroFit | None:
    """Return scale and bias of the gyro; None without one, or for too few segments.

    The rotation by the gyro in a segment is scale times that of the reference, and bias times time. The yaw
    by the wheels is as uncertain as their base: without a measured yaw nothing distinguishes both.

    Args:
        problem: The drives.
        fit: Numbers of the wheels.
    """
    values = fit.values
    drives = [place for place, drive in enumerate(problem.drives) if drive.gyro_rad is not None]
    segments = [each for each in problem.segments if each.drive in drives]
    if len(segments) < LEAST_SEGMENTS:
        return None
    paths = problem.trajectories(values)
    has_yaw = all(problem.drives[place].truth.yaw_rad is not None for place in drives)
    products = []
    for segment in segments:
        drive, part = problem.drives[segment.drive], slice(segment.first, segment.end)
        t_s = drive.truth.t_s[part]
        yaw_rad = drive.truth.yaw_rad if has_yaw else paths[segment.drive].yaw_rad
        assert yaw_rad is not None  # noqa: S101 all drives have it
        assert drive.gyro_rad is not None  # noqa: S101 they are those with a gyro
        columns = np.zeros((len(t_s), 2 + len(drives)))
        columns[:, 0] = yaw_rad[part]
        columns[:, 1 + drives.index(segment.drive)] = t_s
        columns[:, -1] = np.interp(t_s - values.get(DELAY, 0.0), drive.t_s, drive.gyro_rad)
        columns -= columns.mean(axis=0)
        products.append(np.asarray(columns.T @ columns / len(t_s), np.float64))
    total = np.sum(products, axis=0)
    solved = _solve(total)
    others = np.array([_solve(total - each)[:1] for each in products])
    # Rotations that are no constant rate show the scale; the others show the bias.
    shares = np.array([_unlike_time(each) for each in products])
    support = float(shares.sum() ** 2 / max(float(shares @ shares), 1e-300))
    sd = float(deviation(others)[0])
    own = float(student.ppf(0.5 + 0.5 * CONFIDENCE, max(support - 1.0, 1.0))) * sd
    bases = [each.half_width for each in fit.estimates if each.number.name in BASES and not has_yaw]
    return GyroFit(
        scale=float(solved[0]),
        half_width=math.hypot(own, *bases),
        bias_rad_s=solved[1:],
        reference="measured yaw" if has_yaw else "yaw by the corrected wheels",
    )


def _solve(products: Array) -> Array:
    """Return scale and biases by the products of their columns and of the rotation by the gyro."""
    return np.asarray(np.linalg.lstsq(products[:-1, :-1], products[:-1, -1], rcond=1e-9)[0], np.float64)


def _unlike_time(products: Array) -> float:
    """Return the square of the rotation that a constant rate leaves."""
    time = products[1:-1, 1:-1].trace()
    with_time = float(products[0, 1:-1].sum())
    return float(products[0, 0]) - with_time**2 / max(float(time), 1e-300)
