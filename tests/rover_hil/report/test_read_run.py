"""Summary and verdict, from logs whose truth is known."""

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_type_hints

import numpy as np
import pytest
from mcap.reader import make_reader

from controllers.control_loop import StepOutput
from controllers.estimation.filter.guarded_filter import Innovation, Outcome
from controllers.estimation.filter.measurement_model import Measured
from controllers.estimation.pose_estimate import PoseEstimate, YawSource
from controllers.motion.limits import Limit
from controllers.motion.planar import Pose
from controllers.safety import Mode
from drivers.clock import nanoseconds
from drivers.driver import DeviceState, Health
from drivers.errors import LogError
from drivers.link import LinkChange
from drivers.samples import RateSample, SentCommand, WheelCommand, WheelSample
from rover_hil.config import Config, load_config
from rover_hil.drives.formats.robotino_csv import read_run as read_csv
from rover_hil.drives.formats.to_log import observing_config, write_run_as_log
from rover_hil.recording.schema import VIEW_LOG, EstimateRecord, PoseRecord, end_record
from rover_hil.recording.text import estimate_text
from rover_hil.recording.watchdog_note import MOST_CHARACTERS, note_path, read_note
from rover_hil.recording.writer import LogWriter
from rover_hil.report.figures.system import draw_innovations
from rover_hil.report.read_run import read_run
from rover_hil.report.summary import Spread, Summary, summarise
from rover_hil.report.verdict import Grade, facts, grade, tag, verdict
from rover_hil.report.write import write_report
from rover_hil.run.executive import End, RunResult

START_NS = 5_000_000_000
PERIOD_S = 0.02
WAIT_S = 1.0
SPEED_M_S = 0.1
SLIP = 0.2
WHEEL_RAD_S = 2.5


@dataclass(frozen=True, kw_only=True)
class Drive:
    """A drive along x of which everything is known: the encoders overstate the way, the estimate does not.

    After a second of settling the wheels turn for `SPEED_M_S`; the rover moves at (1 - SLIP) of it and turns
    by `yaw_rate_rad_s`, which the encoders do not see. The ground truth is in a separate world frame.
    """

    duration_s: float = 11.0
    yaw_rate_rad_s: float = 0.0
    stop: tuple[float, float] = (0.0, 0.0)
    has_truth: bool = True
    has_end: bool = True
    estimate_is_nan: bool = False
    origin: str = "virtual"
    suspected: tuple[float, float] = (0.0, 0.0)
    world: tuple[float, float, float] = (7.0, -3.0, 2.5)

    def way_m(self, t_s: float) -> float:
        return SPEED_M_S * max(0.0, t_s - WAIT_S)

    def yaw_rad(self, t_s: float) -> float:
        return self.yaw_rate_rad_s * max(0.0, t_s - WAIT_S)

    def mode(self, t_s: float) -> Mode:
        if self.stop[0] <= t_s < self.stop[1]:
            return Mode.SAFE_STOP
        return Mode.SETTLING if t_s <= WAIT_S else Mode.RUNNING

    def output(self, t_s: float) -> StepOutput:
        t_ns, mode = START_NS + nanoseconds(t_s), self.mode(t_s)
        estimate = PoseEstimate(
            t_ns=t_ns,
            x_m=math.nan if self.estimate_is_nan and t_s > 5.0 else (1.0 - SLIP) * self.way_m(t_s),
            y_m=0.003,
            yaw_rad=self.yaw_rad(t_s),
            velocity_x_m_s=SPEED_M_S,
            velocity_y_m_s=0.0,
            yaw_rate_rad_s=0.0,
            gyro_bias_rad_s=0.0,
            covariance=(1e-4, 0.0, 0.0, 4e-4, 0.0, 1e-6),
            yaw_source=YawSource.GYRO,
        )
        innovation = Innovation(
            measured=Measured("imu", "standstill"),
            residual=0.01,
            variance=1e-4,
            nis=1.0,
            outcome=Outcome.ACCEPTED if t_s > 0.1 else Outcome.REJECTED,
        )
        fix = Innovation(
            measured=Measured("overhead", "x"),
            residual=0.004,
            variance=1e-6,
            nis=16.0,
            outcome=Outcome.ACCEPTED,
        )
        late = Innovation(
            measured=Measured("overhead", "too late"),
            residual=None,
            variance=None,
            nis=None,
            outcome=Outcome.REJECTED,
        )
        command = WheelCommand(t_ns=t_ns, expires_ns=t_ns + 1, speed_rad_s=(WHEEL_RAD_S,) * 3)
        return StepOutput(
            t_ns=t_ns,
            mode=mode,
            reason="imu: silent" if mode is Mode.SAFE_STOP else "",
            estimate=estimate,
            odometry=Pose(x_m=self.way_m(t_s)),
            odometry_rebases=0,
            innovations=(innovation, fix, late) if t_s < WAIT_S else (),
            command=command,
            limit=Limit.ACCELERATION if WAIT_S < t_s < WAIT_S + 0.11 else Limit.NONE,
            cross_track_m=0.003 if mode is Mode.RUNNING else None,
            suspicion=(
                f"rover: stuck for {t_s:.2f} s" if self.suspected[0] <= t_s < self.suspected[1] else ""
            ),
        )

    def truth(self, t_s: float) -> dict[str, object]:
        x_m, y_m, yaw_rad = self.world
        way_m = (1.0 - SLIP) * self.way_m(t_s)
        return {
            "t_ns": START_NS + nanoseconds(t_s),
            "x_m": x_m + way_m * math.cos(yaw_rad),
            "y_m": y_m + way_m * math.sin(yaw_rad),
            "yaw_rad": yaw_rad + self.yaw_rad(t_s),
            "wheel_speed_rad_s": [WHEEL_RAD_S if t_s > WAIT_S else 0.0, 0.0, -WHEEL_RAD_S],
            "slip": [SLIP if t_s > WAIT_S else 0.9, 0.5, SLIP],
        }


