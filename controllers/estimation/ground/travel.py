"""Travel over the ground between frames of a camera, beside that of the wheels in the same time."""

import cmath
import math
from collections import deque
from collections.abc import Callable, Iterator
from typing import NamedTuple, Protocol

from controllers.estimation.filter.guarded_filter import Innovation, Outcome
from controllers.estimation.filter.measurement_model import Measured
from controllers.estimation.filter.motion_history import WayBack
from controllers.fault import Bound, Cause, Fault, Severity
from controllers.ground_motion.motion import GroundMotion, Rates, WheelPrior
from controllers.ground_motion.settings import GroundMotionSettings
from drivers.clock import nanoseconds, seconds
from drivers.record import record
from drivers.samples import FrameSample, RateSample

SLIP_WINDOW_M = 0.05
"""The slip is reported over this travel of the wheels; over less than half of it there is only a velocity."""
GREATEST_SLIP = 1.5
"""Greatest difference of ground and wheels, over the travel of the wheels, that slip explains."""
SLACK_M = 0.005
"""And beside it: camera and wheels are timed to some hundredths of a second, and a rover starts and stops."""
WINDOW_NS = 2_000_000_000
"""And over this time at most: what the slip was before the rover stood is not what it is."""
STANDSTILL_NS = 500_000_000
"""Motion while the wheels stand is summed over this time."""
TURN_NS = 1_000_000_000
"""Turns by gyro and by camera are compared over this time."""
DEVIATIONS = 4.0
"""Beyond so many standard deviations a motion at standstill, or a difference of turns, is none of noise."""
STRAIGHT = 0.7
"""Least length of the sum of the travels over the sum of their lengths, for a slip of the whole."""
WHEELS_SD = 0.005
"""Of the travel of rolling wheels, as a share: radius and encoders."""


class GroundMeter(Protocol):
    """Measures the motion over the ground in frames, one after the other."""

    @property
    def point_m(self) -> tuple[float, float]:
        """The point of the vehicle whose motion is measured, forward and left."""
        ...

    @property
    def from_ns(self) -> int | None:
        """Time of the frame at which the next pair begins; None before the first."""
        ...

    def measure(self, frame: FrameSample, t_ns: int, prior: WheelPrior) -> GroundMotion | None:
        """Return the motion since the frame before; None for the first frame and one of another size.

        Args:
            frame: The frame.
            t_ns: Middle of its exposure, later than that of the frame before.
            prior: Motion since the frame before by wheels and gyro.
        """
        ...


class GroundPair(NamedTuple):
    """Travel of the rover's origin between two frames, in the body frame, to the left as imaginary part.

    Attributes:
        rolled_m: By rolling wheels.
        ground_m: Over the ground.
        turn_rad: By the source of the yaw.
        motion: As it was measured.
    """

    rolled_m: complex
    ground_m: complex
    turn_rad: float
    motion: GroundMotion

    @property
    def fault(self) -> Fault | None:
        """Why the motion cannot be that of the ground under these wheels; None where it can.

        Wheels may slip wholly, skid, slide aside, and the rover may roll back at half their speed. Beyond
        that a camera is the likelier cause: turned round, or with another focal length than its rig says.
        """
        apart_m = abs(self.ground_m - self.rolled_m)
        if apart_m <= GREATEST_SLIP * abs(self.rolled_m) + SLACK_M + 3.0 * self.sd_m:
            return None
        text = (
            f"the rover moves over the ground {1e3 * self.ground_m.real:.0f} mm ahead and "
            f"{1e3 * self.ground_m.imag:.0f} mm to the left where its wheels roll "
            f"{1e3 * self.rolled_m.real:.0f} and {1e3 * self.rolled_m.imag:.0f} mm"
        )
        bound = Bound(position_m=apart_m)
        return Fault("camera", Cause.GROUND_AGAINST_WHEELS, text, Severity.UNCERTAIN, bound)

    @property
    def sd_m(self) -> float:
        """Standard deviation of `ground_m` by this pair alone."""
        return math.hypot(self.motion.forward_sd_m, self.motion.left_sd_m)


class SeenFrame(NamedTuple):
    """A frame up to which the motion of the wheels is known.

    Attributes:
        pair: Motion since the pair's first frame; None where it is not valid, or began before the recorded
            motion of the wheels. One that contradicts the wheels is not to be used.
        is_begin: Whether the next pair begins here.
        rig_fault: By how much all earlier pairs may have moved the rover wrongly; None for not at all.
    """

    pair: GroundPair | None
    is_begin: bool
    rig_fault: Fault | None


