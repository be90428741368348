"""The supervisor: when it stops, why, and when it lets go again."""

import math
from collections.abc import Iterable
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controllers.estimation.filter.guarded_filter import Innovation, Outcome
from controllers.estimation.filter.measurement_model import Measured
from controllers.estimation.wheels.turn_evidence import TurnEvidence, WheelTurn
from controllers.fault import Bound, Cause, Fault, Severity
from controllers.roles import DeviceRoles
from controllers.safety import Mode, SafetySupervisor
from controllers.safety.reasons import Cycle, StopRule
from controllers.safety.settings import SafetySettings
from drivers.clock import nanoseconds
from drivers.samples import (
    AttitudeSample,
    BumperSample,
    FaultSample,
    HeadingReference,
    HeadingSample,
    LinkSample,
    PoseFixSample,
    PowerSample,
    RateSample,
    Sample,
    WheelSample,
)
from tests.controllers.safety.cycles import changed, make_cycle

MS = 1_000_000
SECOND_NS = 1000 * MS
ROLES = DeviceRoles(
    wheels="wheels",
    gyro="imu",
    headings=("imu",),
    fixes=("overhead",),
    required={"wheels": 0.1, "imu": 0.2, "drive": 0.3, "overhead": 0.4},
)
SETTINGS = SafetySettings(settle_s=0.5, recover_s=0.4)


def wheel(index: int, t_ns: int, position: float | None = 0.0) -> WheelSample:
    return WheelSample(device="wheels", t_ns=t_ns, wheel=index, position_rad=position)


def heading(t_ns: int, value: float = 0.0) -> HeadingSample:
    return HeadingSample(device="imu", t_ns=t_ns, heading_rad=value, reference=HeadingReference.TRUE)


def rate(t_ns: int, value: float = 0.0) -> RateSample:
    return RateSample(device="imu", t_ns=t_ns, rate_z_rad_s=value)


def power(t_ns: int) -> PowerSample:
    return PowerSample(device="drive", t_ns=t_ns, voltage_v=24.0)


def fix(t_ns: int, x_m: float = 0.0, age_s: float = 0.0) -> PoseFixSample:
    return PoseFixSample(
        device="overhead",
        t_ns=t_ns,
        x_m=x_m,
        y_m=0.0,
        yaw_rad=0.0,
        position_std_m=0.01,
        yaw_std_rad=0.01,
        t_capture_ns=t_ns - nanoseconds(age_s),
    )


def everything(t_ns: int) -> list[Sample]:
    return [wheel(0, t_ns), wheel(1, t_ns), rate(t_ns), heading(t_ns), power(t_ns), fix(t_ns)]


class Watch:
    """A supervisor on a 10 ms cycle."""

    def __init__(self, settings: SafetySettings = SETTINGS) -> None:
        self.supervisor = SafetySupervisor(settings, ROLES, wheel_count=2)
        self.now_ns = 0

    def cycle(
        self,
        *samples: Sample,
        finite: bool = True,
        motion_ns: int | None = -1,
        distance_m: float = 0.0,
        innovations: tuple[Innovation, ...] = (),
    ) -> Mode:
        self.now_ns += 10 * MS
        for sample in samples:
            self.supervisor.observe(sample, sample.t_ns)
        self.supervisor.update(
            make_cycle(
                now_ns=self.now_ns,
                x_m=0.0 if finite else math.inf,
                motion_ns=self.now_ns if motion_ns == -1 else motion_ns,
                distance_m=distance_m,
                innovations=innovations,
            )
        )
        return self.supervisor.mode

    def healthy_until_running(self) -> int:
        """Return after how many ms of healthy cycles the rover may run."""
        start_ns = self.now_ns
        while self.cycle(*everything(self.now_ns + 10 * MS)) is not Mode.RUNNING:
            assert self.now_ns - start_ns < 10_000 * MS
        return (self.now_ns - start_ns) // MS


