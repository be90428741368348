"""Compares the wheels of a recorded drive with its truth, and with themselves."""

import cmath
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from controllers.motion.kinematics import Kinematics, make_kinematics
from controllers.motion.rover_geometry import RoverSettings, WheelsRoverSettings
from rover_hil.drives.arrays import Array
from rover_hil.drives.channels import Channels
from rover_hil.drives.drive import read_drive
from rover_hil.drives.quality.clock_check import clock_findings
from rover_hil.drives.quality.drive_paths import (
    DrivePath,
    effects_of,
    moves_of,
    path_of_wheels,
    places_of,
    wheel_angles,
)
from rover_hil.recording.findings import FoundFinding

Steps = NDArray[np.complex128]
"""How far the rover goes in each window, in its own axes, left as imaginary part."""
WINDOW_S = 1.0
LEAST_WINDOWS = 8
"""Fewer windows in motion do not distinguish one error from another."""
LEAST_MOTION = 0.02
"""Windows with a smaller share of the greatest motion are rests."""
AGREES = 0.3
"""Residual, as a share of the motion, up to which marker offsets and slip explain the difference."""
BETTER = 0.6
"""A correction explains the difference if it leaves less than this share of the residual."""
UNLIKE = 0.7
"""Wheels whose motion leaves more than this share of the truth's say nothing of it."""
ALIKE = 0.1
"""Corrections whose residuals differ by less, as a share of the motion, cannot be distinguished."""
SCALES = (0.35, 1.3)
"""A common factor within these may be slip, on which wheels turn further than the rover, or the radius."""
SPEED_SCALES = (0.8, 1.25)
"""Speed and change of the angle of one wheel agree better: no slip is between them."""
CLOCK_SHARE = 0.004
"""A clock is not named that is wrong by less: integrals of sampled speeds are not better."""
CLOCK_DEVIATIONS = 5.0
LEAST_SD = 0.0005
"""No factor is better known, whatever the residuals say."""
COARSE = 0.005
"""A speed with a coarser resolution, as a share of a usual one, may be cut off instead of rounded."""
LEAST_WAY_M = 1.0
"""A drive that goes less far, and hardly turns, shows the noise of the truth."""
ONE_DIRECTION = 0.8
SAME_WAY = 0.8
"""Cosine of the angle between two steps, from which on they go the same way."""
LEAST_OPPOSITE = 2
"""So many windows in each way: one is noise, or the turn back itself."""
LEAST_ASIDE_RAD = 0.5
"""A truth goes aside if it does so always in one direction, and by more than a marker is set up wrong."""
LEAST_TURN_RAD = 1.5
"""Drives that turn less in one sense do not show the sense of a turn: uneven slip turns a rover, too."""

UNITS = (
    (math.degrees(1.0), "deg where rad is meant, or the other way round"),
    (60.0 / math.tau, "rpm where rad/s is meant, or the other way round"),
    (math.tau, "revolutions where rad is meant, or the other way round"),
    (3.6, "km/h where m/s is meant, or the other way round"),
    (10.0, "cm or a clock that is wrong by 10"),
    (100.0, "cm where m is meant, or the other way round"),
    (1000.0, "mm where m is meant, or ms where s is meant, or the other way round"),
)
STEERING = (
    ("the steering reversed", -1.0),
    ("the steering in deg where rad is meant", math.radians(1.0)),
    ("the steering in rad where deg is meant", math.degrees(1.0)),
)
"""Corrections of the steering angles, and by what they multiply them."""
SAME_UNIT = 0.12
"""A factor is that of a unit within this share."""


@dataclass(frozen=True, slots=True)
class _Motion:
    """Motion of the rover in windows.

    Attributes:
        turn_rad: n.
        distance_m: Not negative, n.
    """

    turn_rad: Array
    distance_m: Array


@dataclass(frozen=True, slots=True)
class _Fit:
    """A correction of the wheels: what it is, the common factor that fits then, and the residual's share."""

    what: str
    scale: float
    residual: float


def truth_findings(path: Path) -> list[FoundFinding]:
    """Return what `compare_with_truth` finds in a log.

    Raises:
        LogError: The log cannot be read or is damaged.
    """
    drive = read_drive(path)
    return compare_with_truth(drive.channels, drive.config.rover)


