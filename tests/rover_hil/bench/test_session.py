"""Who may order what, and what a run needs before it starts."""

import json
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import cast

import pytest

from controllers.motion.settings import ByHandMission, WaypointsMission
from controllers.operator import OperatorInput
from drivers.clock import nanoseconds
from drivers.errors import ConfigError, LogError
from rover_hil.bench import session as session_module
from rover_hil.bench.finished_runs import find_report, list_runs, read_finished
from rover_hil.bench.session import LOG_NAME, VIEWS_KEPT, Kind, Session, State, StopAnswer
from rover_hil.bench.views import EndOrder, RunOrder, View
from rover_hil.config import load_config
from rover_hil.run.executive import End
from rover_hil.run.heartbeat import Heartbeat


class FakeProcess:
    """Keeps the orders of the session."""

    orders: list[object]
    take: object

    def __init__(self, run: object, report: object, take: object) -> None:
        FakeProcess.orders = []
        FakeProcess.take = take
        self.server_life, self.browser_life = Heartbeat(), Heartbeat()
        self.takes = True

    def send(self, order: object) -> bool:
        if self.takes:
            FakeProcess.orders.append(order)
        return self.takes

    def close(self) -> None:
        """Nothing runs."""


@pytest.fixture
def session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Session]:
    monkeypatch.setattr(session_module, "LoopProcess", FakeProcess)
    session = Session(load_config("robotino"), tmp_path, "robotino", None, None)  # type: ignore[arg-type]
    come(session, "a")
    yield session
    session.close()


def come(session: Session, browser: str) -> None:
    """Let a browser connect and answer."""
    session.enter(browser)
    session.answered(browser)


def test_only_one_browser_is_in_control_but_everyone_may_stop(session: Session) -> None:
    come(session, "b")
    refusals: tuple[Callable[[], None], ...] = (
        lambda: session.start("b", Kind.MISSION, is_real=False),
        lambda: session.pause("b", is_paused=True),
        lambda: session.stop("b"),
        lambda: session.set_gain("b", "lookahead_m", 0.3),
        lambda: session.arm("b"),
    )
    for refused in refusals:
        with pytest.raises(ConfigError, match="another browser is in control"):
            refused()
    session.start("a", Kind.MISSION, is_real=False)
    session.emergency_stop()
    end = FakeProcess.orders[-1]
    assert isinstance(end, EndOrder)
    assert end.end is End.EMERGENCY_STOP
    session._take({"kind": "ended", "reason": "emergency stop"})
    session._take({"kind": "reported"})
    session.leave("a")
    session.answered("b")
    session.arm("b")


def test_a_browser_with_a_new_connection_keeps_control_and_arming_when_the_old_one_ends(
    session: Session,
) -> None:
    session.arm("a")
    session.enter("a")
    session.leave("a")
    session.answered("b")
    session.start("a", Kind.MISSION, is_real=True)


