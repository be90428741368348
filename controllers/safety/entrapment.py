"""Stop rule about a rover that does not get on although its wheels turn."""

import cmath
import math
import operator
from collections import deque
from collections.abc import Iterator
from typing import Annotated, NamedTuple

from pydantic import Field

from controllers.estimation.filter.motion_history import HISTORY_NS
from controllers.estimation.ground.travel import GroundPair
from controllers.fault import Bound, Cause, Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety.reasons import Cycle, StopRule
from drivers.clock import seconds
from drivers.safety_event import RESTART, Outcome, SafetyEvent
from drivers.samples import PoseFixSample, Sample
from drivers.settings import Settings


class EntrapmentSettings(Settings):
    """When wheels that turn without moving the rover stop it.

    Attributes:
        back_out_m: After the first stop because it makes no progress the rover waits, drives back by at most
            this travel of its wheels along its estimated path, and tries the mission again; 0 for never. It
            happens once in a mission, with every stop rule in force, and is announced as
            `rover: backs out along …`. A second such stop lasts until restart.
        entrapment_m: The rover stops until restart when its wheels have travelled this far straight ahead and
            pose fixes show no progress. Without fixes nothing decides: the slip of the yaw excitation over
            this travel is shown as a suspicion.
        entrapment_slip: Slip from which on the yaw excitation raises the suspicion. Fixes must be able to
            show it: where they are noisier, a longer travel is needed.
        progress_unknown_m: The rover also stops, and goes on once, when nothing has shown progress for this
            travel of the wheels while the body does not answer the yaw excitation (it turns by less than 0.25
            of its wheels, or lags them much), or while the drive force is below a quarter or above twice of
            that of free driving; or for `entrapment_m` while a rear camera sees no motion. At most half of
            the travel lies before the suspicion. The drive force must be at least 3 N at first, and stops
            once: a slope changes it, too. The pose becomes uncertain by what the wheels turned; where the
            body does not answer, by what no motion and full motion differ from the estimate. Greater than the
            length of the mission for never.
        entrapment_ground_m: The rover also stops until restart when its wheels have travelled this far while
            a camera measured no progress over the ground.
    """

    back_out_m: Annotated[float, Field(ge=0.0, le=0.3)] = 0.0
    entrapment_m: Annotated[float, Field(ge=0.02, le=100.0)] = 0.5
    entrapment_ground_m: Annotated[float, Field(ge=0.02, le=100.0)] = 0.15
    entrapment_slip: Annotated[float, Field(ge=0.5, le=1.0)] = 0.85
    progress_unknown_m: Annotated[float, Field(ge=0.1, le=1000.0)] = 1.5


PROGRESS_CAUSES = (Cause.LOST_RESPONSE, Cause.UNUSUAL_FORCE, Cause.NO_MOTION_SEEN, Cause.STUCK)
"""Causes of the stops of a rover that does not get on, or may not."""

DEVIATIONS = 2.0
"""A displacement between two fixes is progress from this many standard deviations on; 1 in 20 is noise."""

LOOKS = 5
"""Fixes are compared at most this often in `entrapment_m`: each comparison may take noise for progress."""

LEAST_PROGRESS = 0.02
"""A displacement below this share of the travel of the wheels is none: so a rover slides along a wall."""

LEAST_GROUND_PROGRESS = 0.006
"""The same over the ground under a camera. Errors of pairs at rest do not add up, as each frame is compared
with one before: the sum of 17 was 0.03 mm (four rendered drives). The least progress of a rover of
`tests/nature` that drove on was 1.1 % of 0.2 m."""

LEAST_ASIDE = 0.1
"""Travel over the ground across that of the wheels, as a share of it, from which on a rover slides, or its
camera is turned. Along a wall it slides by less: 3 % of 0.15 m (`benchmarks.safety.entrapped_missions`)."""

BEFORE_SHARE = 0.5
"""At most this share of `progress_unknown_m` lies before the suspicion."""