HEALTH = Health(
    device="board",
    state=DeviceState.STREAMING,
    rate_hz=150.0,
    age_s=0.01,
    accepted=100,
    rejected={"checksum": 3},
    breaks=1,
    sent=50,
    send_failures=0,
    last_link_reason="<reopened>",
)


def open_log(path: Path, origin: str, config: Config | None = None) -> LogWriter:
    config_json = (config or load_config("robotino")).model_dump_json(by_alias=True).encode()
    return LogWriter(path, START_NS, config_json, {}, origin)


def write_log(path: Path, drive: Drive) -> Path:
    with open_log(path, drive.origin) as log:
        count = round(drive.duration_s / PERIOD_S)
        for t_s in (index * PERIOD_S for index in range(1, count + 1)):
            write_cycle(log, drive, t_s)
        now_ns = START_NS + nanoseconds(drive.duration_s)
        log.health(now_ns, [HEALTH])
        if drive.has_end:
            result = RunResult(End.FINISHED, "mission finished", Mode.FINISHED, count, 0, drive.duration_s, 0)
            log.write_json("/end", now_ns, end_record(result))
    return path


def write_cycle(log: LogWriter, drive: Drive, t_s: float) -> None:
    t_ns = START_NS + nanoseconds(t_s)
    wheels = [
        WheelSample(device="board", t_ns=t_ns, wheel=i, position_rad=WHEEL_RAD_S * t_s, current_a=0.5)
        for i in range(3)
    ]
    stranger = WheelSample(device="arm", t_ns=t_ns - 1, wheel=0, position_rad=0.0)
    log.samples(t_ns, [*wheels, stranger, RateSample(device="imu", t_ns=t_ns, rate_z_rad_s=0.01)])
    log.write_json("/estimate", t_ns, json.loads(estimate_text(drive.output(t_s))))
    log.write_json("/command", t_ns, SentCommand(t_ns=t_ns, speed_rad_s=(WHEEL_RAD_S,) * 3, delivered=True))
    if drive.has_truth:
        log.write_json("/truth", t_ns, drive.truth(t_s))
    if drive.stop[0] <= t_s < drive.stop[0] + PERIOD_S / 2 and drive.stop[1] > 0.0:
        log.received("imu", LinkChange(t_ns, up=False, reason="unplugged"))
        log.write_json("/watchdog", t_ns, None)
    late_ns = 45_000_000 if 5.0 < t_s < 5.0 + PERIOD_S * 1.5 else 50_000
    log.write_json("/cycle", t_ns, {"late_ns": late_ns, "work_ns": 400_000})


def summary_of(tmp_path: Path, drive: Drive) -> Summary:
    return summarise(read_run(write_log(tmp_path / "run.mcap", drive)))


