"""The operator of a run whose page is in another process: takes orders, hands out views, never waits."""

import math
import queue
from collections.abc import Iterator, Sequence
from multiprocessing.connection import Connection
from typing import Protocol

from controllers.control_loop import StepOutput
from controllers.estimation.ground_settings import GroundSettings
from controllers.motion.body_motion import BodyMotion
from controllers.operator import OperatorInput, merge
from controllers.safety import Mode
from drivers.clock import NANOSECONDS_PER_SECOND, Clock, PacedClock, SystemClock, seconds
from drivers.driver import Health
from drivers.samples import HeadingSample, WheelSample
from rover_hil.bench.camera_frames import CameraFrame, FrameChoice
from rover_hil.bench.views import Confirmation, DeviceView, EndOrder, Notice, Order, View
from rover_hil.run.executive import CycleView, End
from rover_hil.run.heartbeat import LifeWatch, LossLatch
from sim_backends.world.plant import Truth

VIEW_PERIOD_NS = NANOSECONDS_PER_SECOND // 20


class NoticeQueue(Protocol):
    """The bounded queue to the page."""

    def put_nowait(self, item: Notice | CameraFrame, /) -> None:
        """Put an item in; raises `queue.Full` where there is no room."""
        ...


class PageOperator:
    """Operates a run for a page.

    A view is dropped where the queue is full: a page that is slow or hangs never delays the loop.

    Motion by hand counts only after rest was commanded while the loop was running. Whatever stopped the
    rover, a key that is held does not drive it on by itself.

    Args:
        orders: Where the page's orders arrive. When it is closed the page is gone, and the run ends.
        notices: Where views go.
        wheel_count: Number of wheels.
        clock: The clock of a simulated run, or None.
        frames: Chooses the frames to be shown, or None.
        yaw_unwatched: That nothing in the run would notice a wrong yaw; empty where something does.
        ground: What is assumed about slip that nothing measures; None for the default.
        watches: Without these heartbeats the rover stops; when they are back it waits for a confirmation.
        real_clock: Their clock.
    """

    def __init__(
        self,
        orders: "Connection[object, object]",
        notices: NoticeQueue,
        wheel_count: int,
        clock: PacedClock | None,
        frames: FrameChoice | None = None,
        yaw_unwatched: str = "",
        ground: GroundSettings | None = None,
        watches: Sequence[LifeWatch] = (),
        real_clock: Clock | None = None,
    ) -> None:
        self._orders = orders
        self._notices = notices
        self._clock = clock
        self._frames = frames
        self._yaw_unwatched, self._ground = yaw_unwatched, ground or GroundSettings()
        self._latch = LossLatch(watches)
        self._real_clock = real_clock or SystemClock()
        self._stop_reason = ""
        self._loop_waits = False
        self._loop_stops = self._confirmations = 0
        self._is_running = False
        self._was_at_rest = False
        self._first_truth: Truth | None = None
        self._end: tuple[End, str] | None = None
        self._wanted: OperatorInput | None = None
        self._is_connected = True
        self._start_ns: int | None = None
        self._next_ns = 0
        self._cycles = 0
        self._dropped = 0
        self._work_ns = 0
        self._late_ns = 0
        self._current_a: list[float | None] = [None] * wheel_count
        self._headings: dict[str, float] = {}
        self._gains: dict[str, float] = {}

    def wanted(self) -> OperatorInput | None:
        """Return what the page has ordered since the last call, as one input; None for nothing."""
        self._look_for_life()
        self._take_orders()
        wanted, self._wanted = self._wanted, None
        if wanted is not None:
            self._gains.update(wanted.gains)
        return wanted

    @property
    def waits_for_operator(self) -> bool:
        """Whether the rover stays stopped until the operator confirms that it may move."""
        return bool(self._latch.reason) or self._loop_waits

    def end(self) -> tuple[End, str] | None:
        """Return how and why the page ends the run; None to go on."""
        self._take_orders()
        return self._end

    def show(self, view: CycleView) -> None:
        """Take a cycle; every 50 ms one goes to the page."""
        self._cycles += 1
        self._is_running = view.output.mode is Mode.RUNNING
        self._loop_stops += view.output.waits_for_operator and not self._loop_waits
        self._loop_waits = view.output.waits_for_operator
        self._was_at_rest &= self._is_running
        self._work_ns = max(self._work_ns, view.work_ns)
        self._late_ns = max(self._late_ns, view.late_ns)
        for sample in view.samples:
            if isinstance(sample, WheelSample):
                if sample.current_a is not None:
                    self._current_a[sample.wheel] = sample.current_a
            elif isinstance(sample, HeadingSample):
                self._headings[sample.device] = sample.heading_rad
        if self._first_truth is None:
            self._first_truth = view.truth
        if self._frames is not None:
            for frame in self._frames.choose(view):
                self._offer(frame)
        now_ns = view.output.t_ns
        if self._start_ns is None:
            self._start_ns = now_ns
        if now_ns < self._next_ns:
            return
        self._next_ns = now_ns + VIEW_PERIOD_NS
        self._offer(self._view(view, seconds(now_ns - self._start_ns)))
        self._work_ns = self._late_ns = 0

    def _offer(self, notice: Notice | CameraFrame) -> None:
        try:
            self._notices.put_nowait(notice)
        except queue.Full:
            self._dropped += 1

    def _look_for_life(self) -> None:
        reason = self._latch.check(self._real_clock.now_ns())
        if reason != self._stop_reason:
            self._stop_reason = reason
            self._want(OperatorInput(stop_reason=reason))

    @property
    def _stops(self) -> int:
        return self._latch.losses + self._loop_stops + self._confirmations

    def _confirm(self, stops: int) -> None:
        """Release a loss, or else a stop of the loop: one click never confirms what the user has not read."""
        if not self.waits_for_operator or stops != self._stops:
            return
        if not self._latch.reason:
            self._want(OperatorInput(is_confirmed=True))
        elif self._latch.release():
            self._stop_reason = ""
            self._want(OperatorInput(stop_reason=""))
        else:
            return
        self._confirmations += 1

    def _take_orders(self) -> None:
        for order in self._arrived():
            if isinstance(order, EndOrder):
                self._end = self._end or (order.end, order.reason)
            elif isinstance(order, Confirmation):
                self._confirm(order.stops)
            elif order.motion is None or self._may_drive(order.motion):
                self._want(order)

    def _want(self, wanted: OperatorInput) -> None:
        self._wanted = wanted if self._wanted is None else merge(self._wanted, wanted)

    def _may_drive(self, motion: BodyMotion) -> bool:
        self._was_at_rest |= self._is_running and not any(motion)
        return self._was_at_rest

    def _arrived(self) -> Iterator[Order]:
        try:
            while self._is_connected and self._orders.poll():
                order = self._orders.recv()
                if isinstance(order, Order):
                    yield order
        except (EOFError, OSError):
            self._is_connected = False
            self._end = self._end or (End.TERMINATED, "the program of the page has ended")

    def _view(self, view: CycleView, t_s: float) -> View:
        output = view.output
        pose, odometry = output.estimate, output.odometry
        xx, xy, _, yy, _, yaw_yaw = pose.covariance
        slip, slip_names, slip_reason = _slip(output)
        return {
            "kind": "view",
            "t_s": t_s,
            "mode": output.mode.value,
            "reason": self._latch.reason or output.reason,
            "pose": (pose.x_m, pose.y_m, pose.yaw_rad),
            "odometry": (odometry.x_m, odometry.y_m, odometry.yaw_rad),
            "truth": _relative(view.truth, self._first_truth),
            "covariance": (xx, xy, yy, yaw_yaw),
            "headings": dict(self._headings),
            "slip": slip,
            "slip_names": slip_names,
            "slip_reason": slip_reason,
            "assumed": (
                self._ground.contradicted_words if output.is_ground_contradicted else self._ground.words
            ),
            "suspicion": "; ".join(filter(None, (output.suspicion, self._yaw_unwatched))),
            "current_a": list(self._current_a),
            "set_rad_s": view.sent.speed_rad_s,
            "limit": output.limit.value,
            "cross_track_m": output.cross_track_m,
            "devices": [_device(health) for health in view.healths],
            "work_us": self._work_ns / 1e3,
            "late_us": self._late_ns / 1e3,
            "cycles": self._cycles,
            "gains": dict(self._gains),
            "lost_s": 0.0 if self._clock is None else seconds(self._clock.lost_ns),
            "dropped": self._dropped,
            "waits_for_operator": self.waits_for_operator,
            "stops": self._stops,
        }


