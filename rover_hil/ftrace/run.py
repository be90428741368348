"""Runs the trace estimator over recorded frames."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

from controllers.ftrace.estimator import TraceAngle, TraceEstimator
from drivers.clock import nanoseconds
from drivers.errors import ConfigError
from drivers.samples import Image
from rover_hil.ftrace.frames import to_grey
from rover_hil.ftrace.inputs import FrameInputs

HEADER = "frame,t,theta_t_deg,d_t_m,confidence,detected,source,theta_sd_deg,mounting_sd_deg"


@dataclass(frozen=True, slots=True)
class FrameAngle:
    """A frame's number, time in s, grey pixels, and the estimate."""

    number: int
    t_s: float
    grey: Image
    angle: TraceAngle


def estimate(inputs: FrameInputs, estimator: TraceEstimator) -> Iterator[FrameAngle]:
    """Yield the estimate of each frame.

    Raises:
        ConfigError: A frame has another size than the rig's, no row in the telemetry, or an earlier time.
    """
    before = -float("inf")
    for frame in inputs.source:
        row = inputs.row(frame.number)
        if row.t_s <= before:
            raise ConfigError(
                f"time goes backwards: frame {frame.number} at {row.t_s:g} s follows one at {before:g} s"
            )
        before = row.t_s
        grey = to_grey(frame, inputs.rig.image.width, inputs.rig.image.height)
        angle = estimator.step(
            nanoseconds(row.t_s), grey, wheel_speed_m_s=row.wheel_speed_m_s, rates_rad_s=row.rates_rad_s
        )
        yield FrameAngle(frame.number, row.t_s, grey, angle)


def csv_row(item: FrameAngle) -> str:
    """Return a line of the output; angles in degrees, `nan` where unknown."""
    angle = item.angle
    distance = float("nan") if angle.distance_m is None else angle.distance_m
    measured = f"{angle.theta_deg:.4f},{distance:.5f},{angle.confidence:.4f},{int(angle.detected)}"
    sds_deg = (_degrees(angle.theta_sd_rad), _degrees(angle.mounting_sd_rad))
    return f"{item.number},{item.t_s:.6f},{measured},{angle.source},{sds_deg[0]:.4f},{sds_deg[1]:.4f}"


def _degrees(angle_rad: float | None) -> float:
    return float("nan") if angle_rad is None else math.degrees(angle_rad)


def longest_gap(is_detected: list[bool]) -> int:
    """Return the longest run of frames without a trace, after the first and before the last with one."""
    places = [place for place, is_found in enumerate(is_detected) if is_found]
    return max((after - before - 1 for before, after in pairwise(places)), default=0)