STRAIGHT = 0.7
"""Least distance between the ends of a travel over its length: that of a right angle of equal sides."""


KNOWN_YAW_RAD = math.pi / 4.0 / DEVIATIONS
"""Greatest standard deviation of the yaw of a fix that shows a direction: within `DEVIATIONS` of them a
displacement along the travel remains greater along it than across."""


class _Travelled(NamedTuple):
    """What the wheels had travelled by a time.

    Attributes:
        t_ns: The time.
        wheels_m: Place by the wheels, in the local frame.
        yaw_rad: Estimated yaw.
        length_m: Length of the travel of the wheels.
    """

    t_ns: int
    wheels_m: complex
    yaw_rad: float
    length_m: float


class _Seen(NamedTuple):
    """A fix, and what the wheels had travelled when it was captured."""

    fix: PoseFixSample
    travelled: _Travelled

    @property
    def place_m(self) -> complex:
        """By the fix, in its frame."""
        return complex(self.fix.x_m, self.fix.y_m)


class _Progress(NamedTuple):
    """Travel of the wheels between two fixes, and what of it the fixes show.

    Attributes:
        wheels_m: Distance between both ends by the wheels.
        length_m: Length of their travel.
        moved_m: Displacement by the fixes along it; negative backwards. Where the yaw of the first fix is not
            known well, its magnitude in any direction, and 1 in 7 is noise.
        noise_m: A displacement below this is none.
    """

    wheels_m: float
    length_m: float
    moved_m: float
    noise_m: float

    @property
    def is_seen(self) -> bool:
        """Whether the rover has moved along the travel, or against it."""
        return abs(self.moved_m) > max(self.noise_m, LEAST_PROGRESS * self.wheels_m)


class ProgressByFixes:
    """Compares the travel of the wheels with the displacement between fixes of one device.

    A window begins at the last fix that has shown progress. The rover may have got stuck just after the fix
    before that: `lost_m` counts from there.

    Args:
        settings: What counts as no progress.

    Attributes:
        lost_m: Travel of the wheels on which the fixes have shown no progress; 0 where they do not show it.
        is_seen: Whether the newest fix that was compared has shown progress.
    """

    def __init__(self, settings: EntrapmentSettings) -> None:
        self._settings = settings
        self._begin: _Seen | None = None
        self._last: _Seen | None = None
        self._before_m = 0.0
        self.lost_m = 0.0
        self.is_seen = False

    def take(self, seen: _Seen) -> None:
        """Take a fix; those on less than a `LOOKS`-th of `entrapment_m` are left out."""
        begin, last = self._begin, self._last
        if begin is None or last is None:
            self._begin = self._last = seen
            return
        if seen.travelled.length_m - last.travelled.length_m < self._settings.entrapment_m / LOOKS:
            return
        self._last = seen
        whole, newest = _compare(begin, seen), _compare(last, seen)
        self.lost_m, self.is_seen = 0.0, whole.is_seen
        if whole.is_seen:
            self._begin = seen
            self._before_m = max(0.0, newest.wheels_m - abs(newest.moved_m))
        elif whole.wheels_m < STRAIGHT * whole.length_m:
            self._begin, self._before_m = seen, 0.0
        elif whole.noise_m <= (1.0 - self._settings.entrapment_slip) * whole.wheels_m:
            self.lost_m = self._before_m + whole.wheels_m


