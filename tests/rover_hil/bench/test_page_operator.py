"""The loop's side of the page: nothing that the page does or fails to do delays the loop."""

import queue
from dataclasses import replace
from multiprocessing import Pipe
from typing import cast

import numpy as np
import pytest

from controllers.operator import OperatorInput
from controllers.safety import Mode
from drivers.clock import VirtualClock, nanoseconds, stopwatch_ns
from drivers.link import NoTap
from rover_hil.bench.camera_frames import CameraFrame
from rover_hil.bench.loop_process import MOST_NOTICES, NoticeSender, make_watches
from rover_hil.bench.page_operator import VIEW_PERIOD_NS, PageOperator
from rover_hil.bench.views import Confirmation, EndOrder, Notice, Picture, View
from rover_hil.config import BenchSettings
from rover_hil.run.composition import build_virtual_rig
from rover_hil.run.executive import CycleView, End
from rover_hil.run.heartbeat import Heartbeat
from tests.rover_hil.bench.kept import Kept
from tests.rover_hil.bench.rovers import quick

PATIENCE_S = 20.0


def cycles(count: int) -> list[CycleView]:
    clock = VirtualClock()
    rig, _ = build_virtual_rig(quick(), clock, NoTap())
    rig.connect(1.0)
    views = []
    for _ in range(count):
        clock.sleep_until(clock.now_ns() + 20_000_000)
        views.append(CycleView(*rig.cycle(clock.now_ns()), rig.healths(), 1000, 2000))
    rig.close()
    return views


CYCLES = cycles(40)
REST, AHEAD = (0.0, 0.0, 0.0), (0.1, 0.0, 0.0)
RUNNING = next(view for view in CYCLES if view.output.mode is Mode.RUNNING)
SETTLING = next(view for view in CYCLES if view.output.mode is Mode.SETTLING)


def test_every_50_ms_a_cycle_is_shown() -> None:
    theirs, _ours = Pipe(duplex=False)
    kept = Kept(100)
    operator = PageOperator(theirs, kept, 3, None)
    for view in CYCLES:
        operator.show(view)
    shown = [cast("View", notice) for notice in kept.items]
    assert len(shown) == pytest.approx(40 / 3, abs=1)
    assert shown[-1]["current_a"] != [None] * 3
    assert shown[-1]["devices"][0]["state"] == "streaming"
    assert shown[-1]["work_us"] == 2.0


def test_what_may_be_wrong_is_shown() -> None:
    theirs, _ours = Pipe(duplex=False)
    kept = Kept(9)
    output = replace(CYCLES[0].output, suspicion="rover: may be stuck")
    for unwatched in ("", "yaw unwatched: no compass"):
        PageOperator(theirs, kept, 3, None, None, unwatched).show(CYCLES[0]._replace(output=output))
    shown = [cast("View", notice)["suspicion"] for notice in kept.items]
    assert shown == ["rover: may be stuck", "rover: may be stuck; yaw unwatched: no compass"]


def test_orders_of_one_cycle_are_one_input_and_the_newest_wins() -> None:
    theirs, ours = Pipe(duplex=False)
    operator = PageOperator(theirs, Kept(9), 3, None)
    assert operator.wanted() is None
    operator.show(RUNNING)
    ours.send(OperatorInput(motion=REST))
    ours.send(OperatorInput(motion=(0.1, 0.0, 0.0), gains={"lookahead_m": 0.3}))
    ours.send(OperatorInput(motion=REST, is_paused=True))
    assert operator.wanted() == OperatorInput(
        motion=(0.0, 0.0, 0.0), is_paused=True, gains={"lookahead_m": 0.3}
    )
    assert operator.end() is None
    ours.send(EndOrder(end=End.EMERGENCY_STOP, reason="pressed"))
    assert operator.wanted() is None
    assert operator.end() == (End.EMERGENCY_STOP, "pressed")


class Rover:
    """A page's operator on a clock of its own, with the page's end of the orders."""

    def __init__(self) -> None:
        theirs, self.page = Pipe(duplex=False)
        self.signs = {"server": Heartbeat(), "page": Heartbeat()}
        self.kept = Kept(999)
        self._clock = VirtualClock()
        watches = make_watches(BenchSettings(), *self.signs.values())
        self._operator = PageOperator(theirs, self.kept, 3, None, watches=watches, real_clock=self._clock)

    def pass_time(self, duration_s: float, *living: str) -> list[OperatorInput]:
        """Return what is wanted within a time in which these give heartbeats."""
        inputs = list[OperatorInput]()
        for _ in range(round(duration_s / 0.02)):
            self._clock.sleep_until(self._clock.now_ns() + nanoseconds(0.02))
            for name in living:
                self.signs[name].give()
            inputs += filter(None, [self._operator.wanted()])
        return inputs

    def view(self, *, loop_waits: bool = False) -> View:
        """Return what the page shows."""
        output = replace(RUNNING.output, t_ns=self._clock.now_ns() + 10**12, waits_for_operator=loop_waits)
        self._operator.show(RUNNING._replace(output=output))
        return cast("View", self.kept.items[-1])


