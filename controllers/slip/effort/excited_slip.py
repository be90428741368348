"""Slip of the rover by the yaw excitation, its premises, and what is used while they do not hold."""

import cmath
import math
from dataclasses import dataclass

from controllers.slip.effort.ground_knowledge import GYRO_WAS_WRONG, KnownSlip, SlipSource
from controllers.slip.effort.gyro_response import GyroResponse
from controllers.slip.effort.gyro_watch import GyroWatch
from controllers.slip.effort.parameters import EFFORT
from controllers.slip.effort.yaw_excitation import (
    SPRINGS,
    ContactSlip,
    ExcitationResponse,
    YawExcitation,
    YawExcitationMap,
    contact_slip,
    range_problem,
    sensor_response,
    slip_of,
)

RESTS = "the excitation rests"
RETURNING = "excitation valid again, waiting for a second window"


@dataclass(frozen=True, slots=True, kw_only=True)
class RoverSlip:
    """Slip of the rover.

    Attributes:
        slip: In use, 0 to 1.
        sd: Its standard deviation; 1 while it is not valid.
        source: Where it comes from.
        reason: Why it is not valid; empty where it is.
        gyro_lag_s: Lag of the gyro in place beyond the assumed one; None before it was measured.
    """

    slip: float
    sd: float
    source: SlipSource
    reason: str
    gyro_lag_s: float | None