class ProgressOverGround:
    """Compares the travel of the wheels with that over the ground, in a window that moves with the wheels.

    Progress is travel over the ground along that of the wheels, seen from their course, so a curve is none
    less; or much travel across it, of a rover that slides aside, or under a camera that is turned. Pairs are
    joined until the wheels have travelled more than noise. Wheels that go back and forth are no evidence.

    Args:
        travel_m: Length of the window.
    """

    def __init__(self, travel_m: float) -> None:
        self._travel_m = travel_m
        self._joined = _Travels(0j, 0j)
        self._pieces: deque[_Travels] = deque()
        self._wheels_m = 0.0

    def take(self, pair: GroundPair) -> None:
        """Take a pair; turns on the spot are no travel."""
        joined = _Travels(self._joined.wheels_m + pair.rolled_m, self._joined.ground_m + pair.ground_m)
        if abs(joined.wheels_m) <= DEVIATIONS * pair.sd_m:
            self._joined = joined
            return
        self._joined = _Travels(0j, 0j)
        self._pieces.append(joined)
        self._wheels_m += abs(joined.wheels_m)
        while self._wheels_m - abs(self._pieces[0].wheels_m) >= self._travel_m:
            self._wheels_m -= abs(self._pieces.popleft().wheels_m)

    @property
    def lost_m(self) -> float:
        """Travel of the wheels without progress; 0 where there is some, or where the window is not full."""
        if self._wheels_m < self._travel_m or self.is_seen:
            return 0.0
        if abs(sum(piece.wheels_m for piece in self._pieces)) < STRAIGHT * self._wheels_m:
            return 0.0
        return self._wheels_m

    @property
    def is_seen(self) -> bool:
        """Whether the window shows progress."""
        moved_m = sum((piece.ground_m / piece.course for piece in self._pieces), 0j)
        is_along = abs(moved_m.real) > LEAST_GROUND_PROGRESS * self._wheels_m
        is_aside = abs(moved_m.imag) > LEAST_ASIDE * self._wheels_m
        return is_along or is_aside


class _Travels(NamedTuple):
    """Travel of the wheels and over the ground, in the axes of the vehicle, to the left as imaginary part."""

    wheels_m: complex
    ground_m: complex

    @property
    def course(self) -> complex:
        """Direction of the travel of the wheels, of length 1."""
        return self.wheels_m / abs(self.wheels_m)


def _compare(begin: _Seen, end: _Seen) -> _Progress:
    """Compare two fixes in the body frame of the first."""
    first, last = begin.travelled, end.travelled
    wheels_m = (last.wheels_m - first.wheels_m) * cmath.rect(1.0, -first.yaw_rad)
    fixed_m = (end.place_m - begin.place_m) * cmath.rect(1.0, -begin.fix.yaw_rad)
    along = wheels_m / abs(wheels_m) if wheels_m else 1.0 + 0j
    is_direction_known = 0.0 <= begin.fix.yaw_std_rad <= KNOWN_YAW_RAD
    return _Progress(
        wheels_m=abs(wheels_m),
        length_m=last.length_m - first.length_m,
        moved_m=(fixed_m * along.conjugate()).real if is_direction_known else abs(fixed_m),
        noise_m=DEVIATIONS * math.hypot(begin.fix.position_std_m, end.fix.position_std_m),
    )


