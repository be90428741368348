"""The rules for commands from a network: who may move the rover, and when. No network is needed."""

import math

import pytest

from drivers.clock import nanoseconds
from rover_hil.connect.ros2.commands import NEEDS_ZERO, REST, Command, CommandGate, Stop

TIMEOUT_S = 0.5
AHEAD = (0.2, 0.0, 0.1)
CYCLE_NS = nanoseconds(0.02)


class Rover:
    """A gate and the time; the rover runs, and rests where it has no command."""

    def __init__(self, *, is_listening: bool = True) -> None:
        self.gate = CommandGate(TIMEOUT_S, is_listening=is_listening)
        self.now_ns = nanoseconds(100.0)
        self.states: list[str] = []
        self.cycle()

    def send(
        self,
        motion: tuple[float, float, float] = AHEAD,
        writer: str = "a",
        stamp_ns: int | None = None,
        found_after_s: float = 0.0,
    ) -> None:
        earliest_ns = self.now_ns - nanoseconds(found_after_s)
        self.gate.take(Command(writer, self.now_ns, earliest_ns, motion, stamp_ns))

    def press(self, *, writer: str = "a", is_pressed: bool = True, stamp_ns: int | None = None) -> None:
        self.gate.take_stop(Stop(writer, self.now_ns if stamp_ns is None else stamp_ns, is_pressed))

    def cycle(
        self, seconds: float = 0.02, *, is_running: bool = True, is_at_rest: bool | None = None
    ) -> tuple[float, float, float] | None:
        """Run cycles for a time; return the motion of the last one."""
        motion = None
        for _ in range(round(nanoseconds(seconds) / CYCLE_NS)):
            motion = self.gate.motion(self.now_ns)
            is_stopped = not is_running or bool(self.gate.stop_reason)
            at_rest = not any(motion or REST) if is_at_rest is None else is_at_rest
            self.gate.follow(self.now_ns, is_running=not is_stopped, is_at_rest=at_rest)
            self.now_ns += CYCLE_NS
            if self.gate.state not in self.states[-1:]:
                self.states.append(self.gate.state)
        return motion


def test_commands_are_off_unless_wanted_and_stops_are_not() -> None:
    rover = Rover(is_listening=False)
    rover.send()
    assert rover.cycle() is None
    rover.press()
    assert "emergency_stop" in rover.gate.stop_reason


def test_a_command_holds_for_its_time_after_arrival_whatever_its_stamp_says() -> None:
    for stamp_ns in (None, 1, nanoseconds(1e9)):
        rover = Rover()
        rover.send(stamp_ns=stamp_ns)
        assert rover.cycle(TIMEOUT_S) == AHEAD
        assert rover.cycle() == REST
        assert rover.cycle(5.0) is None


def test_a_command_that_was_found_late_counts_from_the_look_before() -> None:
    rover = Rover()
    rover.send(found_after_s=0.4)
    assert rover.cycle(0.1) == AHEAD
    assert rover.cycle() == REST
    rover.send(found_after_s=TIMEOUT_S)
    assert rover.cycle(1.0) is None
    rover.cycle(0.02, is_running=False)
    rover.send(found_after_s=0.1)
    assert rover.cycle(1.0) is None
    rover.send()
    assert rover.cycle() == AHEAD


def test_rest_after_a_timeout_is_told_once_and_a_later_command_moves_again() -> None:
    rover = Rover()
    rover.send()
    rover.cycle(2.0)
    assert rover.states == ["no command", "following a", "no command for 0.5 s: at rest"]
    rover.send()
    assert rover.cycle() == AHEAD


def test_of_a_cycle_only_the_newest_command_counts() -> None:
    rover = Rover()
    rover.send((0.1, 0.0, 0.0))
    rover.send((0.3, 0.0, 0.0))
    assert rover.cycle() == (0.3, 0.0, 0.0)


def test_the_first_of_two_writers_holds_until_its_timeout_and_the_other_is_reported() -> None:
    rover = Rover()
    for _ in range(20):
        rover.send((0.1, 0.0, 0.0), "a")
        rover.send((0.9, 0.0, 0.0), "b")
        assert rover.cycle(0.1) == (0.1, 0.0, 0.0)
    assert rover.gate.reports == {"commands of b while a was followed": 20}
    rover.cycle(TIMEOUT_S)
    rover.send((0.9, 0.0, 0.0), "b")
    assert rover.cycle() == (0.9, 0.0, 0.0)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_a_number_that_is_not_finite_is_rest_and_reported(wrong: float, place: int) -> None:
    rover = Rover()
    rover.send()
    rover.cycle()
    broken = [0.1, 0.1, 0.1]
    broken[place] = wrong
    rover.send((broken[0], broken[1], broken[2]))
    assert rover.cycle() == REST
    assert list(rover.gate.reports.values()) == [1]


