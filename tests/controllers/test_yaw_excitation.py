"""Response to the excitation of signals of which it is known."""

import cmath
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from controllers.slip.effort.gyro_response import GyroResponse
from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.yaw_excitation import (
    OTHER_TURNS,
    TOO_FEW_READINGS,
    WHEELS_DO_NOT_FOLLOW,
    ExcitationResponse,
    ExcitationSettings,
    SwingFilter,
    YawExcitation,
    sensor_response,
)

PERIOD_S = 0.02
AMPLITUDE_RAD_S = 0.24
EXCITATION = ExcitationSettings()


def response(
    lost: float,
    *,
    amplitude_rad_s: float = AMPLITUDE_RAD_S,
    phase_rad: float = 0.3,
    delay_rad: float = 0.4,
    bias_rad_s: float = 0.0,
    trend_rad_s2: float = 0.0,
    noise_rad_s: float = 0.0,
    period_s: float = PERIOD_S,
    seed: int = 0,
) -> ExcitationResponse:
    """Return the response of the first full window for a gyro that follows the wheels by 1 - lost."""
    probe, rng = YawExcitation(EXCITATION, AMPLITUDE_RAD_S), np.random.default_rng(seed)
    for step in range(1, 400):
        t_s = step * period_s
        angle = math.tau * EXCITATION.frequency_hz * t_s + phase_rad
        slow_rad_s = trend_rad_s2 * t_s
        # The wheels give the mean over the period before, the gyro the rate at its end.
        half = math.pi * EXCITATION.frequency_hz * period_s
        mean = math.sin(half) / half
        wheels = amplitude_rad_s * mean * math.sin(angle - half) + slow_rad_s - 0.5 * trend_rad_s2 * period_s
        gyro = (1.0 - lost) * amplitude_rad_s * math.sin(angle - delay_rad) + slow_rad_s + bias_rad_s
        noise = noise_rad_s * rng.normal(size=2)
        found = probe.step(period_s, wheels + noise[0], gyro + noise[1])
        if found is not None:
            return found
    raise AssertionError("no window became full")


@given(
    lost=st.floats(-0.2, 0.9),
    phase_rad=st.floats(-math.pi, math.pi),
    delay_rad=st.floats(-1.0, 1.0),
    bias_rad_s=st.floats(-0.5, 0.5),
    trend_rad_s2=st.floats(-0.1, 0.1),
)
def test_loss_and_lag_do_not_depend_on_phase_bias_and_trend(
    lost: float, phase_rad: float, delay_rad: float, bias_rad_s: float, trend_rad_s2: float
) -> None:
    found = response(
        lost, phase_rad=phase_rad, delay_rad=delay_rad, bias_rad_s=bias_rad_s, trend_rad_s2=trend_rad_s2
    )
    assert found.reason == ""
    assert found.share == pytest.approx((1.0 - lost) * cmath.exp(-1j * delay_rad), abs=1e-6)
    assert found.noise < 1e-6


@pytest.mark.parametrize("lost", [0.0, 0.3, 0.8])
def test_noise_does_not_bias_the_share_and_is_reported(lost: float) -> None:
    found = [response(lost, delay_rad=0.0, noise_rad_s=0.03, seed=seed) for seed in range(80)]
    assert all(each.reason == "" for each in found)
    values = np.array([each.share for each in found])
    reported = float(np.mean([each.noise for each in found]))
    assert values.mean() == pytest.approx(1.0 - lost, abs=0.02)
    assert values.real.std() == pytest.approx(reported, rel=0.25)
    assert values.imag.std() == pytest.approx(reported, rel=0.25)


def test_without_excitation_of_the_wheels_there_is_no_share() -> None:
    assert response(0.3, amplitude_rad_s=0.4 * AMPLITUDE_RAD_S).reason == WHEELS_DO_NOT_FOLLOW
    assert response(0.3, amplitude_rad_s=0.0, trend_rad_s2=0.2).reason == WHEELS_DO_NOT_FOLLOW


def test_other_changes_of_the_yaw_rate_give_no_share() -> None:
    assert response(0.3, noise_rad_s=0.3).reason == OTHER_TURNS


def test_readings_of_a_fast_gyro_in_a_fast_loop_are_counted() -> None:
    found = response(0.3, period_s=0.004)
    assert found.reason == ""
    assert abs(found.share) == pytest.approx(0.7, abs=1e-6)


def test_few_readings_give_no_share() -> None:
    assert response(0.3, period_s=0.125).reason == TOO_FEW_READINGS
    probe = YawExcitation(EXCITATION, AMPLITUDE_RAD_S)
    found = [probe.step(PERIOD_S, math.sin(step), None) for step in range(51)]
    (only,) = [each for each in found if each is not None]
    assert only.reason == TOO_FEW_READINGS


@pytest.mark.parametrize("frequency_hz", [1.0, 2.0, 3.0])
def test_windows_hold_whole_periods_one_after_the_other(frequency_hz: float) -> None:
    settings = ExcitationSettings(frequency_hz=frequency_hz)
    probe = YawExcitation(settings, AMPLITUDE_RAD_S)
    ends = [
        step * PERIOD_S for step in range(1, 401) if probe.step(PERIOD_S, math.sin(step), 0.0) is not None
    ]
    periods = np.diff(ends) * frequency_hz
    assert periods == pytest.approx(
        [EFFORT.excitation.periods] * (len(ends) - 1), abs=PERIOD_S * frequency_hz
    )
    assert len(ends) >= 3