def running() -> Watch:
    watch = Watch()
    watch.healthy_until_running()
    return watch


def test_motion_starts_after_the_settling_time() -> None:
    watch = Watch()
    assert watch.cycle() is Mode.SETTLING
    assert watch.supervisor.reason == "wheels: no position of wheel 0 within 0.1 s"
    assert watch.cycle(*everything(20 * MS)) is Mode.SETTLING
    assert watch.supervisor.reason == ""
    assert watch.healthy_until_running() == 500


def test_settling_starts_again_after_an_interruption() -> None:
    watch = Watch()
    for _ in range(40):
        watch.cycle(*everything(watch.now_ns + 10 * MS))
    watch.cycle(LinkSample(device="imu", t_ns=watch.now_ns, up=False, reason="unplugged"))
    watch.cycle(LinkSample(device="imu", t_ns=watch.now_ns, up=True, reason="reopened"))
    assert watch.healthy_until_running() == pytest.approx(500, abs=10)


GYRO_ONLY = DeviceRoles(wheels="wheels", gyro="imu", required={})


def gyro_reason(*cycles: Cycle) -> str:
    """Return the reason after these cycles, in each of which the gyro reads 0.5 rad/s twice."""
    supervisor = SafetySupervisor(SafetySettings(gyro_follow_s=0.1), GYRO_ONLY, wheel_count=2)
    for cycle in cycles:
        for _ in range(2):
            supervisor.observe(rate(cycle.now_ns, 0.5), cycle.now_ns)
        supervisor.update(changed(cycle, motion_ns=cycle.now_ns))
    return supervisor.reason or supervisor.suspicion


def test_the_rules_about_the_gyro_know_their_limits_and_its_name() -> None:
    too_great = [make_cycle(now_ns=index * SECOND_NS, rejected_rad_s=9.0) for index in range(2)]
    assert gyro_reason(*too_great) == "imu: yaw rate 9.0 rad/s: the rover cannot turn that fast"
    at_rest = [make_cycle(now_ns=index * SECOND_NS, is_still=True) for index in range(3)]
    assert gyro_reason(*at_rest) == "imu: reads 0.500 rad/s at rest, its bias was 0.000 rad/s"
    swinging = [
        make_cycle(
            now_ns=index, turn=TurnEvidence(gyro_rad=0.0, wheels=WheelTurn(duration_s=0.2, left_rad=turn))
        )
        for index, turn in enumerate((0.0, 0.0, 0.1, 0.1))
    ]
    assert gyro_reason(*swinging).startswith("imu: yaw rate follows 0 % of the changes")


SILENCES = [
    pytest.param(0, 100, "wheels: no position of wheel 0 within 0.1 s", id="wheel 0"),
    pytest.param(1, 100, "wheels: no position of wheel 1 within 0.1 s", id="wheel 1"),
    pytest.param(2, 200, "imu: no yaw rate within 0.2 s", id="rate of the imu"),
    pytest.param(3, 200, "imu: no heading within 0.2 s", id="heading of the imu"),
    pytest.param(4, 300, "drive: no sample within 0.3 s", id="drive"),
    pytest.param(5, 400, "overhead: no pose fix in time within 0.4 s", id="camera"),
]


@pytest.mark.parametrize(("left_out", "limit_ms", "reason"), SILENCES)
def test_silence_stops_as_soon_as_the_age_limit_is_exceeded(
    left_out: int, limit_ms: int, reason: str
) -> None:
    watch = running()
    last_heard_ns = watch.now_ns
    mode = Mode.RUNNING
    while mode is Mode.RUNNING:
        samples = everything(watch.now_ns + 10 * MS)
        del samples[left_out]
        mode = watch.cycle(*samples)
    assert mode is Mode.SAFE_STOP
    assert watch.supervisor.reason == reason
    assert watch.now_ns - last_heard_ns == (limit_ms + 10) * MS