def compare_with_truth(rows: Channels, rover: RoverSettings) -> list[FoundFinding]:
    """Return what the truth of a drive says against its wheels, and what a wheel says against itself.

    Turns and distances of windows of a second are compared. Distances are those of the marker that the truth
    is of: where it sits, and which way it looks, does not matter. Of the corrections that are tried (a wheel
    reversed, all reversed, two exchanged, a common factor, the steering) all that explain the difference are
    named.

    Args:
        rows: The drive.
        rover: Its wheels.
    """
    kinematics = make_kinematics(rover)
    path = path_of_wheels(rows, kinematics)
    clocks = list(clock_findings(rows, path))
    findings = [*_speed_findings(rows), *clocks]
    windows = _windows(rows, kinematics)
    if windows is None or clocks:  # with another clock, all other differences are its consequences
        return findings
    turned_rad, steering_rad, truth = windows
    effects = effects_of(kinematics, steering_rad)
    fits = [_fit("", turned_rad, effects, truth)]
    for what, signs, order in _corrections(rover, kinematics):
        corrected = turned_rad[:, np.array(order, int)] * np.array(signs)
        fits.append(_fit(what, corrected, effects, truth))
    if steering_rad is not None:
        fits += [
            _fit(what, turned_rad, effects_of(kinematics, factor * steering_rad), truth)
            for what, factor in STEERING
        ]
    fits += _separate(_motion_of(turned_rad, effects), truth)
    text, paths = _explain(fits, truth), _body_steps(rows, path)
    if not text and paths is not None:
        if opposite := _opposite_ways(*paths):
            findings.append(opposite)
            return findings
        text = _turned_path(*paths[1:])
    if text:
        findings.append(FoundFinding(name="truth", t_s=None, text=text))
    return findings


def _separate(said: _Motion, truth: _Motion) -> Iterator[_Fit]:
    """Yield fits with a factor of the turns, and of the distances, where that is none of slip."""
    pairs = (("turns", said.turn_rad, truth.turn_rad), ("distances", said.distance_m, truth.distance_m))
    for what, own, true in pairs:
        square = float(own @ own)
        factor = float(own @ true) / square if square > 0.0 else 0.0
        if factor <= 0.0 or SCALES[0] <= factor <= SCALES[1]:
            continue
        corrected = (
            replace(said, turn_rad=factor * own)
            if what == "turns"
            else replace(said, distance_m=factor * own)
        )
        yield _compared(f"all {what} {factor:.4g} times as large: {_unit_of(factor)}", corrected, truth)


def _explain(fits: Sequence[_Fit], truth: _Motion) -> str:
    plain, *others = fits
    if plain.residual <= AGREES:
        if SCALES[0] <= plain.scale <= SCALES[1]:
            return ""
        return (
            f"the truth moves {plain.scale:.4g} times as far and turns as much more as the wheels say: "
            f"{_unit_of(plain.scale)}"
        )
    best = min(fit.residual for fit in others)
    if best > AGREES or best > BETTER * plain.residual:
        if plain.residual <= UNLIKE:
            return ""
        return (
            f"wheels and truth contradict each other, {100.0 * plain.residual:.0f} % of the motion is left: "
            "more than one wheel reversed or exchanged, another order of the wheels, or another drive's truth"
        )
    which = [fit.what for fit in others if fit.residual <= best + ALIKE]
    unsure = "; this drive does not show which" if len(which) > 1 else ""
    shares = f"{100.0 * plain.residual:.0f} % of the motion is left, {100.0 * best:.0f} % with"
    return f"wheels and truth contradict each other, {shares} {', or '.join(which)}{unsure}"


def _body_steps(rows: Channels, wheels: DrivePath | None) -> tuple[Array, Steps, Steps] | None:
    """Return the begin of each window, and how far wheels and truth go in it, left as imaginary part."""
    truth = dict(places_of(rows)).get("truth")
    if wheels is None or truth is None:
        return None
    edges_s = np.arange(max(wheels.t_s[0], truth.t_s[0]), min(wheels.t_s[-1], truth.t_s[-1]), WINDOW_S)
    return edges_s[:-1], wheels.body_steps(edges_s), truth.body_steps(edges_s)


