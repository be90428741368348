"""Slip of the rover by the yaw excitation, its premises, and what is used while they do not hold."""

import math
from dataclasses import dataclass

from controllers.motion.kinematics import Kinematics
from controllers.motion.rover_geometry import OmniRoverSettings
from controllers.slip.effort.ground_knowledge import GYRO_WAS_WRONG, KnownSlip, SlipSource
from controllers.slip.effort.gyro_in_place import GyroInPlace
from controllers.slip.effort.gyro_response import GyroResponse
from controllers.slip.effort.learned_bracket import LearnedBracket, conditions_of
from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.slip_bracket import (
    IDLE_WHEELS,
    OPPOSITE,
    BodyResponse,
    DrivenTravel,
    SlipReading,
    YawLever,
    per_slip_m2,
    read_slip,
    read_slip_by_unknown_gyro,
)
from controllers.slip.effort.yaw_excitation import (
    SPRINGS,
    WHEELS_DO_NOT_FOLLOW,
    ExcitationResponse,
    ExcitationSettings,
    SwingFilter,
    YawExcitation,
    sensor_response,
)

RESTS = "the excitation rests"
TOO_LITTLE_TRAVEL = "too little travel to read slip from"
LEAST_ANSWER = 0.25
"""A body that turns with less than this share of the turning of its wheels does not answer. For a contact
whose traction depends on the slip ratio it would be 0.2, a slip of 0.8. On sites of seven laws that it was
not chosen on, 0.2 finds 31 of 35 nearly stuck rovers within 0.5 m, and 0.25 finds 33; neither reports one
of 24 sound ones (`python -m benchmarks.safety.nearly_stuck --first 10 --sites 5`)."""
ANSWERS_AGAIN = 0.35
"""A body that did not answer does so again from this share on."""
NO_ANSWER = "the body does not turn with its wheels any more, its slip is unknown"
UNKNOWN_SLIP = 0.5
"""Slip of a body that does not answer, where none is read: between no motion and full motion."""
GAVE_UP = "the drives do not follow the excitation under load: it is off"
UNKNOWN_GYRO = "delay and bandwidth of the gyro are unknown: run `rover-hil calibrate imu`"


@dataclass(frozen=True, slots=True, kw_only=True)
class RoverSlip:
    """Slip of the rover.

    Attributes:
        slip: In use, 0 to 1: the slip ratio of all wheels that gives the translation of the rover.
        sd: Its standard deviation; 1 while it is not valid.
        source: Where it comes from.
        reason: Why it is not valid; empty where it is.
        unsure: Why its standard deviation is larger than it could be; empty for no such reason.
    """

    slip: float
    sd: float
    source: SlipSource
    reason: str
    unsure: str = ""


