"""What a run came to, in words."""

import math
from dataclasses import dataclass
from enum import StrEnum
from statistics import fmean

from controllers.safety import Mode
from drivers.driver import DeviceState
from rover_hil.report.drift_summary import CrabSummary, DriftSummary
from rover_hil.report.ground_summary import GroundSummary
from rover_hil.report.run_data import RunData
from rover_hil.report.summary import SlipSummary, Summary, TrackError
from rover_hil.run.executive import End

NAMED_BELOW = 0.5
"""Below this valid share of the distance the most frequent cause stands beside the slip; chosen by hand."""


class Grade(StrEnum):
    """How a run went, at a glance."""

    GOOD = "good"
    ATTENTION = "attention"
    BAD = "bad"
    NEUTRAL = "neutral"


@dataclass(frozen=True, slots=True)
class Fact:
    """One number that matters, with what belongs to it."""

    name: str
    value: str
    detail: str


def grade(summary: Summary) -> Grade:
    """Return how a run went: the mission's end first, then what disturbed it.

    NEUTRAL is a drive that was only observed: there was nothing to achieve.
    """
    if summary.end in (End.EMERGENCY_STOP, End.DEVICE_FAILED) or _is_abandoned(summary):
        return Grade.BAD
    is_disturbed = bool(summary.stops or summary.watchdog_interventions or not summary.is_complete)
    if is_disturbed or summary.end in (End.TIME_OVER, End.STOPPED_BY_USER, End.TERMINATED):
        return Grade.ATTENTION
    return Grade.NEUTRAL if summary.mode is Mode.OBSERVING else Grade.GOOD


def tag(summary: Summary) -> str:
    """Return how the run ended in one or two words."""
    if not summary.is_complete:
        return "log cut off"
    if _is_abandoned(summary):
        return "ended without a word"
    return summary.end or "only observed"


def verdict(run: RunData, summary: Summary) -> str:
    """Return what was driven, how it ended, and how far estimate and encoders are off the truth."""
    return f"{_what(run)}{_how_it_ended(summary, run.cut_off_by)} {_how_far_off(summary)}"


def facts(summary: Summary) -> list[Fact]:
    """Return the numbers that matter most."""
    told = [
        Fact(name, length(error.position_final_m), _error_detail(error))
        for name, error in (
            ("estimate off by", summary.estimate_error),
            ("encoders off by", summary.encoders_error),
        )
        if error is not None
    ]
    wheel_slips = [slip for slip in summary.wheel_slip if slip is not None]
    if wheel_slips:
        each = " / ".join(f"{100.0 * slip:.1f}" for slip in wheel_slips)
        told.append(Fact("slip", percent(fmean(wheel_slips)), f"by wheel {each} %"))
    elif summary.slip_ratio is not None:
        told.append(Fact("slip", percent(summary.slip_ratio), "of the wheels' distance, as driven"))
    told += _compensation_facts(summary)
    if summary.cross_track_rms_m is not None and summary.cross_track_max_m is not None:
        greatest = length(summary.cross_track_max_m)
        told.append(
            Fact(
                "off the path",
                length(summary.cross_track_rms_m),
                f"rms by its own estimate, at most {greatest}",
            )
        )
    if summary.work is not None:
        work = f"99 % took less than {time_text(summary.work.p99_us)}"
        told.append(Fact("skipped cycles", f"{summary.skipped} of {summary.cycles}", work))
    for name, count in summary.uncompared_measurements.items():
        told.append(Fact(name, str(count), "measurements that could not be compared with the estimate"))
    told += _doubt_facts(summary)
    if summary.mode is not Mode.OBSERVING:
        stopped_s = sum(stop.end_s - stop.start_s for stop in summary.stops)
        detail = f"{stopped_s:.1f} s in all" if summary.stops else ""
        told.append(Fact("safety stops", str(len(summary.stops)), detail))
    return told


def _doubt_facts(summary: Summary) -> list[Fact]:
    told = []
    if summary.odometry_rebases:
        lost = "times the motion of the wheels was lost for a while; the estimate is wider"
        told.append(Fact("odometry anew", str(summary.odometry_rebases), lost))
    told += [
        Fact("device lost", each.device, "it sent nothing at the end of the run")
        for each in summary.devices
        if each.state in (DeviceState.DEGRADED, DeviceState.FAILED)
    ]
    told += [
        Fact("may be wrong", f"from {each.start_s:.1f} s", f"{each.text}; in {each.cycles} cycles")
        for each in summary.suspicions
    ]
    told += [
        Fact(
            "finding",
            "whole drive" if each.t_s is None else f"at {each.t_s:.1f} s",
            each.text if each.count == 1 else f"{each.text}; {each.count} times",
        )
        for each in summary.findings
    ]
    told.append(Fact("ground", summary.assumed.partition(":")[0], summary.assumed.partition(": ")[2]))
    if summary.yaw_unwatched:
        told.append(Fact("yaw", "unwatched", summary.yaw_unwatched.removeprefix("yaw unwatched: ")))
    return told