def test_after_a_stop_only_a_later_command_moves_the_rover() -> None:
    rover = Rover()
    rover.send()
    assert rover.cycle() == AHEAD
    rover.cycle(0.02, is_running=False)
    before = Command("a", rover.now_ns - 2 * CYCLE_NS, rover.now_ns - 2 * CYCLE_NS, AHEAD)
    rover.gate.take(before)  # it waited somewhere during the stop
    assert rover.cycle() == REST
    assert rover.cycle(1.0) is None
    rover.send()
    assert rover.cycle() == AHEAD


def test_commands_that_arrive_while_the_rover_is_stopped_do_not_move_it_afterwards() -> None:
    rover = Rover()
    rover.cycle(0.1, is_running=False)
    rover.send()
    rover.cycle(is_running=False)
    assert rover.cycle(1.0) is None


def test_stamps_count_against_the_fastest_command_of_a_minute() -> None:
    rover = Rover()
    clock_ns = -nanoseconds(3600.0)  # of the other computer, against ours
    rover.send(stamp_ns=rover.now_ns + clock_ns)
    assert rover.cycle() == AHEAD
    rover.send((0.3, 0.0, 0.0), stamp_ns=rover.now_ns + clock_ns - nanoseconds(0.6))
    assert rover.cycle() == AHEAD  # 0.6 s late: the one before holds until it expires
    rover.send((0.4, 0.0, 0.0), stamp_ns=rover.now_ns + clock_ns - nanoseconds(0.3))
    assert rover.cycle() != (0.4, 0.0, 0.0)  # out of order
    rover.send((0.5, 0.0, 0.0), stamp_ns=rover.now_ns + clock_ns - nanoseconds(0.01))
    assert rover.cycle() == (0.5, 0.0, 0.0)
    assert rover.gate.reports == {"commands that came late or out of order": 2}


@pytest.mark.parametrize("step_s", [3600.0, -3600.0])
def test_a_step_of_the_commanders_clock_moves_nothing_and_ends(step_s: float) -> None:
    rover = Rover()
    rover.send(stamp_ns=rover.now_ns)
    rover.cycle()
    seen = set()
    for number in range(100):
        motion = (0.001 * (number + 1), 0.0, 0.0)
        rover.send(motion, stamp_ns=rover.now_ns + nanoseconds(step_s))
        seen.add(rover.cycle(1.0, is_at_rest=False))
        assert rover.gate.motion(rover.now_ns) in (motion, REST, None)
    assert rover.gate.motion(rover.now_ns) is None
    rover.send(stamp_ns=rover.now_ns + nanoseconds(step_s))
    assert rover.cycle() == AHEAD


class SteppingPlanner:
    """Drives a rover with stamped commands, by a clock that is set while it drives."""

    def __init__(self) -> None:
        self.rover = Rover()
        self.clock_ns, self.speed_m_s = nanoseconds(1e9), 0.1
        assert self.drive(1.0) == 0.0

    def stamp_ns(self) -> int:
        return self.rover.now_ns + self.clock_ns

    def drive(self, seconds: float) -> float | None:
        """Send a command each 0.1 s; return after how many seconds the rover follows, None for not at all."""
        self.speed_m_s += 0.001
        wanted = (self.speed_m_s, 0.0, 0.0)
        for number in range(round(seconds / 0.1)):
            self.rover.send(wanted, stamp_ns=self.stamp_ns())
            if self.rover.cycle() == wanted:
                return number * 0.1
            self.rover.cycle(0.08)
        return None

    def stop(self) -> None:
        assert self.rover.cycle(1.0) is None


STEPPED = {"steps of the clock of a: its later commands count by its new time": 1}


@pytest.mark.parametrize("step_s", [1.0, 3.0, 30.0, 3600.0])
def test_after_a_step_back_of_the_senders_clock_its_commands_count_again_in_5_s(step_s: float) -> None:
    planner = SteppingPlanner()
    planner.clock_ns -= nanoseconds(step_s)
    assert planner.drive(20.0) == pytest.approx(5.1)
    reports = planner.rover.gate.reports
    assert reports.pop("commands that came late or out of order") == 50
    assert reports == STEPPED