def _opposite_ways(begins_s: Array, said_m: Steps, true_m: Steps) -> FoundFinding | None:
    """Return that wheels and truth go opposite ways in a part of the drive; None where they do not."""
    sizes_m = np.abs(said_m)
    is_moving = (sizes_m > LEAST_MOTION * sizes_m.max(initial=0.0)) & (np.abs(true_m) > 0.5 * sizes_m)
    alike = (said_m * true_m.conjugate()).real / np.maximum(sizes_m * np.abs(true_m), 1e-12)
    is_opposite, is_same = is_moving & (alike < -SAME_WAY), is_moving & (alike > SAME_WAY)
    if min(is_opposite.sum(), is_same.sum()) < LEAST_OPPOSITE:
        return None
    is_one_way = bool(np.all(said_m.real[is_moving] >= 0.0))
    cause = "the speeds have no sign" if is_one_way else "wheels or truth are reversed there"
    text = (
        f"wheels and truth go opposite ways in {is_opposite.sum()} of {is_moving.sum()} s of motion, and the "
        f"same way in {is_same.sum()} s: {cause}"
    )
    return FoundFinding(name="truth", t_s=float(begins_s[is_opposite][0] - begins_s[0]), text=text)


def _turned_path(said_m: Steps, true_m: Steps) -> str:
    """Return that the truth goes into another direction of the rover than the wheels; "" where it does not.

    Exchanged wheels of an omnidirectional rover, and a reversed distance, leave its turns and distances.
    """
    sum_m2, length_m2 = complex(np.vdot(said_m, true_m)), float(np.abs(said_m * true_m).sum())
    aside_rad = abs(cmath.phase(sum_m2))
    if length_m2 == 0.0 or abs(sum_m2) < ONE_DIRECTION * length_m2 or aside_rad < LEAST_ASIDE_RAD:
        return ""
    return (
        f"the truth goes {math.degrees(cmath.phase(sum_m2)):+.0f} deg aside of where the wheels go: "
        "truth.marker.yaw_deg is not given, wheels are exchanged, or the distance is reversed; "
        "this drive does not show which"
    )


def _unit_of(factor: float) -> str:
    size = max(factor, 1.0 / factor)
    named = [text for unit, text in UNITS if abs(size / unit - 1.0) <= SAME_UNIT]
    usual = "ticks_per_turn, gear_ratio, radius or unit of the wheels, or the clock of speeds"
    return ", or ".join([*named, usual])


def _corrections(
    rover: RoverSettings, kinematics: Kinematics
) -> Iterator[tuple[str, tuple[float, ...], tuple[int, ...]]]:
    """Yield name, sign and source of each wheel of every correction that is tried."""
    count = kinematics.wheel_count
    same, ones = tuple(range(count)), (1.0,) * count
    measured = [wheel for wheel in same if wheel not in kinematics.unmeasured]
    for wheel in measured:
        signs = tuple(-1.0 if place == wheel else 1.0 for place in same)
        yield f"wheel {wheel} reversed", signs, same
    if len(measured) > 1:
        yield "all wheels reversed", tuple(-sign for sign in ones), same
    if isinstance(rover, WheelsRoverSettings) and len(measured) == count and count > 2 and count % 2 == 0:
        mirrored = _mirrored(rover)
        if mirrored is not None:
            yield "left and right exchanged", ones, mirrored
            yield "left and right exchanged and all reversed", tuple(-sign for sign in ones), mirrored
    for first, second in combinations(measured, 2):
        order = list(same)
        order[first], order[second] = second, first
        name = "left and right" if len(measured) == 2 else f"wheels {first} and {second}"
        yield f"{name} exchanged", ones, tuple(order)


def _mirrored(rover: WheelsRoverSettings) -> tuple[int, ...] | None:
    """Return which wheel sits on the other side of each; None where one has no such."""
    order = []
    for wheel in rover.wheels:
        others = [
            place
            for place, opposite in enumerate(rover.wheels)
            if math.isclose(opposite.x_m, wheel.x_m) and math.isclose(opposite.y_m, -wheel.y_m)
        ]
        if len(others) != 1:
            return None
        order.append(others[0])
    return tuple(order)


def _fit(what: str, turned_rad: Array, effects: Array, truth: _Motion) -> _Fit:
    return _compared(what, _motion_of(turned_rad, effects), truth)