@pytest.mark.parametrize(
    ("left_out", "useless"),
    [
        pytest.param(0, wheel(0, 0, math.nan), id="nan position"),
        pytest.param(0, wheel(0, 0, None), id="current only"),
        pytest.param(2, rate(0, math.inf), id="infinite rate"),
        pytest.param(2, AttitudeSample(device="imu", t_ns=0, roll_rad=0.0), id="attitude for rate"),
        pytest.param(3, heading(0, math.nan), id="nan heading"),
        pytest.param(5, fix(SECOND_NS, x_m=math.nan), id="nan fix"),
        pytest.param(5, fix(SECOND_NS, age_s=2.1), id="late fix"),
    ],
)
def test_useless_samples_do_not_keep_a_device_alive(left_out: int, useless: Sample) -> None:
    watch = running()
    for _ in range(41):
        samples = everything(watch.now_ns + 10 * MS)
        del samples[left_out]
        watch.supervisor.observe(useless, watch.now_ns)
        mode = watch.cycle(*samples)
    assert mode is Mode.SAFE_STOP


def test_repeated_and_old_stamps_do_not_keep_a_device_alive() -> None:
    watch = running()
    stamp_ns = watch.now_ns
    for i in range(11):
        watch.cycle(*everything(stamp_ns - i * MS))
    assert watch.supervisor.mode is Mode.SAFE_STOP


@pytest.mark.parametrize(
    ("sample", "reason"),
    [
        (LinkSample(device="imu", t_ns=0, up=False, reason="unplugged"), "imu: link down (unplugged)"),
        (
            FaultSample(device="drive", t_ns=0, wheel=1, code=4, text="over current"),
            "drive wheel 1: fault 4 (over current)",
        ),
        (FaultSample(device="drive", t_ns=0, code=7, text="bus off"), "drive: fault 7 (bus off)"),
    ],
)
def test_link_and_fault_stop_at_once_and_hold_until_cleared(sample: Sample, reason: str) -> None:
    watch = running()
    for _ in range(100):
        assert watch.cycle(sample, *everything(watch.now_ns + 10 * MS)) is Mode.SAFE_STOP
        assert watch.supervisor.reason == reason
        sample = power(watch.now_ns)
    for clear in (
        LinkSample(device="imu", t_ns=0, up=True, reason="reopened"),
        FaultSample(device="drive", t_ns=0, code=0, text="ok"),
    ):
        watch.supervisor.observe(clear, watch.now_ns)
    assert watch.healthy_until_running() == 410


def test_a_fault_is_cleared_for_its_wheel_only() -> None:
    watch = running()
    for index in (0, 1):
        watch.supervisor.observe(FaultSample(device="drive", t_ns=0, wheel=index, code=1, text="stalled"), 0)
    watch.supervisor.observe(FaultSample(device="drive", t_ns=0, wheel=0, code=0, text="ok"), 0)
    for _ in range(60):
        assert watch.cycle(*everything(watch.now_ns + 10 * MS)) is Mode.SAFE_STOP
    assert watch.supervisor.reason == "drive wheel 1: fault 1 (stalled)"


@pytest.mark.parametrize(
    "pair",
    [
        (
            LinkSample(device="wheels", t_ns=0, up=False, reason="unplugged"),
            LinkSample(device="wheels", t_ns=0, up=True, reason="reopened"),
        ),
        (
            FaultSample(device="drive", t_ns=0, code=1, text="watchdog"),
            FaultSample(device="drive", t_ns=0, code=0, text="ok"),
        ),
    ],
)
def test_a_break_within_one_cycle_stops_too(pair: tuple[Sample, Sample]) -> None:
    watch = running()
    assert watch.cycle(*everything(watch.now_ns + 10 * MS), *pair) is Mode.SAFE_STOP
    assert watch.healthy_until_running() == 410


