"""The watchdog stops the drive when the loop goes silent, once per silence."""

import threading

from drivers.clock import SystemClock, VirtualClock, nanoseconds
from drivers.driver import WheelDrive
from rover_hil.loop.watchdog import Watchdog
from tests.drivers.test_driver import LetterCodec, ScriptedLink

LIMIT_NS = nanoseconds(0.15)


def make_drive(clock: VirtualClock | SystemClock) -> tuple[WheelDrive, ScriptedLink]:
    link = ScriptedLink()
    drive = WheelDrive("wheels", link, LetterCodec(), clock, max_age_s=0.1)
    drive.connect()
    return drive, link


def test_stops_once_per_silence_and_not_before_the_limit() -> None:
    clock = VirtualClock()
    drive, link = make_drive(clock)
    told: list[int] = []
    watchdog = Watchdog(drive, clock, LIMIT_NS, told.append)
    watchdog.feed()
    clock.sleep_until(clock.now_ns() + LIMIT_NS)
    watchdog.check()
    assert link.sent == []
    clock.sleep_until(clock.now_ns() + 1)
    watchdog.check()
    watchdog.check()
    assert link.sent == [b"(0.0, 0.0)"] * 3 + [b"off"]
    assert told == [clock.now_ns()]
    watchdog.feed()
    clock.sleep_until(clock.now_ns() + 2 * LIMIT_NS)
    watchdog.check()
    assert watchdog.interventions == 2


def test_thread_acts_within_the_limit_and_a_check_period() -> None:
    clock = SystemClock()
    drive, link = make_drive(clock)
    acted = threading.Event()
    watchdog = Watchdog(drive, clock, nanoseconds(0.05), lambda _: acted.set())
    watchdog.start()
    assert acted.wait(2.0)
    watchdog.end()
    assert link.sent[-1] == b"off"
