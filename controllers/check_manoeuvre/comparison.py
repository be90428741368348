"""Compares all sources after the check manoeuvre, and names the one that is wrong."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from controllers.check_manoeuvre.relation import PlaneRelation, Relation, relate, relate_places
from controllers.check_manoeuvre.tracks import PlaceTrack, RotationTrack, Tracks
from controllers.check_manoeuvre.verdict import (
    MIRRORED,
    WITH_SKIDDING_WHEELS,
    WITH_WHEELS,
    WITHOUT_WHEELS,
    Range,
    SourceCheck,
    Verdict,
    judge,
    judge_places,
)
from controllers.check_manoeuvre.words import Compared, words_of
from controllers.roles import DeviceRoles

WINDOW_S = 0.2
"""Increments of two integrated sources are compared over this time: several delays of a gyro."""
LEAST_ROTATION_RAD = math.radians(2.0)
"""Sources are not compared over less."""
LEAST_TRAVEL_M = 0.05
"""Nor over less."""


class _Pair(NamedTuple):
    """The later of two sources over the earlier one."""

    relation: Relation | None
    verdict: Verdict


def compare(tracks: Tracks, roles: DeviceRoles, *, skids: bool) -> tuple[SourceCheck, ...]:
    """Return the result for every source, wheels first.

    Rotation is compared between every two sources. Where some agree, the largest group of those decides, and
    the others are wrong. Where none agree, each is compared with the wheels, and the words name both. The
    position and the travel over the ground are compared with the wheels.

    Args:
        tracks: What the sources have measured.
        roles: Which device is what.
        skids: Whether the wheels skid in every rotation.
    """
    with_wheels = WITH_SKIDDING_WHEELS if skids else WITH_WHEELS
    rotations = _compare_rotations(tracks.rotations(), roles.wheels, with_wheels)
    is_decided = roles.wheels in confirmed_by(rotations)
    places = [
        _compare_places(track, tracks, roles.wheels, is_decided=is_decided) for track in tracks.places()
    ]
    return (*rotations, *places, *_compare_travel(tracks, roles, is_decided=is_decided))


def confirmed_by(checks: Sequence[SourceCheck]) -> frozenset[str]:
    """Return the devices of which something agrees, and nothing contradicts."""
    good = {check.device for check in checks if check.verdict is Verdict.AGREES}
    bad = {check.device for check in checks if check.verdict.is_refused or check.verdict is Verdict.SCALE}
    return frozenset(good - bad)


def _compare_rotations(tracks: Sequence[RotationTrack], wheels: str, with_wheels: Range) -> list[SourceCheck]:
    if len(tracks) == 1:
        return [_alone(wheels)]
    pairs = {
        (one, other): _rotation_pair(tracks[one], tracks[other], WITHOUT_WHEELS if one else with_wheels)
        for other in range(len(tracks))
        for one in range(other)
    }
    agreeing = [ends for ends, pair in pairs.items() if pair.verdict is Verdict.AGREES]
    group = _largest_group(len(tracks), agreeing)
    checks = []
    for number, track in enumerate(tracks):
        # Without agreement the wheels are named with each of the others.
        others = [other for other in group or [0] if other != number]
        if others:
            against = min(others, key=lambda other: pairs[_ends(number, other)].verdict is not Verdict.AGREES)
            pair = pairs[_ends(number, against)]
            checks.append(_rotation_check(track, tracks[against], pair, wheels, is_decided=bool(group)))
    return checks


def _rotation_check(
    track: RotationTrack, against: RotationTrack, pair: _Pair, wheels: str, *, is_decided: bool
) -> SourceCheck:
    driven_deg = math.degrees(min(_moved(track.angle_rad), _moved(against.angle_rad)))
    relation = pair.relation
    compared = Compared(
        device=track.device,
        quantity="rotation",
        against=against.device,
        verdict=pair.verdict,
        is_of_wheels=track.device == wheels,
        is_with_wheels=against.device == wheels,
        is_decided=is_decided,
        slope=None if relation is None else relation.slope,
        why=_why_not(min(len(track.t_s), len(against.t_s)), driven_deg, "deg"),
        unit="deg",
        driven=driven_deg,
    )
    return _check(compared, None if relation is None else relation.correlation.value)


def _ends(one: int, other: int) -> tuple[int, int]:
    return min(one, other), max(one, other)


def _rotation_pair(one: RotationTrack, other: RotationTrack, sound: Range) -> _Pair:
    relation = _relate_rotations(one, other)
    return _Pair(relation, judge(None if relation is None else relation.slope, sound))


def _relate_rotations(one: RotationTrack, other: RotationTrack) -> Relation | None:
    """Return the relation of the second to the first, which is not noisier; None without enough readings.

    Two integrated sources are compared by their increments: then the errors of each are independent.
    """
    if min(len(one.t_s), len(other.t_s)) < 2 or _moved(one.angle_rad) < LEAST_ROTATION_RAD:
        return None
    begin_s, end_s = max(one.t_s[0], other.t_s[0]), min(one.t_s[-1], other.t_s[-1])
    lag_s = max(one.lag_s, other.lag_s)
    one, other = (each._replace(angle_rad=each.late_rad(lag_s)) for each in (one, other))
    if one.is_integrated and other.is_integrated:
        edges_s = np.arange(begin_s, end_s, WINDOW_S)
        first, second = (np.diff(np.interp(edges_s, each.t_s, each.angle_rad)) for each in (one, other))
        return relate(first, second, y_sd=other.sd_rad * math.sqrt(WINDOW_S))
    inside = (other.t_s >= begin_s) & (other.t_s <= end_s)
    t_s = other.t_s[inside]
    first = np.interp(t_s, one.t_s, one.angle_rad)
    x_sd = 0.0 if one.is_integrated else one.sd_rad
    return relate(
        first, other.angle_rad[inside], x_sd=x_sd, y_sd=other.sd_rad, time_s=t_s if one.drifts else None
    )


def _largest_group(count: int, agreeing: Sequence[tuple[int, int]]) -> list[int]:
    """Return the largest set of sources that agree directly or by others; empty where none do."""
    labels = list(range(count))
    for one, other in agreeing:
        old, new = labels[other], labels[one]
        labels = [new if label == old else label for label in labels]
    groups = [[number for number in range(count) if labels[number] == label] for label in range(count)]
    largest = max(groups, key=len, default=[])
    return largest if len(largest) > 1 else []


def _compare_places(track: PlaceTrack, tracks: Tracks, wheels: str, *, is_decided: bool) -> SourceCheck:
    begin_s, end_s = tracks.span_s
    inside = (track.t_s >= begin_s) & (track.t_s <= end_s)
    relation, driven_m, axes_rad = None, 0.0, math.nan
    if inside.any():
        first_m, first_rad = tracks.by_wheels(track.t_s[inside], track.arm_m[inside])
        axes_rad = float(np.angle(np.exp(1j * (track.yaw_rad[inside] - first_rad)).mean()))
        driven_m = float(abs(first_m - first_m[0]).max())
        if driven_m >= LEAST_TRAVEL_M:
            relation = relate_places(first_m, track.place_m[inside], track.sd_m)
    verdict = judge_places(relation, axes_rad, WITH_WHEELS)
    compared = Compared(
        device=track.device,
        quantity="position",
        against=wheels,
        verdict=verdict,
        is_with_wheels=True,
        is_decided=is_decided,
        slope=None if relation is None else relation.scale,
        why=_why_not(int(inside.sum()), driven_m, "m"),
        unit="m",
        driven=driven_m,
        needed=None if relation is None else _needed_m(relation, driven_m),
    )
    return _check(compared, None)


def _needed_m(relation: PlaneRelation, driven_m: float) -> float:
    """Return how far the rover would have to drive: standard errors fall with the length of the path."""
    half = 0.5 * (relation.scale.high - relation.scale.low)
    by_axes = MIRRORED / max(abs(relation.mirrored_deviations), 0.1)
    return driven_m * max(half / WITH_WHEELS.follows, by_axes, 1.0)


def _compare_travel(tracks: Tracks, roles: DeviceRoles, *, is_decided: bool) -> list[SourceCheck]:
    rolled_m, seen_m, sd_m = tracks.ground()
    if roles.camera is None or not len(rolled_m):
        return []
    relation = relate(rolled_m, seen_m, y_sd=sd_m)
    slope = None if relation is None else relation.slope
    driven_m = float(abs(rolled_m).sum())
    compared = Compared(
        device=roles.camera,
        quantity="travel",
        against=roles.wheels,
        verdict=judge(slope, WITH_WHEELS),
        is_with_wheels=True,
        is_decided=is_decided,
        slope=slope,
        why=_why_not(len(rolled_m), driven_m, "m"),
        unit="m",
        driven=driven_m,
    )
    return [_check(compared, None if relation is None else relation.correlation.value)]


def _check(compared: Compared, correlation: float | None) -> SourceCheck:
    slope = compared.slope
    return SourceCheck(
        device=compared.device,
        quantity=compared.quantity,
        against=compared.against,
        verdict=compared.verdict,
        slope=None if slope is None else slope.value,
        slope_low=None if slope is None else slope.low,
        slope_high=None if slope is None else slope.high,
        correlation=correlation,
        text=words_of(compared),
    )


def _alone(device: str) -> SourceCheck:
    return SourceCheck(
        device=device,
        quantity="rotation",
        against="",
        verdict=Verdict.NOT_COMPARED,
        slope=None,
        slope_low=None,
        slope_high=None,
        correlation=None,
        text=f"{device}: rotation not compared: no other source measures it",
    )


def _why_not(readings: int, moved: float, unit: str) -> str:
    return f"{readings} readings over {moved:.2g} {unit} are too few"


def _moved(values: "np.typing.NDArray[np.float64]") -> float:
    return float(np.ptp(values)) if len(values) else 0.0
