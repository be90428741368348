"""Transmission loss of signals of which it is known."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.yaw_excitation import (
    TOO_FEW_READINGS,
    ExcitationResponse,
    YawExcitation,
    YawExcitationMap,
    contact_slip,
    range_problem,
    slip_of,
)
from tests.controllers.slip_maps import PROBE

PERIOD_S = 0.02


def response(
    lost: float,
    *,
    amplitude_rad_s: float = 0.5,
    phase_rad: float = 0.3,
    delay_rad: float = 0.4,
    bias_rad_s: float = 0.0,
    trend_rad_s2: float = 0.0,
    noise_rad_s: float = 0.0,
    period_s: float = PERIOD_S,
    seed: int = 0,
) -> ExcitationResponse:
    """Return the response of the first full window for a gyro that follows the wheels by 1 - lost."""
    probe, rng = YawExcitation(PROBE), np.random.default_rng(seed)
    for step in range(1, 200):
        t_s = step * period_s
        angle = math.tau * PROBE.frequency_hz * t_s + phase_rad
        slow_rad_s = trend_rad_s2 * t_s
        # The wheels give the mean over the period before, the gyro the rate at its end.
        half = math.pi * PROBE.frequency_hz * period_s
        mean = math.sin(half) / half
        wheels = amplitude_rad_s * mean * math.sin(angle - half) + slow_rad_s - 0.5 * trend_rad_s2 * period_s
        gyro = (1.0 - lost) * amplitude_rad_s * math.sin(angle - delay_rad) + slow_rad_s + bias_rad_s
        noise = noise_rad_s * rng.normal(size=2)
        found = probe.step(period_s, wheels + noise[0], gyro + noise[1])
        if found is not None:
            return found
    raise AssertionError("no window became full")


@given(
    lost=st.floats(-0.2, 1.0),
    phase_rad=st.floats(-math.pi, math.pi),
    delay_rad=st.floats(-1.0, 1.0),
    bias_rad_s=st.floats(-0.5, 0.5),
    trend_rad_s2=st.floats(-0.5, 0.5),
)
def test_the_loss_does_not_depend_on_phase_bias_and_trend(
    lost: float, phase_rad: float, delay_rad: float, bias_rad_s: float, trend_rad_s2: float
) -> None:
    found = response(
        lost, phase_rad=phase_rad, delay_rad=delay_rad, bias_rad_s=bias_rad_s, trend_rad_s2=trend_rad_s2
    )
    assert found.reason == ""
    assert found.transmission_loss == pytest.approx(lost, abs=1e-6)


@pytest.mark.parametrize("lost", [0.0, 0.3, 0.8])
def test_noise_does_not_bias_the_loss(lost: float) -> None:
    found = [response(lost, noise_rad_s=0.05, seed=seed) for seed in range(60)]
    assert all(each.reason == "" for each in found)
    values = np.array([each.transmission_loss for each in found])
    assert values.mean() == pytest.approx(lost, abs=0.02)
    # Least squares over 25 readings: 0.05 sqrt(2 / 25) / 0.5 = 0.028 for the gyro, alike for the wheels.
    assert values.std() < 0.045


def test_without_excitation_of_the_wheels_there_is_no_loss() -> None:
    assert response(0.3, amplitude_rad_s=0.1).reason == "the wheels do not shake as asked"
    assert response(0.3, amplitude_rad_s=0.0, trend_rad_s2=1.0).reason == "the wheels do not shake as asked"


def test_other_changes_of_the_yaw_rate_give_no_loss() -> None:
    assert response(0.3, noise_rad_s=0.6).reason == "the yaw rate changes too much besides the shake"


def test_readings_of_a_fast_gyro_in_a_fast_loop_are_counted() -> None:
    found = response(0.3, period_s=0.004)
    assert found.reason == ""
    assert found.transmission_loss == pytest.approx(0.3, abs=1e-6)


def test_few_readings_give_no_loss() -> None:
    assert response(0.3, period_s=0.1).reason == TOO_FEW_READINGS
    probe = YawExcitation(PROBE)
    found = [probe.step(PERIOD_S, math.sin(step), None) for step in range(26)]
    (only,) = [each for each in found if each is not None]
    assert only.reason == TOO_FEW_READINGS


def test_a_window_begins_where_the_one_before_ended() -> None:
    probe = YawExcitation(PROBE)
    ends = [
        step * PERIOD_S
        for step in range(1, 101)
        if probe.step(PERIOD_S, math.sin(math.tau * 5.0 * step * PERIOD_S), 0.0) is not None
    ]
    assert np.diff(ends) == pytest.approx([EFFORT.excitation.window_s] * (len(ends) - 1), abs=PERIOD_S)
    assert len(ends) >= 3


def test_a_window_holds_nothing_of_the_one_before() -> None:
    probe = YawExcitation(PROBE)
    found = []
    for step in range(1, 101):
        angle = math.tau * PROBE.frequency_hz * step * PERIOD_S
        share = 1.0 if step * PERIOD_S <= 1.0 else 0.4
        wheels = 0.5 * math.sin(angle - math.pi * PROBE.frequency_hz * PERIOD_S)
        found.append(probe.step(PERIOD_S, wheels, 0.5 * share * math.sin(angle)))
    losses = [each.transmission_loss for each in found if each is not None]
    mean = np.sinc(PROBE.frequency_hz * PERIOD_S)
    assert (losses[0], losses[-1]) == pytest.approx((1.0 - mean, 1.0 - 0.4 * mean), abs=1e-6)


@settings(max_examples=30)
@given(
    st.lists(
        st.tuples(st.floats(0.001, 0.2), st.floats(-50, 50), st.none() | st.floats(-50, 50)), max_size=80
    )
)
def test_every_response_is_finite(
    readings: list[tuple[float, float, float | None]],
) -> None:
    probe = YawExcitation(PROBE)
    for reading in readings:
        found = probe.step(*reading)
        if found is not None:
            assert math.isfinite(found.transmission_loss)
            assert found.transmission_loss <= 1.0


def test_the_excitation_has_the_set_amplitude_and_frequency() -> None:
    probe = YawExcitation(PROBE)
    t_s = np.arange(0.0, 1.0, 1e-3)
    rates = np.array([probe.yaw_rate_rad_s(float(t)) for t in t_s])
    spectrum = np.abs(np.fft.rfft(rates)) * 2.0 / len(t_s)
    assert int(spectrum.argmax()) == 5
    assert spectrum.max() == pytest.approx(PROBE.amplitude_rad_s, rel=1e-3)


def test_slip_is_held_and_flagged_beyond_the_table() -> None:
    assert [slip_of(PROBE, lost) for lost in (-0.3, 0.0, 0.25, 0.5, 0.9)] == [0.0, 0.0, 0.5, 1.0, 1.0]
    assert [range_problem(PROBE, lost, 0.1j) for lost in (0.0, 0.25, 0.5)] == ["", "", ""]
    assert range_problem(PROBE, 0.9, 0.1j) == "lost share of 0.90 is outside the training range"
    assert range_problem(PROBE, -0.3, 0.1j) == "lost share of -0.30 is outside the training range"


@pytest.mark.parametrize(
    ("travelled_m", "problem"),
    [
        (0.1, ""),
        (0.1 * 1j, "direction 90 deg is outside the training range"),
        (0.01j, ""),
        (0.4, "speed 0.8 m/s is outside the training range"),
    ],
)
def test_other_travel_than_that_of_the_drives_is_flagged(travelled_m: complex, problem: str) -> None:
    probe = PROBE.model_copy(update={"directions_rad": (0.0, math.pi)})
    assert range_problem(probe, 0.2, travelled_m) == problem


@pytest.mark.parametrize(
    ("key", "value"),
    [("frequency_hz", 1.0), ("amplitude_rad_s", 5.0), ("lost", (0.5, 0.0)), ("slips", (1.0, 0.0))],
)
def test_maps_out_of_range_are_rejected(key: str, value: object) -> None:
    with pytest.raises(ValidationError, match=key):
        YawExcitationMap.model_validate({**PROBE.model_dump(by_alias=True), key: value})


@pytest.mark.parametrize("slip", [0.03, 0.1, 0.3])
@pytest.mark.parametrize("speed_m_s", [0.07, 0.13, 0.2])
def test_slip_by_contact_is_that_of_a_linear_contact_with_drag(slip: float, speed_m_s: float) -> None:
    """Drag over the slope of the grip is the slip, s / (1 - s) in the linearised response of the body."""
    lag = 0.5 * speed_m_s / 0.13
    response = 1.0 / (1.0 + slip / (1.0 - slip) + 1j * lag)
    found = contact_slip(response, speed_m_s, 0.06, 0.03)
    assert found.slip == pytest.approx(slip, abs=3.0 * found.sd)
    assert found.sd < 0.2


def test_the_uncertainty_grows_with_slip_lag_and_relaxation() -> None:
    def sd(response: complex, unsure_rad: float = 0.0, unsure_gain: float = 0.0) -> float:
        return contact_slip(response, 0.13, unsure_rad, unsure_gain).sd

    firm, soft = 1.0 / (1.01 + 0.05j), 1.0 / (1.4 + 0.5j)
    assert sd(soft) > 3.0 * sd(firm)
    assert sd(firm, unsure_rad=0.1) > sd(firm)
    assert sd(firm, unsure_gain=0.1) > sd(firm)
    assert sd(1.0 / (0.8 + 0.05j)) > sd(firm) + 0.02


@given(st.complex_numbers(max_magnitude=3.0, allow_nan=False), st.floats(0.0, 1.0))
def test_slip_by_contact_is_a_slip(response: complex, speed_m_s: float) -> None:
    found = contact_slip(response, speed_m_s, 0.06, 0.03)
    assert 0.0 <= found.slip <= 1.0
    assert 0.0 < found.sd < 3.0


def test_a_rover_that_does_not_follow_slips_completely() -> None:
    assert contact_slip(0j, 0.13, 0.0, 0.0).slip > 0.95
