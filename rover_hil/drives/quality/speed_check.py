"""Compares the speed of each wheel of a recorded drive with the change of its angle."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rover_hil.drives.channels import Channels
from rover_hil.drives.quality.drive_paths import LONGEST_S, integrated
from rover_hil.drives.quality.motion import LEAST_WINDOWS, WINDOW_S
from rover_hil.drives.quality.units import SAME_UNIT, unit_of
from rover_hil.recording.findings import FoundFinding

AGREES = 0.3
"""Residual, as a share of the motion, up to which speed and angle agree."""
SPEED_SCALES = (0.8, 1.25)
"""Speed and change of the angle of one wheel agree well: no slip is between them."""
CLOCK_SHARE = 0.004
"""A clock is not named that is wrong by less: integrals of sampled speeds are not better."""
CLOCK_DEVIATIONS = 5.0
LEAST_SD = 0.0005
"""No factor is better known, whatever the residuals say."""
OTHERS = "ticks_per_turn, gear_ratio, radius or unit of the wheels"
COARSE = 0.005
"""A speed with a coarser resolution, as a share of a usual one, may be cut off instead of rounded."""


@dataclass(frozen=True, slots=True)
class _SpeedFit:
    """Speed of a wheel over the change of its angle.

    Attributes:
        ratio: As it is.
        factor: Without what a coarse speed may have been cut off by.
        sd: Standard deviation of the factor.
        residual: Share that the factor leaves.
    """

    wheel: int
    ratio: float
    factor: float
    sd: float
    residual: float


def speed_findings(rows: Channels) -> Iterator[FoundFinding]:
    """Yield wheels whose speed is not the change of their angle, and a clock that all speeds contradict."""
    fits = list(_speed_fits(rows))
    for fit in fits:
        if fit.residual > AGREES:
            what = f"wheel {fit.wheel}: its speed and the change of its angle contradict each other"
            text = f"{what}: an angle that jumps or starts again, or one of another wheel"
            yield FoundFinding(name="speed", t_s=None, text=text)
        if fit.residual <= AGREES and not SPEED_SCALES[0] <= fit.ratio <= SPEED_SCALES[1]:
            others = f"{OTHERS}, or a clock"
            why = "its sign" if abs(fit.ratio + 1.0) <= SAME_UNIT else unit_of(abs(fit.ratio), others)
            text = f"wheel {fit.wheel}: its speed is {fit.ratio:.4g} times the change of its angle: {why}"
            yield FoundFinding(name="speed", t_s=None, text=text)
    factors, sds = np.array([fit.factor for fit in fits]), np.array([fit.sd for fit in fits])
    if not len(fits) or not ((factors >= SPEED_SCALES[0]) & (factors <= SPEED_SCALES[1])).all():
        return
    weights = 1.0 / np.maximum(sds, LEAST_SD) ** 2
    mean, sd = float(weights @ factors / weights.sum()), float(weights.sum() ** -0.5)
    agree = (np.abs(factors - mean) <= CLOCK_DEVIATIONS * np.maximum(sds, LEAST_SD)).all()
    if agree and abs(mean - 1.0) > max(CLOCK_SHARE, CLOCK_DEVIATIONS * sd):
        text = (
            f"the speeds of all wheels are {mean:.4f} times the changes of their angles, standard deviation "
            f"{sd:.2g}: a clock whose seconds are {1.0 / mean:.4f} s long, or gear_ratio, ticks_per_turn or "
            "radius of one of the two"
        )
        yield FoundFinding(name="clock", t_s=None, text=text)


def _speed_fits(rows: Channels) -> Iterator[_SpeedFit]:
    """Yield the fit of each wheel with speeds and angles that moves enough."""
    wheel = 0
    while f"speed{(wheel := wheel + 1)}_rad_s" in rows:
        speed, angle = rows[f"speed{wheel}_rad_s"], rows[f"position{wheel}_rad"]
        if len(angle) < LEAST_WINDOWS or len(speed) < LEAST_WINDOWS:
            continue
        if angle.t_ns[-1] - angle.t_ns[0] > LONGEST_S * 1e9:
            continue
        edges_ns = np.arange(angle.t_ns[0], angle.t_ns[-1], WINDOW_S * 1e9)
        if len(edges_ns) <= LEAST_WINDOWS:
            continue
        turned = np.diff(np.interp(edges_ns, angle.t_ns, angle.value))
        said = np.diff(np.interp(edges_ns, speed.t_ns, integrated(speed)))
        # Nothing is measured in a gap.
        held = [np.diff(np.searchsorted(each.t_ns, edges_ns)) > 0 for each in (angle, speed)]
        turned, said = (values[held[0] & held[1]] for values in (turned, said))
        if len(turned) < LEAST_WINDOWS or not turned.any() or not said.any():
            continue
        causes = turned[:, np.newaxis]
        levels = np.unique(np.abs(speed.value[speed.value != 0.0]))
        resolution = float(np.diff(levels).min()) if len(levels) > 1 else math.inf
        if resolution > COARSE * float(np.median(levels)):
            # A coarse speed may be cut off, not rounded: a part of it that does not grow with the speed.
            causes = np.column_stack((turned, np.sign(turned)))
        coefficients, _, rank, _ = np.linalg.lstsq(causes, said, rcond=1e-6)
        if rank < causes.shape[1]:
            continue
        residuals = said - causes @ coefficients
        spread = float(residuals @ residuals) / max(1, len(said) - causes.shape[1])
        sd = math.sqrt(spread * float(np.linalg.inv(causes.T @ causes)[0, 0]))
        ratio = float(said @ turned) / float(turned @ turned)
        residual = math.sqrt(float(residuals @ residuals) / float(said @ said))
        yield _SpeedFit(wheel - 1, ratio, float(coefficients[0]), sd, residual)
