"""Labelled readings of the yaw excitation, and what was learned from them."""

import math
from dataclasses import replace

import pytest

from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import OmniRoverSettings
from controllers.slip.effort.excited_slip import ExcitedSlip
from controllers.slip.effort.gyro_response import GyroResponse
from controllers.slip.effort.labelled_windows import LabelledReading, LabelledWindows
from controllers.slip.effort.learned_bracket import LearnedBracket, conditions_of
from controllers.slip.effort.slip_bracket import DrivenTravel, SlipReading
from controllers.slip.effort.slip_by_fixes import SlipAtForce
from controllers.slip.effort.yaw_excitation import ExcitationResponse, ExcitationSettings
from rover_hil.config import load_config

SECOND_NS = 1_000_000_000
LEARNED = LearnedBracket(
    source="runs",
    learned_on="2026-11-27",
    windows=24,
    weights=(0.8, 0.3),
    covariance=(0.01, -0.01, -0.01, 0.04),
    residual_sd=0.03,
    secant_range=(0.1, 0.5),
    width_range=(0.0, 0.4),
    speed_range_m_s=(0.1, 0.2),
    force_range_n=(5.0, 15.0),
)
TRAVEL = DrivenTravel(0.15, 10.0)


def reading(secant: float, bound: float, problem: str = "") -> SlipReading:
    return SlipReading(0.5 * (secant + bound), 0.1, problem, secant, bound)


def slip_of(from_s: float, to_s: float, travel_m: float, slip: float = 0.25) -> SlipAtForce:
    return SlipAtForce(8.0, slip, 0.02, round(from_s * SECOND_NS), round(to_s * SECOND_NS), travel_m)


def test_windows_between_two_fixes_are_labelled_by_their_travel() -> None:
    windows = LabelledWindows(1.0)
    for end_s, secant, bound, speed_m_s in (
        (1, 0.9, 0.9, 9.0),
        (2, 0.2, 0.3, 0.1),
        (3, 0.5, 0.9, 0.3),
        (4, 0, 0, 9),
    ):
        windows.add(end_s * SECOND_NS, reading(secant, bound), DrivenTravel(speed_m_s, 20.0 * speed_m_s))
    windows.wait(slip_of(1.0, 3.4, 0.4))
    assert windows.label(round(3.9 * SECOND_NS)) is None
    found = windows.label(round(3.9 * SECOND_NS) + 1)
    assert found is not None
    # A bound above 0.6 counts as this; weights 0.1 and 0.3.
    expected = LabelledReading(0.425, 0.1, 0.25, 5.0, 0.25, 0.02)
    assert tuple(found) == pytest.approx(tuple(expected))
    assert windows.label(9 * SECOND_NS) is None


@pytest.mark.parametrize(("travel_m", "is_labelled"), [(0.28, True), (0.29, False)])
def test_windows_must_cover_most_of_the_travel(travel_m: float, is_labelled: bool) -> None:
    windows = LabelledWindows(1.0)
    windows.add(1 * SECOND_NS, reading(0.2, 0.3), DrivenTravel(0.2, None))
    windows.add(2 * SECOND_NS, reading(0.2, 0.3, "in doubt"), DrivenTravel(0.2, 1.0))
    windows.wait(slip_of(0.0, 2.0, travel_m))
    found = windows.label(3 * SECOND_NS)
    assert (found is not None) is is_labelled
    assert found is None or found.force_n is None


def test_what_was_learned_replaces_slip_and_deviation() -> None:
    found, problem = LEARNED.read(reading(0.4, 0.5), TRAVEL)
    assert problem == ""
    assert found.slip == pytest.approx(0.8 * 0.4 + 0.3 * 0.1)
    variance = 0.01 * 0.4**2 + 0.04 * 0.1**2 - 2.0 * 0.01 * 0.4 * 0.1
    assert found.sd == pytest.approx(math.hypot(0.03, math.sqrt(variance)))
    greatest, _ = LEARNED.model_copy(update={"weights": (3.0, 0.3)}).read(reading(0.5, 0.5), TRAVEL)
    assert greatest.slip == 1.0


def test_with_many_labels_the_shares_change_with_response_speed_and_force() -> None:
    weights = (0.8, 0.3, 0.1, 0.2, 0.4, -0.05, -0.2)
    covariance = tuple(0.01 if row == column else 0.0 for row in range(7) for column in range(7))
    smooth = LearnedBracket(**{**LEARNED.model_dump(), "weights": weights, "covariance": covariance})
    # Three quarters of the range of readings, a quarter of the speeds, the greatest force.
    found, _ = smooth.read(reading(0.4, 0.5), DrivenTravel(0.125, 15.0))
    terms = (0.4, 0.1, 0.4 * 0.5, 0.4 * -0.5, 0.1 * -0.5, 0.4, 0.1)
    assert found.slip == pytest.approx(
        sum(weight * term for weight, term in zip(weights, terms, strict=True))
    )
    assert found.sd == pytest.approx(math.hypot(0.03, *(0.1 * term for term in terms)))
    without_force, _ = smooth.read(reading(0.4, 0.5), DrivenTravel(0.125, None))
    assert without_force.slip == pytest.approx(found.slip + 0.05 * 0.4 + 0.2 * 0.1)


