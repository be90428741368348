"""Slip read from the response of contact models whose equations are linearised here, by numbers."""

import cmath
import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.motion.kinematics import OmniKinematics, SkidSteerKinematics
from controllers.motion.rover_geometry import OmniRoverSettings, SkidSteerRoverSettings
from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.slip_bracket import (
    FALLING_TRACTION,
    IDLE_WHEELS,
    IN_NOISE,
    OPPOSITE,
    BodyResponse,
    DrivenTravel,
    SlipReading,
    YawLever,
    per_slip_m2,
    read_slip,
    read_slip_by_unknown_gyro,
)

ARM_M, MASS_KG, INERTIA_KG_M2, FREQUENCY_HZ = 0.125, 12.0, 0.21, 2.0
WHEELS, LOAD_N = 3, MASS_KG * 9.81 / 3.0
SPEED_M_S = 0.15
TURNING = math.tau * FREQUENCY_HZ
LEVER = YawLever(
    frequency_hz=FREQUENCY_HZ, inertia_kg_m2=INERTIA_KG_M2, mass_kg=MASS_KG, per_slip_m2=2.0 * ARM_M**2
)
Traction = Callable[[float, float], float]
"""Traction of a wheel in N, of the speed of its rim and of its centre along the rim, m/s."""


def ratio_law(stiffness: float, friction: float = 0.6) -> Traction:
    """Return a brush-like curve over the slip ratio."""

    def traction_n(rim_m_s: float, wheel_m_s: float) -> float:
        return friction * LOAD_N * math.tanh(stiffness / friction * (rim_m_s - wheel_m_s) / rim_m_s)

    return traction_n


def velocity_law(stiffness_s_m: float, friction: float = 0.6) -> Traction:
    """Return a saturating curve over the slip velocity; linear where `friction` is large."""

    def traction_n(rim_m_s: float, wheel_m_s: float) -> float:
        return friction * LOAD_N * math.tanh(stiffness_s_m / friction * (rim_m_s - wheel_m_s))

    return traction_n


def respond(
    traction: Traction, slip: float, *, drag_n_s_m: float = 0.0, relaxation_s: float = 0.0
) -> tuple[complex, float]:
    """Return the response of the body to a small swing at a slip, and the drive force in N.

    The wheels sit at 120 degrees. Each is taken at the slip of the rover, with the tangents of its traction.
    """
    step = 1e-6
    rim_m_s, wheel_m_s = SPEED_M_S, SPEED_M_S * (1.0 - slip)
    by_rim = (traction(rim_m_s + step, wheel_m_s) - traction(rim_m_s - step, wheel_m_s)) / (2.0 * step)
    by_wheel = (traction(rim_m_s, wheel_m_s - step) - traction(rim_m_s, wheel_m_s + step)) / (2.0 * step)
    lag = 1.0 + 1j * TURNING * relaxation_s
    # Yaw moment: sum L (K_x L rim - K_u L body) / lag = (d + j w J) body
    gain = WHEELS * ARM_M**2
    share = gain * by_rim / (gain * by_wheel + (drag_n_s_m + 1j * TURNING * INERTIA_KG_M2) * lag)
    # Each wheel pulls along its own rim: 1.5 of three wheels' worth along the travel.
    return share, 1.5 * traction(rim_m_s, wheel_m_s)


def read(
    share: complex, force_n: float | None, *, noise: float = 0.0, lag_sd_rad: float = 0.0
) -> SlipReading:
    return read_slip(BodyResponse(share, noise, lag_sd_rad), DrivenTravel(SPEED_M_S, force_n), LEVER)


@pytest.mark.parametrize("slip", [0.1, 0.2, 0.4])
@pytest.mark.parametrize("stiffness", [0.7, 1.5, 4.0])
def test_the_secant_is_the_slip_of_a_ratio_law_at_any_point_of_its_curve(
    slip: float, stiffness: float
) -> None:
    found = read(*respond(ratio_law(stiffness), slip))
    assert found.secant == pytest.approx(slip, abs=1e-4)