@pytest.mark.parametrize("lost", ["server", "page"])
def test_after_a_loss_the_rover_rests_until_the_operator_confirms(lost: str) -> None:
    rover = Rover()
    others = [name for name in rover.signs if name != lost]
    assert rover.pass_time(2.0, *rover.signs) == []
    assert not rover.view()["waits_for_operator"]
    assert rover.pass_time(0.5, *others) == []
    (stop,) = rover.pass_time(0.02, *others)
    assert stop.stop_reason is not None
    assert stop.stop_reason.endswith("for 0.5 s")
    assert rover.pass_time(2.0, *others) == []  # it is ordered once
    rover.page.send(Confirmation(stops=1))  # what is lost cannot confirm
    assert rover.pass_time(0.04, *others) == []
    assert rover.pass_time(60.0, *rover.signs) == []  # it is back: nothing moves
    view = rover.view()
    assert view["waits_for_operator"]
    rover.page.send(Confirmation(stops=view["stops"]))
    assert rover.pass_time(2.0, *rover.signs) == [OperatorInput(stop_reason="")]
    assert not rover.view()["waits_for_operator"]


def test_a_confirmation_that_was_on_its_way_while_another_loss_began_does_not_count() -> None:
    rover = Rover()
    rover.pass_time(2.0, "server")
    rover.pass_time(1.0, *rover.signs)
    stops = rover.view()["stops"]
    rover.pass_time(2.0, "page")
    rover.page.send(Confirmation(stops=stops))
    assert rover.pass_time(2.0, *rover.signs) == []
    assert rover.view()["waits_for_operator"]
    rover.page.send(Confirmation(stops=rover.view()["stops"]))
    assert rover.pass_time(1.0, *rover.signs) == [OperatorInput(stop_reason="")]


def test_a_stop_of_the_loop_is_confirmed_once_and_only_by_a_click_that_knew_of_it() -> None:
    rover = Rover()
    rover.pass_time(1.0, *rover.signs)
    stops = rover.view()["stops"]
    rover.pass_time(0.1, *rover.signs)
    view = rover.view(loop_waits=True)
    assert view["waits_for_operator"]
    rover.page.send(Confirmation(stops=stops))
    assert rover.pass_time(0.04, *rover.signs) == []
    rover.page.send(Confirmation(stops=view["stops"]))
    rover.page.send(Confirmation(stops=view["stops"]))
    assert rover.pass_time(0.04, *rover.signs) == [OperatorInput(is_confirmed=True)]


def test_a_double_click_after_a_loss_does_not_confirm_a_stop_of_the_loop() -> None:
    rover = Rover()
    rover.pass_time(2.0)
    rover.pass_time(1.0, *rover.signs)
    view = rover.view(loop_waits=True)
    rover.page.send(Confirmation(stops=view["stops"]))
    rover.page.send(Confirmation(stops=view["stops"]))
    assert rover.pass_time(0.1, *rover.signs) == [OperatorInput(stop_reason="")]
    view = rover.view(loop_waits=True)
    assert view["waits_for_operator"]
    rover.page.send(Confirmation(stops=view["stops"]))
    assert rover.pass_time(0.04, *rover.signs) == [OperatorInput(is_confirmed=True)]


def test_a_confirmation_of_nothing_and_other_orders_release_no_stop() -> None:
    rover = Rover()
    rover.page.send(Confirmation(stops=0))
    assert rover.pass_time(1.0, *rover.signs) == []
    rover.pass_time(2.0)
    others = OperatorInput(is_paused=False, gains={"lookahead_m": 0.3})
    rover.page.send(others)
    assert rover.pass_time(1.0, *rover.signs) == [others]
    assert rover.view()["waits_for_operator"]


def test_a_run_for_which_no_page_is_required_goes_on_without_a_browser_but_not_without_the_server() -> None:
    server, browser = Heartbeat(), Heartbeat()
    (watch,) = make_watches(BenchSettings(page_required=False, server_timeout_s=0.2), server, browser)
    assert watch.check(0) == ""
    browser.give()
    assert watch.check(nanoseconds(0.2) + 1) == "page: no heartbeat of its program for 0.2 s"