def test_errors_against_a_known_truth(tmp_path: Path) -> None:
    summary = summary_of(tmp_path, Drive(yaw_rate_rad_s=0.01))
    encoders, estimate = summary.encoders_error, summary.estimate_error
    assert encoders is not None
    assert estimate is not None
    assert summary.distance_encoders_m == pytest.approx(1.0, abs=1e-6)
    assert summary.distance_truth_m == pytest.approx(0.8, abs=1e-6)
    assert summary.slip_ratio == pytest.approx(SLIP, abs=1e-6)
    assert encoders.position_final_m == pytest.approx(0.2, abs=1e-6)
    assert encoders.position_max_m == pytest.approx(0.2, abs=1e-6)
    assert encoders.position_final_share == pytest.approx(0.25, abs=1e-6)
    # The error grows linearly over 10 of 11 seconds.
    assert encoders.position_rms_m == pytest.approx(0.2 * math.sqrt(10 / 33), rel=0.01)
    assert encoders.yaw_final_rad == pytest.approx(-0.1, abs=1e-6)
    assert estimate.position_final_m == pytest.approx(0.003, abs=1e-6)
    assert estimate.yaw_rms_rad == pytest.approx(0.0, abs=1e-6)
    assert summary.final_truth is not None
    assert (summary.final_truth.x_m, summary.final_truth.y_m) == pytest.approx((0.8, 0.0), abs=1e-6)
    assert summary.final_truth.yaw_rad == pytest.approx(0.1, abs=1e-6)


def test_slip_of_a_wheel_is_its_mean_over_the_angle_turned(tmp_path: Path) -> None:
    # The 0.9 at standstill must not count, and a wheel that never turned has none.
    first, second, third = summary_of(tmp_path, Drive()).wheel_slip
    assert (first, third) == pytest.approx((SLIP, SLIP))
    assert second is None


def test_every_number_that_a_cycle_computes_is_read_under_its_key(tmp_path: Path) -> None:
    computed = read_run(write_log(tmp_path / "run.mcap", Drive())).computed
    plain = {
        name for name, kind in get_type_hints(EstimateRecord).items() if kind in (int, float, float | None)
    }
    assert plain - {"t_ns"} == {name for name in computed if "." not in name}
    assert {name for name in computed if name.startswith("odometry.")} == {
        f"odometry.{name}" for name in PoseRecord.__annotations__
    }
    assert set(computed["estimate.velocity_x_m_s"].value) == {SPEED_M_S}
    running = computed["cross_track_m"]
    assert running.t_s[0] > WAIT_S
    assert set(running.value) == {0.003}


def test_the_residual_of_a_position_is_drawn_as_a_length_and_that_of_a_gyro_as_a_rate(tmp_path: Path) -> None:
    run = read_run(write_log(tmp_path / "run.mcap", Drive()))
    figure = draw_innovations(run, summarise(run))
    assert figure is not None
    gyro, position = figure.axes
    assert (gyro.get_title(), gyro.get_ylabel()) == ("imu standstill", "residual (deg/s)")
    assert np.asarray(gyro.lines[0].get_ydata()) == pytest.approx(math.degrees(0.01))
    assert (position.get_title(), position.get_ylabel()) == ("overhead x", "residual (mm)")
    assert np.asarray(position.lines[0].get_ydata()) == pytest.approx(4.0)


def test_cycles_limits_and_cross_track(tmp_path: Path) -> None:
    summary = summary_of(tmp_path, Drive())
    assert (summary.end, summary.mode, summary.cycles) == ("mission finished", Mode.RUNNING, 550)
    assert summary.limited_cycles == {"acceleration": 5}
    assert summary.refused_innovations == {"imu standstill": 5, "overhead x": 0}
    assert summary.uncompared_measurements == {"overhead too late": round(WAIT_S / PERIOD_S) - 1}
    (late,) = [fact for fact in facts(summary) if fact.name == "overhead too late"]
    assert late.value == str(summary.uncompared_measurements["overhead too late"])
    assert summary.cross_track_rms_m == pytest.approx(0.003)
    assert summary.lateness == Spread(p50_us=50.0, p99_us=50.0, max_us=45_000.0)
    assert summary.work == Spread(p50_us=400.0, p99_us=400.0, max_us=400.0)


