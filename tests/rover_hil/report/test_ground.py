"""What the report says of the slip that a camera measured over the ground."""

from dataclasses import replace

import numpy as np
import pytest

from rover_hil.report.ground_summary import summarise_ground
from rover_hil.report.run_data import GroundData
from rover_hil.report.tracks import Series
from rover_hil.report.verdict import _ground_facts

T_S = np.arange(0.0, 10.0, 0.1)
BLIND = T_S >= 8.0


def measured() -> GroundData:
    """Slip 0.3, not measured in the last fifth."""
    return GroundData(
        slip=Series(T_S, np.where(BLIND, np.nan, 0.3)),
        slip_sd=np.where(BLIND, np.nan, 0.02),
        reasons=["too few points move alike" if blind else "" for blind in BLIND],
    )


def test_what_was_not_measured_counts_for_nothing_but_its_share() -> None:
    summary = summarise_ground(measured(), Series(T_S, np.full(len(T_S), 0.35)))
    assert summary is not None
    assert summary.slip == pytest.approx(0.3)
    assert summary.slip_sd == pytest.approx(0.02)
    assert summary.slip_error_rms == pytest.approx(0.05)
    assert summary.valid_share == pytest.approx(0.8)
    assert summary.invalid_share == {"too few points move alike": pytest.approx(0.2)}
    (fact,) = _ground_facts(summary)
    assert fact.value == "30.0 % ± 2.0 %"
    assert fact.detail == "by the camera, in 80.0 % of the cycles; else: too few points move alike"


def test_a_scale_that_the_run_has_not_confirmed_is_named() -> None:
    note = "scale not confirmed: rotate by 45 deg on the spot"
    summary = summarise_ground(replace(measured(), unconfirmed=note), None)
    assert summary is not None
    (fact,) = _ground_facts(summary)
    assert fact.detail.endswith(f"; {note}")


def test_without_the_truth_no_error_is_told() -> None:
    summary = summarise_ground(measured(), None)
    assert summary is not None
    assert summary.slip_error_rms is None


def test_a_camera_that_saw_nothing_says_so() -> None:
    nothing = np.full(len(T_S), np.nan)
    summary = summarise_ground(
        GroundData(slip=Series(T_S, nothing), slip_sd=nothing, reasons=["no frame"] * len(T_S)), None
    )
    assert summary is not None
    assert summary.slip is None
    (fact,) = _ground_facts(summary)
    assert (fact.value, fact.detail) == ("none", "by the camera, in 0.0 % of the cycles; else: no frame")


def test_without_a_camera_nothing_is_told() -> None:
    assert summarise_ground(None, None) is None
