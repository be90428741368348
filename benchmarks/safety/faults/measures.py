"""What the log of a faulty run says: when it stopped, what was invented, whether the estimate was honest.

The truth is the plant's. Only the log is read, never a filter or a rule.
"""

import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.safety.faults.cases import FOR_EVER_S, Case, Duty, all_cases
from benchmarks.safety.faults.runs import WATCHED_S, rover_config, run_case
from controllers.motion.rover_geometry import OmniRoverSettings, track_of
from drivers.clock import NANOSECONDS_PER_SECOND, nanoseconds, seconds
from drivers.errors import LogError
from rover_hil.config import Config
from rover_hil.drives.drive import read_drive
from rover_hil.recording.data_files import restore_config
from rover_hil.recording.reader import LogReader
from rover_hil.report.read_run import read_run
from rover_hil.run.replay import replay

ZERO_BAR_MS = 150.0
NOTICE_BAR_S, NOTICE_BAR_M = 1.5, 0.15
NEES_BAR = 16.27
"""99.9 % of a chi-square distribution with 3 degrees of freedom."""
RESOLUTION = 0.001
"""In m and rad: in the first cycle of a motion nothing is uncertain, and every error infinitely unlikely."""
HEADING_SHOWS_RAD = math.radians(1.0)
"""A gyro that has turned wrongly by this much shows in the headings of the simulated compass: three standard
errors of averages of a second (0.4 deg), its resolution (0.1 deg), deviation and damping (0.5 deg)."""
BEFORE_S = 3.0
LEAST_SILENCE_S = 0.15
DRIVING = ("running", "finished")


@dataclass(slots=True)
class Moment:
    """One cycle: what was estimated, sent and true; poses are relative to the start."""

    t_ns: int
    mode: str
    reason: str
    estimate: tuple[float, float, float]
    covariance: tuple[float, ...]
    odometry: tuple[float, float, float]
    is_zero: bool = False
    sent_ns: int = 0
    suspicion: str = ""
    truth: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def error(self) -> NDArray[np.float64]:
        """Estimate minus truth: x, y in m and yaw in rad."""
        x_m, y_m, yaw_rad = (was - true for was, true in zip(self.estimate, self.truth, strict=True))
        return np.array([x_m, y_m, math.remainder(yaw_rad, math.tau)])

    @property
    def nees(self) -> float:
        """Normalised estimation error squared of the pose; errors of 1 mm and 1 mrad count for nothing."""
        xx, xy, xt, yy, yt, tt = self.covariance
        covariance = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]]) + RESOLUTION**2 * np.eye(3)
        return float(self.error @ np.linalg.solve(covariance, self.error))


@dataclass(slots=True)
class Story:
    """A log, read once.

    Attributes:
        raw_ns: Arrival times of the payloads of the faulty device.
        sample_ns: Stamps of its samples, in the order of the cycles, each with the time of its cycle.
        rates: Its yaw rates in rad/s as received, each with its stamp.
        link_ns: When its link changed.
        breaks_ns: When its link went down.
        rejected: What its codec rejected until the end, by reason.
        lost: Payloads of it that were not decoded.
        end: Why the run ended.
    """

    moments: list[Moment] = field(default_factory=list)
    raw_ns: list[int] = field(default_factory=list)
    sample_ns: list[tuple[int, int]] = field(default_factory=list)
    rates: list[tuple[int, float]] = field(default_factory=list)
    link_ns: list[int] = field(default_factory=list)
    breaks_ns: list[int] = field(default_factory=list)
    rejected: Mapping[str, int] = field(default_factory=dict)
    lost: int = 0
    end: str = "none"
    truth: list[tuple[int, float, float, float]] = field(default_factory=list)


