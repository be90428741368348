"""A heartbeat crosses processes, and its loss is noticed after the limit, not before."""

import multiprocessing

from drivers.clock import SystemClock, nanoseconds
from rover_hil.run.heartbeat import Heartbeat, LifeWatch, LossLatch

LIMIT_NS = nanoseconds(0.5)
START_NS = 1_000
PATIENCE_S = 60.0


def watch(sign: Heartbeat) -> LifeWatch:
    return LifeWatch(sign, 0.5, "page: lost")


def test_without_a_new_sign_there_is_a_reason_after_the_limit_and_not_before() -> None:
    sign = Heartbeat()
    watching = watch(sign)
    assert watching.check(START_NS) == ""
    assert watching.check(START_NS + LIMIT_NS) == ""
    assert watching.check(START_NS + LIMIT_NS + 1) == "page: lost"
    assert watching.check(START_NS + 9 * LIMIT_NS) == "page: lost"


def test_signs_before_the_first_look_do_not_count_as_new_ones() -> None:
    sign = Heartbeat()
    sign.give()
    watching = watch(sign)
    assert watching.check(START_NS) == ""
    assert watching.check(START_NS + LIMIT_NS + 1) == "page: lost"


def test_each_sign_counts_from_when_it_was_seen() -> None:
    sign = Heartbeat()
    watching = watch(sign)
    assert watching.check(START_NS) == ""
    sign.give()
    seen_ns = START_NS + LIMIT_NS + 1
    assert watching.check(seen_ns) == ""  # the watcher itself was late
    assert watching.check(seen_ns + LIMIT_NS) == ""
    assert watching.check(seen_ns + LIMIT_NS + 1) == "page: lost"
    sign.give()
    assert watching.check(seen_ns + LIMIT_NS + 2) == ""


def test_a_pause_of_the_watcher_alone_is_no_silence_where_pauses_are_forgiven() -> None:
    sign = Heartbeat()
    watching = LifeWatch(sign, 0.5, "page: lost", forgives_pauses=True)
    assert watching.check(START_NS) == ""
    resumed_ns = START_NS + 9 * LIMIT_NS
    assert watching.check(resumed_ns) == ""
    sign.give()
    assert watching.check(resumed_ns + 1) == ""
    for tenth in range(1, 11):
        assert watching.check(resumed_ns + 1 + tenth * LIMIT_NS // 10) == ""
    assert watching.check(resumed_ns + 2 + LIMIT_NS) == "page: lost"


def test_signs_are_counted_one_by_one() -> None:
    sign = Heartbeat()
    assert sign.count == 0
    sign.give()
    sign.give()
    assert sign.count == 2


def give_some(sign: Heartbeat) -> None:
    for _ in range(3):
        sign.give()


def test_signs_are_seen_by_another_process_without_waiting() -> None:
    sign = Heartbeat()
    process = multiprocessing.get_context("spawn").Process(target=give_some, args=(sign,))
    process.start()
    clock = SystemClock()
    deadline_ns = clock.now_ns() + nanoseconds(PATIENCE_S)
    while sign.count < 3:
        assert clock.now_ns() < deadline_ns
        clock.sleep_until(clock.now_ns() + 5_000_000)
    process.join(PATIENCE_S)
    assert process.exitcode == 0


def test_after_a_loss_the_reason_stays_until_it_is_released_while_nothing_is_lost() -> None:
    first, second = Heartbeat(), Heartbeat()
    latch = LossLatch([watch(first), LifeWatch(second, 0.5, "page: other")])
    now_ns = START_NS

    def after_half_a_second(*living: Heartbeat) -> str:
        nonlocal now_ns
        now_ns += LIMIT_NS + 1
        for sign in living:
            sign.give()
        return latch.check(now_ns)

    assert after_half_a_second(first, second) == ""
    assert after_half_a_second(first, second) == ""
    assert latch.losses == 0
    assert after_half_a_second(first) == "page: other"
    assert after_half_a_second() == "page: lost"  # the same loss, of which more is known now
    assert after_half_a_second(first) == "page: lost"
    assert latch.losses == 1
    assert not latch.release()
    assert latch.reason == "page: lost"
    assert after_half_a_second(first, second) == "page: lost"
    assert after_half_a_second(first) == "page: other"
    assert after_half_a_second(first, second) == "page: other"
    assert latch.losses == 2
    assert latch.release()
    assert latch.reason == ""
    assert after_half_a_second(first, second) == ""
