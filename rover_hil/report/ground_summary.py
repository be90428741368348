"""Slip that a camera measured over the ground, in numbers."""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from rover_hil.drives.arrays import rms
from rover_hil.report.run_data import GroundData
from rover_hil.report.tracks import Series, running_mean


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundSummary:
    """Motion over the ground by a camera; None where unknown.

    Attributes:
        slip: Mean measured slip ratio.
        slip_sd: Its mean reported standard deviation.
        slip_error_rms: Root mean square of measured minus true slip, both averaged over half a second.
        valid_share: Share of the cycles in which the motion was measured.
        invalid_share: Share of the cycles in which it was not, by reason.
        unconfirmed: What the run has not confirmed about the camera, and how it does; empty for nothing.
    """

    slip: float | None
    slip_sd: float | None
    slip_error_rms: float | None
    valid_share: float
    invalid_share: dict[str, float]
    unconfirmed: str = ""


def summarise_ground(ground: GroundData | None, true_slip: Series | None) -> GroundSummary | None:
    """Return the numbers of a run; None without a camera that measures the motion over the ground."""
    if ground is None:
        return None
    count = len(ground.reasons)
    invalid = Counter(reason for reason in ground.reasons if reason)
    known = np.isfinite(ground.slip.value)
    return GroundSummary(
        slip=float(ground.slip.value[known].mean()) if known.any() else None,
        slip_sd=float(ground.slip_sd[known].mean()) if known.any() else None,
        slip_error_rms=None if true_slip is None else _error_rms(ground.slip, true_slip),
        valid_share=1.0 - sum(invalid.values()) / count,
        invalid_share={reason: cycles / count for reason, cycles in invalid.most_common()},
        unconfirmed=ground.unconfirmed,
    )


def _error_rms(measured: Series, true: Series) -> float | None:
    mean = running_mean(measured)
    error = mean.value - np.interp(mean.t_s, true.t_s, true.value)
    known = error[np.isfinite(error)]
    return rms(known) if len(known) else None
