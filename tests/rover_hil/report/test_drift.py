"""What the report says of slip and slip angle of the whole rover."""

import math

import numpy as np
import pytest

from rover_hil.report.drift_summary import summarise_drift
from rover_hil.report.run_data import DriftData
from rover_hil.report.tracks import Series

T_S = np.arange(0.0, 10.0, 0.1)


def told(*, has_truth: bool = True) -> DriftData:
    """Slip 0.1 too small everywhere, slip angle 2 deg off; the wheels stand in the first fifth."""
    true_slip = np.where(T_S < 2.0, np.nan, 0.4)
    true_angle = np.where(T_S < 2.0, np.nan, math.radians(-6.0))
    return DriftData(
        slip=Series(T_S, np.where(T_S < 2.0, 0.9, 0.3)),
        angle=Series(T_S, np.full(len(T_S), math.radians(-8.0))),
        reasons=["no trace" if t_s < 3.0 else "" for t_s in T_S],
        trace=Series(T_S[30::2], np.zeros(35)),
        true_slip=Series(T_S, true_slip) if has_truth else None,
        true_angle=Series(T_S, true_angle) if has_truth else None,
    )


def test_numbers_while_the_wheels_turn() -> None:
    summary = summarise_drift(told())
    assert summary is not None
    assert summary.slip == pytest.approx(0.3)
    assert summary.slip_error_rms == pytest.approx(0.1)
    assert summary.slip_angle_error_rms_deg == pytest.approx(2.0)
    assert summary.greatest_slip_angle_deg == pytest.approx(8.0)
    assert summary.traces == 35
    assert summary.unsure_share == {"no trace": pytest.approx(0.3)}


def test_without_the_truth_no_error_is_told() -> None:
    summary = summarise_drift(told(has_truth=False))
    assert summary is not None
    assert summary.slip == pytest.approx(0.42)
    assert summary.slip_error_rms is None
    assert summary.slip_angle_error_rms_deg is None


def test_a_rover_that_never_moves_has_no_slip() -> None:
    still = told()
    nothing = Series(T_S, np.full(len(T_S), np.nan))
    summary = summarise_drift(
        DriftData(
            slip=still.slip,
            angle=still.angle,
            reasons=still.reasons,
            trace=still.trace,
            true_slip=nothing,
            true_angle=nothing,
        )
    )
    assert summary is not None
    assert summary.slip is None
    assert summary.slip_error_rms is None


def test_nothing_told() -> None:
    assert summarise_drift(None) is None