@pytest.mark.parametrize("slip", [0.1, 0.2, 0.4])
def test_the_bound_is_the_slip_of_linear_creep(slip: float) -> None:
    found = read(*respond(velocity_law(4.0, friction=1e3), slip))
    assert found.secant == pytest.approx(0.0, abs=1e-9)
    assert found.bound == pytest.approx(slip, rel=1e-3)
    assert found.slip == pytest.approx(0.5 * slip, rel=1e-3)
    assert abs(found.slip - slip) < 2.0 * found.sd


@pytest.mark.parametrize("slip", [0.1, 0.3, 0.5])
@pytest.mark.parametrize("drag_n_s_m", [0.0, 0.1])
def test_the_slip_of_a_saturating_velocity_law_lies_in_the_bracket(slip: float, drag_n_s_m: float) -> None:
    traction = velocity_law(6.0, friction=0.3)
    found = read(*respond(traction, slip, drag_n_s_m=drag_n_s_m))
    assert found.secant <= slip <= found.bound
    assert found.secant <= found.slip <= min(found.bound, EFFORT.bracket.greatest_bound)
    assert (found.secant > 0.0) is (drag_n_s_m > 0.0)


def test_relaxation_lowers_the_reading_less_at_two_hertz_than_the_deviation() -> None:
    share, force_n = respond(ratio_law(1.0), 0.2, relaxation_s=0.015 / SPEED_M_S)
    plain, _ = respond(ratio_law(1.0), 0.2)
    late, exact = read(share, force_n), read(plain, force_n)
    assert exact.secant - late.secant > 0.0
    assert abs(late.slip - 0.2) < 2.0 * late.sd


def test_a_velocity_law_reads_less_than_a_ratio_law_and_no_force_is_a_guess() -> None:
    share, force_n = respond(velocity_law(4.0, friction=1e3), 0.2)
    measured, guessed = read(share, force_n), read(share, None)
    usual_n = EFFORT.bracket.usual_force_n_kg * MASS_KG
    assert guessed.bound == pytest.approx(measured.bound * usual_n / force_n, rel=1e-9)


def test_the_bound_counts_up_to_a_limit() -> None:
    found = read(1.0 / (1.0 + 5.0j), 30.0)
    assert found.bound > 1.0
    assert found.slip == pytest.approx(EFFORT.bracket.weight * EFFORT.bracket.greatest_bound)


def test_slow_travel_counts_as_less_slow() -> None:
    def at(speed_m_s: float) -> float:
        return read_slip(BodyResponse(1.0 / (1.0 + 0.1j), 0.0), DrivenTravel(speed_m_s, 8.0), LEVER).bound

    assert at(0.01) == at(EFFORT.bracket.least_speed_m_s) > at(0.1)


def test_past_the_peak_no_slip_is_not_reported() -> None:
    """A velocity law past its peak gives Re 1/H = 1: a reading of its own would say that nothing slips."""

    def falling(rim_m_s: float, wheel_m_s: float) -> float:
        return LOAD_N * (0.5 - 2.0 * (rim_m_s - wheel_m_s))

    share, force_n = respond(falling, 0.5)
    assert (1.0 / share).real == pytest.approx(1.0)
    assert read(share, force_n).problem == FALLING_TRACTION
    # With so much noise that its sign is not known, it says nothing of the kind.
    share, force_n = respond(lambda rim, wheel: LOAD_N * (0.5 - 20.0 * (rim - wheel)), 0.1)
    lag = abs((1.0 / share).imag)
    assert read(share, force_n, noise=0.4 * lag * abs(share) ** 2).problem == FALLING_TRACTION
    assert read(share, force_n, noise=0.6 * lag * abs(share) ** 2).problem == ""


def test_firm_ground_is_valid_from_either_side_of_no_lag() -> None:
    for lag in (0.004, 0.0, -0.004):
        found = read(1.0 / (1.0 + 1j * lag), 8.0, noise=0.01)
        assert found.problem == ""
        assert found.slip < 0.02