def test_while_a_run_goes_on_nobody_takes_control_without_a_click(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    life = session._process.browser_life
    come(session, "b")
    session.start("a", Kind.MISSION, is_real=False)
    count = life.count
    session.leave("a")
    session.answered("b")
    assert life.count == count
    with pytest.raises(ConfigError, match="the browser in control answers: close its page first"):
        session.take_control("b")
    assert not session.snapshot().is_control_free
    late_ns = session._clock.now_ns() + nanoseconds(session.config.bench.page_timeout_s) + 1
    monkeypatch.setattr(type(session._clock), "now_ns", lambda clock: late_ns)
    assert session.snapshot().is_control_free
    session.take_control("b")
    assert not session.snapshot().is_control_free
    come(session, "a")  # it is back, too late
    assert life.count == count
    session.answered("b")
    assert life.count == count + 1
    session.pause("b", is_paused=True)


def test_a_browser_that_left_in_a_run_and_is_back_is_in_control_until_the_run_has_ended(
    session: Session,
) -> None:
    life = session._process.browser_life
    session.start("a", Kind.MISSION, is_real=False)
    session.leave("a")
    come(session, "b")
    count = life.count
    come(session, "a")
    assert life.count == count + 1
    session.leave("a")
    session._take({"kind": "ended", "reason": "time over"})
    assert session.snapshot().controller == "a"
    session._take({"kind": "reported"})
    assert session.snapshot().controller is None
    session.answered("b")
    session.start("b", Kind.MISSION, is_real=False)


def test_a_press_stops_the_run_for_which_it_was_meant_once_and_no_other_one(session: Session) -> None:
    assert session.emergency_stop("") == (StopAnswer.ENDED, "")
    session.start("a", Kind.MISSION, is_real=False)
    first = session.snapshot().run
    assert session.emergency_stop("an older run") == (StopAnswer.OTHER, first)
    assert len(FakeProcess.orders) == 1
    assert [session.emergency_stop(first) for _ in range(3)] == [(StopAnswer.SENT, first)] * 3
    assert len(FakeProcess.orders) == 2  # sent again and again by the page, ordered once
    session._take({"kind": "ended", "reason": "emergency stop pressed on the page"})
    assert session.emergency_stop(first) == (StopAnswer.ENDED, first)
    session._take({"kind": "reported"})
    assert session.emergency_stop(first) == (StopAnswer.ENDED, first)
    session.start("a", Kind.MISSION, is_real=False)
    second = session.snapshot().run
    assert second != first
    assert session.emergency_stop(first) == (StopAnswer.OTHER, second)
    assert len(FakeProcess.orders) == 1
    assert session.emergency_stop(None) == (StopAnswer.SENT, second)
    assert isinstance(FakeProcess.orders[-1], EndOrder)


def test_only_the_answers_of_the_browser_in_control_are_told_to_the_loop(session: Session) -> None:
    life = session._process.browser_life
    assert life.count == 1  # of "a"
    session.answered("b")
    assert life.count == 1
    session.leave("a")
    session.answered("b")  # it takes over
    assert life.count == 2
    session.answered("a")
    assert life.count == 2


def test_a_loop_that_takes_no_orders_is_told_and_changes_nothing(session: Session) -> None:
    session.start("a", Kind.MISSION, is_real=False)
    process = session._process
    assert isinstance(process, FakeProcess)
    process.takes = False
    orders: tuple[Callable[[], None], ...] = (
        lambda: session.pause("a", is_paused=True),
        lambda: session.set_gain("a", "lookahead_m", 0.7),
    )
    for order in orders:
        with pytest.raises(ConfigError, match="the loop of the run takes no orders at the moment"):
            order()
    now = session.snapshot()
    assert not now.is_paused
    assert now.gains["lookahead_m"] != 0.7


def test_views_are_given_in_pieces_the_oldest_first_and_each_once(session: Session) -> None:
    session.start("a", Kind.MISSION, is_real=False)
    for number in range(VIEWS_KEPT + 7):
        session._take(cast("View", {"kind": "view", "t_s": number}))
    seen, number = list[float](), 0
    while True:
        number, views = session.views(number, 500)
        assert len(views) <= 500
        if not views:
            break
        seen += [json.loads(view)["t_s"] for view in views]
    assert seen == list(range(7, VIEWS_KEPT + 7))
    session._take(cast("View", {"kind": "view", "t_s": -1.0}))
    assert [json.loads(view)["t_s"] for view in session.views(number, 500)[1]] == [-1.0]


def test_the_session_can_be_stopped_while_a_new_process_is_made(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    session.start("a", Kind.MISSION, is_real=False)
    is_free = list[bool]()

    def make() -> object:
        asking = threading.Thread(target=session.emergency_stop)
        asking.start()
        asking.join(5.0)
        is_free.append(not asking.is_alive())
        return FakeProcess(None, None, None)

    monkeypatch.setattr(session, "_make_process", make)
    session._take({"kind": "reported"})
    assert is_free == [True]


def test_a_real_run_needs_arming_each_time_and_for_half_a_minute(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ConfigError, match="the real rover is not armed"):
        session.start("a", Kind.MISSION, is_real=True)
    session.arm("a")
    late_ns = session._clock.now_ns() + 31 * 10**9
    with monkeypatch.context() as later:
        later.setattr(type(session._clock), "now_ns", lambda clock: late_ns)
        with pytest.raises(ConfigError, match="not armed"):
            session.start("a", Kind.MISSION, is_real=True)
    session.start("a", Kind.MISSION, is_real=True)
    (order,) = FakeProcess.orders
    assert isinstance(order, RunOrder)
    assert not order.is_virtual
    assert not session.snapshot().is_armed
    # The excitation has not passed a commissioning on the real rover.
    assert order.config.slip is None
    message = session.snapshot().message
    assert message.startswith(
        "moving the rover of robotino (board at ports/board, imu at ports/imu); the yaw excitation is off"
    )
    assert order.source == "robotino"


@pytest.mark.parametrize("disarm", ["emergency stop", "lost browser"])
def test_an_emergency_stop_and_a_lost_browser_disarm(session: Session, disarm: str) -> None:
    session.arm("a")
    if disarm == "lost browser":
        session.leave("a")
        come(session, "a")
    else:
        session.emergency_stop()
    with pytest.raises(ConfigError, match="not armed"):
        session.start("a", Kind.MISSION, is_real=True)


def test_a_second_run_waits_for_the_first(session: Session) -> None:
    session.start("a", Kind.MISSION, is_real=False)
    with pytest.raises(ConfigError, match="a run is starting"):
        session.start("a", Kind.MISSION, is_real=False)
    session._take({"kind": "ended", "reason": "mission finished"})
    assert session.snapshot().state is State.REPORTING
    session._take({"kind": "reported"})
    now = session.snapshot()
    assert (now.state, now.message) == (State.IDLE, "mission finished")
    assert now.report_name.startswith("robotino-")


def test_what_failed_is_shown_and_the_next_run_may_start(session: Session) -> None:
    session.start("a", Kind.MISSION, is_real=False)
    session._take({"kind": "failed", "error": "no device"})
    assert session.snapshot().message == "no device"
    session.start("a", Kind.MISSION, is_real=False)


def test_gains_move_within_the_range_of_tune_and_hold_for_the_next_run(session: Session) -> None:
    assert session.gain_ranges()["lookahead_m"] == (0.03, 1.5)
    with pytest.raises(ConfigError, match=r"mission.lookahead_m is 2, outside 0.03 .. 1.5 m"):
        session.set_gain("a", "lookahead_m", 2.0)
    session.set_gain("a", "lookahead_m", 0.7)
    session.start("a", Kind.MISSION, is_real=False)
    session.set_gain("a", "lookahead_m", 0.8)
    order, change = FakeProcess.orders
    assert isinstance(order, RunOrder)
    assert order.config.mission is not None
    assert order.config.mission.lookahead_m == 0.7
    assert change == OperatorInput(gains={"lookahead_m": 0.8})


def test_by_hand_the_yaw_is_not_excited(session: Session) -> None:
    session.start("a", Kind.BY_HAND, is_real=False)
    session.drive("a", (0.1, 0.0, 0.0))
    order, motion = FakeProcess.orders
    assert isinstance(order, RunOrder)
    assert isinstance(order.config.mission, ByHandMission)
    assert order.config.slip is not None
    assert order.config.slip.use == "surfaces"
    assert motion == OperatorInput(motion=(0.1, 0.0, 0.0))


def test_a_mission_takes_no_commands_by_hand(session: Session) -> None:
    session.start("a", Kind.MISSION, is_real=False)
    session.drive("a", (0.1, 0.0, 0.0))
    assert len(FakeProcess.orders) == 1


def test_way_points(session: Session) -> None:
    with pytest.raises(ConfigError, match="there are no way-points"):
        session.start("a", Kind.WAYPOINTS, is_real=False)
    with pytest.raises(ConfigError, match="way-point 2 at 900, 0 m is outside"):
        session.start("a", Kind.WAYPOINTS, is_real=False, points=((0.5, 0.0), (900.0, 0.0)))
    with pytest.raises(ConfigError, match="leave the point out"):
        session.start("a", Kind.WAYPOINTS, is_real=False, points=((0.5, 0.0), (0.5, 0.0)))
    session.start("a", Kind.WAYPOINTS, is_real=False, points=((0.5, 0.2),))
    (order,) = FakeProcess.orders
    assert isinstance(order, RunOrder)
    assert isinstance(order.config.mission, WaypointsMission)
    assert order.config.mission.points == ((0.5, 0.2),)


def test_only_runs_in_the_folder_are_read(tmp_path: Path) -> None:
    (tmp_path / "secret").mkdir()
    (tmp_path / "secret" / "report.html").write_text("page")
    folder = tmp_path / "runs"
    (folder / "one").mkdir(parents=True)
    (folder / "one" / "report.html").write_text("page")
    assert find_report(folder, "one") == folder / "one" / "report.html"
    for name in ("../secret", "..", "", "two"):
        assert find_report(folder, name) is None
        with pytest.raises(LogError, match="there is no run"):
            read_finished(folder, name, LOG_NAME)
    assert list_runs(folder, LOG_NAME) == []
