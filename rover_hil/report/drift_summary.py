"""How the whole rover slipped, in numbers: estimates from trace and tilt."""

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from rover_hil.drives.arrays import rms
from rover_hil.report.run_data import CrabData, DriftData
from rover_hil.report.tracks import Series, Track

LINE_STEPS = 500


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftSummary:
    """Estimates of compensation by trace and tilt; None where unknown.

    Attributes:
        slip: Mean slip ratio while the wheels turned.
        slip_error_rms: Root mean square of estimated minus true slip.
        slip_angle_error_rms_deg: The same of the slip angle.
        greatest_slip_angle_deg: Largest estimate, either way.
        traces: Frames in which the trace was found.
        unsure_share: Share of the cycles in which slip and slip angle were not sure, by reason.
    """

    slip: float | None
    slip_error_rms: float | None
    slip_angle_error_rms_deg: float | None
    greatest_slip_angle_deg: float
    traces: int
    unsure_share: dict[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class CrabSummary:
    """Steering of a rover that crabs.

    Attributes:
        greatest_steering_deg: Largest mean steering angle of the wheels, either way.
        source_share: Share of the driven cycles by what the slip angle came from: trace, tilt, none.
        true_left_of_line_rms_m: Root mean square of the true distance from the line over the distance along
            it; None where unknown, or for a path with corners.
    """

    greatest_steering_deg: float
    source_share: dict[str, float]
    true_left_of_line_rms_m: float | None


def summarise_crab(crab: CrabData | None, truth: Track | None) -> CrabSummary | None:
    """Return the numbers of a run; None where the rover did not crab."""
    if crab is None:
        return None
    sources = Counter(crab.sources)
    left_m = None
    if crab.true_left_of_line is not None and truth is not None:
        along_m = np.maximum.accumulate(truth.x_m)
        steps_m = np.linspace(along_m[0], along_m[-1], LINE_STEPS)
        left_m = rms(np.interp(steps_m, along_m, crab.true_left_of_line.value))
    return CrabSummary(
        greatest_steering_deg=math.degrees(float(np.abs(crab.steering.value).max())),
        source_share={source: cycles / len(crab.sources) for source, cycles in sources.most_common()},
        true_left_of_line_rms_m=left_m,
    )


def summarise_drift(drift: DriftData | None) -> DriftSummary | None:
    """Return the numbers of a run; None without compensation."""
    if drift is None:
        return None
    count = len(drift.reasons)
    unsure = Counter(reason for reason in drift.reasons if reason)
    slip = drift.slip.value
    if drift.true_slip is not None:
        slip = slip[np.isfinite(np.interp(drift.slip.t_s, drift.true_slip.t_s, drift.true_slip.value))]
    angle_rms = _error_rms(drift.angle, drift.true_angle)
    return DriftSummary(
        slip=float(slip.mean()) if len(slip) else None,
        slip_error_rms=_error_rms(drift.slip, drift.true_slip),
        slip_angle_error_rms_deg=None if angle_rms is None else math.degrees(angle_rms),
        greatest_slip_angle_deg=math.degrees(float(np.abs(drift.angle.value).max())),
        traces=len(drift.trace.t_s),
        unsure_share={reason: cycles / count for reason, cycles in unsure.most_common()},
    )


def _error_rms(estimated: Series, true: Series | None) -> float | None:
    if true is None:
        return None
    error = estimated.value - np.interp(estimated.t_s, true.t_s, true.value)
    known = error[np.isfinite(error)]
    return rms(known) if len(known) else None