def _relative(truth: Truth | None, first: Truth | None) -> tuple[float, float, float] | None:
    """Return the true pose from where the rover was at first, as the estimate counts it."""
    if truth is None or first is None:
        return None
    x_m, y_m = truth.x_m - first.x_m, truth.y_m - first.y_m
    cos, sin = math.cos(first.yaw_rad), math.sin(first.yaw_rad)
    return cos * x_m + sin * y_m, -sin * x_m + cos * y_m, truth.yaw_rad - first.yaw_rad


def _slip(output: StepOutput) -> tuple[list[float | None], list[str], str]:
    """Return the measured or estimated slip, what each number is, and why one is not valid or unsure."""
    if output.ground is not None and not output.ground.reason:
        return [output.ground.slip], ["rover, by the camera"], ""
    if output.scomp is not None:
        reason = output.scomp.reason
        return [None if reason else output.scomp.slip], ["rover"], reason
    if output.slip is None:
        return [], [], ""
    wheels = output.slip.wheels
    reasons = [wheel.reason for wheel in wheels if not wheel.valid]
    rover = output.slip.rover
    if rover is not None and rover.unsure:
        reasons.append(rover.unsure)
    values = [wheel.slip if wheel.valid else None for wheel in wheels]
    return values, [f"wheel {number}" for number in range(len(wheels))], next(iter(reasons), "")


def _device(health: Health) -> DeviceView:
    return {
        "name": health.device,
        "state": health.state.value,
        "rate_hz": health.rate_hz,
        "age_s": health.age_s,
        "reason": health.last_link_reason,
    }
