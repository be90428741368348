"""The process of the loop: started before it is needed, so that a run begins at once."""

import multiprocessing
import queue
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TypeAlias

from controllers.motion.kinematics import make_kinematics
from controllers.unwatched_yaw import find_unwatched_yaw
from drivers.clock import PacedClock, SystemClock, nanoseconds
from drivers.errors import RoverHilError
from drivers.safety_event import RESTART, Outcome, SafetyEvent
from rover_hil.bench.camera_frames import CameraFrame, FrameChoice, pack
from rover_hil.bench.page_operator import PageOperator
from rover_hil.bench.views import EndOrder, Notice, Order, Picture, RunOrder
from rover_hil.config import BenchSettings, Config
from rover_hil.recording.watchdog_note import read_note
from rover_hil.run.executive import Operator, RunResult
from rover_hil.run.heartbeat import Heartbeat, LifeWatch

MOST_NOTICES = 64
MOST_ORDERS = 64
"""While the loop hangs so many orders wait for it."""
SERVER_SILENT = "page: no heartbeat of its program for {:g} s"
PAGE_SILENT = "page: the script of the page in control did not answer for {:g} s"
END_S = 5.0
"""Time that a run has to stop the drive and close its log when the program ends."""
NOTE_S = 1.0
"""Time that the watchdog has to write why it ended a run."""
DIED = "the process of the run has ended without a word: `rover-hil replay` reads its log up to there"

RunFunction: TypeAlias = Callable[[RunOrder, Operator, PacedClock | None], RunResult]
ReportFunction: TypeAlias = Callable[[RunOrder], None]
PipeEnd: TypeAlias = "Connection[object, object]"

EVENTS = (
    SafetyEvent(
        Outcome.STOPS,
        "The program of the page hangs.",
        f"`{SERVER_SILENT.replace('{:g}', '…')}`",
        (
            "tests/rover_hil/bench/test_page_operator.py::"
            "test_after_a_loss_the_rover_rests_until_the_operator_confirms",
        ),
        within="`server_timeout_s` and one cycle",
        settings=("bench.server_timeout_s",),
        clears="a click on *Let the rover move again* on the page in control",
    ),
    SafetyEvent(
        Outcome.STOPS,
        "The script of the page in control hangs, or the browser or the network is gone. A page "
        "that only watches does not count.",
        f"`{PAGE_SILENT.replace('{:g}', '…')}`",
        (
            "tests/rover_hil/bench/test_page_operator.py::"
            "test_after_a_loss_the_rover_rests_until_the_operator_confirms",
            "tests/rover_hil/bench/test_stop_in_browser.py::"
            "test_after_a_loss_the_rover_rests_until_the_user_clicks_whatever_comes_back",
            "tests/rover_hil/bench/test_session.py::"
            "test_while_a_run_goes_on_nobody_takes_control_without_a_click",
        ),
        within="`page_timeout_s` and one cycle",
        settings=("bench.page_timeout_s", "bench.page_required"),
        clears="a click on *Let the rover move again* on the page in control",
    ),
    SafetyEvent(
        Outcome.CONTINUES,
        "More than 16 pages, 16 streams, 64 stop connections or 400 connections are open.",
        "Further ones are refused; those in use are kept.",
        ("tests/rover_hil/bench/test_stop_line.py::test_connections_are_limited_and_those_in_use_are_kept",),
    ),
    SafetyEvent(
        Outcome.ENDS,
        "EMERGENCY STOP is pressed on the page.",
        "`emergency stop`, reason `emergency stop pressed on the page`",
        ("tests/rover_hil/bench/test_stop_line.py::test_a_press_is_ordered_once_and_answered_each_time",),
        within="one cycle after it has arrived",
        clears=RESTART,
    ),
    SafetyEvent(
        Outcome.ENDS,
        "The program of the page is gone.",
        "`terminated`",
        ("tests/rover_hil/bench/test_page_operator.py::test_a_run_ends_when_the_page_s_program_is_gone",),
        within="one cycle",
        clears=RESTART,
    ),
)
"""Rows of the reference page of safety."""