@dataclass(slots=True)
class Row:
    """One row of the table; None where it does not apply.

    Attributes:
        detectable_s: From the fault until it can be detected: its silence exceeds the age limit, its link
            breaks; 0 for wrong values.
        zero_ms: From then to zero setpoints.
        stop_s: From the fault to zero setpoints.
        driven_m: True distance from the fault to the stop, or to the end where there is none.
        invented: Samples with a stamp at which nothing arrived, or odometry that went on in the silence.
        error_m: Position error when it drove again, or at the end of the watch where it never stopped.
        error_deg: Yaw error then.
        nees_again: NEES then.
        nees_later: Greatest NEES while it drives, until 5 s later. Of a fault that stays: the greatest when
            it begins to drive again; in between the fault misleads it until it is noticed.
        sigma_m: Position sigma when it drove again.
        sigma_deg: Yaw sigma then.
        unseen_m: How far the rover could have moved while the device was silent: its true speed before,
            times the silence; None where nothing was silent, or it did not drive again.
        wider_m: Position sigma that was added, over that.
        unseen_deg: How far it could have turned: with the wheels of one side at rest.
        wider_deg: Yaw sigma that was added, over that.
        outcome: Stopped, resumed, ended how.
        replays: Whether the replay of the log is identical.
        is_refused: Whether a reader refused the log.
    """

    rover: str
    device: str
    fault: str
    mode: str
    duty: str
    detectable_s: float | None = None
    zero_ms: float | None = None
    stop_s: float | None = None
    driven_m: float = 0.0
    invented: int = 0
    error_m: float | None = None
    error_deg: float | None = None
    nees_again: float | None = None
    nees_later: float | None = None
    sigma_m: float | None = None
    sigma_deg: float | None = None
    unseen_m: float | None = None
    wider_m: float | None = None
    unseen_deg: float | None = None
    wider_deg: float | None = None
    outcome: str = ""
    replays: bool | None = None
    is_refused: bool = False
    message: str = ""
    rejected: dict[str, int] = field(default_factory=dict)
    lost: int = 0
    failures: list[str] = field(default_factory=list)
    why: str = ""

    @property
    def verdict(self) -> str:
        """Return "ok", "by physics" or what misses its bar."""
        if self.failures:
            return "MISSED: " + "; ".join(self.failures)
        return "by physics" if self.why else "ok"

    def as_json(self) -> dict[str, object]:
        """Return all of it, the verdict included."""
        return {**asdict(self), "verdict": self.verdict}


def read_story(path: Path, device: str) -> Story:
    """Read what matters of a log; of a log that was cut off, what is there."""
    story = Story()
    for message in LogReader(path).messages():
        if message.topic == f"/raw/{device}":
            story.raw_ns.append(message.t_ns)
        elif message.topic == f"/link/{device}":
            story.link_ns.append(message.t_ns)
            if not _record(message.json())["up"]:
                story.breaks_ns.append(message.t_ns)
        elif message.topic in _TAKERS:
            _TAKERS[message.topic](story, message.t_ns, message.json(), device)
    return story


def add_truth(story: Story) -> None:
    """Give each cycle the true pose relative to the start, interpolated to its time."""
    t_ns, x_m, y_m, yaw_rad = np.array(story.truth, dtype=float).T
    c, s = math.cos(yaw_rad[0]), math.sin(yaw_rad[0])
    dx_m, dy_m = x_m - x_m[0], y_m - y_m[0]
    columns = (c * dx_m + s * dy_m, c * dy_m - s * dx_m, yaw_rad - yaw_rad[0])
    at_ns = [float(moment.t_ns) for moment in story.moments]
    poses = zip(*(np.interp(at_ns, t_ns, column) for column in columns), strict=True)
    for moment, (x, y, yaw) in zip(story.moments, poses, strict=True):
        moment.truth = (float(x), float(y), float(yaw))


def measure(title: str, is_excited: bool = True) -> Row:
    """Run the case with this title on simulated time; return its row.

    A worker process finds it here: it cannot import the module of the command.
    """
    case = next(case for case in all_cases() if case.title == title)
    case = replace(case, is_excited=is_excited)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        _, window = run_case(case, path)
        story = read_story(path, case.device)
        add_truth(story)
        row = judge(case, story, rover_config(case), window.begin_ns)
        check_readers(row, path)
        check_replay(row, path)
    return row