def test_a_suspicion_is_told_with_its_cycles_and_stops_nothing(tmp_path: Path) -> None:
    summary = summary_of(tmp_path, Drive(suspected=(4.0, 5.0)))
    (suspicion,) = summary.suspicions
    assert (suspicion.text, suspicion.cycles) == ("rover: stuck for 4.00 s", round(1.0 / PERIOD_S))
    assert summary.stops == ()
    (fact,) = [fact for fact in facts(summary) if fact.name == "may be wrong"]
    assert (fact.value, fact.detail) == ("from 4.0 s", "rover: stuck for 4.00 s; in 50 cycles")


def test_the_begin_of_a_suspicion_is_an_event_of_the_log(tmp_path: Path) -> None:
    drive = Drive(suspected=(4.0, 5.0))
    with open_log(tmp_path / "run.mcap", "virtual") as log:
        for t_s in (3.98, 4.0, 4.02, 5.02):
            log.estimate(drive.output(t_s))
    with (tmp_path / "run.mcap").open("rb") as stream:
        events = [message.data.decode() for _, _, message in make_reader(stream).iter_messages([VIEW_LOG])]
    assert ["stuck for 4.00 s" in event for event in events if "suspicion" in event] == [True]


def test_a_yaw_that_nothing_watches_is_told(tmp_path: Path) -> None:
    config = load_config("robotino").model_copy(update={"slip": None})
    with open_log(tmp_path / "run.mcap", "real", config) as log:
        write_cycle(log, Drive(), 1.5)
    summary = summarise(read_run(tmp_path / "run.mcap"))
    (fact,) = [fact for fact in facts(summary) if fact.name == "yaw"]
    assert fact.value == "unwatched"
    assert fact.detail.startswith("nothing in this mission would notice that imu measures no turns; ")
    watched = summarise(read_run(write_log(tmp_path / "watched.mcap", Drive())))
    assert [fact for fact in facts(watched) if fact.name == "yaw"] == []


def test_a_safety_stop_is_told_with_its_time_and_reason(tmp_path: Path) -> None:
    summary = summary_of(tmp_path, Drive(stop=(4.0, 6.0)))
    (stop,) = summary.stops
    assert (stop.start_s, stop.end_s) == pytest.approx((4.0, 6.0))
    assert (stop.mode, stop.reasons) == (Mode.SAFE_STOP, ("imu: silent",))
    assert summary.watchdog_interventions == 1
    assert grade(summary) is Grade.ATTENTION


def test_only_new_camera_poses_count_as_truth(tmp_path: Path) -> None:
    drive = Drive(origin="imported", has_end=False)
    with open_log(tmp_path / "run.mcap", "imported") as log:
        for index in range(1, 551):
            t_s = index * PERIOD_S
            write_cycle(log, replace(drive, has_truth=False), t_s)
            is_new = index % 2 == 0
            pose = {key: drive.truth(t_s)[key] for key in ("t_ns", "x_m", "y_m", "yaw_rad")}
            if not is_new:
                pose["x_m"] = 99.0
            log.write_json("/truth", START_NS + nanoseconds(t_s), {**pose, "is_new": is_new})
    summary = summarise(read_run(tmp_path / "run.mcap"))
    assert summary.slip_ratio == pytest.approx(SLIP, abs=1e-3)
    assert summary.encoders_error is not None
    assert summary.encoders_error.position_max_m < 0.21
    assert summary.end is None