@record(frozen=True, slots=True, kw_only=True)
class GroundReport:
    """Motion over the ground as the camera measures it.

    Attributes:
        t_ns: Time of the newest frame of which a motion is known, middle of its exposure; 0 before.
        velocity_x_m_s: Of the rover, forward, over the newest valid pair; None where that is too old.
        velocity_y_m_s: The same to the left.
        slip: Slip ratio of the rover over the last `SLIP_WINDOW_M` of its wheels; None near standstill,
            on turns, and where the motion is not valid.
        slip_sd: Its standard deviation; None likewise.
        drift_rad: Angle from the course of rolling wheels to the true one, left positive; None likewise.
        reason: Why the motion is not valid; empty where it is.
        unconfirmed: What the drive has not confirmed about the camera so far, and how it does, and which
            motion the ground leaves open; empty for nothing.
    """

    t_ns: int
    velocity_x_m_s: float | None
    velocity_y_m_s: float | None
    slip: float | None
    slip_sd: float | None
    drift_rad: float | None
    reason: str
    unconfirmed: str = ""


class GroundTravel:
    """The pairs of frames that were measured, and the slip that they show.

    Args:
        settings: Times of the camera.
        meter: Measures the motion.

    Attributes:
        sees_rotation: Whether the turn that was last compared with that by the gyro is none of noise.
    """

    def __init__(self, settings: GroundMotionSettings, meter: GroundMeter) -> None:
        self._meter = meter
        self._delay_ns = nanoseconds(settings.camera_delay_s)
        self._age_ns = nanoseconds(settings.greatest_age_s)
        self._frame_ns: int | None = None
        self._window: deque[GroundPair] = deque()
        self._valid: GroundPair | None = None
        self._reason = "no pair of frames so far"
        self._unconfirmed = ""
        self._rates_rad_s: Rates | None = None
        self._recent: deque[GroundPair] = deque()
        self._turned: list[GroundPair] = []
        self.sees_rotation = False
        self._t_ns = 0

    def exposed_ns(self, frame: FrameSample, t_ns: int) -> int:
        """Return the middle of the exposure of a frame that arrived at `t_ns`."""
        stamp_ns = frame.t_ns if frame.t_capture_ns is None else frame.t_capture_ns
        return min(stamp_ns, t_ns) - self._delay_ns

    def take_rates(self, sample: RateSample) -> None:
        """Take the turn rates of the body for the frames to come."""
        x, y, z = sample.rate_x_rad_s, sample.rate_y_rad_s, sample.rate_z_rad_s
        self._rates_rad_s = None if x is None or y is None or not math.isfinite(x + y + z) else (x, y, z)

    def measure(
        self, frame: FrameSample, t_ns: int, now: WayBack, way_back: Callable[[int], WayBack | None]
    ) -> SeenFrame:
        """Return what a frame shows.

        Args:
            frame: Newer than the one before.
            t_ns: Middle of its exposure.
            now: From the present pose to that at this time.
            way_back: Returns the same for another time; None outside the recorded motion.
        """
        before = None if self._frame_ns is None else way_back(self._frame_ns)
        self._frame_ns = t_ns
        rolled_m, turn_rad = (0j, 0.0) if before is None else _between(before, now)
        point_m = rolled_m + self._turned_m(turn_rad)
        prior = WheelPrior(point_m.real, point_m.imag, turn_rad, self._rates_rad_s)
        motion = self._meter.measure(frame, t_ns, prior)
        pair = None if motion is None else self._pair(motion, now, way_back(motion.from_ns))
        rig_fault = None if motion is None else motion.rig_fault
        return SeenFrame(pair, self._meter.from_ns == t_ns, rig_fault)

    def miss(self) -> None:
        """Take that a frame is older than the recorded motion."""
        self._reason = "frame older than the motion of the wheels"

    def _turned_m(self, turn_rad: float) -> complex:
        """Return by how much the measured point moves, in the later axes, while the origin only turns."""
        return complex(*self._meter.point_m) * (1.0 - cmath.rect(1.0, -turn_rad))

    def _pair(self, motion: GroundMotion, now: WayBack, before: WayBack | None) -> GroundPair | None:
        self._t_ns, self._unconfirmed = motion.to_ns, motion.unconfirmed
        if not motion.is_valid or before is None:
            self._reason = motion.invalid_because or "pair older than the motion of the wheels"
            return None
        rolled_m, turn_rad = _between(before, now)
        ground_m = complex(motion.forward_m, motion.left_m) - self._turned_m(turn_rad)
        pair = GroundPair(rolled_m, ground_m, turn_rad, motion)
        fault = pair.fault
        self._reason = "" if fault is None else fault.text
        if fault is not None:
            return pair
        self._valid = pair
        self._recent.append(pair)
        self._turned.append(pair)
        self._window.append(pair)
        _forget(self._recent, motion.to_ns - STANDSTILL_NS)
        _forget(self._window, motion.to_ns - WINDOW_NS)
        length_m = sum(abs(pair.rolled_m) for pair in self._window)
        while length_m - abs(self._window[0].rolled_m) >= SLIP_WINDOW_M:
            length_m -= abs(self._window.popleft().rolled_m)
        return pair

    def is_valid(self, now_ns: int) -> bool:
        """Return whether a valid pair is new enough to be used."""
        return self._valid is not None and now_ns - self._valid.motion.to_ns <= self._age_ns

    def moved_m(self, since_ns: int, now_ns: int) -> float:
        """Return how far the rover has moved over the ground in the newest half second, after a time.

        0 where it may not have moved at all, and where that is not measured.
        """
        if not self.is_valid(now_ns):
            return 0.0
        pairs = [pair for pair in self._recent if pair.motion.from_ns >= since_ns]
        moved_m = abs(sum(pair.ground_m for pair in pairs))
        noise_m = math.sqrt(sum(pair.sd_m**2 for pair in pairs))
        return moved_m if moved_m > DEVIATIONS * noise_m else 0.0

    def compare_turns(self, camera: str, *, is_gyro: bool) -> Iterator[Innovation]:
        """Yield the turn by the camera against that by the gyro, once in a second; it corrects nothing.

        Errors of neighbouring pairs are alike: their standard deviations add up.

        Args:
            camera: Name of the camera.
            is_gyro: Whether the turn of the newest pairs was measured by a gyro.
        """
        pairs = self._turned
        if not is_gyro:
            pairs.clear()
        if not pairs or pairs[-1].motion.to_ns - pairs[0].motion.from_ns < TURN_NS:
            return
        self._turned = []
        seen_rad = sum(pair.motion.turn_rad for pair in pairs)
        residual_rad = seen_rad - sum(pair.turn_rad for pair in pairs)
        variance = sum(pair.motion.turn_sd_rad for pair in pairs) ** 2
        self.sees_rotation = seen_rad**2 > DEVIATIONS**2 * variance
        nis = residual_rad**2 / variance if variance > 0.0 else math.inf
        yield Innovation(
            measured=Measured(camera, "turn"),
            outcome=Outcome.ACCEPTED if nis <= DEVIATIONS**2 else Outcome.REJECTED,
            residual=residual_rad,
            variance=variance,
            nis=nis,
            gate=DEVIATIONS**2,
        )

    def report(self, now_ns: int) -> GroundReport:
        """Return the motion by the newest pair; where that is not valid, or too old, it is absent."""
        valid = self._valid if self.is_valid(now_ns) and not self._reason else None
        if valid is None:
            self._window.clear()
            return GroundReport(
                t_ns=self._t_ns,
                velocity_x_m_s=None,
                velocity_y_m_s=None,
                slip=None,
                slip_sd=None,
                drift_rad=None,
                reason=self._reason or "no frame for too long",
                unconfirmed=self._unconfirmed,
            )
        velocity_m_s = valid.ground_m / seconds(valid.motion.to_ns - valid.motion.from_ns)
        slip, slip_sd, drift_rad = self._slip()
        return GroundReport(
            t_ns=self._t_ns,
            velocity_x_m_s=velocity_m_s.real,
            velocity_y_m_s=velocity_m_s.imag,
            slip=slip,
            slip_sd=slip_sd,
            drift_rad=drift_rad,
            reason="",
            unconfirmed=self._unconfirmed,
        )

    def _slip(self) -> tuple[float | None, float | None, float | None]:
        """Return slip, its standard deviation and the drift of the window.

        None where it has no direction, and where the wheels have hardly moved in the newest half second.
        """
        newest_m = abs(sum(pair.rolled_m for pair in self._recent))
        if newest_m <= DEVIATIONS * self._recent[-1].sd_m:
            return None, None, None
        rolled_m = sum((pair.rolled_m for pair in self._window), 0j)
        length_m = sum(abs(pair.rolled_m) for pair in self._window)
        if abs(rolled_m) < max(0.5 * SLIP_WINDOW_M, STRAIGHT * length_m):
            return None, None, None
        share = sum((pair.ground_m for pair in self._window), 0j) / rolled_m
        pairs_sd = math.sqrt(sum(pair.sd_m**2 for pair in self._window)) / abs(rolled_m)
        scale_sd = max(pair.motion.scale_sd for pair in self._window)
        sd = math.hypot(pairs_sd, abs(share) * math.hypot(scale_sd, WHEELS_SD))
        return 1.0 - share.real, sd, cmath.phase(share) if abs(share) > pairs_sd else 0.0


def _forget(pairs: deque[GroundPair], before_ns: int) -> None:
    """Leave out pairs that began before a time, but not the newest one."""
    while len(pairs) > 1 and pairs[0].motion.from_ns < before_ns:
        pairs.popleft()


def _between(before: WayBack, now: WayBack) -> tuple[complex, float]:
    """Return the travel of rolling wheels between two times, in the axes of the later one, and the turn."""
    rolled_m = (before.rolled_m - now.rolled_m) * cmath.rect(1.0, now.turned_rad)
    return rolled_m, math.remainder(before.turned_rad - now.turned_rad, math.tau)