def test_an_old_stamp_after_a_new_one_does_not_make_a_device_stale() -> None:
    watch = running()
    for _ in range(30):
        now_ns = watch.now_ns + 10 * MS
        assert watch.cycle(*everything(now_ns), *everything(now_ns - 400 * MS)) is Mode.RUNNING


def test_clearing_one_device_leaves_the_faults_of_others() -> None:
    watch = running()
    for sample in (
        FaultSample(device="drive", t_ns=0, wheel=0, code=1, text="stalled"),
        FaultSample(device="imu", t_ns=0, code=2, text="saturated"),
        FaultSample(device="drive", t_ns=0, code=0, text="ok"),
    ):
        watch.supervisor.observe(sample, 0)
    for _ in range(60):
        assert watch.cycle(*everything(watch.now_ns + 10 * MS)) is Mode.SAFE_STOP
    assert watch.supervisor.reason == "imu: fault 2 (saturated)"


def test_devices_that_are_not_required_do_not_stop() -> None:
    watch = running()
    for sample in (
        LinkSample(device="camera", t_ns=0, up=False, reason="unplugged"),
        FaultSample(device="camera", t_ns=0, code=1, text="overheated"),
    ):
        assert watch.cycle(sample, *everything(watch.now_ns + 10 * MS)) is Mode.RUNNING


def test_recovery_takes_unbroken_freshness() -> None:
    watch = running()
    watch.cycle(LinkSample(device="imu", t_ns=0, up=False, reason="unplugged"))
    watch.supervisor.observe(LinkSample(device="imu", t_ns=0, up=True, reason="reopened"), 0)
    for _ in range(39):
        assert watch.cycle(*everything(watch.now_ns + 10 * MS)) is Mode.SAFE_STOP
    for _ in range(11):
        watch.cycle()
    assert watch.supervisor.reason == "wheels: no position of wheel 0 within 0.1 s"
    assert watch.healthy_until_running() == 410
    assert watch.supervisor.reason == ""


def test_an_estimate_that_is_not_finite_stops() -> None:
    watch = running()
    assert watch.cycle(*everything(watch.now_ns + 10 * MS), finite=False) is Mode.SAFE_STOP
    assert watch.supervisor.reason == "pose filter: the estimate is not finite"


def test_a_bumper_stops_for_good() -> None:
    watch = running()
    bumper = BumperSample(device="bumper", t_ns=0, pressed=True)
    assert watch.cycle(bumper, *everything(watch.now_ns + 10 * MS)) is Mode.EMERGENCY_STOP
    for _ in range(200):
        released = BumperSample(device="bumper", t_ns=0, pressed=False)
        assert watch.cycle(released, *everything(watch.now_ns + 10 * MS)) is Mode.EMERGENCY_STOP
    assert watch.supervisor.reason == "bumper: bumper pressed"


def test_bumpers_can_be_switched_off() -> None:
    watch = Watch(SafetySettings(bumper_stops=False))
    watch.healthy_until_running()
    bumper = BumperSample(device="bumper", t_ns=0, pressed=True)
    assert watch.cycle(bumper, *everything(watch.now_ns + 10 * MS)) is Mode.RUNNING


def test_a_finished_mission_stays_finished() -> None:
    watch = running()
    watch.supervisor.finish()
    assert watch.cycle(*everything(watch.now_ns + 10 * MS)) is Mode.FINISHED
    watch.cycle(LinkSample(device="imu", t_ns=0, up=False, reason="unplugged"))
    assert watch.supervisor.mode is Mode.FINISHED
    watch.supervisor.observe(LinkSample(device="imu", t_ns=0, up=True, reason="reopened"), 0)
    for _ in range(100):
        assert watch.cycle(*everything(watch.now_ns + 10 * MS)) is Mode.FINISHED


def not_finite(watch: Watch) -> Mode:
    return watch.cycle(*everything(watch.now_ns + 10 * MS), finite=False)