def test_a_window_holds_nothing_of_the_one_before() -> None:
    probe = YawExcitation(EXCITATION, AMPLITUDE_RAD_S)
    found = []
    for step in range(1, 201):
        angle = math.tau * EXCITATION.frequency_hz * step * PERIOD_S
        share = 1.0 if step * PERIOD_S <= 2.0 else 0.4
        wheels = AMPLITUDE_RAD_S * math.sin(angle - math.pi * EXCITATION.frequency_hz * PERIOD_S)
        found.append(probe.step(PERIOD_S, wheels, AMPLITUDE_RAD_S * share * math.sin(angle)))
    shares = [abs(each.share) for each in found if each is not None]
    mean = np.sinc(EXCITATION.frequency_hz * PERIOD_S)
    assert (shares[0], shares[-1]) == pytest.approx((mean, 0.4 * mean), abs=1e-6)


@settings(max_examples=30)
@given(
    st.lists(
        st.tuples(st.floats(0.001, 0.2), st.floats(-50, 50), st.none() | st.floats(-50, 50)), max_size=80
    )
)
def test_every_response_is_finite(
    readings: list[tuple[float, float, float | None]],
) -> None:
    probe = YawExcitation(EXCITATION, AMPLITUDE_RAD_S)
    for reading in readings:
        found = probe.step(*reading)
        if found is not None:
            assert cmath.isfinite(found.share)
            assert math.isfinite(found.noise)


def test_the_excitation_has_the_set_amplitude_and_frequency() -> None:
    probe = YawExcitation(EXCITATION, AMPLITUDE_RAD_S)
    t_s = np.arange(0.0, 1.0, 1e-3)
    rates = np.array([probe.yaw_rate_rad_s(float(t)) for t in t_s])
    spectrum = np.abs(np.fft.rfft(rates)) * 2.0 / len(t_s)
    assert int(spectrum.argmax()) == EXCITATION.frequency_hz
    assert spectrum.max() == pytest.approx(AMPLITUDE_RAD_S, rel=1e-3)


@pytest.mark.parametrize(
    ("travel_m_s", "rim_m_s"), [(0.15, 0.03), (0.1, 0.02), (0.3, 0.04), (0.001, 0.005), (None, 0.03)]
)
def test_the_rims_swing_by_a_fifth_of_the_travel_and_never_faster_than_40_mm_s(
    travel_m_s: float | None, rim_m_s: float
) -> None:
    assert EXCITATION.rim_m_s(travel_m_s) == pytest.approx(rim_m_s)
    assert ExcitationSettings(rim_speed_m_s=0.025).rim_m_s(travel_m_s) == 0.025


def test_the_yaw_inertia_is_that_of_a_disc_unless_it_is_given() -> None:
    assert ExcitationSettings(mass_kg=12.0).inertia_kg_m2(0.2) == pytest.approx(0.24)
    assert ExcitationSettings(mass_kg=12.0, body_radius_m=0.1).inertia_kg_m2(0.2) == pytest.approx(0.06)
    assert ExcitationSettings(yaw_inertia_kg_m2=0.3, body_radius_m=0.1).inertia_kg_m2(0.2) == 0.3


@pytest.mark.parametrize(
    ("key", "value"),
    [("frequency_hz", 0.5), ("rim_speed_m_s", 0.041), ("mass_kg", 0.0), ("yaw_inertia_kg_m2", 0.0)],
)
def test_settings_out_of_range_are_rejected(key: str, value: float) -> None:
    with pytest.raises(ValidationError, match=key):
        ExcitationSettings.model_validate({key: value})


def test_the_constants_of_the_sensors_are_taken_out() -> None:
    gyro = GyroResponse(source="by hand", identified_on="2026-01-01", gain=0.9, delay_s=0.03)
    share = sensor_response(2.0, gyro, 0.01)
    assert share == pytest.approx(0.9 * cmath.exp(-1j * math.tau * 2.0 * 0.02) / (1.0 + 0.01j))
    assert sensor_response(2.0, None, 0.0) == 1.0


def follow(*, filtered: bool, delay_s: float = 0.12) -> float:
    """Return the swing under a follower with a delay, over the excitation."""
    swing, gain, period_s = SwingFilter(2.0), 8.0, 0.02
    yaw_rad, waiting, rates = 0.0, [0.0] * round(delay_s / period_s), []
    for step in range(1000):
        t_s = step * period_s
        wanted = -gain * yaw_rad
        if filtered:
            wanted = swing.without_swing(t_s, wanted)
        waiting.append(wanted + 0.24 * math.sin(math.tau * 2.0 * t_s))
        rates.append(waiting.pop(0))
        yaw_rad += rates[-1] * period_s
    return float(np.std(rates[-500:]) * math.sqrt(2.0) / 0.24)


def test_the_follower_does_not_work_on_the_swing() -> None:
    assert follow(filtered=True) == pytest.approx(1.0, abs=0.03)
    assert abs(follow(filtered=False, delay_s=0.08) - 1.0) > 0.2


def test_other_yaw_rates_pass_the_notch() -> None:
    swing, passed, wanted = SwingFilter(2.0), [], []
    for step in range(1000):
        t_s = step * 0.02
        wanted.append(0.5 + 0.3 * math.sin(math.tau * 0.5 * t_s))
        passed.append(swing.without_swing(t_s, wanted[-1]))
    assert np.abs(np.array(passed) - wanted)[500:].max() < 0.05
