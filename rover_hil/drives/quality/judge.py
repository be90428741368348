"""What is wrong with a recorded drive: one cause with its evidence, and its consequences below it.

Wheels and gyro are compared with the ground truth, else with positions, else with each other. A cause that
explains the whole drive comes before what the rules found while the estimate was made: those that compare
the same sensors are its consequences.
"""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from controllers.fault import Cause
from controllers.motion.kinematics import make_kinematics
from rover_hil.config import Config
from rover_hil.drives.arrays import Array, Flags, Times
from rover_hil.drives.channels import Channels
from rover_hil.drives.drive import read_drive
from rover_hil.drives.quality.clock_check import clock_findings
from rover_hil.drives.quality.corrections import Wheels
from rover_hil.drives.quality.drive_paths import GROUND_TRUTH, POSITIONS, path_of_wheels
from rover_hil.drives.quality.motion import LEAST_MOTION, WINDOW_S, Windows, windows_of
from rover_hil.drives.quality.references import (
    LEAST_TURN_RAD,
    Fit,
    GyroReference,
    PoseReference,
    PositionReference,
    Reference,
    references_of,
)
from rover_hil.drives.quality.sampling_check import sampling_findings
from rover_hil.drives.quality.speed_check import OTHERS, speed_findings
from rover_hil.drives.quality.units import unit_of
from rover_hil.recording.findings import FoundFinding

AGREES = 0.3
"""Residual, as a share of the motion, up to which marker offsets and slip explain the difference."""
MUCH_BETTER = 0.3
"""A correction that leaves less than this share of a residual that agrees shows a fault all the same."""
BETTER = 0.6
"""A correction explains the difference if it leaves less than this share of the residual."""
UNLIKE = 0.7
"""Wheels whose motion leaves more than this share of the reference's show nothing of it."""
ALIKE = 0.1
"""Corrections whose residuals differ by less, as a share of the motion, cannot be distinguished."""
SCALES = (0.35, 1.3)
"""A common factor within these may be slip, on which wheels turn further than the rover, or the radius."""
USUAL_SCALES = (0.9, 1.03)
"""A factor of the distances within these is usual: slip makes it smaller, nothing makes it greater."""
SURE_SD = 5.0
"""Standard deviations by which a factor differs from a usual one."""
GYRO_SHARE = 0.1
TRACK_SHARE = 0.1
SIDE_SHARE = 0.06
"""Factors of a gyro, of a track and of one side that differ from 1 by less are usual."""
SAME_WAY = 0.8
"""Cosine of the angle between two steps, from which on they go the same way."""
LEAST_OPPOSITE = 2
"""Windows in each direction: a single one is noise, or the change of direction itself."""
LEAST_ASIDE_RAD = 0.5
"""Ground truth goes aside by more than a marker is set up wrong."""
STRETCH_PRICE = 0.02
"""Price of each change to and from a correction, as a share of all errors of the drive."""
STRETCHES = tuple(np.geomspace(0.3, 3.0, 13).tolist())
"""Of exchanged latitude and longitude: their degrees are not equally long."""

SIGN_OF_GYRO = "the gyro has the opposite sign"
UNSURE = "; this drive does not show which"
NAMES = {GROUND_TRUTH: "truth", POSITIONS: "positions"}
"""Names of findings by what the wheels are compared with."""
CONTRADICTIONS = frozenset(
    {
        Cause.DIFFERENT_MOTION.value,
        Cause.DISPLACED_POSITION.value,
        Cause.GYRO_APART.value,
        Cause.GYRO_BEYOND_WHEELS.value,
        Cause.GYRO_DOES_NOT_FOLLOW.value,
        Cause.GYRO_HEADING.value,
        Cause.JUMPED_POSITION.value,
        Cause.MISSED_TURN.value,
        Cause.MOTION_AT_STANDSTILL.value,
        Cause.SOURCE_CHECK.value,
        Cause.STANDING_WHEELS.value,
        Cause.TURN.value,
        Cause.UNCERTAIN_YAW.value,
        Cause.UNUSUAL_FORCE.value,
        Cause.WHEEL_REVERSED.value,
    }
)
"""What rules find where two measurements of the motion contradict each other."""