def judge(case: Case, story: Story, config: Config, begin_ns: int, mode: str = "virtual") -> Row:
    """Return the row of a run whose fault began at `begin_ns`; replay is checked elsewhere."""
    row = Row(case.rover, case.device, case.fault, mode, case.duty.value, why=case.why)
    row.rejected, row.lost = dict(story.rejected), story.lost
    after = [moment for moment in story.moments if moment.t_ns >= begin_ns]
    if not after:
        row.failures.append(f"ended before the fault: {story.end}")
        return row
    stop = next((moment for moment in after if moment.is_zero and moment.mode not in DRIVING), None)
    named = _find_named(case, after, stop)
    if named is not None:
        row.stop_s = round(seconds(named.sent_ns - begin_ns), 3)
        row.message = named.reason or named.suspicion
    way = [moment.truth for moment in after if named is None or moment.t_ns <= named.t_ns]
    row.driven_m = round(sum(math.dist(a[:2], b[:2]) for a, b in pairwise(way)), 3)
    age_limit_s = config.devices[case.device].max_age_s if case.is_of_device else None
    detectable_ns = _find_detectable(case, story, begin_ns, age_limit_s)
    if detectable_ns is not None:
        row.detectable_s = round(seconds(detectable_ns - begin_ns), 3)
        if stop is not None:
            row.zero_ms = round(1e3 * seconds(stop.sent_ns - detectable_ns), 1)
    row.invented = _count_invented(case, story, begin_ns)
    again = _find_again(after, stop)
    if stop is None and named is not None:
        # Of two suspicions the second may be the one that widens the estimate.
        honest_ns = max(named.t_ns, begin_ns + nanoseconds(NOTICE_BAR_S))
        after = [moment for moment in after if moment.t_ns > honest_ns] or after[-1:]
    _measure_estimate(
        row, after, again, has_stopped=stop is not None, is_lasting=case.duration_s == FOR_EVER_S
    )
    if again is not None and case.duration_s != FOR_EVER_S:
        _measure_width(row, case, story, config, begin_ns, again)
    row.outcome = _tell(stop, again, story.end)
    _judge_bars(case, row, has_stopped=stop is not None)
    if case.zero_bar_s is not None:
        warned = next((each for each in story.moments if each.t_ns >= begin_ns and each.suspicion), None)
        if row.stop_s is None or row.stop_s > case.zero_bar_s:
            row.failures.append(f"zero setpoints after {row.stop_s} s, bar {case.zero_bar_s:g} s")
        elif warned is None or stop is None or warned.t_ns >= stop.t_ns:
            row.failures.append("stopped without a warning before")
    return row


def _find_named(case: Case, after: list[Moment], stop: Moment | None) -> Moment | None:
    """Return when the fault was named: at the stop, or earlier by a suspicion where it must be noticed."""
    if case.duty is not Duty.NOTICE:
        return stop
    suspected = next((moment for moment in after if moment.suspicion and moment.mode in DRIVING), None)
    return min((each for each in (stop, suspected) if each), key=lambda each: each.t_ns, default=None)


def check_readers(row: Row, path: Path) -> None:
    """Note whether a report, quantities and tables can be made of a log."""
    try:
        read_run(path)
        read_drive(path)
        for _ in LogReader(path).messages():
            pass
    except LogError as error:
        row.is_refused = True
        row.failures.append(f"refused: {error}")


def check_replay(row: Row, path: Path) -> None:
    """Note whether the replay of a log gives the same outputs, and what differs."""
    try:
        log = LogReader(path)
        with restore_config(log) as config:
            differences = replay(log, config, lambda: None).differences
    except LogError as error:
        row.is_refused = True
        row.failures.append(f"no replay: {error}")
        return
    row.replays = not differences
    if differences:
        names = ", ".join(f"{difference.field} ({difference.count})" for difference in differences[:3])
        row.failures.append(f"replay differs in {names}")


def _find_detectable(case: Case, story: Story, begin_ns: int, age_limit_s: float | None) -> int | None:
    """Return when the fault could be seen: the link broke, or the newest stamp was too old in a cycle."""
    if case.by_heading:
        return _find_wrong_turn(story, begin_ns)
    if case.duty is not Duty.STOP:
        return begin_ns if case.duty is Duty.NOTICE else None
    if case.is_unplug:
        return next((t_ns for t_ns in story.breaks_ns if t_ns >= begin_ns), begin_ns)
    assert age_limit_s is not None
    age_limit_ns, newest_ns, samples = nanoseconds(age_limit_s), 0, iter(story.sample_ns)
    sample = next(samples, None)
    for moment in story.moments:
        while sample is not None and sample[0] <= moment.t_ns:
            newest_ns, sample = max(newest_ns, sample[1]), next(samples, None)
        if moment.t_ns > max(begin_ns, newest_ns + age_limit_ns):
            return newest_ns + age_limit_ns
    return None