def test_a_killed_run_is_reported_up_to_the_cut(tmp_path: Path) -> None:
    whole = write_log(tmp_path / "whole.mcap", Drive()).read_bytes()
    cut = tmp_path / "run.mcap"
    cut.write_bytes(whole[: len(whole) * 3 // 5])
    run = read_run(cut)
    summary = summarise(run)
    assert (summary.is_complete, summary.end) == (False, None)
    assert 5.1 < summary.duration_s < 8.0
    assert summary.skipped == 2  # the cycle that came 45 ms late had left out two of 20 ms
    assert "the log was cut off after" in verdict(run, summary)
    assert (tag(summary), grade(summary)) == ("log cut off", Grade.ATTENTION)


def test_why_the_watchdog_ended_a_run_is_told(tmp_path: Path) -> None:
    whole = write_log(tmp_path / "whole.mcap", Drive())
    cut = tmp_path / "run.mcap"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size * 3 // 5])
    cause = "watchdog: the loop gave no heartbeat; the drive was stopped"
    for log in (whole, cut):
        note_path(log).write_text(f"{cause}\n")
    summary = summarise(run := read_run(cut))
    assert summary.reason == cause
    assert f" s, {cause}. " in verdict(run, summary)
    assert cause not in verdict(read_run(whole), summarise(read_run(whole)))  # of an earlier run


def test_a_note_of_the_watchdog_is_one_line_whatever_is_in_the_file(tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    assert read_note(log) == ""
    note_path(log).write_bytes(b"\x1b[2J\xff\n" + b"a" * 100_000)
    assert read_note(log).startswith(" [2J\ufffd aaa")
    assert len(read_note(log)) == MOST_CHARACTERS
    note_path(log).unlink()
    note_path(log).mkdir()
    assert read_note(log) == ""


def test_wherever_a_log_is_cut_it_is_read_or_refused(tmp_path: Path) -> None:
    whole = write_log(tmp_path / "whole.mcap", Drive(duration_s=0.2)).read_bytes()
    cut = tmp_path / "run.mcap"
    outcomes = set()
    for size in range(1, len(whole), 97):
        cut.write_bytes(whole[:size])
        try:
            outcomes.add(summarise(read_run(cut)).cycles > 0)
        except LogError:
            outcomes.add(False)
    assert outcomes == {True, False}


def test_only_the_wheel_device_turns_wheels(tmp_path: Path) -> None:
    speed = read_run(write_log(tmp_path / "run.mcap", Drive())).wheels[0].speed
    assert speed is not None
    assert speed.value == pytest.approx(WHEEL_RAD_S)


def test_a_run_that_ended_without_a_word_is_bad(tmp_path: Path) -> None:
    run = read_run(write_log(tmp_path / "run.mcap", Drive(has_end=False)))
    summary = summarise(run)
    assert "without saying why" in verdict(run, summary)
    assert grade(summary) is Grade.BAD


def test_the_verdict_says_why_a_run_did_not_finish(tmp_path: Path) -> None:
    run = read_run(write_log(tmp_path / "run.mcap", Drive(duration_s=2.0)))
    summary = summarise(run)
    late = replace(summary, end=End.TIME_OVER, reason="time is over; the rover was running")
    bumped = replace(summary, end=End.EMERGENCY_STOP, reason="board: bumper pressed")
    assert ": time over after 2.0 s (the rover was running)." in verdict(run, late)
    assert ": emergency stop after 2.0 s (board: bumper pressed)." in verdict(run, bumped)
    assert [grade(each) for each in (summary, late, bumped)] == [Grade.GOOD, Grade.ATTENTION, Grade.BAD]


def test_a_log_without_a_cycle_is_refused(tmp_path: Path) -> None:
    log_path = write_log(tmp_path / "run.mcap", Drive(duration_s=0.0))
    with pytest.raises(LogError, match="no complete cycle"):
        write_report(log_path, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_message_of_another_shape_is_refused_by_name(tmp_path: Path) -> None:
    with open_log(tmp_path / "run.mcap", "virtual") as log:
        write_cycle(log, Drive(), PERIOD_S)
        log.write_json("/cycle", START_NS, {"late_ns": "soon"})
    with pytest.raises(LogError, match="/cycle at 5000000000 ns: late_ns"):
        write_report(tmp_path / "run.mcap", tmp_path / "out")


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("table_surface/exp00", 0.05, 0.15),
        ("gray_surface/exp52", 0.2, 0.4),
        ("green_surface/exp76", 0.4, 0.7),
    ],
)
def test_slip_of_measured_runs(
    tmp_path: Path, shared_data: Path, name: str, least: float, most: float
) -> None:
    source = shared_data / "robotino_2023" / "one_surface_type" / f"{name}.csv.gz"
    log_path = tmp_path / "run.mcap"
    config = observing_config(load_config("robotino"))
    for _ in write_run_as_log(read_csv(source, 1.84), source.name, config, log_path):
        pass
    summary = summarise(read_run(log_path))
    assert summary.slip_ratio is not None
    assert least < summary.slip_ratio < most
    assert (summary.end, summary.lateness, summary.work, summary.devices) == (None, None, None, ())
    assert grade(summary) is Grade.NEUTRAL