class EntrapmentRule(StopRule):
    """Stops where fixes, or a camera, show that the rover does not get on, and where nothing decides.

    The slip reading alone is a suspicion that stops nothing. Others are a response of the yaw that is lost, a
    drive force that is far from that of free driving, and a rear camera that sees no motion: one that lasts
    while nothing decides stops the rover once.

    Progress is the displacement along the travel of the wheels. A rover that slips much and moves is not
    stuck. A fix is compared with the newest travel up to its capture. One that was captured more than
    `HISTORY_NS` before the newest motion does not count.
    """

    observes = (PoseFixSample,)

    events = (
        SafetyEvent(
            Outcome.ENDS,
            "The wheels turn and the rover makes no progress, by pose measurements.",
            "`rover: stuck, its wheels travelled … m and … shows no progress: free it and "
            "restart`; `emergency stop`, exit code 1",
            (
                "tests/controllers/safety/test_entrapment.py::"
                "test_without_progress_on_half_a_metre_the_stop_is_final",
            ),
            within="`entrapment_m` of travel, one period of the measurements and their lag",
            settings=("entrapment_m", "entrapment_slip", "back_out_m"),
            clears="restart; with `back_out_m` the first such stop is not final: the rover drives back "
            "along its path, once, and tries the mission again",
        ),
        SafetyEvent(
            Outcome.ENDS,
            "The wheels turn and the rover makes no progress, by a ground camera: below 0.6 % of "
            "the travel along it, and below 10 % across it.",
            "`rover: stuck, its wheels travelled … m and … shows no progress: free it and "
            "restart`; `emergency stop`, exit code 1",
            (
                "tests/controllers/test_ground_motion_in_the_loop.py::"
                "test_a_rover_whose_ground_stands_still_is_stopped_for_good",
            ),
            within="`entrapment_ground_m` of travel, one period of the frames and their lag",
            settings=("entrapment_ground_m", "back_out_m"),
            clears=RESTART,
        ),
        SafetyEvent(
            Outcome.STOPS,
            "The body no longer answers the yaw excitation, the drive force is below a quarter "
            "or above twice of that of free driving, or a rear camera sees no motion (limit: "
            "`entrapment_m`), and nothing shows progress. The pose becomes uncertain by all the "
            "wheels turned.",
            "`rover: progress unknown on … m of its wheels, …`",
            (
                "tests/controllers/safety/test_entrapment.py::"
                "test_a_suspicion_that_nothing_decides_stops_once_and_counts_anew_after_a_rest",
                "tests/controllers/test_progress.py::"
                "test_a_rover_that_does_not_get_on_is_stopped_as_promised",
            ),
            within="`progress_unknown_m` of travel",
            settings=("progress_unknown_m", "entrapment_m"),
            clears="once, after `suspicion_rest_s` at standstill",
        ),
        SafetyEvent(
            Outcome.CONTINUES,
            "The body turns with less than a quarter of its wheels: its slip is unknown. The region grows by "
            "what no motion and full motion differ from the estimate.",
            "Warning `may be stuck, or … has no signal` in the log, on the page and in the report.",
            (
                "tests/controllers/safety/test_entrapment.py::"
                "test_unknown_slip_widens_the_region_until_progress_is_seen",
            ),
        ),
        SafetyEvent(
            Outcome.CONTINUES,
            "The yaw excitation reads a slip of at least `entrapment_slip` over `entrapment_m`.",
            "Warning `may be stuck` in the log, on the page and in the report.",
            ("tests/controllers/safety/test_entrapment.py::test_a_slip_near_1_alone_is_a_suspicion",),
            settings=("entrapment_slip", "entrapment_m"),
        ),
    )

    def __init__(self, settings: EntrapmentSettings, roles: DeviceRoles) -> None:
        self._settings = settings
        self._camera, self._gyro = roles.camera, roles.gyro
        self._fix_devices = roles.fixes
        self._severity = Severity.RECOVERABLE if settings.back_out_m else Severity.FINAL
        self._is_force_asked = False
        self._begin_anew()
        self._arrived: list[PoseFixSample] = []
        self._wheels_m, self._length_m = 0j, 0.0
        self._history: deque[_Travelled] = deque()
        self._slipped_m = self._unknown_m = self._before_m = self._since_m = 0.0
        self._unknown_slip_m: float | None = None
        self._is_over = False
        self._unknown_rad: tuple[float, ...] = ()
        self._before_ns: int | None = None

    def _begin_anew(self) -> None:
        self._ground = ProgressOverGround(self._settings.entrapment_ground_m)
        self._fixes = {device: ProgressByFixes(self._settings) for device in self._fix_devices}

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take a pose fix."""
        if isinstance(sample, PoseFixSample) and sample.device in self._fixes and _is_usable(sample):
            self._arrived.append(sample)

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Take the travel and the fixes of a cycle; return a reason when the rover does not get on."""
        is_decided = False
        for pair in cycle.measurements.ground_pairs:
            self._ground.take(pair)
            is_decided = self._ground.is_seen
        self._travel(cycle)
        is_decided |= self._take_fixes()
        lost = {self._camera or "": self._ground.lost_m} if self._ground.lost_m else {}
        lost |= {
            device: progress.lost_m
            for device, progress in self._fixes.items()
            if progress.lost_m >= self._settings.entrapment_m
        }
        if lost and cycle.wheels.is_still and self._severity is Severity.RECOVERABLE:
            self._severity, lost = Severity.FINAL, {}  # now it backs out, and all counts anew
            self._begin_anew()
        for device, lost_m in lost.items():
            yield _entrapped(lost_m, device, self._severity)
        yield from self._suspect_slip(cycle)
        self._follow_answers(cycle, is_decided=is_decided)
        suspicion = self._suspicion(cycle)
        self._count(cycle, suspicion, is_decided=is_decided)
        if suspicion is not None:
            yield self._stop(suspicion) if self._is_over else suspicion

    def _travel(self, cycle: Cycle) -> None:
        """Note what the wheels have travelled by the time of their newest motion."""
        self._wheels_m += cycle.wheels.travel_m
        self._length_m += cycle.wheels.distance_m
        history, t_ns = self._history, cycle.wheels.motion_ns
        if t_ns is None or (history and t_ns <= history[-1].t_ns):
            return
        history.append(_Travelled(t_ns, self._wheels_m, cycle.estimate.yaw_rad, self._length_m))
        while history[0].t_ns < t_ns - HISTORY_NS:
            history.popleft()

    def _take_fixes(self) -> bool:
        """Compare each fix with what the wheels had travelled when it was captured.

        Returns:
            Whether one of them has shown progress.
        """
        is_seen = False
        for fix in self._arrived:
            travels = reversed(self._history)
            before = next((each for each in travels if each.t_ns <= fix.t_capture_ns), None)
            if before is not None:
                self._fixes[fix.device].take(_Seen(fix, before))
                is_seen |= self._fixes[fix.device].is_seen
        self._arrived.clear()
        return is_seen

    def _suspect_slip(self, cycle: Cycle) -> Iterator[Fault]:
        """Add up the travel at a slip near 1. Smaller slip clears; unknown slip does not."""
        settings = self._settings
        if cycle.slip.slip is not None:
            is_held = cycle.slip.slip >= settings.entrapment_slip
            self._slipped_m = self._slipped_m + cycle.wheels.distance_m if is_held else 0.0
        if self._slipped_m >= settings.entrapment_m:
            text = (
                "rover: may be stuck, by the yaw excitation its wheels travelled "
                f"{settings.entrapment_m:g} m at a slip of at least {settings.entrapment_slip:g}"
            )
            yield Fault("rover", Cause.MAY_BE_STUCK, text, Severity.WARNING)

    def _follow_answers(self, cycle: Cycle, *, is_decided: bool) -> None:
        """Add up how far the estimate may be off by unknown slip, since progress was seen."""
        share = cycle.slip.unknown_share
        if not share:
            self._unknown_slip_m = None
        elif is_decided:
            self._unknown_slip_m = 0.0
        elif self._unknown_slip_m is None:
            self._unknown_slip_m = share * cycle.slip.unanswered_m
        else:
            self._unknown_slip_m += share * cycle.wheels.distance_m

    def _suspicion(self, cycle: Cycle) -> Fault | None:
        """Return what may be wrong with the progress, beside the slip that is read."""
        if cycle.slip.unmoved_m:
            text = (
                "rover: may be stuck, the rear camera sees no motion of the ground: no progress, or the "
                "camera is covered, turned, or in the dark"
            )
            return Fault("rover", Cause.NO_MOTION_SEEN, text, Severity.WARNING)
        if cycle.slip.lost_response:
            text = f"rover: may be stuck, or {self._gyro} has no signal: {cycle.slip.lost_response}"
            if not self._unknown_slip_m:
                # Known slip, or progress that was just seen: what is bounded begins anew.
                return Fault("rover", Cause.LOST_RESPONSE, text, Severity.WARNING)
            bound = Bound(position_m=self._unknown_slip_m)
            return Fault("rover", Cause.LOST_RESPONSE, text, Severity.UNCERTAIN, bound)
        if cycle.slip.unusual_force:
            text = f"rover: may be stuck, or on a slope or another ground: {cycle.slip.unusual_force}"
            return Fault("rover", Cause.UNUSUAL_FORCE, text, Severity.WARNING)
        return None

    def _limit_m(self, cycle: Cycle) -> float:
        """Return the travel on which nothing may decide: a camera that sees no motion nearly does."""
        settings = self._settings
        least_m = settings.entrapment_m if cycle.slip.unmoved_m else math.inf
        return min(settings.progress_unknown_m, least_m)

    def _count(self, cycle: Cycle, suspicion: Fault | None, *, is_decided: bool) -> None:
        """Add up what the wheels do while a suspicion stands and nothing decides.

        What is over lasts until the wheels are at rest. Then the travel counts anew. An odd force stops once:
        on a slope or another ground it stays as it is.
        """
        is_asked = suspicion is not None and suspicion.cause is Cause.UNUSUAL_FORCE and self._is_force_asked
        is_open = suspicion is not None and not is_decided and not is_asked
        limit_m = self._limit_m(cycle)
        self._since_m = 0.0 if is_decided else self._since_m + cycle.wheels.distance_m
        elapsed_s = 0.0 if self._before_ns is None else seconds(cycle.now_ns - self._before_ns)
        self._before_ns = cycle.now_ns
        if self._is_over and cycle.wheels.is_still:
            self._since_m = 0.0
            self._is_force_asked |= suspicion is not None and suspicion.cause is Cause.UNUSUAL_FORCE
        if not is_open or (self._is_over and cycle.wheels.is_still):
            self._unknown_m, self._unknown_rad, self._is_over = 0.0, (), False
        elif not self._is_over:
            if not self._unknown_rad:
                unsure_m = max(
                    cycle.slip.unanswered_m if cycle.slip.lost_response else 0.0,
                    cycle.slip.unusual_force_m if cycle.slip.unusual_force else 0.0,
                )
                before_m = min(unsure_m, BEFORE_SHARE * limit_m)
                self._before_m = max(
                    before_m, min(cycle.slip.unmoved_m, self._since_m) - cycle.wheels.distance_m, 0.0
                )
                self._unknown_m = self._before_m
            self._unknown_m += cycle.wheels.distance_m
            turned_rad = [speed_rad_s * elapsed_s for speed_rad_s in cycle.wheels.measured_rad_s]
            before_rad = self._unknown_rad or (0.0,) * len(turned_rad)
            self._unknown_rad = tuple(map(operator.add, before_rad, turned_rad))
            self._is_over = self._unknown_m >= limit_m

    def _stop(self, suspicion: Fault) -> Fault:
        """Return the stop of a suspicion that nothing has decided for too long."""
        text = (
            f"rover: progress unknown on {self._unknown_m:.2f} m of its wheels, "
            f"{suspicion.text.removeprefix('rover: ')}"
        )
        # What the wheels turned before the suspicion stood, they turned as they did after it.
        seen_m = self._unknown_m - self._before_m
        share = self._unknown_m / seen_m if seen_m > 0.0 else 1.0
        wheel_rad = tuple(share * turned_rad for turned_rad in self._unknown_rad)
        is_bounded = suspicion.severity is Severity.UNCERTAIN
        bound = suspicion.bound if is_bounded else Bound(wheel_rad=wheel_rad)
        return suspicion._replace(text=text, severity=Severity.RECOVERABLE, bound=bound)


def _entrapped(lost_m: float, device: str, severity: Severity) -> Fault:
    remedy = "free it and restart" if severity is Severity.FINAL else "it rests and backs out once"
    text = f"rover: stuck, its wheels travelled {lost_m:.2f} m and {device} shows no progress: {remedy}"
    return Fault("rover", Cause.STUCK, text, severity)


def _is_usable(fix: PoseFixSample) -> bool:
    numbers = (fix.x_m, fix.y_m, fix.yaw_rad, fix.position_std_m)
    return all(map(math.isfinite, numbers)) and fix.position_std_m > 0.0