def drive(watch: Watch, distance_m: float, innovations: tuple[Innovation, ...] = ()) -> None:
    now_ns = watch.now_ns + 10 * MS
    mode = watch.cycle(*everything(now_ns), distance_m=distance_m, innovations=innovations)
    assert mode is Mode.RUNNING


NOT_FINITE = "pose filter: the estimate is not finite"


def test_the_third_identical_stop_is_final() -> None:
    watch = running()
    for _ in range(2):
        assert not_finite(watch) is Mode.SAFE_STOP
        assert watch.supervisor.reason == NOT_FINITE
        watch.healthy_until_running()
        drive(watch, 0.4)
    assert not_finite(watch) is Mode.EMERGENCY_STOP
    final = f"{NOT_FINITE}; stopped 3 times for this, stays stopped until restart"
    assert watch.supervisor.reason == final
    watch.cycle()
    for _ in range(60):
        assert watch.cycle(*everything(watch.now_ns + 10 * MS)) is Mode.EMERGENCY_STOP
    assert watch.supervisor.reason == final


def test_the_first_stop_is_final_where_one_is_allowed() -> None:
    watch = Watch(SafetySettings(identical_stops=1))
    watch.healthy_until_running()
    assert not_finite(watch) is Mode.EMERGENCY_STOP


def test_stops_for_different_causes_are_counted_apart() -> None:
    watch = running()
    for device in ("imu", "wheels"):
        for _ in range(2):
            watch.cycle(LinkSample(device=device, t_ns=0, up=False, reason="unplugged"))
            watch.supervisor.observe(LinkSample(device=device, t_ns=0, up=True, reason="reopened"), 0)
            watch.healthy_until_running()
    watch.cycle(LinkSample(device="imu", t_ns=0, up=False, reason="another one"))
    assert watch.supervisor.mode is Mode.EMERGENCY_STOP


def test_a_cause_that_comes_and_goes_at_rest_is_one_stop() -> None:
    watch = running()
    for _ in range(10):
        assert not_finite(watch) is Mode.SAFE_STOP
        watch.cycle(*everything(watch.now_ns + 10 * MS))
    assert watch.healthy_until_running() == 400


@pytest.mark.parametrize(("driven_m", "then"), [(0.75, Mode.EMERGENCY_STOP), (1.0, Mode.SAFE_STOP)])
def test_stops_are_forgotten_after_a_metre(driven_m: float, then: Mode) -> None:
    watch = running()
    for _ in range(2):
        not_finite(watch)
        watch.healthy_until_running()
    for _ in range(4):
        drive(watch, driven_m / 4)
    assert not_finite(watch) is then


def test_distance_before_the_newest_stop_does_not_count() -> None:
    watch = running()
    for _ in range(2):
        not_finite(watch)
        watch.healthy_until_running()
        drive(watch, 0.75)
    drive(watch, 0.2)
    assert not_finite(watch) is Mode.EMERGENCY_STOP


def test_distance_with_a_sign_of_the_cause_does_not_count() -> None:
    rejected = Innovation(
        measured=Measured("compass"), residual=1.0, variance=1.0, nis=20.0, outcome=Outcome.REJECTED
    )
    accepted = replace(rejected, outcome=Outcome.ACCEPTED)
    watch = running()
    for attempt in range(3):
        drive(watch, 0.75, (rejected,))
        drive(watch, 0.75)
        while watch.cycle(*everything(watch.now_ns + 10 * MS), innovations=(rejected,)) is Mode.RUNNING:
            pass
        assert watch.supervisor.mode is (Mode.SAFE_STOP if attempt < 2 else Mode.EMERGENCY_STOP)
        watch.cycle(*everything(watch.now_ns + 10 * MS), innovations=(accepted,))
        if attempt < 2:
            watch.healthy_until_running()


