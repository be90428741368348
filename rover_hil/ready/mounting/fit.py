"""Mounting, scale and bias of an inertial sensor from known turns between rests.

A rover that turns about its own z axis turns its sensor about the same axis, whatever the ground: the
integral of the three rates over a turn is that axis, times the angle. The accelerations at rest, which point
up, only confirm it: ground is rarely level.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from drivers.errors import LogError
from rover_hil.drives.arrays import Array
from rover_hil.ready.mounting.parameters import MOUNTING_FIT
from rover_hil.ready.mounting.record import InertialTurns

COUNTED = "counted turns"
"""Measured by the user, who may have exchanged the two senses."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """A turn between two rests.

    Attributes:
        start_s: Its beginning.
        end_s: Its end.
        angle_rad: Integral of the rates without bias, about the axes of the sensor, (3,).
    """

    start_s: float
    end_s: float
    angle_rad: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class MountingFit:
    """What came out.

    Attributes:
        turns: The turns.
        known_rad: What is known of each, counter-clockwise positive, (n,).
        reference: What measured them, in words.
        up: The rover's z axis in the axes of the sensor, (3,).
        gravity: Direction of the acceleration at rest there, (3,); NaN without accelerations.
        roll_deg, pitch_deg: Of the mounting.
        tilt_sd_deg: Scatter of the axis from turn to turn, 0 for one turn.
        scale: True yaw rate over the reading.
        scale_sd: Its standard deviation.
        bias_deg_s: Reading at rest about the rover's z axis, after scaling, mean over the rests.
        bias_sd_deg_s: Scatter of the bias from rest to rest.
        problem: Why the result must not be used; empty where it may.
    """

    turns: tuple[Turn, ...]
    known_rad: Array
    reference: str
    up: Array
    gravity: Array
    roll_deg: float
    pitch_deg: float
    tilt_sd_deg: float
    scale: float
    scale_sd: float
    bias_deg_s: float
    bias_sd_deg_s: float
    problem: str


@dataclass(frozen=True, slots=True)
class _Rest:
    start_s: float
    end_s: float
    bias_rad_s: Array

    @property
    def middle_s(self) -> float:
        return 0.5 * (self.start_s + self.end_s)


def find_turns(record: InertialTurns) -> tuple[tuple[Turn, ...], Array]:
    """Return the turns between rests, and the bias at each rest in rad/s, (k, 3).

    Raises:
        LogError: The log does not begin or end with a rest, or holds no turn.
    """
    rests = _rests(record)
    if len(rests) < 2:
        raise LogError(
            f"log {record.path}: '{record.device}' was not at rest before and after a turn: rest for two "
            "seconds before, between and after the turns"
        )
    rates = record.rate_rad_s
    middles = np.array([rest.middle_s for rest in rests])
    biases = np.array([rest.bias_rad_s for rest in rests])
    bias = np.column_stack([np.interp(record.t_s, middles, biases[:, axis]) for axis in range(3)])
    turns = []
    for before, after in pairwise(rests):
        inside = (record.t_s >= before.end_s) & (record.t_s <= after.start_s)
        t_s = record.t_s[inside]
        if len(t_s) < 2:
            continue
        angle = np.trapezoid((rates - bias)[inside], t_s, axis=0)
        if np.linalg.norm(angle) >= MOUNTING_FIT.least_turn_rad:
            turns.append(Turn(start_s=before.end_s, end_s=after.start_s, angle_rad=angle))
    if not turns:
        raise LogError(
            f"log {record.path}: '{record.device}' made no half turn between two rests: turn further"
        )
    return tuple(turns), biases


def turns_by(record: InertialTurns, turns: Sequence[Turn], reference: str) -> Array:
    """Return each turn in rad by another device, (n,): its mean yaw in the rest after, less that before.

    Args:
        record: The log.
        turns: The turns.
        reference: Name in `record.references`.
    """
    t_s, yaw_rad = record.references[reference]
    ends = [*(turn.start_s for turn in turns[1:]), math.inf]
    begins = [-math.inf, *(turn.end_s for turn in turns[:-1])]

    def mean(start_s: float, end_s: float) -> float:
        inside = (t_s >= start_s) & (t_s <= end_s)
        return float(yaw_rad[inside].mean()) if inside.any() else math.nan

    return np.array(
        [
            mean(turn.end_s, end_s) - mean(begin_s, turn.start_s)
            for turn, begin_s, end_s in zip(turns, begins, ends, strict=True)
        ]
    )


def fit_mounting(
    record: InertialTurns,
    turns: Sequence[Turn],
    biases: Array,
    known_rad: Array,
    reference: str,
    sd_rad: float,
) -> MountingFit:
    """Return mounting, scale and bias.

    Args:
        record: The log.
        turns: Its turns.
        biases: Bias at each rest, (k, 3).
        known_rad: What is known of each turn, counter-clockwise positive, (n,).
        reference: What measured them, in words.
        sd_rad: Standard deviation of what is known.
    """
    angles = np.array([turn.angle_rad for turn in turns])
    signed = angles * np.sign(known_rad)[:, None]
    up = signed.sum(axis=0)
    up = up / np.linalg.norm(up)
    axes = signed / np.linalg.norm(signed, axis=1)[:, None]
    off_deg = np.degrees(np.arccos(np.clip(axes @ up, -1.0, 1.0)))
    along = angles @ up
    weight = float(along @ along)
    scale = float(known_rad @ along) / weight
    unexplained = known_rad - scale * along
    scatter_rad = math.sqrt(float(unexplained @ unexplained) / max(1, len(turns) - 1))
    scale_sd = max(sd_rad, scatter_rad) / math.sqrt(weight)
    gravity = _gravity(record, turns)
    roll, pitch = _levelling(up)
    rest_deg_s = np.degrees(scale * biases @ up)
    return MountingFit(
        turns=tuple(turns),
        known_rad=known_rad,
        reference=reference,
        up=up,
        gravity=gravity,
        roll_deg=math.degrees(roll),
        pitch_deg=math.degrees(pitch),
        tilt_sd_deg=float(np.sqrt(np.mean(off_deg**2))),
        scale=scale,
        scale_sd=scale_sd,
        bias_deg_s=float(rest_deg_s.mean()),
        bias_sd_deg_s=float(rest_deg_s.std()),
        problem=_problem(scale, scale_sd, off_deg, unexplained, up, gravity)
        or (_sense_problem(record, up, gravity) if reference == COUNTED else ""),
    )


def _sense_problem(record: InertialTurns, up: Array, gravity: Array) -> str:
    """Return why turns that were counted in the wrong sense would pass for a sensor upside down."""
    if np.isfinite(gravity).all() or up @ record.expected_up >= MOUNTING_FIT.least_expected_share:
        return ""
    return (
        "the sensor is mounted in another way than the configuration says, or the turns were counted in the "
        "wrong sense: let the sensor send accelerations, which show which, or enter the rough mounting first"
    )


def _problem(
    scale: float, scale_sd: float, off_deg: Array, unexplained: Array, up: Array, gravity: Array
) -> str:
    if off_deg.max() > MOUNTING_FIT.greatest_axis_deg:
        return (
            f"the axis of the turns differs by {off_deg.max():.1f} deg from turn to turn: turn the rover on "
            "the ground, without lifting it"
        )
    if np.isfinite(gravity).all():
        tilt_deg = math.degrees(math.acos(float(np.clip(up @ gravity, -1.0, 1.0))))
        if tilt_deg > 180.0 - MOUNTING_FIT.greatest_gravity_deg:
            return "the accelerations say that the turns have the other sense: counter-clockwise is positive"
        if tilt_deg > MOUNTING_FIT.greatest_gravity_deg:
            return f"the ground slopes by {tilt_deg:.0f} deg, or the sensor moved: turn on level ground"
    if not MOUNTING_FIT.least_scale <= scale <= MOUNTING_FIT.greatest_scale:
        return f"the gyro would be wrong by a factor of {1.0 / scale:.3g}: were all turns counted?"
    residual_deg = math.degrees(float(np.abs(unexplained).max()))
    if residual_deg > MOUNTING_FIT.greatest_residual_deg:
        return f"the turns contradict each other by {residual_deg:.0f} deg: count again, turn slower"
    if scale_sd > MOUNTING_FIT.greatest_scale_sd:
        return f"the scale is uncertain by {100 * scale_sd:.1f} %: make more turns"
    return ""


def _levelling(up: Array) -> tuple[float, float]:
    """Return roll and pitch that turn a direction of the sensor to z."""
    x, y, z = up.tolist()
    return math.atan2(y, z), math.atan2(-x, math.hypot(y, z))


def _gravity(record: InertialTurns, turns: Sequence[Turn]) -> Array:
    """Return the direction of the acceleration before, between and after the turns; NaN without any."""
    t_s = record.acceleration_t_s
    at_rest = np.ones(len(t_s), np.bool_)
    for turn in turns:
        at_rest &= (t_s < turn.start_s) | (t_s > turn.end_s)
    if not at_rest.any():
        return np.full(3, np.nan)
    mean = record.acceleration_m_s2[at_rest].mean(axis=0)
    direction: Array = mean / np.linalg.norm(mean)
    return direction


def _rests(record: InertialTurns) -> list[_Rest]:
    """Return the rests: blocks that are as quiet as the quietest one, joined."""
    rates = record.rate_rad_s
    block = np.floor((record.t_s - record.t_s[0]) / MOUNTING_FIT.block_s).astype(np.int64)
    numbers, first = np.unique(block, return_index=True)
    parts = np.split(np.arange(len(block)), first[1:])
    means = np.array([rates[part].mean(axis=0) for part in parts])
    scatters = np.array([np.linalg.norm(rates[part].std(axis=0)) for part in parts])
    whole = np.array([len(part) >= 3 for part in parts])
    if not whole.any():
        return []
    quietest = int(np.argmin(np.where(whole, np.linalg.norm(means, axis=1) + scatters, np.inf)))
    is_rest = (
        whole
        & (np.linalg.norm(means - means[quietest], axis=1) < MOUNTING_FIT.rest_rad_s)
        & (scatters <= MOUNTING_FIT.rest_scatter * scatters[quietest] + 1e-4)
    )
    rests = []
    start = None
    for place in range(len(numbers) + 1):
        if place < len(numbers) and is_rest[place]:
            start = place if start is None else start
            continue
        if start is not None:
            inside = np.concatenate(parts[start:place])
            begin_s, end_s = float(record.t_s[inside[0]]), float(record.t_s[inside[-1]])
            if end_s - begin_s >= MOUNTING_FIT.least_rest_s - MOUNTING_FIT.block_s / 2:
                rests.append(_Rest(begin_s, end_s, rates[inside].mean(axis=0)))
        start = None
    return rests
