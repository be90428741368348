"""The numbers of a run: how it ended, and how far estimate and encoders are off the truth."""

import math
import re
from collections import Counter
from dataclasses import dataclass

import numpy as np

from controllers.motion.limits import Limit
from controllers.motion.planar import wrap_angle
from controllers.safety import Mode
from controllers.unwatched_yaw import find_unwatched_yaw
from drivers.driver import Health
from rover_hil.drives.arrays import Array, rms, wrap_angles
from rover_hil.recording.findings import FoundFinding
from rover_hil.recording.schema import OddityRecord, SourceCheckRecord
from rover_hil.report.compensation import Compensation, compensation_of
from rover_hil.report.drift_summary import CrabSummary, DriftSummary, summarise_crab, summarise_drift
from rover_hil.report.ground_summary import GroundSummary, summarise_ground
from rover_hil.report.run_data import Cycles, RunData, WheelData
from rover_hil.report.tracks import Series, Track, running_mean, slip_over_time, spans

LEAST_DISTANCE_M = 0.05
_NUMBER = re.compile(r"-?\d+(\.\d+)?(e[-+]?\d+)?")
STOP_MODES = (Mode.SAFE_STOP, Mode.EMERGENCY_STOP)


@dataclass(frozen=True, slots=True, kw_only=True)
class FinalPose:
    """Where the rover was at the end, in the local frame: m, m, rad within [-pi, pi); None without a yaw."""

    x_m: float
    y_m: float
    yaw_rad: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackError:
    """Distance of a track from the ground truth; the final values are those of the last time that both have.

    Ground truth without yaw is turned and moved to fit the estimate best: the errors are those after it.

    Attributes:
        position_final_m: Distance from the truth at the end.
        position_rms_m: Root mean square of that distance over the run.
        position_max_m: The greatest.
        position_final_share: Final distance as a share of the true distance driven; None when that is
            less than 0.05 m.
        yaw_final_rad: Yaw minus the true yaw at the end, within [-pi, pi); None where no true yaw is known.
        yaw_rms_rad: Root mean square of that difference over the run.
    """

    position_final_m: float
    position_rms_m: float
    position_max_m: float
    position_final_share: float | None
    yaw_final_rad: float | None
    yaw_rms_rad: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """How a time spreads over the cycles, in microseconds."""

    p50_us: float
    p99_us: float
    max_us: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Stop:
    """A safety stop: begin and end in s since the start of the run, and its reasons in their order."""

    start_s: float
    end_s: float
    mode: Mode
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class SlipSummary:
    """Estimates of slip compensation. Means over a wheel are over the angle it turned; None where it did not.

    Attributes:
        map: Name of the map in use.
        wheel_slip: Mean of each wheel.
        error_rms: Root mean square of estimated minus true slip of each wheel, both averaged over half a
            second; None also without the truth.
        valid_share: Share of the angle turned for which the slip was valid.
        surface_share: Share of the cycles in which each surface was recognised; "unknown" is the rest.
        invalid_cycles: In how many cycles a wheel was not valid, by reason, numbers in it left out.
    """

    map: str
    wheel_slip: tuple[float | None, ...]
    error_rms: tuple[float | None, ...]
    valid_share: tuple[float | None, ...]
    surface_share: dict[str, float]
    invalid_cycles: dict[str, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Suspicion:
    """What may have been wrong although it stopped nothing.

    Attributes:
        text: In its own words, when it came up first.
        start_s: When that was.
        cycles: In how many cycles it was there, whatever the numbers in its words.
    """

    text: str
    start_s: float
    cycles: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """What a run came to. None is for what its log does not hold.

    Attributes:
        log: Path of the log.
        origin: What made the log: "virtual", "real", or what was imported.
        is_complete: False when the log was cut off.
        end: Why the run ended; None when the log was cut off or imported.
        reason: The same with its particulars; why the watchdog ended it, where it did.
        mode: What the rover was doing at the end.
        cycles: How many cycles the log holds.
        skipped: Cycles left out because an earlier one took too long.
        watchdog_interventions: How often the watchdog stopped a hanging loop.
        duration_s: Length of the run.
        final_estimate, final_encoders, final_truth: Poses at the end.
        distance_encoders_m: Distance by the wheels.
        distance_truth_m: True distance.
        estimate_error, encoders_error: Distance from the truth.
        slip_ratio: 1 - true distance / encoder distance; None when the latter is less than 0.05 m.
        wheel_slip: True slip ratio of each wheel, its mean over the angle turned; None where it is not known.
        slip: Estimates of slip compensation; None without it.
        drift: Estimates of compensation by trace and tilt; None without it.
        compensation: What slip compensation has changed, and its cost; None without it.
        crab: Steering against the slip angle; None where the rover did not crab.
        ground: Slip that a camera measured over the ground; None without one.
        cross_track_rms_m, cross_track_max_m: Distance of the estimate from the path while driving.
        lateness: How late cycles began; None for imported logs.
        work: How long they took; None likewise.
        limited_cycles: In how many cycles which limit held the setpoints back.
        refused_innovations: How many measurements were refused by the filter, by name.
        odometry_rebases: How often the odometry lost its base, together with the motion in between.
        uncompared_measurements: How many could not be compared with the estimate, by name: fixes that came
            too late, numbers that are not finite.
        stops: Safety stops.
        suspicions: What was suspected and stopped nothing, the most frequent first.
        findings: What the rules found wrong with a drive that somebody else controlled.
        oddities: Data-quality findings of a recorded drive, and what was done about each.
        checks: What the check manoeuvre showed about each source; empty where it was not driven.
        assumed: What was assumed about slip that nothing measures.
        yaw_unwatched: That nothing would have noticed a wrong yaw, and what would; else empty.
        devices: Health facts at the end of the run.
    """

    log: str
    origin: str
    is_complete: bool
    end: str | None
    reason: str
    mode: Mode
    cycles: int
    skipped: int
    watchdog_interventions: int
    duration_s: float
    final_estimate: FinalPose
    final_encoders: FinalPose
    final_truth: FinalPose | None
    distance_encoders_m: float
    distance_truth_m: float | None
    estimate_error: TrackError | None
    encoders_error: TrackError | None
    slip_ratio: float | None
    wheel_slip: tuple[float | None, ...]
    slip: SlipSummary | None
    drift: DriftSummary | None
    compensation: Compensation | None
    crab: CrabSummary | None
    ground: GroundSummary | None
    cross_track_rms_m: float | None
    cross_track_max_m: float | None
    lateness: Spread | None
    work: Spread | None
    limited_cycles: dict[str, int]
    refused_innovations: dict[str, int]
    odometry_rebases: int
    uncompared_measurements: dict[str, int]
    stops: tuple[Stop, ...]
    suspicions: tuple[Suspicion, ...]
    findings: tuple[FoundFinding, ...]
    oddities: tuple[OddityRecord, ...]
    checks: tuple[SourceCheckRecord, ...]
    assumed: str
    yaw_unwatched: str
    devices: tuple[Health, ...]


def summarise(run: RunData) -> Summary:
    """Return the numbers of a run."""
    end, cycles, truth = run.end, run.cycles, run.truth
    encoders_m = float(run.encoders.distance_m()[-1])
    truth_m = None if truth is None else float(truth.distance_m()[-1])
    period_us = 1e6 / run.config.loop.rate_hz
    is_timed = bool(cycles.work_us.any())
    cross_track = run.computed.get("cross_track_m")
    cross_m = None if cross_track is None else np.abs(cross_track.value)
    return Summary(
        log=str(run.path),
        origin=run.origin,
        is_complete=run.is_complete,
        end=None if end is None else end["end"],
        reason=run.cut_off_by or (cycles.reason[-1] if end is None else end["reason"]),
        mode=cycles.mode[-1],
        cycles=len(cycles.late_us),
        skipped=int(np.sum(cycles.late_us // period_us)) if end is None else end["skipped"],
        watchdog_interventions=len(run.watchdog_s),
        duration_s=run.duration_s,
        final_estimate=_final_pose(run.estimate),
        final_encoders=_final_pose(run.encoders),
        final_truth=None if truth is None else _final_pose(truth),
        distance_encoders_m=encoders_m,
        distance_truth_m=truth_m,
        estimate_error=_track_error(run.estimate, truth, truth_m),
        encoders_error=_track_error(run.encoders, truth, truth_m),
        slip_ratio=_slip_ratio(run),
        wheel_slip=tuple(_mean_slip(wheel.slip, wheel.true_speed) for wheel in run.wheels),
        slip=_slip_summary(run),
        drift=summarise_drift(run.drift),
        compensation=compensation_of(run),
        crab=summarise_crab(run.crab, truth),
        ground=summarise_ground(run.ground, None if truth is None else slip_over_time(run.encoders, truth)),
        cross_track_rms_m=None if cross_m is None else rms(cross_m),
        cross_track_max_m=None if cross_m is None else float(cross_m.max()),
        lateness=_spread(cycles.late_us) if is_timed else None,
        work=_spread(cycles.work_us) if is_timed else None,
        limited_cycles=dict(Counter(limit.value for limit in cycles.limit if limit is not Limit.NONE)),
        refused_innovations={
            str(measured): int(np.sum(data.is_accepted == 0)) for measured, data in run.innovations.items()
        },
        odometry_rebases=run.odometry_rebases,
        uncompared_measurements=dict(run.uncompared),
        stops=_stops(run),
        suspicions=_suspicions(cycles),
        findings=tuple(cycles.findings),
        oddities=tuple(run.oddities),
        checks=tuple(run.checks),
        assumed=run.config.ground.words,
        yaw_unwatched=str(find_unwatched_yaw(run.config, run.config.device_roles()) or ""),
        devices=tuple(run.health),
    )


def position_error_m(track: Track, truth: Track) -> Series:
    """Return the distance from the truth wherever both are known."""
    true = truth.at(track.t_s)
    return _known(track.t_s, np.hypot(track.x_m - true.x_m, track.y_m - true.y_m))


def _known(t_s: Array, value: Array) -> Series:
    known = np.isfinite(value)
    return Series(t_s[known], value[known])


def _track_error(track: Track, truth: Track | None, distance_m: float | None) -> TrackError | None:
    if truth is None or distance_m is None:
        return None
    position_m = position_error_m(track, truth).value
    yaw_rad = _known(track.t_s, wrap_angles(track.yaw_rad - truth.at(track.t_s).yaw_rad)).value
    if len(position_m) == 0:
        return None
    final_m = float(position_m[-1])
    return TrackError(
        position_final_m=final_m,
        position_rms_m=rms(position_m),
        position_max_m=float(position_m.max()),
        position_final_share=None if distance_m < LEAST_DISTANCE_M else final_m / distance_m,
        yaw_final_rad=float(yaw_rad[-1]) if len(yaw_rad) else None,
        yaw_rms_rad=rms(yaw_rad) if len(yaw_rad) else None,
    )


def _final_pose(track: Track) -> FinalPose:
    yaw_rad = float(track.yaw_rad[-1])
    return FinalPose(
        x_m=float(track.x_m[-1]),
        y_m=float(track.y_m[-1]),
        yaw_rad=wrap_angle(yaw_rad) if math.isfinite(yaw_rad) else None,
    )


def _slip_ratio(run: RunData) -> float | None:
    encoders, truth = run.encoders, run.truth
    encoders_m = float(encoders.distance_m()[-1])
    if truth is None or encoders_m < LEAST_DISTANCE_M:
        return None
    # Up to the same time: the newest wheel positions are older than the newest truth.
    return 1.0 - float(np.interp(encoders.t_s[-1], truth.t_s, truth.distance_m())) / encoders_m


def _mean_slip(slip: Series | None, true_speed: Series | None) -> float | None:
    if slip is None or true_speed is None:
        return None
    weight = np.abs(np.interp(slip.t_s, true_speed.t_s, true_speed.value))
    return float(np.average(slip.value, weights=weight)) if weight.any() else None


def _slip_summary(run: RunData) -> SlipSummary | None:
    slip = run.slip
    if slip is None:
        return None
    reasons = [set(cycle) - {""} for cycle in zip(*(wheel.reasons for wheel in slip.wheels), strict=True)]
    invalid = Counter(reason for cycle in reasons for reason in {_NUMBER.sub("...", each) for each in cycle})
    surfaces = Counter(surface or "unknown" for surface in slip.surfaces)
    pairs = list(zip(slip.wheels, run.wheels, strict=True))
    return SlipSummary(
        map=slip.map,
        wheel_slip=tuple(_mean_while_turning(each.slip.value, slip.t_s, wheel) for each, wheel in pairs),
        error_rms=tuple(_slip_error_rms(each.slip, wheel) for each, wheel in pairs),
        valid_share=tuple(
            _mean_while_turning(np.array([not reason for reason in each.reasons], float), slip.t_s, wheel)
            for each, wheel in pairs
        ),
        surface_share={name: count / len(slip.t_s) for name, count in surfaces.items()},
        invalid_cycles=dict(invalid.most_common()),
    )


def _slip_error_rms(estimated: Series, wheel: WheelData) -> float | None:
    if wheel.slip is None:
        return None
    true, mean_estimate = running_mean(wheel.slip), running_mean(estimated)
    squares = (mean_estimate.value - np.interp(estimated.t_s, true.t_s, true.value)) ** 2
    mean = _mean_while_turning(squares, estimated.t_s, wheel)
    return None if mean is None else math.sqrt(mean)


def _mean_while_turning(values: Array, t_s: Array, wheel: WheelData) -> float | None:
    """Return the mean over the angle that the wheel turned, by its truth where that is known."""
    speed = wheel.true_speed or wheel.speed
    if speed is None or not np.isfinite(speed.value).any():
        return None
    known = np.isfinite(speed.value)
    weight = np.abs(np.interp(t_s, speed.t_s[known], speed.value[known]))
    return float(np.average(values, weights=weight)) if weight.any() else None


def _spread(time_us: Array) -> Spread:
    p50_us, p99_us = np.percentile(time_us, (50, 99))
    return Spread(p50_us=float(p50_us), p99_us=float(p99_us), max_us=float(time_us.max()))


def _suspicions(cycles: Cycles) -> tuple[Suspicion, ...]:
    texts = [_NUMBER.sub("...", each) for each in cycles.suspicion]
    return tuple(
        Suspicion(text=cycles.suspicion[first], start_s=float(cycles.t_s[first]), cycles=count)
        for text, count in Counter(filter(None, texts)).most_common()
        for first in (texts.index(text),)
    )


def _stops(run: RunData) -> tuple[Stop, ...]:
    cycles = run.cycles
    stops: list[Stop] = []
    for start_s, end_s, mode in spans(cycles.t_s, cycles.mode):
        if mode in STOP_MODES:
            first, after = np.searchsorted(cycles.t_s, (start_s, end_s))
            reasons = tuple(dict.fromkeys(cycles.reason[first : max(after, first + 1)]))
            stops.append(Stop(start_s=start_s, end_s=end_s, mode=Mode(mode), reasons=reasons))
    return tuple(stops)