def _motion_of(turned_rad: Array, effects: Array) -> _Motion:
    moves = moves_of(turned_rad, effects)
    return _Motion(moves[:, 2], np.hypot(moves[:, 0], moves[:, 1]))


def _compared(what: str, motion: _Motion, truth: _Motion) -> _Fit:
    turn_rad, distance_m = motion.turn_rad, motion.distance_m
    turns, distances = float(np.sum(truth.turn_rad**2)), float(np.sum(truth.distance_m**2))
    # Both count alike, but a drive that does not turn is judged by its distances.
    turns_count = float(np.ptp(np.cumsum(truth.turn_rad))) >= LEAST_TURN_RAD
    weights = (1.0 / turns if turns_count else 0.0, 1.0 / distances if distances else 0.0)
    seen = np.concatenate((weights[0] ** 0.5 * truth.turn_rad, weights[1] ** 0.5 * truth.distance_m))
    said = np.concatenate((weights[0] ** 0.5 * turn_rad, weights[1] ** 0.5 * distance_m))
    square = float(said @ said)
    scale = max(0.0, float(said @ seen) / square) if square > 0.0 else 0.0
    residual = math.sqrt(float(np.sum((seen - scale * said) ** 2) / max(float(seen @ seen), 1e-30)))
    return _Fit(what, scale, residual)


def _windows(rows: Channels, kinematics: Kinematics) -> tuple[Array, Array | None, _Motion] | None:
    """Return turns and steering of the wheels in windows of motion, and the truth; None without enough."""
    count = kinematics.wheel_count
    measured = [wheel for wheel in range(count) if wheel not in kinematics.unmeasured]
    wheels = [wheel_angles(rows, wheel + 1) for wheel in measured]
    poses = [rows[name] for name in ("x_m", "y_m", "yaw_rad")]
    if any(wheel is None for wheel in wheels) or min(map(len, poses)) < 2:
        return None
    known = [wheel for wheel in wheels if wheel is not None]
    begin_ns = max(poses[0].t_ns[0], *(times[0] for times, _ in known))
    end_ns = min(poses[0].t_ns[-1], *(times[-1] for times, _ in known))
    edges_ns = np.arange(begin_ns, end_ns, WINDOW_S * 1e9)
    if len(edges_ns) <= LEAST_WINDOWS:
        return None
    turned = np.zeros((len(edges_ns) - 1, count))
    turned[:, measured] = np.column_stack(
        [np.diff(np.interp(edges_ns, times, angles)) for times, angles in known]
    )
    x_m, y_m = (np.diff(np.interp(edges_ns, pose.t_ns, pose.value)) for pose in poses[:2])
    yaw_rad = np.interp(edges_ns, poses[2].t_ns, np.unwrap(poses[2].value))
    truth = _Motion(np.diff(yaw_rad), np.hypot(x_m, y_m))
    rim = np.abs(turned).max(axis=1)
    moves = rim > LEAST_MOTION * rim.max() if rim.max() > 0.0 else np.zeros(len(rim), bool)
    has_way = truth.distance_m[moves].sum() >= LEAST_WAY_M or np.ptp(yaw_rad) >= LEAST_TURN_RAD
    if moves.sum() < LEAST_WINDOWS or not has_way:
        return None
    middles_ns = 0.5 * (edges_ns[:-1] + edges_ns[1:])
    steering = [rows[f"steer{wheel}_rad"] for wheel in range(1, count + 1)]
    angles = None
    if any(len(readings) for readings in steering):
        angles = np.column_stack(
            [
                np.interp(middles_ns, readings.t_ns, readings.value)
                if len(readings)
                else np.zeros(len(middles_ns))
                for readings in steering
            ]
        )[moves]
    return turned[moves], angles, _Motion(truth.turn_rad[moves], truth.distance_m[moves])


@dataclass(frozen=True, slots=True)
class _SpeedFit:
    """Speed of a wheel over the change of its angle.

    Attributes:
        ratio: As it is.
        factor: Without what a coarse speed may have been cut off by.
        sd: Standard deviation of the factor.
        residual: Share that the factor leaves.
    """

    wheel: int
    ratio: float
    factor: float
    sd: float
    residual: float