def test_the_command_that_shows_the_new_time_and_those_before_it_move_nothing() -> None:
    planner = SteppingPlanner()
    planner.clock_ns -= nanoseconds(3600.0)
    planner.stop()
    for _ in range(51):
        planner.rover.send(stamp_ns=planner.stamp_ns())
        assert planner.rover.cycle(0.1) is None
    assert STEPPED.items() <= planner.rover.gate.reports.items()
    planner.rover.send(stamp_ns=planner.stamp_ns(), found_after_s=0.2)  # it may have arrived before
    assert planner.rover.cycle(0.1) is None
    planner.rover.send(stamp_ns=planner.stamp_ns())
    assert planner.rover.cycle() == AHEAD


def test_no_command_of_the_time_before_the_step_moves_the_rover_after_it() -> None:
    planner = SteppingPlanner()
    old_ns = planner.stamp_ns() - nanoseconds(1.0)
    planner.clock_ns -= nanoseconds(3600.0)
    planner.stop()
    assert planner.drive(20.0) is not None
    planner.rover.cycle(1.0)
    for number in range(20):
        planner.rover.send((0.3, 0.0, 0.0), stamp_ns=old_ns + nanoseconds(0.04 * number))
        assert planner.rover.cycle(0.02) is None
    planner.rover.send(stamp_ns=planner.stamp_ns())
    assert planner.rover.cycle() == AHEAD


def test_a_clock_that_is_set_forward_again_counts_at_once_beyond_the_time_before_and_else_in_5_s() -> None:
    for forward_s, after_s in ((3600.0, 0.0), (1800.0, 5.1)):
        planner = SteppingPlanner()
        planner.clock_ns -= nanoseconds(3600.0)
        planner.stop()
        planner.drive(20.0)
        planner.clock_ns += nanoseconds(forward_s)
        planner.stop()
        assert planner.drive(20.0) == pytest.approx(after_s)


def test_commands_of_two_times_are_no_step() -> None:
    planner = SteppingPlanner()
    for number in range(200):
        rover = planner.rover
        rover.send((0.3, 0.0, 0.0), stamp_ns=planner.stamp_ns() - nanoseconds(30.0))
        assert rover.cycle() != (0.3, 0.0, 0.0)
        if number % 40 == 0:  # timely ones are rare
            rover.send(stamp_ns=planner.stamp_ns())
            assert rover.cycle() == AHEAD
        rover.cycle(0.08)
    assert set(planner.rover.gate.reports) == {"commands that came late or out of order"}


@pytest.mark.parametrize("delay_s", [1.0, 3.0])
def test_a_network_that_becomes_slow_is_no_step_until_the_fast_commands_are_forgotten(delay_s: float) -> None:
    planner = SteppingPlanner()
    planner.rover.cycle(delay_s)
    planner.clock_ns -= nanoseconds(delay_s)
    planner.rover.cycle(0.1)
    after_s = planner.drive(100.0)
    assert after_s is not None
    assert 55.0 < after_s < 62.0
    assert STEPPED.items() <= planner.rover.gate.reports.items()


def test_a_burst_of_old_commands_is_no_step() -> None:
    planner = SteppingPlanner()
    old_ns = planner.stamp_ns() - nanoseconds(60.0)
    planner.stop()
    for number in range(500):
        planner.rover.send(stamp_ns=old_ns + nanoseconds(0.1 * number))
        assert planner.rover.cycle() is None
    assert set(planner.rover.gate.reports) == {"commands that came late or out of order"}


def released(rover: Rover, writer: str = "a") -> None:
    rover.press(writer=writer, is_pressed=False)
    rover.cycle(0.1)


def test_a_press_stops_and_only_release_zero_and_a_new_command_move_again() -> None:
    rover = Rover()
    rover.send()
    rover.cycle()
    rover.press()
    assert "a" in rover.gate.stop_reason
    assert rover.cycle() == REST
    rover.send()
    assert rover.cycle(0.1) is None
    released(rover)
    assert rover.gate.stop_reason == ""
    rover.send()
    assert rover.cycle(0.1) is None
    assert rover.gate.state == NEEDS_ZERO
    rover.send(REST)
    assert rover.cycle() == REST
    rover.send()
    assert rover.cycle() == AHEAD


