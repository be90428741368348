"""Several sides that operate one run: each may stop the rover, and none releases the stop of another."""

from controllers.operator import OperatorInput
from rover_hil.run.executive import CycleView, End
from rover_hil.run.operators import Operators


class Side:
    """Returns what the test gives it."""

    def __init__(self) -> None:
        self.next: OperatorInput | None = None
        self.ends: tuple[End, str] | None = None
        self.seen: list[CycleView] = []

    def wanted(self) -> OperatorInput | None:
        wanted, self.next = self.next, None
        return wanted

    def end(self) -> tuple[End, str] | None:
        return self.ends

    def show(self, view: CycleView) -> None:
        self.seen.append(view)


def test_nothing_is_wanted_where_no_side_wants_anything() -> None:
    assert Operators([Side(), Side()]).wanted() is None


def test_no_side_releases_the_stop_of_another() -> None:
    first, second = Side(), Side()
    both = Operators([first, second])
    first.next = OperatorInput(stop_reason="by the first")
    second.next = OperatorInput(stop_reason="by the second")
    assert both.wanted() == OperatorInput(stop_reason="by the first")
    first.next = OperatorInput(stop_reason="")
    assert both.wanted() == OperatorInput(stop_reason="by the second")
    first.next = OperatorInput(stop_reason="")
    assert both.wanted() == OperatorInput(stop_reason="by the second")
    second.next = OperatorInput(stop_reason="")
    assert both.wanted() == OperatorInput(stop_reason="")


def test_a_confirmation_is_passed_on_and_releases_no_stop_of_another_side() -> None:
    first, second = Side(), Side()
    both = Operators([first, second])
    first.next = OperatorInput(stop_reason="by the first")
    second.next = OperatorInput(stop_reason="by the second")
    both.wanted()
    second.next = OperatorInput(stop_reason="", is_confirmed=True)
    assert both.wanted() == OperatorInput(stop_reason="by the first", is_confirmed=True)
    second.next = OperatorInput(is_confirmed=True)
    assert both.wanted() == OperatorInput(is_confirmed=True)


def test_of_what_both_change_the_last_side_counts_and_the_rest_is_kept() -> None:
    first, second = Side(), Side()
    both = Operators([first, second])
    first.next = OperatorInput(motion=(0.1, 0.0, 0.0), gains={"speed_m_s": 0.1}, stop_reason="stop")
    second.next = OperatorInput(motion=(0.2, 0.0, 0.0), is_paused=True)
    assert both.wanted() == OperatorInput(
        motion=(0.2, 0.0, 0.0), gains={"speed_m_s": 0.1}, is_paused=True, stop_reason="stop"
    )
    second.next = OperatorInput(motion=(0.3, 0.0, 0.0))
    assert both.wanted() == OperatorInput(motion=(0.3, 0.0, 0.0))


def test_a_command_does_not_release_a_stop() -> None:
    first, second = Side(), Side()
    both = Operators([first, second])
    first.next = OperatorInput(stop_reason="stop")
    both.wanted()
    second.next = OperatorInput(motion=(0.3, 0.0, 0.0), stop_reason="")
    wanted = both.wanted()
    assert wanted is not None
    assert wanted.stop_reason == "stop"


def test_any_side_ends_the_run() -> None:
    first, second = Side(), Side()
    both = Operators([first, second])
    assert both.end() is None
    second.ends = (End.TERMINATED, "gone")
    assert both.end() == (End.TERMINATED, "gone")
    first.ends = (End.STOPPED_BY_USER, "stopped")
    assert both.end() == (End.STOPPED_BY_USER, "stopped")


def test_all_sides_see_each_cycle() -> None:
    first, second = Side(), Side()
    view = CycleView((), None, None, (), 0, 0)  # type: ignore[arg-type]
    Operators([first, second]).show(view)
    assert first.seen == second.seen == [view]