def _slip_facts(slip: SlipSummary) -> list[Fact]:
    slips, valid = (
        [each for each in values if each is not None] for values in (slip.wheel_slip, slip.valid_share)
    )
    if not slips:
        return []
    share = fmean(valid)
    detail = f"by {slip.map}, valid for {percent(share)} of the distance"
    if share < NAMED_BELOW and slip.invalid_cycles:
        detail += f"; mostly: {next(iter(slip.invalid_cycles))}"
    return [Fact("estimated slip", percent(fmean(slips)), detail)]


def _compensation_facts(summary: Summary) -> list[Fact]:
    facts: list[Fact] = []
    if summary.slip is not None:
        facts += _slip_facts(summary.slip)
    if summary.ground is not None:
        facts += _ground_facts(summary.ground)
    if summary.drift is not None:
        facts += _drift_facts(summary.drift)
    if summary.compensation is not None:
        moved = summary.compensation
        facts.append(Fact("path changed by compensation", length(moved.moved_m), moved.words))
    if summary.crab is not None:
        facts.append(_crab_fact(summary.crab))
    return facts


def _ground_facts(ground: GroundSummary) -> list[Fact]:
    detail = f"by the camera, in {percent(ground.valid_share)} of the cycles"
    if ground.invalid_share:
        detail += f"; else: {next(iter(ground.invalid_share))}"
    if ground.unconfirmed:
        detail += f"; {ground.unconfirmed}"
    if ground.slip is None or ground.slip_sd is None:
        return [Fact("measured slip", "none", detail)]
    return [Fact("measured slip", f"{percent(ground.slip)} ± {percent(ground.slip_sd)}", detail)]


def _drift_facts(drift: DriftSummary) -> list[Fact]:
    if drift.slip is None:
        return []
    detail = f"slip angle up to {drift.greatest_slip_angle_deg:.1f}°, {drift.traces} traces"
    return [Fact("estimated slip", percent(drift.slip), detail)]


def _crab_fact(crab: CrabSummary) -> Fact:
    by = ", ".join(f"{source} {percent(share)}" for source, share in crab.source_share.items())
    return Fact(
        "wheels turned by up to", f"{crab.greatest_steering_deg:.1f}°", f"against the slip angle by {by}"
    )


def length(length_m: float) -> str:
    """Return a length as text: millimetres below one metre."""
    if abs(length_m) >= 1.0:
        return f"{length_m:.2f} m"
    return f"{1e3 * length_m:.0f} mm" if abs(length_m) >= 0.01 else f"{1e3 * length_m:.1f} mm"


def percent(share: float) -> str:
    """Return a share as a percentage."""
    return f"{100.0 * share:.1f} %"


def time_text(time_us: float) -> str:
    """Return a time in the unit that keeps it short."""
    return f"{time_us:.0f} µs" if time_us < 1000.0 else f"{time_us / 1e3:.1f} ms"


def _what(run: RunData) -> str:
    mission = run.config.mission
    driven = "A drive that was only observed" if mission is None else mission.title
    rovers = {"virtual": " on the simulated rover", "real": " on the rover"}
    return driven + rovers.get(run.origin, f", {run.origin}")


def _how_it_ended(summary: Summary, cut_off_by: str) -> str:
    time = f"{summary.duration_s:.1f} s"
    if not summary.is_complete:
        cause = cut_off_by or "the program was killed or the disk was full"
        return f": the log was cut off after {time}, {cause}."
    if _is_abandoned(summary):
        return f": the program ended after {time} without saying why."
    if summary.end is None:
        return f": {time} long."
    stops = len(summary.stops)
    stopped = {0: "", 1: " and one safety stop"}.get(stops, f" and {stops} safety stops")
    particulars = summary.reason.removeprefix("time is over; ")
    why = "" if summary.end in (End.FINISHED, End.STOPPED_BY_USER) else f" ({particulars})"
    return f": {summary.end} after {time}{stopped}{why}."


def _how_far_off(summary: Summary) -> str:
    estimate, encoders = summary.estimate_error, summary.encoders_error
    if estimate is None or encoders is None or summary.distance_truth_m is None:
        return (
            "The true pose was not recorded, so the error of the estimate is unknown; the wheels turned for "
            f"{length(summary.distance_encoders_m)}."
        )
    return (
        f"Of {length(summary.distance_truth_m)} driven, the estimate is {_off(estimate)} off the truth at "
        f"the end and the encoders alone {_off(encoders)}."
    )


def _off(error: TrackError) -> str:
    share = error.position_final_share
    return length(error.position_final_m) + ("" if share is None else f" ({percent(share)})")


def _error_detail(error: TrackError) -> str:
    rms = f"rms {length(error.position_rms_m)}"
    if error.yaw_final_rad is None:
        return f"{rms}, after alignment: the ground truth has no yaw"
    return f"{rms}, yaw {math.degrees(error.yaw_final_rad):+.1f}°"


def _is_abandoned(summary: Summary) -> bool:
    return summary.is_complete and summary.end is None and summary.origin in ("virtual", "real")