def test_a_bumper_keeps_its_reason_where_the_first_stop_is_final() -> None:
    watch = Watch(SafetySettings(identical_stops=1))
    watch.healthy_until_running()
    watch.cycle(BumperSample(device="bumper", t_ns=0, pressed=True), *everything(watch.now_ns + 10 * MS))
    assert watch.supervisor.reason == "bumper: bumper pressed"


def test_wheels_without_a_known_motion_stop() -> None:
    watch = running()
    moved_ns = watch.now_ns
    while watch.cycle(*everything(watch.now_ns + 10 * MS), motion_ns=moved_ns) is Mode.RUNNING:
        pass
    assert watch.now_ns - moved_ns == 210 * MS
    assert watch.supervisor.reason == "wheels: no wheel motion measured for 0.2 s"
    watch = Watch()
    watch.cycle(*everything(10 * MS), motion_ns=None)
    assert watch.supervisor.reason == "wheels: no wheel motion measured for 0.2 s"


@given(heard=st.lists(st.lists(st.booleans(), min_size=6, max_size=6), min_size=1, max_size=150))
def test_running_means_that_every_part_is_fresh(heard: list[list[bool]]) -> None:
    watch = running()
    limits_ms = (100, 100, 200, 200, 300, 400)
    newest_ns = [watch.now_ns] * 6
    for row in heard:
        now_ns = watch.now_ns + 10 * MS
        newest_ns = [now_ns if here else old for here, old in zip(row, newest_ns, strict=True)]
        mode = watch.cycle(*(s for s, here in zip(everything(now_ns), row, strict=True) if here))
        is_fresh = all(now_ns - t <= limit * MS for t, limit in zip(newest_ns, limits_ms, strict=True))
        if not is_fresh:
            assert mode is Mode.SAFE_STOP


class Named(StopRule):
    """Gives the reasons that a test has set."""

    def __init__(self) -> None:
        self.reasons: list[Fault] = []

    def check(self, cycle: Cycle) -> Iterable[Fault]:
        return self.reasons


class Suspected:
    """A supervisor with one rule, which runs."""

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, settle_s: float = 0.0, suspicion_rest_s: float = 2.0
    ) -> None:
        self.rule = Named()
        monkeypatch.setattr("controllers.safety.supervisor.make_rules", lambda *_: (self.rule,))
        settings = SafetySettings(settle_s=settle_s, recover_s=0.5, suspicion_rest_s=suspicion_rest_s)
        self.supervisor = SafetySupervisor(settings, GYRO_ONLY, 2)
        self.now_ns = 0
        self.cycle()

    def cycle(self, *reasons: Fault, distance_m: float = 0.0, is_still: bool = True) -> Mode:
        self.now_ns += 100 * MS
        self.rule.reasons = list(reasons)
        self.supervisor.update(make_cycle(now_ns=self.now_ns, distance_m=distance_m, is_still=is_still))
        return self.supervisor.mode

    def rest_s(self) -> float:
        """Return how long it takes until the rover runs again."""
        start_ns = self.now_ns
        while self.cycle() is not Mode.RUNNING:
            assert self.supervisor.mode is Mode.SAFE_STOP
        return (self.now_ns - start_ns) / SECOND_NS


NO_GRIP = Fault("imu", Cause.GYRO_DOES_NOT_FOLLOW, "imu: no grip", Severity.RECOVERABLE, Bound(gyro_rad=0.5))
FINALLY = "imu: no grip; stopped {} times on suspicion, stays stopped until restart"
STOPPED = Fault("wheels", Cause.DEVICE_FAULT, "fault")


def test_a_recoverable_stop_rests_for_two_seconds_and_widens_what_cannot_keep_it_stopped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = Suspected(monkeypatch)
    assert run.cycle(NO_GRIP) is Mode.SAFE_STOP
    assert run.supervisor.reason == "imu: no grip"
    assert run.supervisor.faults == [NO_GRIP]
    assert run.rest_s() == pytest.approx(2.1)
    assert run.cycle(NO_GRIP._replace(cause=Cause.DEVICE_FAULT, severity=Severity.STOP)) is Mode.SAFE_STOP
    assert run.rest_s() == pytest.approx(0.6)