class ExcitedSlip:
    """Turns windows of the excitation into the slip of the rover.

    While the excitation gives no valid slip, the slip is, in this order: that of a recognised surface, if the
    user has named the surfaces; that of the learned curve, if the user wants one; the last valid one, which
    decays; zero, as the encoders have it. A body that does not answer may be stuck, or its gyro dead: the
    slip is then unknown.

    Where asked to, the excitation rests after some valid windows, as long as map or learned curve are valid.

    Args:
        settings: The excitation.
        rover: Geometry of the wheels.
        kinematics: Of the same rover.
        gyro: Constants of the gyro; None where they were not identified.
        learned: What was learned of the reading on the rover's ground; None for nothing.
        wheel_age_s: Age of the wheels' positions at their time stamp; None where it is unknown.
        travel_m_s: Speed of the mission; None without one.
        rest_s: How long the excitation may rest.
        proves_gyro: Turn back and forth in place before the mission's travel, see `GyroInPlace`.

    Attributes:
        excitation: Excites the yaw.
        swing: Keeps the path follower from working against the excitation.
        in_place: Judges scale and sign of the gyro before the rover travels; None where it is not to turn.
        lost_response: Why the rover may not get on: the body answered before and does not any more, or wheels
            turn with hardly any force. Empty where it does.
        drift_rad: Angle from the course of the wheels to the true one, as learned; 0 without.
        reading: By the newest window, without what was learned, and its travel; None where it gave none.
        unanswered_m: Travel of the wheels since the begin of the last window in which the body answered.
    """

    def __init__(
        self,
        settings: ExcitationSettings,
        rover: OmniRoverSettings,
        kinematics: Kinematics,
        *,
        gyro: GyroResponse | None = None,
        learned: LearnedBracket | None = None,
        wheel_age_s: float | None = None,
        travel_m_s: float | None = None,
        rest_s: float = 0.0,
        proves_gyro: bool = True,
    ) -> None:
        self._settings = settings
        self._kinematics = kinematics
        self._radius_m = rover.wheel_radius_m
        self._inertia_kg_m2 = settings.inertia_kg_m2(rover.base_radius_m + rover.wheel_radius_m)
        frequency_hz = settings.frequency_hz
        amplitude_rad_s = settings.rim_m_s(travel_m_s) / rover.base_radius_m
        sensors = sensor_response(frequency_hz, gyro, wheel_age_s or 0.0)
        self.excitation = YawExcitation(settings, amplitude_rad_s, sensors)
        self.swing = SwingFilter(frequency_hz)
        self.in_place = GyroInPlace(rover.base_radius_m) if proves_gyro and travel_m_s is not None else None
        self._gyro, self.drift_rad = gyro, 0.0
        self._not_learned = "" if learned is None else learned.other_conditions(conditions_of(settings, gyro))
        self._learned = None if self._not_learned else learned
        self.reading: tuple[SlipReading, DrivenTravel] | None = None
        self._lag_sd_rad = math.tau * frequency_hz * _lag_sd_s(gyro, frequency_hz, wheel_age_s)
        self._gain_sd = 0.0 if gyro is None else _gain_sd(gyro, frequency_hz)
        self._valid_windows = 0
        self._weak_windows = 0
        self._now_s = 0.0
        self._pause_end_s = 0.0
        self._rest_s = rest_s
        self._rest_end_s = 0.0
        self._has_given_up = False
        self._was_off = False
        self._begin_s: float | None = None
        self._has_answered = self._is_doubted = False
        self.lost_response = ""
        self.unanswered_m = 0.0
        self.slip = self._no_slip(TOO_LITTLE_TRAVEL)

    def _no_slip(self, reason: str) -> RoverSlip:
        return RoverSlip(slip=0.0, sd=1.0, source=SlipSource.ENCODERS, reason=reason, unsure=self._unsure)

    @property
    def _unsure(self) -> str:
        return UNKNOWN_GYRO if self._gyro is None else self._not_learned

    @property
    def unknown_share(self) -> float:
        """Greatest error of the travel over that of the wheels, while the slip is unknown; else 0."""
        slip = self.slip
        return max(slip.slip, 1.0 - slip.slip) if slip.source is SlipSource.UNKNOWN else 0.0

    def forget_gyro(self) -> None:
        """Return to the encoders' slip: that in use was read from a gyro that was wrong.

        The open window gives no slip either, but still shows whether the body answers.
        """
        self._valid_windows = 0
        self._is_doubted = True
        if self.slip.source is not SlipSource.UNKNOWN:
            self.slip = self._no_slip(GYRO_WAS_WRONG)

    def yaw_rate_rad_s(self, t_s: float) -> float:
        """Return what to add to the commanded yaw rate at a time; 0 during a pause, and once it is off."""
        self._now_s = t_s
        is_quiet = self._has_given_up or t_s < max(self._pause_end_s, self._rest_end_s)
        if is_quiet:
            self._begin_s = None
            return 0.0
        if self._begin_s is None:
            self._begin_s = t_s
        # From phase 0 on: a swing that begins at another one turns the rover aside.
        return self.excitation.yaw_rate_rad_s(t_s - self._begin_s)

    def leave_out(self, t_s: float) -> None:
        """Take note that nothing was added to the commanded yaw rate at a time: the slip is measured."""
        self._now_s = t_s
        self._was_off = True
        self._begin_s = None

    def take(
        self,
        response: ExcitationResponse,
        travelled_m: complex,
        force_n: float | None,
        known: KnownSlip | None,
    ) -> RoverSlip:
        """Take one window; return the slip to use from here on.

        Args:
            response: Of the window.
            travelled_m: By the wheels in the window, in the body frame.
            force_n: Mean drive force along the travel; None where it is unknown.
            known: Slip by the drive force; None where it is not to be used.
        """
        self.reading = None
        is_travel = abs(travelled_m) >= EFFORT.excitation.least_distance_m
        if not response.reason and not is_travel and self.slip.source is SlipSource.EXCITATION:
            return self.slip
        travel = DrivenTravel(abs(travelled_m) / self._settings.window_s, force_n)
        reading = self._read(response, travelled_m, travel)
        self._was_off = False
        self._follow_response(response, reading.problem, abs(travelled_m))
        if self._is_doubted:
            reading = reading._replace(problem=reading.problem or GYRO_WAS_WRONG)
            self._is_doubted = False
        self.reading = (reading, travel)
        self.drift_rad = 0.0
        if self._learned is not None:
            reading, self._not_learned = self._learned.read(reading, travel)
            self.drift_rad = 0.0 if self._not_learned else self._learned.drift_per_slip * reading.slip
        reason = reading.problem
        self._valid_windows = 0 if reason else self._valid_windows + 1
        slip, sd, source = reading.slip, reading.sd, SlipSource.EXCITATION
        if self.lost_response == NO_ANSWER:
            slip, sd = UNKNOWN_SLIP if reason else slip, 1.0
            source, reason = SlipSource.UNKNOWN, self.lost_response
        elif reason and known is not None and not known.reason:
            slip, sd, source, reason = known.slip, known.sd, known.source, ""
        elif reason:
            slip, source = self._fall_back()
            sd = 1.0
        self._rest(known)
        unsure = self._unsure if source is SlipSource.EXCITATION or reason else ""
        self.slip = RoverSlip(slip=slip, sd=sd, source=source, reason=reason, unsure=unsure)
        return self.slip

    def _follow_response(self, response: ExcitationResponse, problem: str, travelled_m: float) -> None:
        """Take note whether the body answered in a window; what says nothing about it changes nothing."""
        self.unanswered_m += travelled_m
        if problem == IDLE_WHEELS:
            self.lost_response = problem
        elif response.reason or problem == OPPOSITE:
            return  # a body that swings against its wheels springs on its contacts
        elif abs(response.share) >= (ANSWERS_AGAIN if self.lost_response else LEAST_ANSWER):
            self._has_answered, self.lost_response = True, ""
            self.unanswered_m = travelled_m
        elif self._has_answered or (self.in_place is not None and not self.in_place.reason):
            self.lost_response = NO_ANSWER

    def _read(self, response: ExcitationResponse, travelled_m: complex, travel: DrivenTravel) -> SlipReading:
        """Return the slip by this window alone."""
        problem = self._problem(response, travelled_m)
        if problem:
            return SlipReading(0.0, 1.0, problem)
        body = BodyResponse(response.share, response.noise, self._lag_sd_rad, self._gain_sd)
        direction_rad = math.atan2(travelled_m.imag, travelled_m.real)
        lever = YawLever(
            frequency_hz=self._settings.frequency_hz,
            inertia_kg_m2=self._inertia_kg_m2,
            mass_kg=self._settings.mass_kg,
            per_slip_m2=per_slip_m2(self._kinematics, self._radius_m, direction_rad),
        )
        read = read_slip_by_unknown_gyro if self._gyro is None else read_slip
        reading = read(body, travel, lever)
        by_gyro = "" if self.in_place is None else self.in_place.reason
        return reading._replace(problem=reading.problem or by_gyro)

    def _problem(self, response: ExcitationResponse, travelled_m: complex) -> str:
        """Return why this window says nothing about slip; empty where it does."""
        if self._has_given_up:
            return GAVE_UP
        if response.reason == SPRINGS and self._now_s >= self._pause_end_s:
            self._pause_end_s = self._now_s + EFFORT.excitation.pause_s
        if self._now_s < self._pause_end_s:
            return SPRINGS
        is_travel = abs(travelled_m) >= EFFORT.excitation.least_distance_m
        if response.reason:
            if self._was_off or self._now_s < self._rest_end_s:
                return RESTS
            is_weak = is_travel and response.reason == WHEELS_DO_NOT_FOLLOW
            self._weak_windows = self._weak_windows + 1 if is_weak else 0
            self._has_given_up = self._weak_windows >= EFFORT.excitation.windows_to_give_up
            return response.reason
        self._weak_windows = 0
        return "" if is_travel else TOO_LITTLE_TRAVEL

    def _rest(self, known: KnownSlip | None) -> None:
        """Begin a rest of the excitation after enough valid windows; end it where nothing else is valid."""
        if known is None or known.reason:
            self._rest_end_s = 0.0
        elif self._valid_windows >= EFFORT.excitation.windows_to_rest:
            self._valid_windows = 0
            self._rest_end_s = self._now_s + self._rest_s

    def _fall_back(self) -> tuple[float, SlipSource]:
        if self.slip.source is SlipSource.UNKNOWN:
            return 0.0, SlipSource.ENCODERS
        slip = self.slip.slip * math.exp(-self._settings.window_s / EFFORT.hold.fade_s)
        if slip < EFFORT.hold.encoders_below:
            return 0.0, SlipSource.ENCODERS
        return slip, SlipSource.HELD