def drive_findings(path: Path) -> list[FoundFinding]:
    """Return what a log shows as a whole, see `findings_of`.

    Raises:
        LogError: The log cannot be read or is damaged.
    """
    drive = read_drive(path)
    return findings_of(drive.channels, drive.config)


def with_causes(
    causes: Sequence[FoundFinding], findings: Sequence[FoundFinding], doubts: Sequence[FoundFinding]
) -> tuple[list[FoundFinding], list[FoundFinding]]:
    """Return the findings, causes first, and the suspected faults that remain.

    What rules found because two measurements contradict each other is a consequence of the first cause.

    Args:
        causes: What the whole drive shows.
        findings: Of rules while the estimate was made.
        doubts: What they suspected.
    """
    if not causes:
        return list(findings), list(doubts)
    followers = [each for each in findings if _kind(each.name) in CONTRADICTIONS]
    causes[0].consequences.extend([*followers, *doubts])
    return [*causes, *(each for each in findings if each not in followers)], []


def _kind(name: str) -> str:
    """Return the name of a finding without its source."""
    return next(
        (each for each in CONTRADICTIONS if "{}" in each and name.endswith(each.removeprefix("{}"))), name
    )


def findings_of(rows: Channels, config: Config) -> list[FoundFinding]:
    """Return what a drive as a whole shows against its clocks, wheels, gyro and positions.

    Of the corrections that are tried (signs, exchanges, units, factors) all that explain a difference are
    named; without one that does, nothing is.

    Args:
        rows: The drive.
        config: Of its rover.
    """
    kinematics = make_kinematics(config.rover)
    path = path_of_wheels(rows, kinematics)
    clocks = list(clock_findings(rows, kinematics, path))
    findings = [*speed_findings(rows), *clocks]
    windows = windows_of(rows, kinematics)
    if windows is not None and not clocks:  # with another clock, all other differences are its consequences
        wheels = Wheels(config.rover, kinematics, windows)
        judge = _Judge(wheels, windows, config.limits.wheel_speed_rad_s)
        findings += judge.contradictions(rows)
    return [*findings, *sampling_findings(rows)]


class _Cause(NamedTuple):
    """What explains a contradiction.

    Attributes:
        text: For the user; "" for nothing.
        harm: As of a finding.
    """

    text: str
    harm: float | None = None


