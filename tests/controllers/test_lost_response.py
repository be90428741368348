"""A body that no longer answers the yaw excitation: its slip is unknown, until it answers again."""

import pytest

from controllers.motion.kinematics import make_kinematics
from controllers.motion.rover_geometry import OmniRoverSettings
from controllers.slip.effort.excited_slip import NO_ANSWER, ExcitedSlip, RoverSlip
from controllers.slip.effort.ground_knowledge import SlipSource
from controllers.slip.effort.gyro_response import GyroResponse
from controllers.slip.effort.slip_bracket import IDLE_WHEELS
from controllers.slip.effort.yaw_excitation import ExcitationResponse, ExcitationSettings
from rover_hil.config import load_config

WINDOW_M = 0.15


class Drive:
    """Windows of straight travel with a response of the body."""

    def __init__(self) -> None:
        rover = load_config("robotino").rover
        assert isinstance(rover, OmniRoverSettings)
        gyro = GyroResponse(source="", identified_on="2026-11-30")
        self.excited = ExcitedSlip(
            ExcitationSettings(), rover, make_kinematics(rover), gyro=gyro, proves_gyro=False
        )

    def window(self, share: complex, force_n: float = 12.0, reason: str = "") -> RoverSlip:
        response = ExcitationResponse(share, 0.005, 0.0, 0.0, reason)
        return self.excited.take(response, complex(WINDOW_M), force_n, None)


def test_a_body_that_does_not_answer_has_an_unknown_slip_until_it_answers_again() -> None:
    drive = Drive()
    assert drive.window(0.9 - 0.1j).source is SlipSource.EXCITATION
    lost = drive.window(0.2 - 0.1j)
    assert (lost.sd, lost.source, lost.reason) == (1.0, SlipSource.UNKNOWN, NO_ANSWER)
    assert lost.slip > 0.7
    # The rover may also have moved as far as its wheels.
    assert drive.excited.unknown_share == lost.slip
    assert drive.excited.unanswered_m == pytest.approx(2.0 * WINDOW_M)
    # Between the two limits it has not answered yet.
    assert drive.window(0.3 + 0j).source is SlipSource.UNKNOWN
    assert drive.window(0.4 + 0j).source is SlipSource.EXCITATION
    assert drive.excited.lost_response == ""


def test_a_weak_answer_that_was_not_lost_is_read() -> None:
    drive = Drive()
    drive.window(0.9 + 0j)
    assert drive.window(0.3 + 0j).source is SlipSource.EXCITATION


def test_a_body_that_never_answered_may_have_a_gyro_without_a_signal() -> None:
    assert Drive().window(0.05 + 0j).source is not SlipSource.UNKNOWN


def test_windows_without_a_response_decide_nothing() -> None:
    drive = Drive()
    drive.window(0.9 + 0j)
    drive.window(0.1 + 0j)
    assert drive.window(0j, reason="the wheels do not follow the excitation").source is SlipSource.UNKNOWN
    assert drive.excited.unanswered_m == pytest.approx(3.0 * WINDOW_M)


def test_a_doubt_about_the_gyro_does_not_bring_the_encoders_back() -> None:
    drive = Drive()
    drive.window(0.9 + 0j)
    drive.window(0.1 + 0j)
    drive.excited.forget_gyro()
    assert drive.excited.slip.source is SlipSource.UNKNOWN
    found = drive.window(0.1 + 0j)  # the gyro was doubted in this window: it gives no slip
    assert (found.slip, found.source) == (0.5, SlipSource.UNKNOWN)
    assert drive.excited.unknown_share == 0.5


def test_a_body_that_swings_against_its_wheels_decides_nothing() -> None:
    drive = Drive()
    drive.window(0.9 + 0j)
    assert drive.window(-0.15 - 0.1j).source is not SlipSource.UNKNOWN
    assert drive.excited.lost_response == ""


def test_the_assumed_slip_is_not_held_as_a_measured_one() -> None:
    drive = Drive()
    drive.window(0.9 + 0j)
    drive.window(0.1 + 0j)
    drive.excited.forget_gyro()
    found = drive.window(0.9 + 0j)  # answers, but the gyro was doubted in this window
    assert (found.slip, found.source) == (0.0, SlipSource.ENCODERS)


def test_idle_wheels_are_a_suspicion_and_no_unknown_slip() -> None:
    drive = Drive()
    drive.window(0.9 + 0j)
    found = drive.window(0.4 - 0.4j, force_n=0.5)
    assert drive.excited.lost_response == IDLE_WHEELS
    assert found.source is not SlipSource.UNKNOWN