def test_a_loss_and_an_order_of_the_same_cycle_are_one_input() -> None:
    orders, ours = Pipe(duplex=False)
    clock = VirtualClock()
    watches = make_watches(BenchSettings(page_required=False), Heartbeat(), Heartbeat())
    operator = PageOperator(orders, Kept(9), 3, None, watches=watches, real_clock=clock)
    assert operator.wanted() is None
    clock.sleep_until(clock.now_ns() + nanoseconds(0.6))
    ours.send(OperatorInput(is_paused=True))
    wanted = operator.wanted()
    assert wanted == OperatorInput(is_paused=True, stop_reason="page: no heartbeat of its program for 0.5 s")


def test_motion_by_hand_begins_after_rest_was_commanded_while_the_loop_runs() -> None:
    orders, ours = Pipe(duplex=False)
    operator = PageOperator(orders, Kept(99), 3, None)

    def motion(*sent: tuple[float, float, float]) -> object:
        for one in sent:
            ours.send(OperatorInput(motion=one))
        wanted = operator.wanted()
        return None if wanted is None else wanted.motion

    assert motion(REST, AHEAD) is None  # nothing runs yet
    operator.show(RUNNING)
    assert motion(AHEAD) is None  # a key that was held before
    assert motion(REST) == REST
    assert motion(AHEAD) == AHEAD
    operator.show(RUNNING)
    assert motion(AHEAD) == AHEAD
    operator.show(SETTLING)  # as after any stop: the key is still held
    operator.show(RUNNING)
    assert motion(AHEAD) is None
    assert motion(REST, AHEAD) == AHEAD


def test_an_end_is_seen_between_two_cycles_and_no_order_is_lost_by_looking() -> None:
    theirs, ours = Pipe(duplex=False)
    operator = PageOperator(theirs, Kept(9), 3, None)
    ours.send(OperatorInput(is_paused=True))
    ours.send(EndOrder(end=End.STOPPED_BY_USER, reason="stopped on the page"))
    assert operator.end() == (End.STOPPED_BY_USER, "stopped on the page")
    assert operator.wanted() == OperatorInput(is_paused=True)
    assert operator.wanted() is None


def test_a_frame_that_cannot_be_drawn_is_told_and_does_not_end_the_views() -> None:
    ours, notices = Pipe(duplex=False)
    sender = NoticeSender(notices)
    sender.put_nowait(CameraFrame("rear", np.zeros((0, 0), np.uint8), None, None))
    sender.put({"kind": "reported"})
    assert ours.poll(PATIENCE_S)
    picture = cast("Picture", ours.recv())
    assert (picture["camera"], picture["jpeg"]) == ("rear", b"")
    assert picture["words"].startswith("this frame cannot be drawn: ")
    assert ours.poll(PATIENCE_S)
    assert ours.recv() == {"kind": "reported"}
    sender.close()


def test_a_run_ends_when_the_page_s_program_is_gone() -> None:
    theirs, ours = Pipe(duplex=False)
    operator = PageOperator(theirs, Kept(9), 3, None)
    ours.close()
    assert operator.wanted() is None
    assert operator.end() == (End.TERMINATED, "the program of the page has ended")


class Counted:
    """Counts the notices for which a sender has no room."""

    def __init__(self, sender: NoticeSender) -> None:
        self.refused = 0
        self._sender = sender

    def put_nowait(self, item: Notice | CameraFrame, /) -> None:
        try:
            self._sender.put_nowait(item)
        except queue.Full:
            self.refused += 1
            raise


def test_a_page_that_stops_reading_drops_views_and_costs_the_loop_nothing() -> None:
    orders, _ours = Pipe(duplex=False)
    unread, notices = Pipe(duplex=False)
    sender = NoticeSender(notices)
    counted = Counted(sender)
    operator = PageOperator(orders, counted, 3, None)
    longest_ns, costs_ns = 0, []
    for number in range(3000):
        view = CYCLES[number % len(CYCLES)]
        output = replace(view.output, t_ns=number * VIEW_PERIOD_NS)  # every cycle is shown
        later = CycleView(view.samples, output, view.sent, view.healths, 0, 0)
        begun_ns = stopwatch_ns()
        operator.wanted()
        operator.show(later)
        costs_ns.append(stopwatch_ns() - begun_ns)
        longest_ns = max(longest_ns, costs_ns[-1])
    assert counted.refused > 3000 - 2 * MOST_NOTICES - 500
    assert sorted(costs_ns)[len(costs_ns) // 2] < 300_000
    unread.close()
    sender.close()