def _find_wrong_turn(story: Story, begin_ns: int) -> int | None:
    """Return when the gyro has turned wrongly by what a compass shows; its bias is that before the fault.

    None where it never has, or less than `NOTICE_BAR_S` before the end of the run.
    """
    t_ns, rates_rad_s = np.array(story.rates).T
    at_s = (t_ns - begin_ns) / NANOSECONDS_PER_SECOND
    steps_rad = 0.5 * (rates_rad_s[1:] + rates_rad_s[:-1]) * np.diff(at_s)
    yaw_rad = np.interp(t_ns, [m.t_ns for m in story.moments], [m.truth[2] for m in story.moments])
    wrong_rad = np.concatenate(([0.0], np.cumsum(steps_rad))) - yaw_rad
    first, begin = np.searchsorted(at_s, [-BEFORE_S, 0.0])
    bias_rad_s = (wrong_rad[begin] - wrong_rad[first]) / (at_s[begin] - at_s[first])
    wrong_rad -= wrong_rad[begin] + bias_rad_s * (at_s - at_s[begin])
    shows = np.flatnonzero((at_s > 0.0) & (np.abs(wrong_rad) > HEADING_SHOWS_RAD))
    last_ns = story.moments[-1].t_ns - nanoseconds(NOTICE_BAR_S)
    return int(t_ns[shows[0]]) if len(shows) and t_ns[shows[0]] <= last_ns else None


def _measure_width(row: Row, case: Case, story: Story, config: Config, begin_ns: int, again: Moment) -> None:
    """Compare the sigma that the fault added with the greatest motion while its device was silent."""
    stamps_ns = [stamp_ns for _, stamp_ns in story.sample_ns] or [m.t_ns for m in story.moments]
    around = [t_ns for t_ns in sorted(stamps_ns) if begin_ns - nanoseconds(0.5) < t_ns <= again.t_ns]
    silent_s = max((seconds(b - a) for a, b in pairwise(around)), default=0.0)
    before = [m for m in story.moments if begin_ns - nanoseconds(1.0) <= m.t_ns < begin_ns]
    if silent_s < LEAST_SILENCE_S or len(before) < 2:
        return
    speeds_m_s = [math.dist(a.truth[:2], b.truth[:2]) / seconds(b.t_ns - a.t_ns) for a, b in pairwise(before)]
    rover = config.rover
    arm_m = rover.base_radius_m if isinstance(rover, OmniRoverSettings) else 0.5 * track_of(rover)
    unseen_m = max(speeds_m_s) * silent_s
    unseen_deg = math.degrees(unseen_m / arm_m)
    was, now = before[-1].covariance, again.covariance
    added_m = math.sqrt(max(0.0, now[0] + now[3] - was[0] - was[3]))
    added_deg = math.degrees(math.sqrt(max(0.0, now[5] - was[5])))
    row.unseen_m, row.wider_m = round(unseen_m, 3), round(added_m / unseen_m, 2)
    row.unseen_deg, row.wider_deg = round(unseen_deg, 1), round(added_deg / unseen_deg, 2)


def _count_invented(case: Case, story: Story, begin_ns: int) -> int:
    """Count samples of which nothing arrived, and odometry that moved while the wheels were silent."""
    if not case.is_of_device:
        return 0
    arrived = {*story.raw_ns, *story.link_ns}
    invented = sum(stamp_ns not in arrived for _, stamp_ns in story.sample_ns)
    is_silent = case.is_unplug or case.fault == "freeze"
    if is_silent and case.device in ("board", "wheels"):
        last_ns = max((t_ns for t_ns in story.raw_ns if t_ns < begin_ns), default=begin_ns)
        back_ns = min((t_ns for t_ns in story.raw_ns if t_ns > begin_ns), default=story.moments[-1].t_ns)
        silent = [m for m in story.moments if last_ns + nanoseconds(0.05) < m.t_ns < back_ns]
        invented += sum(a.odometry != b.odometry for a, b in pairwise(silent))
    return invented


def _find_again(after: Sequence[Moment], stop: Moment | None) -> Moment | None:
    """Return the first cycle in which it drives after the stop."""
    if stop is None:
        return None
    return next((m for m in after if m.t_ns > stop.t_ns and m.mode == "running"), None)


def _measure_estimate(
    row: Row, after: Sequence[Moment], again: Moment | None, *, has_stopped: bool, is_lasting: bool
) -> None:
    """Fill in errors and NEES: when it drives again, else over all that was driven since the fault."""
    at = again or after[-1]
    error = at.error
    row.error_m = round(float(np.hypot(error[0], error[1])), 4)
    row.error_deg = round(math.degrees(error[2]), 2)
    row.nees_again = round(at.nees, 2)
    row.sigma_m = round(math.sqrt(max(at.covariance[0] + at.covariance[3], 0.0)), 4)
    row.sigma_deg = round(math.degrees(math.sqrt(max(at.covariance[5], 0.0))), 3)
    begin_ns = again.t_ns if again is not None else after[0].t_ns
    end_ns = begin_ns + nanoseconds(WATCHED_S) if again is not None else after[-1].t_ns
    watched = [m for m in after if begin_ns <= m.t_ns <= end_ns and m.mode in DRIVING]
    if has_stopped and again is None:
        watched = []
    elif is_lasting and again is not None:
        watched = [b for a, b in pairwise(after) if a.mode == "safe_stop" and b.mode == "running"]
    row.nees_later = round(max((m.nees for m in watched), default=0.0), 2) if watched else None