def _slower(gyro: GyroResponse) -> GyroResponse:
    """Return the gyro with a bandwidth that is smaller by its standard deviation."""
    low_hz = max(gyro.bandwidth_hz - gyro.bandwidth_sd_hz, 0.5 * gyro.bandwidth_hz)
    return gyro.model_copy(update={"bandwidth_hz": low_hz})


def _gain_sd(gyro: GyroResponse, frequency_hz: float) -> float:
    """Return the relative standard deviation of the size of an oscillation, from gain and bandwidth."""
    by_bandwidth = 1.0 - abs(_slower(gyro).at(frequency_hz) / gyro.at(frequency_hz))
    return math.hypot(gyro.gain_sd / gyro.gain, by_bandwidth)


def _lag_sd_s(gyro: GyroResponse | None, frequency_hz: float, wheel_age_s: float | None) -> float:
    """Return the standard deviation of the lag of an oscillation that the sensors' constants leave.

    The delay of a gyro that was not calibrated is not in it.
    """
    if gyro is None:
        return EFFORT.bracket.least_lag_sd_s if wheel_age_s is not None else EFFORT.bracket.unknown_age_s
    by_bandwidth_s = _slower(gyro).lag_s(frequency_hz) - gyro.lag_s(frequency_hz)
    return max(math.hypot(gyro.delay_sd_s, by_bandwidth_s), EFFORT.bracket.least_lag_sd_s)