def test_idle_wheels_are_named_by_a_long_lag_with_hardly_any_force() -> None:
    share = 1.0 / (1.0 + 0.8j)
    weak_n = 0.5 * EFFORT.bracket.idle_force_n_kg * MASS_KG
    assert read(share, weak_n).problem == IDLE_WHEELS
    assert read(share, 10.0 * weak_n).problem == ""
    assert read(share, None).problem == ""
    assert read(1.0 / (1.0 + 0.1j), weak_n).problem == ""


def test_a_response_within_its_noise_says_nothing() -> None:
    assert read(0.01 + 0.01j, 8.0, noise=0.02).problem == IN_NOISE
    assert read(0j, 8.0).problem == IN_NOISE
    assert read(-0.8 + 0.05j, 8.0, noise=0.01).problem == OPPOSITE


def test_the_deviation_grows_with_the_width_the_slip_and_the_doubt_about_the_sensors() -> None:
    narrow, wide = read(1.0 / (1.4 + 0.02j), 10.0), read(1.0 / (1.4 + 0.5j), 10.0)
    assert wide.sd > narrow.sd > read(1.0 / (1.01 + 0.01j), 10.0).sd
    assert read(1.0 / (1.4 + 0.5j), 10.0, lag_sd_rad=0.2).sd > wide.sd
    by_gain = read_slip(BodyResponse(0.7 + 0j, 0.0, 0.0, 0.2), DrivenTravel(SPEED_M_S, 10.0), LEVER)
    assert by_gain.sd > read(0.7 + 0j, 10.0).sd


def delayed(share: complex, delay_s: float) -> complex:
    return share * cmath.exp(-1j * TURNING * delay_s)


def by_unknown(share: complex, force_n: float | None) -> SlipReading:
    return read_slip_by_unknown_gyro(BodyResponse(share, 0.01), DrivenTravel(SPEED_M_S, force_n), LEVER)


@pytest.mark.parametrize("law", [ratio_law(1.0), velocity_law(4.0)])
@pytest.mark.parametrize("delay_s", [0.0, 0.015, 0.04])
@pytest.mark.parametrize("slip", [0.1, 0.2, 0.4])
def test_an_unknown_gyro_gives_no_more_slip_than_a_known_one_and_contains_it(
    law: Traction, delay_s: float, slip: float
) -> None:
    share, force_n = respond(law, slip)
    known = read(share, force_n, noise=0.01)
    unknown = by_unknown(delayed(share, delay_s), force_n)
    assert unknown.problem == ""
    assert unknown.slip <= known.slip + 0.02
    assert unknown.sd >= known.sd
    assert abs(unknown.slip - slip) < 2.0 * unknown.sd


def test_an_unknown_gyro_names_idle_wheels_only_where_no_delay_explains_the_lag() -> None:
    weak_n = 0.5 * EFFORT.bracket.idle_force_n_kg * MASS_KG
    assert by_unknown(delayed(1.0 + 0j, 0.04), weak_n).problem == ""
    assert by_unknown(1.0 / (1.0 + 3.0j), weak_n).problem == IDLE_WHEELS
    assert by_unknown(1.0 / (1.0 - 0.3j), 8.0).problem == FALLING_TRACTION
    assert by_unknown(0j, 8.0).problem == IN_NOISE


@given(
    st.complex_numbers(max_magnitude=3.0, allow_nan=False),
    st.floats(0.0, 1.0),
    st.none() | st.floats(-50.0, 50.0),
    st.floats(0.0, 0.5),
)
def test_every_reading_is_a_slip(
    share: complex, speed_m_s: float, force_n: float | None, noise: float
) -> None:
    for reader in (read_slip, read_slip_by_unknown_gyro):
        found = reader(BodyResponse(share, noise, 0.05, 0.02), DrivenTravel(speed_m_s, force_n), LEVER)
        assert 0.0 <= found.slip <= 1.0
        assert 0.0 < found.sd < 3.0