class _Judge:
    """Compares the wheels of a drive with what else measured its motion.

    Args:
        wheels: Of the drive.
        windows: What they measured.
        limit_rad_s: No wheel turns faster.
    """

    def __init__(self, wheels: Wheels, windows: Windows, limit_rad_s: float) -> None:
        self._wheels = wheels
        self._windows = windows
        self._moves = wheels.moves
        self._corrections = list(wheels.corrections())
        self._limit_rad_s = limit_rad_s
        self._has_signs = bool((windows.turned_rad < 0.0).any())
        gyro_rad = windows.gyro_rad
        turned_rad = np.zeros(1) if gyro_rad is None else np.column_stack((gyro_rad, self._moves[:, 2]))
        is_shown = np.abs(turned_rad).sum(axis=0).max() >= LEAST_TURN_RAD
        self._gyro = None if gyro_rad is None or not is_shown else GyroReference("gyro", gyro_rad)

    def contradictions(self, rows: Channels) -> Iterator[FoundFinding]:
        """Yield the one contradiction that decides, if there is one."""
        reference = next(references_of(rows, self._windows, self._moves[:, 2]), None)
        for name, cause in self._causes(reference):
            if cause.text:
                yield FoundFinding(name=name, t_s=None, text=cause.text, harm=cause.harm)
                return

    def _causes(self, reference: Reference | None) -> Iterator[tuple[str, _Cause]]:
        """Yield names and causes in the order in which they decide, those without a text too."""
        if reference is not None:
            yield NAMES[reference.name], self._explain(reference, self._opposite_ways(reference))
            yield "gyro", _Cause(self._gyro_fault(reference))
        yield "gyro", self._by_gyro()
        if reference is not None:
            yield NAMES[reference.name], _Cause(_unexplained(reference, self._moves), 1.0)

    def _explain(self, reference: Reference, opposite: _Cause) -> _Cause:
        """Return what is wrong with the wheels or with the places."""
        plain = reference.fit(self._moves)
        if opposite.text and not self._has_signs:
            return opposite
        fits = [(each.what, each.moves, reference.fit(each.moves)) for each in self._corrections]
        # With another factor besides there would be two faults.
        fits = [each for each in fits if _is_slip(each[-1].scale)]
        fits += _separate(self._moves, reference)
        fits += self._exchanged_places(reference)
        best = min((fit.residual for *_, fit in fits), default=math.inf)
        ratio = self._wheels.ratio(reference)
        if ratio is not None and _is_slip(ratio[1].scale) and ratio[1].residual < BETTER * best:
            fits, best = [(*ratio[0], ratio[1])], ratio[1].residual
        if plain.residual <= AGREES and best > min(MUCH_BETTER * plain.residual, plain.residual - ALIKE):
            return self._factors(reference, plain)
        if best > AGREES or best > BETTER * plain.residual:
            if text := _side(self._wheels, reference, plain):
                return _Cause(text, plain.residual)
            partly = self._partly(reference)
            return partly if partly.text else opposite
        which = [(what, moves, fit) for what, moves, fit in fits if fit.residual <= best + ALIKE]
        agreeing = [each for each in which if self._agrees_with_gyro(each[1])] or which
        text = _contradiction(
            f"wheels and {reference.name}", plain.residual, best, [what for what, *_ in agreeing]
        )
        return _Cause(text, plain.residual)

    def _opposite_ways(self, reference: Reference) -> _Cause:
        """Return that wheels and poses go opposite ways in a part of the drive."""
        if not isinstance(reference, PoseReference):
            return _Cause("")
        used = reference.is_used
        said_m = self._moves[used, 0] + 1j * self._moves[used, 1]
        true_m = reference.at_origin(self._moves).step_m[used]
        sizes_m = np.abs(said_m)
        is_moving = (sizes_m > LEAST_MOTION * sizes_m.max(initial=0.0)) & (np.abs(true_m) > 0.5 * sizes_m)
        alike = (said_m * true_m.conjugate()).real / np.maximum(sizes_m * np.abs(true_m), 1e-12)
        is_opposite, is_same = is_moving & (alike < -SAME_WAY), is_moving & (alike > SAME_WAY)
        if min(is_opposite.sum(), is_same.sum()) < LEAST_OPPOSITE:
            return _Cause("")
        cause = "the speeds have no sign"
        if self._has_signs:
            cause = "wheels or ground truth are reversed there, or the yaw of the ground truth is wrong"
        return _Cause(
            f"wheels and ground truth go opposite ways in {is_opposite.sum()} of {is_moving.sum()} s of "
            f"motion, and the same way in {is_same.sum()} s: {cause}",
            float(is_opposite.sum() / is_moving.sum()),
        )

    def _factors(self, reference: Reference, plain: Fit) -> _Cause:
        """Return a factor of wheels that otherwise agree that is not usual."""
        by = f"by the {reference.name}"
        if not _is_slip(plain.scale):
            # Rotations have the factor, too: without it they fit.
            factor = plain.scale * reference.fit(plain.scale * self._moves).scale
            what = unit_of(factor, OTHERS)
            text = f"{by} the rover moves {factor:.3g} times as far as by the wheels: {what}"
            return _Cause(text, _share_of(factor))
        sd = plain.residual / math.sqrt(max(1, int(self._windows.is_moving.sum())))
        # Positions on a circle fit any factor of one side, by another rotation and scale.
        is_shape = isinstance(reference, PositionReference)
        if not is_shape and (text := _side(self._wheels, reference, plain)):
            return _Cause(text, plain.residual)
        distance, turn, aside_rad = plain.distance_scale, plain.turn_scale, 0.0
        if isinstance(reference, PoseReference):
            origin = reference.at_origin(self._moves)
            sd *= 1.0 if origin is reference else reference.arm_growth(self._moves)
            reference = origin
            aside_rad = reference.aside_rad(self._moves) if reference.goes else 0.0
            distance, turn = distance if reference.goes else 1.0, turn if reference.turns else distance
            # A common factor is that of the radius.
            ratio = turn / distance
        else:
            ratio = turn
            by_gyro = turn if self._gyro is None else self._gyro.fit(self._moves).scale
            if turn != 1.0 and abs(by_gyro - turn) > TRACK_SHARE:
                return _Cause("")  # uneven slip bends a path, too
        if self._wheels.is_skidding:
            ratio = 1.0
        is_track = abs(ratio - 1.0) > TRACK_SHARE + SURE_SD * sd
        track = f"track or wheelbase {1.0 / ratio:.3g} times as wide"
        if isinstance(reference, PositionReference) and self._gyro is None:
            track += ", or uneven slip"
        if not USUAL_SCALES[0] - SURE_SD * sd <= distance <= USUAL_SCALES[1] + SURE_SD * sd:
            slip = "" if distance > 1.0 else f", or a slip of {1.0 - distance:.2g} throughout"
            return _Cause(
                f"{by} the rover goes {distance:.3g} times as far as by the wheels: radius, ticks_per_turn "
                f"or gear_ratio of all wheels{slip}{f'; {track}' if is_track else ''}",
                _share_of(distance),
            )
        if is_track:
            text = f"{by} the rover turns {turn:.3g} times as much as by the wheels: {track}"
            return _Cause(text, _share_of(turn))
        if abs(aside_rad) >= LEAST_ASIDE_RAD:
            return _Cause(
                f"the ground truth goes {math.degrees(aside_rad):+.0f} deg aside of where the wheels go: "
                "truth.marker.yaw_deg is not given, wheels are exchanged, or the distance is reversed"
                f"{UNSURE}",
                min(1.0, abs(aside_rad)),
            )
        return _Cause("")

    def _agrees_with_gyro(self, moves: Array) -> bool:
        if self._gyro is None:
            return False
        fit = self._gyro.fit(moves)
        return fit.residual <= AGREES and _is_slip(fit.scale)

    def _exchanged_places(self, reference: Reference) -> Iterator[tuple[str, Array, Fit]]:
        """Yield fits with exchanged coordinates, and with the other sign of a yaw."""
        if isinstance(reference, PoseReference) and reference.goes:
            what = "x and y of the ground truth exchanged, or one of them with the opposite sign"
            yield what, self._moves, reference.mirrored().fit(self._moves)
            what = "the yaw of the ground truth has the opposite sign"
            yield what, self._moves, reference.reversed_yaw().fit(self._moves)
        if isinstance(reference, PositionReference):
            fits = [reference.mirrored(stretch).fit(self._moves) for stretch in STRETCHES]
            what = "latitude and longitude, or x and y, exchanged"
            yield what, self._moves, min(fits, key=lambda each: each.residual)

    def _partly(self, reference: Reference) -> _Cause:
        """Return which part of the drive contradicts, and why."""
        plain, size = reference.errors(self._moves, self._moves)
        most = min(
            AGREES, BETTER * math.sqrt(float(plain.sum())), BETTER * reference.fit(self._moves).residual
        )
        who, of = f"wheels and {reference.name} contradict each other", len(self._windows.is_moving)
        begins_s = self._windows.edges_s[::size][: len(plain)] - self._windows.edges_s[0]
        parts = self._parts(reference, plain)
        best = min((left for *_, left in parts), default=math.inf)
        if best <= most:
            parts.sort(key=lambda each: each[-1])
            which = [(what, part) for what, part, left in parts if left <= best + ALIKE]
            part = which[0][1]
            unsure = UNSURE if len(which) > 1 else ""
            what = ", or ".join(what for what, _ in which)
            return _Cause(
                f"{what} in {int(part.sum()) * size} of {of} s, first at {begins_s[part][0]:.0f} s{unsure}: "
                f"{who}, {100.0 * best:.0f} % of the motion is left with it",
                float(part.mean()),
            )
        for wheel in self._wheels.measured:
            is_still = self._windows.is_moving & (self._windows.turned_rad[:, wheel] == 0.0)
            # What it missed may come at once when it recovers.
            around = np.convolve(is_still, np.ones(3), mode="same") > 0.0
            part = np.add.reduceat(around[: size * len(plain)], np.arange(0, size * len(plain), size)) > 0
            left = math.sqrt(float(plain[~part].sum()))
            if is_still.any() and left <= most:
                return _Cause(
                    f"the encoder of wheel {wheel} stays in {int(is_still.sum())} of {of} s while others "
                    f"turn, first at {begins_s[part][0]:.0f} s: {who} there, {100.0 * left:.0f} % of the "
                    "motion is left elsewhere",
                    float(is_still.mean()),
                )
        return _Cause("")

    def _parts(self, reference: Reference, plain: Array) -> list[tuple[str, Flags, float]]:
        """Return corrections that hold in a part of the drive, that part, and what they leave."""
        unsigned = [] if self._has_signs else self._wheels.signs()
        tried = [(each.what, [each.moves]) for each in self._corrections]
        if unsigned:
            tried = [("the speeds of the wheels have no sign: they are negative", unsigned)]
        parts = []
        for what, motions in tried:
            errors = np.column_stack([plain, *(reference.errors(moves, self._moves)[0] for moves in motions)])
            states = _stretches(errors)
            left = math.sqrt(float(np.take_along_axis(errors, states[:, np.newaxis], 1).sum()))
            if states.any() and (unsigned or not states.all()):
                parts.append((what, states > 0, left))
        return parts

    def _gyro_fault(self, reference: Reference) -> str:
        """Return a sign or factor of the gyro that wheels and ground truth, or positions, both show."""
        plain = reference.fit(self._moves)
        if self._gyro is None or plain.residual > AGREES:
            return ""
        fit, by_wheels = reference.turn_factor(self._moves, self._gyro.turn_rad), self._gyro.fit(self._moves)
        if max(fit.residual, by_wheels.residual) > AGREES or fit.turn_scale * plain.turn_scale == 0.0:
            return ""
        factor = 1.0 / fit.turn_scale
        errors = factor - 1.0, by_wheels.scale / plain.turn_scale - 1.0
        if max(errors) >= -GYRO_SHARE and min(errors) <= GYRO_SHARE:
            return ""
        return f"{_gyro_text(factor)}; wheels and {reference.name} agree"

    def _by_gyro(self) -> _Cause:
        """Return what explains that wheels and gyro contradict each other."""
        reference = self._gyro
        if reference is None:
            return _Cause("")
        plain = reference.fit(self._moves)
        if plain.residual <= AGREES and _is_slip(plain.scale):
            return self._partly(reference)
        if text := self._steering_wheel(reference, plain):
            return _Cause(text)
        fits = [(each.what, reference.fit(each.moves)) for each in self._corrections]
        explaining = [what for what, fit in fits if fit.residual <= AGREES and _is_slip(fit.scale)]
        if plain.residual <= AGREES and plain.scale != 0.0:
            explaining.append(self._scale(plain.scale))
        if not explaining:
            return self._partly(reference)
        unsure = UNSURE if len(explaining) > 1 or "; or " in explaining[0] else ""
        return _Cause(f"{', or '.join(explaining)}{unsure}: wheels and gyro contradict each other")

    def _scale(self, factor: float) -> str:
        """Return what a factor of the gyro's rotation over that of the wheels comes from."""
        if factor < 0.0:
            return _gyro_text(factor)
        wheels = f"the wheels turn {1.0 / factor:.3g} times as far: {unit_of(factor, OTHERS)}"
        if np.abs(self._windows.turned_rad).max() > self._limit_rad_s * WINDOW_S:
            return f"{wheels}; they turn faster than limits.wheel_speed_rad_s = {self._limit_rad_s:g}"
        # What a rover does at most when its wheels turn as fast as they can.
        most_rad = self._limit_rad_s * float(np.abs(self._wheels.yaw_effects).sum()) * WINDOW_S
        if self._gyro is not None and np.abs(self._gyro.turn_rad).max() > most_rad:
            return f"{_gyro_text(factor)}; no rover turns so fast whose wheels turn at their limit"
        return f"{wheels}; or {_gyro_text(factor)}"

    def _steering_wheel(self, reference: Reference, plain: Fit) -> str:
        """Return the ratio of steering angles beyond the limit of the wheels; "" where they are within it."""
        angles = self._windows.steering_rad
        if angles is None or np.abs(angles).max() <= self._wheels.steering_limit_rad:
            return ""
        ratio = self._wheels.ratio(reference)
        assert ratio is not None  # noqa: S101 there are angles
        correction, fit = ratio
        if fit.residual > min(AGREES, BETTER * plain.residual):
            return ""
        largest = (
            f"the steering angles are up to {math.degrees(np.abs(angles).max()):.0f} deg, but the wheels of "
            f"[rover] steer up to {math.degrees(self._wheels.steering_limit_rad):.0f} deg"
        )
        return (
            f"{largest}: {_contradiction('wheels and gyro', plain.residual, fit.residual, [correction.what])}"
        )


