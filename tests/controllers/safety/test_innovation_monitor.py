"""Measurements that the filter rejects again and again."""

import pytest

from controllers.estimation.filter.guarded_filter import Innovation, Outcome
from controllers.estimation.filter.measurement_model import Measured
from controllers.fault import Cause, Fault, Severity
from controllers.safety.innovation_monitor import InnovationMonitor, InnovationSettings
from drivers.clock import nanoseconds
from tests.controllers.safety.cycles import make_cycle


def innovation(name: str, *, accepted: bool, residual: float | None = 1.0) -> Innovation:
    return Innovation(
        measured=Measured(*name.split(" ", 1)),
        residual=residual,
        variance=1.0,
        nis=1.0,
        outcome=Outcome.ACCEPTED if accepted else Outcome.REJECTED,
    )


REJECTED = innovation("compass", accepted=False)
ACCEPTED = innovation("compass", accepted=True)


class Rejections:
    """An innovation monitor that is fed at given times."""

    def __init__(self) -> None:
        self.monitor = InnovationMonitor(InnovationSettings())

    def at(self, t_s: float, *innovations: Innovation) -> list[Fault]:
        return list(self.monitor.check(make_cycle(now_ns=nanoseconds(t_s), innovations=innovations)))


@pytest.mark.parametrize(("period_s", "stops_after_s"), [(0.02, 2.0), (0.5, 2.0), (1.0, 2.0), (5.0, 10.0)])
def test_rejections_stop_after_two_seconds_and_three_of_them(period_s: float, stops_after_s: float) -> None:
    rejections = Rejections()
    count = round(stops_after_s / period_s)
    for index in range(count):
        (reason,) = rejections.at(index * period_s, REJECTED, innovation("imu", accepted=True))
        assert reason.severity is Severity.SYMPTOM
    (reason,) = rejections.at(count * period_s, REJECTED)
    assert reason == Fault(
        "compass", Cause.CONTRADICTED_ESTIMATE, "compass: contradicts the estimate, rejected for 2 s"
    )


def test_the_time_is_kept_to_the_nanosecond() -> None:
    monitor = InnovationMonitor(InnovationSettings(contradiction_s=2.0))
    for now_ns in (1_000_000_000, 2_000_000_000, 2_999_999_999):
        (reason,) = monitor.check(make_cycle(now_ns=now_ns, innovations=(REJECTED,)))
        assert reason.severity is Severity.SYMPTOM
    (reason,) = monitor.check(make_cycle(now_ns=3_000_000_000, innovations=(REJECTED,)))
    assert reason.severity is Severity.STOP


@pytest.mark.parametrize("contradiction_s", [0.1, 1.999999999, 60.0])
def test_the_third_of_sparse_rejections_stops(contradiction_s: float) -> None:
    monitor = InnovationMonitor(InnovationSettings(contradiction_s=contradiction_s))
    severities = [
        reason.severity
        for t_s in (100.0, 200.0, 300.0)
        for reason in monitor.check(make_cycle(now_ns=nanoseconds(t_s), innovations=(REJECTED,)))
    ]
    assert severities == [Severity.SYMPTOM, Severity.SYMPTOM, Severity.STOP]


def test_one_acceptance_ends_a_contradiction() -> None:
    rejections = Rejections()
    for index in range(4):
        rejections.at(float(index), REJECTED)
    (reason,) = rejections.at(3.5)
    assert reason.severity is Severity.STOP
    assert rejections.at(4.0, ACCEPTED) == []
    (reason,) = rejections.at(5.0, REJECTED)
    assert reason.severity is Severity.SYMPTOM


def test_silence_after_a_rejection_is_no_further_evidence() -> None:
    rejections = Rejections()
    rejections.at(0.0, REJECTED)
    (reason,) = rejections.at(100.0)
    assert reason.severity is Severity.SYMPTOM


def test_a_measurement_that_could_not_be_compared_neither_stops_nor_clears() -> None:
    rejections = Rejections()
    late = innovation("compass", accepted=False, residual=None)
    for index in range(100):
        assert rejections.at(float(index), late) == []
    for t_s in (100.0, 101.0, 102.0):
        (reason,) = rejections.at(t_s, REJECTED, late)
    assert reason.severity is Severity.STOP