def test_a_doubt_widens_and_is_shown_and_stops_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Suspected(monkeypatch)
    doubt = NO_GRIP._replace(severity=Severity.UNCERTAIN)
    assert run.cycle(doubt) is Mode.RUNNING
    assert (run.supervisor.reason, run.supervisor.suspicion) == ("", "imu: no grip")
    assert run.supervisor.faults == [doubt]
    assert doubt.adds_uncertainty
    assert run.supervisor.is_gyro_undecided
    assert run.cycle(doubt._replace(severity=Severity.WARNING)) is Mode.RUNNING
    assert not run.supervisor.is_gyro_undecided


def test_another_reason_during_the_rest_does_not_shorten_it(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Suspected(monkeypatch)
    run.cycle(NO_GRIP)
    run.cycle(STOPPED)
    assert run.rest_s() == pytest.approx(2.1)


def test_the_rest_after_a_suspicion_begins_when_the_wheels_are_at_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = Suspected(monkeypatch)
    run.cycle(NO_GRIP, is_still=False)
    for _ in range(30):
        assert run.cycle(is_still=False) is Mode.SAFE_STOP
    assert run.rest_s() == pytest.approx(2.0)
    run.cycle(STOPPED, is_still=False)
    for _ in range(5):
        assert run.cycle(is_still=False) is Mode.SAFE_STOP
    assert run.cycle(is_still=False) is Mode.RUNNING


def test_the_rest_after_a_suspicion_is_not_shorter_than_after_other_stops(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = Suspected(monkeypatch, suspicion_rest_s=0.1)
    run.cycle(NO_GRIP)
    assert run.rest_s() == pytest.approx(0.6)


@pytest.mark.parametrize("first", [STOPPED, NO_GRIP])
def test_the_most_severe_reason_of_a_cycle_decides(monkeypatch: pytest.MonkeyPatch, first: Fault) -> None:
    run = Suspected(monkeypatch)
    final = Fault("imu", Cause.MISSED_TURN, "imu: missed turn", Severity.FINAL)
    assert run.cycle(first, final) is Mode.EMERGENCY_STOP
    assert run.supervisor.reason == f"{first.text}; imu: missed turn"


def test_a_suspicion_is_not_hidden_by_another_stop_of_its_cycle(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Suspected(monkeypatch)
    run.cycle(STOPPED, NO_GRIP)
    assert run.supervisor.reason == "fault; imu: no grip"
    assert run.rest_s() == pytest.approx(2.1)
    assert run.cycle(STOPPED, NO_GRIP) is Mode.EMERGENCY_STOP


def test_of_reasons_as_severe_the_first_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Suspected(monkeypatch)
    run.cycle(STOPPED, STOPPED._replace(text="other"))
    assert run.supervisor.reason == "fault"


def test_a_suspicion_while_the_rover_is_stopped_counts_and_prolongs_the_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = Suspected(monkeypatch)
    run.cycle(STOPPED)
    assert run.cycle(NO_GRIP) is Mode.SAFE_STOP
    assert run.rest_s() == pytest.approx(2.1)
    run.cycle(STOPPED)
    assert run.cycle(NO_GRIP) is Mode.EMERGENCY_STOP
    assert run.supervisor.reason == FINALLY.format(2)


def test_one_stop_is_one_suspicion_however_many_rules_have_it(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Suspected(monkeypatch)
    run.cycle(NO_GRIP)
    assert run.cycle(NO_GRIP, NO_GRIP._replace(cause=Cause.MISSED_TURN), is_still=False) is Mode.SAFE_STOP
    assert run.cycle(NO_GRIP._replace(cause=Cause.MISSED_TURN), is_still=False) is Mode.SAFE_STOP
    assert run.rest_s() == pytest.approx(2.1)


def test_a_suspicion_before_the_first_motion_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Suspected(monkeypatch, settle_s=1.0)
    assert run.cycle(NO_GRIP) is Mode.SETTLING
    for _ in range(10):
        assert run.cycle(is_still=False) is Mode.SETTLING
    assert run.cycle(is_still=False) is Mode.RUNNING
    assert run.cycle(NO_GRIP) is Mode.SAFE_STOP


def test_the_second_suspicion_before_a_metre_without_one_is_final(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Suspected(monkeypatch)
    run.cycle(NO_GRIP)
    run.rest_s()
    run.cycle(distance_m=0.99)
    assert run.cycle(NO_GRIP) is Mode.EMERGENCY_STOP
    assert run.supervisor.reason == FINALLY.format(2)


def test_the_third_suspicion_of_a_mission_is_final(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Suspected(monkeypatch)
    for _ in range(2):
        assert run.cycle(NO_GRIP) is Mode.SAFE_STOP
        run.rest_s()
        run.cycle(distance_m=1.0)
    assert run.cycle(NO_GRIP) is Mode.EMERGENCY_STOP
    assert run.supervisor.reason == FINALLY.format(3)


def test_suspicions_of_different_causes_are_counted_together(monkeypatch: pytest.MonkeyPatch) -> None:
    missed = NO_GRIP._replace(cause=Cause.MISSED_TURN)
    run = Suspected(monkeypatch)
    for stop in (NO_GRIP, missed):
        assert run.cycle(stop) is Mode.SAFE_STOP
        run.rest_s()
        run.cycle(distance_m=1.0)
    assert run.cycle(NO_GRIP) is Mode.EMERGENCY_STOP
    assert run.supervisor.reason == FINALLY.format(3)
    run = Suspected(monkeypatch)
    run.cycle(missed)
    run.rest_s()
    run.cycle(distance_m=0.1)
    assert run.cycle(NO_GRIP) is Mode.EMERGENCY_STOP


def test_distance_with_a_sign_of_any_suspicion_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Suspected(monkeypatch)
    run.cycle(NO_GRIP)
    run.rest_s()
    run.cycle(NO_GRIP._replace(severity=Severity.SYMPTOM), distance_m=1.0)
    assert run.cycle(NO_GRIP._replace(cause=Cause.MISSED_TURN)) is Mode.EMERGENCY_STOP


def test_a_suspicion_is_shown_and_stops_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    run = Suspected(monkeypatch)
    suspicion = Fault("rover", Cause.MAY_BE_STUCK, "rover: may be stuck", Severity.WARNING)
    assert run.cycle(suspicion, suspicion._replace(text="other")) is Mode.RUNNING
    assert run.supervisor.suspicion == "rover: may be stuck"
    assert run.supervisor.reason == ""
    assert run.cycle() is Mode.RUNNING
    assert run.supervisor.suspicion == ""


class Listener(StopRule):
    """Notes what it observes."""

    def __init__(self) -> None:
        self.observed: list[Sample] = []

    def observe(self, sample: Sample, t_ns: int) -> None:
        self.observed.append(sample)

    def check(self, cycle: Cycle) -> Iterable[Fault]:
        return ()


class RateListener(Listener):
    observes = (RateSample,)


def test_a_rule_observes_the_kinds_that_it_names_and_else_every_sample(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    every, rates = Listener(), RateListener()
    monkeypatch.setattr("controllers.safety.supervisor.make_rules", lambda *_: (every, rates))
    supervisor = SafetySupervisor(SafetySettings(), DeviceRoles(wheels="wheels", required={}), 4)
    samples = [wheel(0, 1), rate(2), power(3), rate(4)]
    for sample in samples:
        supervisor.observe(sample, sample.t_ns)
    assert every.observed == samples
    assert rates.observed == [samples[1], samples[3]]