def _share_of(factor: float) -> float:
    """Return which share of a motion is wrong that is so many times as large as it is measured."""
    return min(1.0, abs(factor - 1.0))


def _is_slip(factor: float) -> bool:
    return SCALES[0] <= factor <= SCALES[1]


def _contradiction(who: str, residual: float, best: float, which: Sequence[str]) -> str:
    """Return the corrections that explain a contradiction, and how much of it."""
    unsure = UNSURE if len(which) > 1 else ""
    return (
        f"{', or '.join(which)}{unsure}: {who} contradict each other, {100.0 * residual:.0f} % of the motion "
        f"is left, {100.0 * best:.0f} % with it"
    )


def _unexplained(reference: Reference, moves: Array) -> str:
    residual = reference.fit(moves).residual
    if residual <= UNLIKE:
        return ""
    return (
        f"wheels and {reference.name} contradict each other, {100.0 * residual:.0f} % of the motion is left, "
        "and no cause that is tried explains it: more than one fault, or one in a part of the drive only, "
        "another order of the wheels, or another drive"
    )


def _separate(moves: Array, reference: Reference) -> Iterator[tuple[str, Array, Fit]]:
    """Yield fits with a factor of the rotations, and of the distances, where that is none of slip."""
    if not isinstance(reference, PoseReference):
        return
    plain = reference.fit(moves)
    tracks = f"track or wheelbase {1.0 / plain.turn_scale:.3g} times as wide" if plain.turn_scale else ""
    for what, factor, others in (
        ("rotations", plain.turn_scale, f"{tracks}, or unit of the yaw of the {reference.name}"),
        ("distances", plain.distance_scale, f"unit of x and y of the {reference.name}"),
    ):
        if factor <= 0.0 or _is_slip(factor):
            continue
        corrected = moves.copy()
        corrected[:, 2 if what == "rotations" else slice(0, 2)] *= factor
        text = f"all {what} {factor:.4g} times as large: {unit_of(factor, others)}"
        yield text, corrected, reference.fit(corrected)


