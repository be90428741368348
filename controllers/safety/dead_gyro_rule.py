"""Stop rule about a gyro that is known to be dead."""

from collections.abc import Iterator
from statistics import fmean

from controllers.fault import Cause, Fault
from controllers.roles import DeviceRoles
from controllers.safety.gyro_turn_rules import AVERAGE_S, GyroTurnSettings
from controllers.safety.reasons import Cycle, StopRule
from controllers.safety.unproven_turn import UnprovenTurn
from drivers.clock import nanoseconds
from drivers.safety_event import Outcome, SafetyEvent
from drivers.samples import RateSample, Sample


class DeadGyroRule(StopRule):
    """Stops while the gyro is dead: the rover was known to turn, and the gyro has shown no signal since.

    At rest a dead gyro looks like a healthy one. It has a signal when its readings, averaged over
    `AVERAGE_S`, differ from its bias by `gyro_follow_rad_s`: turn the rover by hand.

    Args:
        settings: What counts as a signal.
        roles: Which device is the gyro.
        unproven: Shared with the rules that find a dead gyro, and are checked before.
    """

    observes = (RateSample,)

    events = (
        SafetyEvent(
            Outcome.STOPS,
            "The gyro has no signal, although the rover turned.",
            "`…: no signal, although the rover turned: …`",
            (
                "tests/controllers/safety/test_dead_gyro_rule.py::"
                "test_a_dead_gyro_keeps_the_rover_stopped_until_it_shows_a_signal",
            ),
            within="one cycle",
            settings=("gyro_follow_rad_s",),
            clears="readings that differ from the bias by `gyro_follow_rad_s` on the average of 0.25 s: "
            "turn the rover by hand",
        ),
    )

    def __init__(self, settings: GyroTurnSettings, roles: DeviceRoles, unproven: UnprovenTurn) -> None:
        self._least_rad_s = settings.gyro_follow_rad_s
        self._gyro = str(roles.gyro)
        self._unproven = unproven
        self._readings_rad_s: list[float] = []
        self._began_ns: int | None = None

    def observe(self, sample: Sample, t_ns: int) -> None:
        """Take a reading of the gyro."""
        if isinstance(sample, RateSample) and sample.device == self._gyro:
            self._readings_rad_s.append(sample.rate_z_rad_s)

    def check(self, cycle: Cycle) -> Iterator[Fault]:
        """Return a reason while the gyro is dead."""
        if self._began_ns is None:
            self._began_ns = cycle.now_ns
        if cycle.now_ns - self._began_ns >= nanoseconds(AVERAGE_S):
            readings_rad_s, self._readings_rad_s = self._readings_rad_s, []
            self._began_ns = cycle.now_ns
            if (
                readings_rad_s
                and abs(fmean(readings_rad_s) - cycle.estimate.gyro_bias_rad_s) >= self._least_rad_s
            ):
                self._unproven.prove()
        if self._unproven.is_dead:
            text = (
                f"{self._gyro}: no signal, although the rover turned: wrong axis, or broken; the rover stays "
                "stopped until the gyro measures a turn"
            )
            yield Fault(self._gyro, Cause.DEAD_GYRO, text)