def test_a_press_before_the_run_holds() -> None:
    gate = CommandGate(TIMEOUT_S)
    gate.take_stop(Stop("a", 5, True))
    gate.follow(1, is_running=False, is_at_rest=True)
    assert gate.stop_reason


def test_a_stop_is_released_at_rest_only() -> None:
    rover = Rover()
    rover.press()
    rover.cycle()
    rover.gate.follow(rover.now_ns, is_running=False, is_at_rest=False)
    rover.press(is_pressed=False)
    assert rover.gate.stop_reason
    assert rover.gate.reports == {"releases of a stop while the rover moved": 1}
    rover.cycle()
    rover.press(is_pressed=False)
    assert not rover.gate.stop_reason


def test_the_page_releases_all_stops_at_rest_only() -> None:
    rover = Rover()
    rover.press(writer="a")
    rover.press(writer="b")
    rover.cycle()
    rover.gate.follow(rover.now_ns, is_running=False, is_at_rest=False)
    rover.gate.resume()
    assert rover.gate.stop_reason
    rover.cycle()
    rover.gate.resume()
    assert not rover.gate.stop_reason
    rover.send()
    assert rover.cycle(0.1) is None
    rover.send(REST)
    rover.cycle()
    rover.send()
    assert rover.cycle() == AHEAD


def test_to_resume_without_a_stop_changes_nothing() -> None:
    rover = Rover()
    rover.send()
    rover.cycle()
    rover.gate.follow(rover.now_ns, is_running=True, is_at_rest=False)
    state = rover.gate.state
    rover.gate.resume()
    assert rover.gate.state == state
    assert not rover.gate.reports
    assert rover.cycle() == AHEAD


def test_a_writer_releases_only_its_own_stop() -> None:
    rover = Rover()
    rover.press(writer="a")
    rover.press(writer="b")
    rover.cycle()
    rover.press(writer="c", is_pressed=False)
    released(rover, "b")
    assert "a" in rover.gate.stop_reason
    rover.cycle(3600.0)  # a has disappeared for long
    assert "a" in rover.gate.stop_reason
    released(rover, "a")
    assert not rover.gate.stop_reason


def test_what_two_readers_get_twice_counts_once_in_any_order() -> None:
    for order in ([0, 1, 0, 1], [0, 0, 1, 1], [1, 0, 1, 0], [0, 1, 1, 0]):
        rover = Rover()
        rover.cycle()
        messages = [Stop("a", 10, True), Stop("a", 20, False)]
        for number in order:
            rover.gate.take_stop(messages[number])
            rover.gate.follow(rover.now_ns, is_running=False, is_at_rest=True)
        # A release that came before its press releases nothing.
        assert bool(rover.gate.stop_reason) == (order[0] == 1), order
    rover = Rover()
    rover.cycle()
    for stop in (Stop("a", 10, True), Stop("a", 20, False), Stop("a", 30, True), Stop("a", 20, False)):
        rover.gate.take_stop(stop)
        rover.gate.follow(rover.now_ns, is_running=False, is_at_rest=True)
    assert rover.gate.stop_reason


def test_a_press_by_a_clock_that_was_set_back_stops_and_an_old_release_does_not_release() -> None:
    rover = Rover()
    rover.press(stamp_ns=1000)
    rover.cycle()
    rover.press(stamp_ns=2000, is_pressed=False)
    assert rover.gate.stop_reason == ""
    rover.press(stamp_ns=10)
    rover.press(stamp_ns=20, is_pressed=False)
    assert rover.gate.stop_reason


def test_any_number_of_writers_can_stop_and_memory_stays_bounded() -> None:
    rover = Rover()
    for number in range(1000):
        rover.press(writer=str(number), stamp_ns=number)
        rover.send(writer=str(number), stamp_ns=number)
    assert rover.gate.stop_reason
    assert len(rover.gate.reports) <= 64
    for number in range(1000):
        rover.cycle()
        rover.press(writer=str(number), stamp_ns=number + 1, is_pressed=False)
    assert rover.gate.stop_reason  # those beyond the memory hold until a restart


def test_stamps_of_many_writers_are_forgotten_together() -> None:
    rover = Rover()
    for number in range(200):
        rover.now_ns += nanoseconds(1.0)  # each after the time-out of the one before
        rover.send((0.001 * (number + 1), 0.0, 0.0), writer=str(number), stamp_ns=rover.now_ns)
        assert rover.gate.motion(rover.now_ns) == (0.001 * (number + 1), 0.0, 0.0)