def _side(wheels: Wheels, reference: Reference, plain: Fit) -> str:
    """Return the factor of the wheels of one side, where it explains what differs."""
    side = wheels.side(reference)
    if side is None or abs(side[0] - 1.0) <= SIDE_SHARE:
        return ""
    factor, fit = side
    if fit.residual > min(AGREES, BETTER * plain.residual) or not _is_slip(fit.scale):
        return ""
    what = f"radius of the wheels of one side, or uneven slip: the left ones roll {factor:.3g} times as far"
    return _contradiction(f"wheels and {reference.name}", plain.residual, fit.residual, [what])


def _stretches(errors: Array) -> Times:
    """Return which of several motions holds when: the stretches that leave the least errors, each at a price.

    Args:
        errors: Of n parts of the drive and m motions, the first as measured, shape (n, m).
    """
    price = STRETCH_PRICE * float(errors[:, 0].sum())
    cost = np.array([0.0, *[price] * (errors.shape[1] - 1)])
    came = np.zeros(errors.shape, np.int64)
    for place, left in enumerate(errors):
        cheapest = int(cost.argmin())
        changes = cost[cheapest] + price < cost
        came[place] = np.where(changes, cheapest, np.arange(len(cost)))
        cost = np.where(changes, cost[cheapest] + price, cost) + left
    states = np.zeros(len(errors), np.int64)
    state = int(cost.argmin())
    for place in range(len(errors) - 1, -1, -1):
        states[place] = state
        state = int(came[place, state])
    return states


def _gyro_text(factor: float) -> str:
    size = f"it measures {factor:.3g} times the rotation"
    if factor < 0.0 and abs(factor + 1.0) <= GYRO_SHARE:
        return f"{SIGN_OF_GYRO}: {size}"
    sign = f"{SIGN_OF_GYRO}, and another scale" if factor < 0.0 else "the gyro has another scale"
    return f"{sign}: {size}: {unit_of(abs(factor), 'its scale factor')}"