def test_a_file_that_was_changed_by_hand_is_refused() -> None:
    with pytest.raises(
        ValueError, match=r"weights and covariance must have 2 and 4 numbers, or 7 and 49: take"
    ):
        LearnedBracket(**{**LEARNED.model_dump(), "weights": (1.0, 0.5, 0.0)})


@pytest.mark.parametrize(
    ("secant", "bound", "travel", "what"),
    [
        (0.61, 0.61, TRAVEL, "response"),
        (-0.01, 0.3, TRAVEL, "response"),
        (0.0, 0.55, TRAVEL, "lag"),
        (0.4, 0.5, DrivenTravel(0.23, 10.0), "speed"),
        (0.4, 0.5, DrivenTravel(0.15, 2.0), "drive force"),
        (0.61, 0.61, DrivenTravel(0.07, 20.0), "response and speed and drive force"),
    ],
)
def test_outside_of_what_was_driven_the_reading_stays_and_says_so(
    secant: float, bound: float, travel: DrivenTravel, what: str
) -> None:
    found = reading(secant, bound)
    assert LEARNED.read(found, travel) == (found, f"{what} outside of what was learned on the rover")


def test_a_margin_of_a_quarter_and_an_unknown_force_are_inside() -> None:
    assert LEARNED.read(reading(0.59, 0.59), DrivenTravel(0.22, None))[1] == ""
    without_force = LEARNED.model_copy(update={"force_range_n": None})
    assert without_force.read(reading(0.4, 0.5), DrivenTravel(0.15, 99.0))[1] == ""


def test_an_invalid_reading_stays_invalid() -> None:
    found = reading(0.4, 0.5, "in doubt")
    assert LEARNED.read(found, TRAVEL) == (found, "in doubt")


def excited(learned: LearnedBracket | None) -> ExcitedSlip:
    rover = load_config("robotino").rover
    assert isinstance(rover, OmniRoverSettings)
    gyro = GyroResponse(source="", identified_on="2026-11-27")
    return ExcitedSlip(
        ExcitationSettings(), rover, make_kinematics(rover), gyro=gyro, learned=learned, proves_gyro=False
    )


def test_the_excitation_reads_by_what_was_learned_and_says_where_it_does_not() -> None:
    response = ExcitationResponse(1.0 / (1.3 + 0.2j), 0.005, 0.0, 0.0, "")
    plain = excited(None)
    usual = plain.take(response, 0.15 + 0j, 10.0, None)
    assert plain.reading is not None
    found, travel = plain.reading
    assert usual.slip == found.slip
    learning = excited(LEARNED)
    learned = learning.take(response, 0.15 + 0j, 10.0, None)
    assert learned.slip == LEARNED.read(found, travel)[0].slip != usual.slip
    assert learned.unsure == ""
    # Labels for learning are of the reading itself.
    assert learning.reading == plain.reading
    outside = learning.take(response, 0.3 + 0j, 10.0, None)
    assert outside.unsure == "speed outside of what was learned on the rover"
    assert outside == replace(plain.take(response, 0.3 + 0j, 10.0, None), unsure=outside.unsure)


GYRO = GyroResponse(source="a log", identified_on="2026-11-28", delay_s=0.02, bandwidth_hz=10.0)


@pytest.mark.parametrize(
    ("excitation", "gyro", "is_used"),
    [
        (ExcitationSettings(), GYRO, True),
        (ExcitationSettings(), GYRO.model_copy(update={"source": "another log", "delay_s": 0.0201}), True),
        (ExcitationSettings(), GYRO.model_copy(update={"delay_s": 0.03}), False),
        (ExcitationSettings(), None, False),
        (ExcitationSettings(frequency_hz=3.0), GYRO, False),
        (ExcitationSettings(mass_kg=15.0), GYRO, False),
    ],
)
def test_what_was_learned_with_another_gyro_or_excitation_is_not_used_and_this_is_said(
    excitation: ExcitationSettings, gyro: GyroResponse | None, is_used: bool
) -> None:
    learned = LEARNED.model_copy(update={"conditions": conditions_of(ExcitationSettings(), GYRO)})
    reason = learned.other_conditions(conditions_of(excitation, gyro))
    assert (reason == "") is is_used
    if not is_used:
        assert reason.startswith(
            "learned reading not used: learned with excitation 2 Hz of 12, gyro gain 1.00, "
        )
        assert reason.endswith(": commission again")
    assert LEARNED.other_conditions("anything") == ""