@pytest.mark.parametrize("direction_rad", [0.0, 0.4, 1.6, math.pi])
def test_the_geometry_factor_of_three_wheels_at_120_degrees_is_two(direction_rad: float) -> None:
    rover = OmniRoverSettings(kinematics="omni3", wheel_radius_m=0.04, base_radius_m=ARM_M)
    assert per_slip_m2(OmniKinematics(rover), 0.04, direction_rad) == pytest.approx(2.0 * ARM_M**2)


def test_the_geometry_factor_depends_on_the_directions_of_traction() -> None:
    rover = OmniRoverSettings(
        kinematics="omni3", wheel_radius_m=0.04, base_radius_m=ARM_M, wheel_angles_deg=(70.0, 180.0, 290.0)
    )
    ahead, aside = (per_slip_m2(OmniKinematics(rover), 0.04, angle) for angle in (0.0, math.pi / 2.0))
    angles = [math.radians(degrees) for degrees in (70.0, 180.0, 290.0)]
    assert ahead == pytest.approx(3.0 * ARM_M**2 / sum(math.sin(angle) ** 2 for angle in angles))
    assert aside == pytest.approx(3.0 * ARM_M**2 / sum(math.cos(angle) ** 2 for angle in angles))
    skid = SkidSteerRoverSettings(kinematics="skid_steer_4", wheel_radius_m=0.04, track_m=0.5)
    assert per_slip_m2(SkidSteerKinematics(skid), 0.04, 0.0) == pytest.approx(0.25**2)
    assert per_slip_m2(SkidSteerKinematics(skid), 0.04, math.pi / 2.0) == 0.0


def test_the_deviation_holds_what_the_law_leaves_open_and_the_noise() -> None:
    """Uniform from the secant reading to the bound, half of the secant reading, the floor."""
    found = read(1.0 / (1.0 + 5.0j), 30.0)
    assert found.sd == pytest.approx(math.hypot(EFFORT.bracket.sd, 1.0 / math.sqrt(12.0)))
    firm = read(complex(0.5), None)
    assert firm.sd == pytest.approx(math.hypot(EFFORT.bracket.sd, 0.25))
    noisy = read(complex(0.5), None, noise=0.2)
    assert noisy.sd > math.hypot(firm.sd, 0.2)


def test_where_one_wheel_grips_and_the_others_slide_the_deviation_reaches_the_slip() -> None:
    """The wheel across the travel carries the swing: at a slip of 0.93 the reading is 0.6."""
    found = read(1.0 / (2.5 + 0.2j), 28.0)
    assert found.bound < found.secant
    assert found.slip == pytest.approx(0.6, abs=0.01)
    assert found.slip + 2.0 * found.sd > 0.93


def test_an_angle_that_is_uncertain_counts_to_both_sides() -> None:
    """Where wheels are read late the gyro seems early, and lag is hidden."""
    sure, unsure = read(complex(0.8), None), read(complex(0.8), None, lag_sd_rad=0.3)
    assert unsure.slip == sure.slip
    hidden = read(cmath.rect(0.8, -0.3), None)
    assert hidden.slip > sure.slip + 0.03
    assert unsure.sd >= math.hypot(sure.sd, hidden.slip - sure.slip) - 1e-9


@given(lag=st.floats(0.35, 0.7))
def test_wheels_that_may_be_idle_are_never_surely_without_slip_for_an_unknown_gyro(lag: float) -> None:
    share, weak = 1.0 / complex(1.0, lag), DrivenTravel(SPEED_M_S, 0.1 * MASS_KG)
    assert read_slip(BodyResponse(share, 0.0), weak, LEVER).problem == IDLE_WHEELS
    found = read_slip_by_unknown_gyro(BodyResponse(share, 0.0), weak, LEVER)
    assert found.problem or found.slip + 2.0 * found.sd > 1.0