class LoopProcess:
    """A process that waits for one order to run, runs it, and writes its report.

    Args:
        run: Runs the order; a function of a module, so that the other process can import it.
        report: Writes the report of the order.
        on_notice: Called with every notice of the run, from a thread.

    Attributes:
        server_life: The heartbeat of the program that serves the page.
        browser_life: That of the script of the page in control.
    """

    def __init__(self, run: RunFunction, report: ReportFunction, on_notice: Callable[[Notice], None]) -> None:
        context = multiprocessing.get_context("spawn")
        their_orders, self._orders = context.Pipe(duplex=False)
        self._notices, their_notices = context.Pipe(duplex=False)
        self._on_notice = on_notice
        self.server_life, self.browser_life = Heartbeat(), Heartbeat()
        signs = self.server_life, self.browser_life
        self._process = context.Process(
            target=_serve, args=(run, report, their_orders, their_notices, signs), name="loop"
        )
        self._process.start()
        # Else neither side would notice that the other is gone.
        their_orders.close()
        their_notices.close()
        self._waiting: queue.SimpleQueue[RunOrder | Order | None] = queue.SimpleQueue()
        self._is_closing = False
        self._log_path: Path | None = None
        threading.Thread(target=self._send, name="orders", daemon=True).start()
        threading.Thread(target=self._drain, name="notices", daemon=True).start()

    def send(self, order: RunOrder | Order) -> bool:
        """Send an order, without ever waiting; it has no effect when the process has ended.

        Returns whether it was taken. While the loop hangs only a few inputs are, but each order to end is.
        """
        if not isinstance(order, RunOrder | EndOrder) and self._waiting.qsize() >= MOST_ORDERS:
            return False
        if isinstance(order, RunOrder) and not order.is_virtual:
            self._log_path = order.log_path
        self._waiting.put(order)
        return True

    def close(self) -> None:
        """End the run, if there is one, and the process."""
        self._is_closing = True
        self._waiting.put(None)
        self._process.join(END_S)
        if self._process.is_alive():
            self._process.terminate()
            self._process.join()

    def _send(self) -> None:
        with self._orders, suppress(OSError):
            while (order := self._waiting.get()) is not None:
                self._orders.send(order)

    def _drain(self) -> None:
        kind = "view"
        while kind not in ("reported", "failed"):
            try:
                notice: Notice = self._notices.recv()
            except (EOFError, OSError):
                if self._is_closing:
                    return
                notice = {"kind": "failed", "error": self._cause_of_death()}
            kind = notice["kind"]
            self._on_notice(notice)
        self._notices.close()
        self._waiting.put(None)
        self._process.join()

    def _cause_of_death(self) -> str:
        """Return what the watchdog wrote beside the log, else that nothing is known."""
        if self._log_path is None:
            return DIED
        clock = SystemClock()
        end_ns = clock.now_ns() + nanoseconds(NOTE_S)
        while not (note := read_note(self._log_path)) and clock.now_ns() < end_ns:
            clock.sleep_until(clock.now_ns() + nanoseconds(0.05))
        return note or DIED


class NoticeSender:
    """Sends notices from a thread of its own, which also packs frames; there is room for a bounded number.

    Args:
        pipe: Where they go.
    """

    def __init__(self, pipe: PipeEnd) -> None:
        self._pipe = pipe
        self._waiting: queue.Queue[Notice | CameraFrame | None] = queue.Queue(MOST_NOTICES)
        self._thread = threading.Thread(target=self._send, name="views", daemon=True)
        self._thread.start()

    def put_nowait(self, item: Notice | CameraFrame, /) -> None:
        """Hand a notice over.

        Raises:
            queue.Full: There is no room.
        """
        self._waiting.put_nowait(item)

    def put(self, item: Notice) -> None:
        """Hand a notice over that must arrive; it is given up when nobody reads for seconds."""
        with suppress(queue.Full):
            self._waiting.put(item, timeout=END_S)

    def close(self) -> None:
        """Wait until everything is sent, or nobody reads for seconds."""
        with suppress(queue.Full):
            self._waiting.put(None, timeout=END_S)
        self._thread.join(END_S)

    def _send(self) -> None:
        with suppress(OSError):
            while (notice := self._waiting.get()) is not None:
                self._pipe.send(_picture(notice) if isinstance(notice, CameraFrame) else notice)


def _picture(frame: CameraFrame) -> Picture:
    try:
        return pack(frame)
    except Exception as error:  # noqa: BLE001 - a frame that cannot be drawn must not end all views of the run
        words = f"this frame cannot be drawn: {error}"
        return {"kind": "picture", "camera": frame.camera, "words": words, "jpeg": b""}


def _serve(
    run: RunFunction,
    report: ReportFunction,
    orders: PipeEnd,
    notices: PipeEnd,
    signs: tuple[Heartbeat, Heartbeat],
) -> None:
    """Wait for an order, run it, write its report."""
    with suppress(KeyboardInterrupt, EOFError):
        order = orders.recv()
        if isinstance(order, RunOrder):
            sender = NoticeSender(notices)
            _run(run, report, order, orders, sender, make_watches(order.config.bench, *signs))
            sender.close()


def make_watches(settings: BenchSettings, server: Heartbeat, browser: Heartbeat) -> list[LifeWatch]:
    """Return what watches the heartbeats that a run from the page needs."""
    server_s, page_s = settings.server_timeout_s, settings.page_timeout_s
    watches = [LifeWatch(server, server_s, SERVER_SILENT.format(server_s))]
    if settings.page_required:
        watches.append(LifeWatch(browser, page_s, PAGE_SILENT.format(page_s)))
    return watches


def _run(
    run: RunFunction,
    report: ReportFunction,
    order: RunOrder,
    orders: PipeEnd,
    sender: NoticeSender,
    watches: Sequence[LifeWatch],
) -> None:
    clock = PacedClock() if order.is_virtual else None
    wheel_count = make_kinematics(order.config.rover).wheel_count
    unwatched = find_unwatched_yaw(order.config, order.config.device_roles())
    operator = PageOperator(
        orders,
        sender,
        wheel_count,
        clock,
        _frame_choice(order.config),
        yaw_unwatched=str(unwatched or ""),
        ground=order.config.ground,
        watches=watches,
    )
    try:
        result = run(order, operator, clock)
        sender.put({"kind": "ended", "reason": result.reason})
        report(order)
        sender.put({"kind": "reported"})
    except RoverHilError as error:
        sender.put({"kind": "failed", "error": str(error)})


def _frame_choice(config: Config) -> FrameChoice:
    rig = None if config.scomp is None else config.scomp.rig
    return FrameChoice(config.roles.camera, None if rig is None else rig.geometry())
