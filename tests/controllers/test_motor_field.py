"""The field of motor currents is taken out of a compass heading."""

import cmath
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from controllers.control_loop import ControlLoop
from controllers.estimation.headings.motor_field import MotorCurrents, without_motor_field
from controllers.estimation.settings import FilterSettings, MotorFields
from controllers.safety import Mode
from drivers.samples import HeadingReference, HeadingSample, Sample, WheelSample
from tests.controllers.simulated import (
    LONG_WAY,
    MS,
    ROLES,
    SECOND_NS,
    START_NS,
    make_settings,
    omni_rover,
    run,
)

FIELDS = MotorFields(
    source="x",
    identified_on="2026-05-04",
    device="compass",
    per_ampere=((0.2, 0.0), (0.0, 0.1), (0.0, 0.0)),
)
CURRENTS_A = (2.0, -3.0, 0.0)


def shown_yaw_rad(yaw_rad: float, ahead: float, left: float) -> float:
    """Return the yaw that a compass shows: the earth's field points to 90 deg of the world."""
    north = 1j + complex(ahead, left) * cmath.rect(1.0, yaw_rad)
    return yaw_rad - (cmath.phase(north) - math.pi / 2)


def test_a_heading_is_corrected_exactly() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        yaw_rad, direction = rng.uniform(-math.pi, math.pi, 2)
        ahead, left = (rng.uniform(0.0, 0.85) * each for each in (math.cos(direction), math.sin(direction)))
        found = without_motor_field(shown_yaw_rad(yaw_rad, ahead, left), ahead, left)
        assert found is not None
        assert math.remainder(found - yaw_rad, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert without_motor_field(0.3, 0.7, 0.7) is None


def current(
    wheel: int, amperes: float, t_ns: int = START_NS, speed_rad_s: float | None = None
) -> WheelSample:
    return WheelSample(
        device="wheels",
        t_ns=t_ns,
        wheel=wheel,
        current_a=amperes,
        speed_rad_s=speed_rad_s,
        current_is_signed=speed_rad_s is None,
    )


def test_currents_have_the_sign_of_the_speed_and_an_age() -> None:
    currents = MotorCurrents(2, 0.0, 0.1)
    currents.take(current(0, 1.5, speed_rad_s=-2.0), START_NS)
    assert currents.at(START_NS) is None
    currents.take(current(1, -0.5), START_NS)
    assert currents.at(START_NS + 100 * MS) == (-1.5, -0.5)
    assert currents.at(START_NS + 101 * MS) is None
    currents.take(current(7, 1.0), START_NS)  # no motor of this rover


def test_currents_are_smoothed_as_the_compass_is() -> None:
    currents = MotorCurrents(1, 0.5, 1.0)
    currents.take(current(0, 0.0), START_NS)
    for step in range(1, 51):
        currents.take(current(0, 1.0), START_NS + step * 10 * MS)
    (smoothed,) = currents.at(START_NS + SECOND_NS // 2) or ()
    assert smoothed == pytest.approx(1.0 - math.exp(-1.0))


def test_the_estimator_corrects_the_compass_and_needs_the_currents() -> None:
    yaw_rad = 1.0
    headings = [
        HeadingSample(
            device="compass", t_ns=START_NS + n * MS, heading_rad=yaw, reference=HeadingReference.MAGNETIC
        )
        for n, yaw in enumerate((yaw_rad, shown_yaw_rad(yaw_rad, 0.4, -0.3)))
    ]
    by_motors_rad = shown_yaw_rad(yaw_rad, 0.4, -0.3) - yaw_rad
    assert by_motors_rad > 0.3
    for settings, expected in ((FilterSettings(), by_motors_rad), (FilterSettings(motor_fields=FIELDS), 0.0)):
        loop = ControlLoop(make_settings(filter_settings=settings), replace(ROLES, required={}))
        loop.step(START_NS, [*(current(wheel, 0.0) for wheel in range(3)), headings[0]])
        moved = [current(0, 2.0), current(1, -3.0), headings[1]]
        (innovation,) = loop.step(START_NS + MS, moved).innovations
        assert innovation.residual == pytest.approx(expected, abs=1e-3)
    without = ControlLoop(
        make_settings(filter_settings=FilterSettings(motor_fields=FIELDS)), replace(ROLES, required={})
    )
    assert without.step(START_NS, [headings[0]]).innovations == ()


def with_motors(reports_current: bool = True) -> Callable[[Sample], Sample]:
    """Return what the motors do from two seconds on: their field at the compass is 0.4 ahead, 0.3 right."""

    def change(sample: Sample) -> Sample:
        is_on = sample.t_ns > START_NS + 2 * SECOND_NS
        if isinstance(sample, WheelSample) and reports_current:
            return replace(sample, current_a=is_on * CURRENTS_A[sample.wheel])
        if isinstance(sample, HeadingSample) and is_on:
            # The simulated compass shows the yaw from an axis of its own.
            return replace(sample, heading_rad=shown_yaw_rad(sample.heading_rad, 0.4, -0.3))
        return sample

    return change


@pytest.mark.parametrize("fields", [None, FIELDS])
def test_stop_rules_compare_corrected_headings_with_the_gyro(fields: MotorFields | None) -> None:
    rover = replace(omni_rover(), mute=with_motors())
    settings = make_settings(mission=LONG_WAY, filter_settings=FilterSettings(motor_fields=fields))
    outputs = run(ControlLoop(settings, ROLES), rover, 5.0)
    reasons = {output.reason for output in outputs[50:] if output.mode is Mode.SAFE_STOP}
    assert (reasons == set()) == (fields is not None)


def test_a_required_heading_that_cannot_be_corrected_stops_the_rover() -> None:
    rover = replace(omni_rover(), mute=with_motors(reports_current=False))
    settings = make_settings(mission=LONG_WAY, filter_settings=FilterSettings(motor_fields=FIELDS))
    outputs = run(ControlLoop(settings, ROLES), rover, 2.0)
    assert outputs[-1].mode is not Mode.RUNNING
    assert "compass: no heading within 0.25 s" in outputs[-1].reason


def test_numbers_that_are_not_finite_have_no_effect() -> None:
    currents = MotorCurrents(1, 0.5, 1.0)
    for step in range(3):
        currents.take(current(0, (1.0, math.nan, 1.0)[step]), START_NS + step * MS)
    assert currents.at(START_NS + 2 * MS) == (1.0,)
    loop = ControlLoop(
        make_settings(filter_settings=FilterSettings(motor_fields=FIELDS)), replace(ROLES, required={})
    )
    heading = HeadingSample(
        device="compass", t_ns=START_NS, heading_rad=math.inf, reference=HeadingReference.MAGNETIC
    )
    assert loop.step(START_NS, [*(current(wheel, 0.0) for wheel in range(3)), heading]).innovations == ()