def _tell(stop: Moment | None, again: Moment | None, end: str) -> str:
    if stop is None:
        return f"drives on ({end})"
    if again is None:
        return f"stays stopped ({end})"
    return f"resumed after {seconds(again.t_ns - stop.t_ns):.2f} s ({end})"


def _judge_bars(case: Case, row: Row, *, has_stopped: bool) -> None:
    if row.invented:
        row.failures.append(f"{row.invented} invented")
    if case.duty is Duty.PHYSICS:
        return
    if case.duty is Duty.STOP and row.detectable_s is not None:
        if not has_stopped:
            row.failures.append("not stopped")
        elif row.zero_ms is not None and row.zero_ms > ZERO_BAR_MS:
            row.failures.append(f"zero setpoints after {row.zero_ms:.0f} ms")
    if case.duty is Duty.NOTICE:
        _judge_notice(case, row)
    is_noticed = has_stopped and not any("notice" in failure for failure in row.failures)
    is_lasting = case.duration_s == FOR_EVER_S
    is_watched = row.stop_s is not None or case.duty is not Duty.NOTICE or row.detectable_s is None
    if is_watched and row.nees_later is not None and row.nees_later > NEES_BAR:
        what = "drives again" if has_stopped else "drives on"
        row.failures.append(f"{what} with NEES {row.nees_later:.0f}")
    elif is_noticed and is_lasting and row.detectable_s is not None and row.outcome.startswith("drives on"):
        row.failures.append("drives on")


def _judge_notice(case: Case, row: Row) -> None:
    if row.stop_s is None and row.detectable_s is not None:
        row.failures.append(f"not noticed in {row.driven_m:.2f} m")
    elif row.stop_s is not None and row.detectable_s is not None:
        late_s = row.stop_s - row.detectable_s
        if late_s > NOTICE_BAR_S and row.driven_m * late_s / row.stop_s > NOTICE_BAR_M:
            row.failures.append(f"noticed late: {late_s:.1f} s, {row.driven_m:.2f} m")
    if row.stop_s is not None and not any(name in row.message.lower() for name in case.names):
        row.failures.append("not named")


def _record(value: object) -> dict[str, Any]:
    assert isinstance(value, dict)
    return value


def _take_estimate(story: Story, t_ns: int, value: object, device: str) -> None:
    record = _record(value)
    estimate, odometry = record["estimate"], record["odometry"]
    story.moments.append(
        Moment(
            t_ns=t_ns,
            mode=record["mode"],
            reason=record["reason"],
            estimate=(estimate["x_m"], estimate["y_m"], estimate["yaw_rad"]),
            covariance=tuple(estimate["covariance"]),
            odometry=(odometry["x_m"], odometry["y_m"], odometry["yaw_rad"]),
            suspicion=record.get("suspicion") or "",
        )
    )


def _take_command(story: Story, t_ns: int, value: object, device: str) -> None:
    story.moments[-1].is_zero = not any(_record(value)["speed_rad_s"])
    story.moments[-1].sent_ns = t_ns


def _take_truth(story: Story, t_ns: int, value: object, device: str) -> None:
    record = _record(value)
    story.truth.append((t_ns, record["x_m"], record["y_m"], record["yaw_rad"]))


def _take_samples(story: Story, t_ns: int, value: object, device: str) -> None:
    for samples in _record(value).values():
        own = [sample for sample in samples if sample["device"] == device]
        story.sample_ns += [(t_ns, sample["t_ns"]) for sample in own]
        story.rates += [(s["t_ns"], s["rate_z_rad_s"]) for s in own if "rate_z_rad_s" in s]


def _take_health(story: Story, t_ns: int, value: object, device: str) -> None:
    assert isinstance(value, list)
    for health in value:
        if health["device"] == device:
            story.rejected, story.lost = health["rejected"], health["lost"]


def _take_end(story: Story, t_ns: int, value: object, device: str) -> None:
    story.end = str(_record(value)["end"])


_TAKERS = {
    "/estimate": _take_estimate,
    "/command": _take_command,
    "/truth": _take_truth,
    "/samples": _take_samples,
    "/health": _take_health,
    "/end": _take_end,
}