def _speed_findings(rows: Channels) -> Iterator[FoundFinding]:
    """Yield wheels whose speed is not the change of their angle, and a clock that all speeds contradict."""
    fits = list(_speed_fits(rows))
    for fit in fits:
        if fit.residual > AGREES:
            what = f"wheel {fit.wheel}: its speed and the change of its angle contradict each other"
            text = f"{what}: an angle that jumps or starts again, or one of another wheel"
            yield FoundFinding(name="speed", t_s=None, text=text)
        if fit.residual <= AGREES and not SPEED_SCALES[0] <= fit.ratio <= SPEED_SCALES[1]:
            why = "its sign" if abs(fit.ratio + 1.0) <= SAME_UNIT else _unit_of(abs(fit.ratio))
            text = f"wheel {fit.wheel}: its speed is {fit.ratio:.4g} times the change of its angle: {why}"
            yield FoundFinding(name="speed", t_s=None, text=text)
    factors, sds = np.array([fit.factor for fit in fits]), np.array([fit.sd for fit in fits])
    if not len(fits) or not ((factors >= SPEED_SCALES[0]) & (factors <= SPEED_SCALES[1])).all():
        return
    weights = 1.0 / np.maximum(sds, LEAST_SD) ** 2
    mean, sd = float(weights @ factors / weights.sum()), float(weights.sum() ** -0.5)
    agree = (np.abs(factors - mean) <= CLOCK_DEVIATIONS * np.maximum(sds, LEAST_SD)).all()
    if agree and abs(mean - 1.0) > max(CLOCK_SHARE, CLOCK_DEVIATIONS * sd):
        text = (
            f"the speeds of all wheels are {mean:.4f} times the changes of their angles, standard deviation "
            f"{sd:.2g}: a clock whose seconds are {1.0 / mean:.4f} s long, or gear_ratio, ticks_per_turn or "
            "radius of one of the two"
        )
        yield FoundFinding(name="clock", t_s=None, text=text)


def _speed_fits(rows: Channels) -> Iterator[_SpeedFit]:
    """Yield the fit of each wheel with speeds and angles that moves enough."""
    wheel = 0
    while f"speed{(wheel := wheel + 1)}_rad_s" in rows:
        speed, angle = rows[f"speed{wheel}_rad_s"], rows[f"position{wheel}_rad"]
        if len(angle) < LEAST_WINDOWS or len(speed) < LEAST_WINDOWS:
            continue
        edges_ns = np.arange(angle.t_ns[0], angle.t_ns[-1], WINDOW_S * 1e9)
        if len(edges_ns) <= LEAST_WINDOWS:
            continue
        turned = np.diff(np.interp(edges_ns, angle.t_ns, angle.value))
        steps = 0.5 * (speed.value[1:] + speed.value[:-1]) * np.diff(speed.t_ns) / 1e9
        said = np.diff(np.interp(edges_ns, speed.t_ns, np.concatenate(([0.0], np.cumsum(steps)))))
        # Nothing is measured in a gap.
        held = [np.diff(np.searchsorted(each.t_ns, edges_ns)) > 0 for each in (angle, speed)]
        turned, said = (values[held[0] & held[1]] for values in (turned, said))
        if len(turned) < LEAST_WINDOWS or not turned.any() or not said.any():
            continue
        causes = turned[:, np.newaxis]
        levels = np.unique(np.abs(speed.value[speed.value != 0.0]))
        resolution = float(np.diff(levels).min()) if len(levels) > 1 else math.inf
        if resolution > COARSE * float(np.median(levels)):
            # A coarse speed may be cut off, not rounded: a part of it that does not grow with the speed.
            causes = np.column_stack((turned, np.sign(turned)))
        coefficients, _, rank, _ = np.linalg.lstsq(causes, said, rcond=1e-6)
        if rank < causes.shape[1]:
            continue
        residuals = said - causes @ coefficients
        spread = float(residuals @ residuals) / max(1, len(said) - causes.shape[1])
        sd = math.sqrt(spread * float(np.linalg.inv(causes.T @ causes)[0, 0]))
        ratio = float(said @ turned) / float(turned @ turned)
        residual = math.sqrt(float(residuals @ residuals) / float(said @ said))
        yield _SpeedFit(wheel - 1, ratio, float(coefficients[0]), sd, residual)