class ExcitedSlip:
    """Turns windows of the excitation into the slip of the rover.

    While the excitation gives no valid slip, the slip is, in this order: that of a recognised surface, if the
    user has named the surfaces; that of the learned curve, if the user wants one; the last valid one, which
    decays; zero, as the encoders have it. After a map or zero the excitation must be valid in
    `windows_to_return` windows before it is used again.

    Where asked to, the excitation rests after some valid windows, as long as map or learned curve are valid.

    Args:
        settings: The excitation.
        gyro: Constants of the gyro; None where they were not identified.
        wheel_age_s: Age of the wheels' positions at their time stamp; None where it is unknown.
        rest_s: How long the excitation may rest.

    Attributes:
        excitation: Excites the yaw.
        watch: Compares the gyro with the wheels in place.
    """

    def __init__(
        self,
        settings: YawExcitationMap,
        gyro: GyroResponse | None,
        wheel_age_s: float | None,
        rest_s: float = 0.0,
    ) -> None:
        self._settings = settings
        sensors = sensor_response(settings, gyro, wheel_age_s or 0.0)
        self.excitation = YawExcitation(settings, sensors)
        lag_sd_s = 0.0 if gyro is None else _lag_sd_s(gyro, settings.frequency_hz)
        self.watch = GyroWatch(
            is_calibrated=gyro is not None,
            lag_sd_s=lag_sd_s,
            wheels_may_be_old=gyro is None and wheel_age_s is None,
        )
        self._unsure_lag_s = EFFORT.contact.unsure_lag_s if gyro is None else lag_sd_s
        self._unsure_gain = (
            EFFORT.contact.unsure_gain if gyro is None else _gain_sd(gyro, settings.frequency_hz)
        )
        self._began_s: float | None = None
        self._valid_windows = 0
        self._now_s = 0.0
        self._pause_end_s = 0.0
        self._rest_s = rest_s
        self._rest_end_s = 0.0
        self.slip = RoverSlip(
            slip=0.0, sd=1.0, source=SlipSource.ENCODERS, reason=self.watch.reason, gyro_lag_s=None
        )

    def doubt_gyro(self) -> None:
        """Return to the encoders' slip: that in use was read from a gyro that was wrong."""
        self._valid_windows = 0
        self.slip = RoverSlip(
            slip=0.0,
            sd=1.0,
            source=SlipSource.ENCODERS,
            reason=GYRO_WAS_WRONG,
            gyro_lag_s=self.watch.lag_s,
        )

    def waits_in_place(self, t_s: float) -> bool:
        """Return whether the rover should excite in place: until the gyro was compared with the wheels.

        Args:
            t_s: Time of a cycle in which the rover may move; the first of them begins the wait.
        """
        if self._began_s is None:
            self._began_s = t_s
        return not self.watch.is_compared and t_s - self._began_s < EFFORT.watch.longest_s

    def yaw_rate_rad_s(self, t_s: float) -> float:
        """Return what to add to the commanded yaw rate at a time; 0 during a pause."""
        self._now_s = t_s
        return 0.0 if t_s < max(self._pause_end_s, self._rest_end_s) else self.excitation.yaw_rate_rad_s(t_s)

    def take(self, response: ExcitationResponse, travelled_m: complex, known: KnownSlip | None) -> RoverSlip:
        """Take one window; return the slip to use from here on.

        Args:
            response: Of the window.
            travelled_m: By the wheels in the window, in the body frame.
            known: Slip by the drive force; None where it is not to be used.
        """
        found, reason = self._read(response, travelled_m)
        self._valid_windows = 0 if reason else self._valid_windows + 1
        before = self.slip
        is_back = before.source in (SlipSource.EXCITATION, SlipSource.LEARNED, SlipSource.HELD)
        if not reason and not is_back and self._valid_windows < EFFORT.hold.windows_to_return:
            reason = RETURNING
        slip, sd, source = found.slip, found.sd, SlipSource.EXCITATION
        if reason and known is not None and not known.reason:
            slip, sd, source, reason = known.slip, known.sd, known.source, ""
        elif reason:
            slip, source = self._fall_back()
            sd = 1.0
        self._rest(known)
        self.slip = RoverSlip(slip=slip, sd=sd, source=source, reason=reason, gyro_lag_s=self.watch.lag_s)
        return self.slip

    def _read(self, response: ExcitationResponse, travelled_m: complex) -> tuple[ContactSlip, str]:
        """Return the slip by this window alone, and why it is not valid; else empty."""
        if response.reason == SPRINGS and self._now_s >= self._pause_end_s:
            self._pause_end_s = self._now_s + EFFORT.excitation.pause_s
        if self._now_s < self._pause_end_s:
            return ContactSlip(0.0, 1.0), SPRINGS
        if response.reason:
            rests = self._now_s < self._rest_end_s
            return ContactSlip(0.0, 1.0), RESTS if rests else response.reason
        speed_m_s = abs(travelled_m) / EFFORT.excitation.window_s
        turning = math.tau * self._settings.frequency_hz
        lag_s = -cmath.phase(response.share) / turning
        self.watch.take(speed_m_s, lag_s, abs(response.share))
        problem = self.watch.reason or range_problem(self._settings, response.transmission_loss, travelled_m)
        if self._settings.reads == "contact":
            found = contact_slip(response.share, speed_m_s, turning * self._unsure_lag_s, self._unsure_gain)
        else:
            found = ContactSlip(slip_of(self._settings, response.transmission_loss), self._settings.slip_sd)
        return found, problem

    def _rest(self, known: KnownSlip | None) -> None:
        """Begin a rest of the excitation after enough valid windows; end it where nothing else is valid."""
        if known is None or known.reason:
            self._rest_end_s = 0.0
        elif self._valid_windows >= EFFORT.excitation.windows_to_rest:
            self._valid_windows = 0
            self._rest_end_s = self._now_s + self._rest_s

    def _fall_back(self) -> tuple[float, SlipSource]:
        slip = self.slip.slip * math.exp(-EFFORT.excitation.window_s / EFFORT.hold.fade_s)
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


def _lag_sd_s(gyro: GyroResponse, frequency_hz: float) -> float:
    """Return the standard deviation of the lag of an oscillation, from those of delay and bandwidth."""
    by_bandwidth_s = _slower(gyro).lag_s(frequency_hz) - gyro.lag_s(frequency_hz)
    return max(math.hypot(gyro.delay_sd_s, by_bandwidth_s), EFFORT.contact.least_lag_sd_s)
