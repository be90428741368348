"""Compares the wheels of a recorded drive with its truth, and with themselves."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from controllers.motion.kinematics import Kinematics, make_kinematics
from controllers.motion.rover_geometry import RoverSettings, WheelsRoverSettings
from rover_hil.datasets.arrays import Array, Times
from rover_hil.datasets.log import LogRows, read_drive
from rover_hil.recording.findings import FoundFinding

WINDOW_S = 1.0
LEAST_WINDOWS = 8
"""Fewer windows in motion do not tell one error from another."""
LEAST_MOTION = 0.02
"""Windows with a smaller share of the greatest motion are rests."""
AGREES = 0.3
"""Residual, as a share of the motion, up to which marker offsets and slip explain the difference."""
BETTER = 0.6
"""A correction explains the difference if it leaves less than this share of the residual."""
UNLIKE = 0.7
"""Wheels whose motion leaves more than this share of the truth's say nothing of it."""
ALIKE = 0.1
"""Corrections whose residuals differ by less, as a share of the motion, cannot be told apart."""
SCALES = (0.35, 1.3)
"""A common factor within these may be slip, on which wheels turn further than the rover, or the radius."""
SPEED_SCALES = (0.8, 1.25)
"""Speed and change of the angle of one wheel agree better: no slip is between them."""
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
    return compare_with_truth(drive.rows, drive.config.rover)


def compare_with_truth(rows: LogRows, rover: RoverSettings) -> list[FoundFinding]:
    """Return what the truth of a drive says against its wheels, and what a wheel says against itself.

    Turns and distances of windows of a second are compared. Distances are those of the marker that the truth
    is of: where it sits, and which way it looks, does not matter. Of the corrections that are tried (a wheel
    reversed, all reversed, two exchanged, a common factor) all that explain the difference are named.

    Args:
        rows: The drive.
        rover: Its wheels.
    """
    findings = [FoundFinding(name="speed", t_s=None, text=text) for text in _speed_findings(rows)]
    kinematics = make_kinematics(rover)
    windows = _windows(rows, kinematics.wheel_count)
    if windows is None:
        return findings
    turned_rad, steering_rad, truth = windows
    count = kinematics.wheel_count
    fits = [_fit("", kinematics, turned_rad, steering_rad, truth)]
    for what, signs, order in _corrections(rover, count):
        corrected = turned_rad[:, np.array(order, int)] * np.array(signs)
        fits.append(_fit(what, kinematics, corrected, steering_rad, truth))
    text = _explain(fits, truth)
    if text:
        findings.append(FoundFinding(name="truth", t_s=None, text=text))
    return findings


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
    unsure = "; this drive cannot tell which" if len(which) > 1 else ""
    shares = f"{100.0 * plain.residual:.0f} % of the motion is left, {100.0 * best:.0f} % with"
    return f"wheels and truth contradict each other, {shares} {', or '.join(which)}{unsure}"


def _unit_of(factor: float) -> str:
    size = max(factor, 1.0 / factor)
    named = [text for unit, text in UNITS if abs(size / unit - 1.0) <= SAME_UNIT]
    usual = "ticks_per_turn, gear_ratio, radius or unit of the wheels, or the clock of speeds"
    return ", or ".join([*named, usual])


def _corrections(
    rover: RoverSettings, count: int
) -> Iterator[tuple[str, tuple[float, ...], tuple[int, ...]]]:
    """Yield name, sign and source of each wheel of every correction that is tried."""
    same, ones = tuple(range(count)), (1.0,) * count
    for wheel in range(count):
        signs = tuple(-1.0 if place == wheel else 1.0 for place in same)
        yield f"wheel {wheel} reversed", signs, same
    yield "all wheels reversed", tuple(-one for one in ones), same
    if isinstance(rover, WheelsRoverSettings) and count > 2 and count % 2 == 0:
        mirrored = _mirrored(rover)
        if mirrored is not None:
            yield "left and right exchanged", ones, mirrored
            yield "left and right exchanged and all reversed", tuple(-one for one in ones), mirrored
    for first, second in combinations(same, 2):
        order = list(same)
        order[first], order[second] = second, first
        name = "left and right" if count == 2 else f"wheels {first} and {second}"
        yield f"{name} exchanged", ones, tuple(order)


def _mirrored(rover: WheelsRoverSettings) -> tuple[int, ...] | None:
    """Return which wheel sits on the other side of each; None where one has no such."""
    order = []
    for wheel in rover.wheels:
        others = [
            place
            for place, other in enumerate(rover.wheels)
            if math.isclose(other.x_m, wheel.x_m) and math.isclose(other.y_m, -wheel.y_m)
        ]
        if len(others) != 1:
            return None
        order.append(others[0])
    return tuple(order)


def _fit(
    what: str, kinematics: Kinematics, turned_rad: Array, steering_rad: Array | None, truth: _Motion
) -> _Fit:
    moves = np.array(
        [
            kinematics.body_motion(row.tolist(), () if steering_rad is None else tuple(steering_rad[place]))
            for place, row in enumerate(turned_rad)
        ]
    )
    turn_rad, distance_m = moves[:, 2], np.hypot(moves[:, 0], moves[:, 1])
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


def _windows(rows: LogRows, count: int) -> tuple[Array, Array | None, _Motion] | None:
    """Return turns and steering of the wheels in windows of motion, and the truth; None without enough."""
    wheels = [_angles(rows, wheel) for wheel in range(1, count + 1)]
    poses = [rows[name] for name in ("x_m", "y_m", "psi_rad")]
    if any(wheel is None for wheel in wheels) or min(map(len, poses)) < 2:
        return None
    known = [wheel for wheel in wheels if wheel is not None]
    begin_ns = max(poses[0].t_ns[0], *(times[0] for times, _ in known))
    end_ns = min(poses[0].t_ns[-1], *(times[-1] for times, _ in known))
    edges_ns = np.arange(begin_ns, end_ns, WINDOW_S * 1e9)
    if len(edges_ns) <= LEAST_WINDOWS:
        return None
    turned = np.column_stack([np.diff(np.interp(edges_ns, times, angles)) for times, angles in known])
    x_m, y_m = (np.diff(np.interp(edges_ns, pose.t_ns, pose.value)) for pose in poses[:2])
    yaw_rad = np.interp(edges_ns, poses[2].t_ns, np.unwrap(poses[2].value))
    truth = _Motion(np.diff(yaw_rad), np.hypot(x_m, y_m))
    rim = np.abs(turned).max(axis=1)
    moves = rim > LEAST_MOTION * rim.max() if rim.max() > 0.0 else np.zeros(len(rim), bool)
    if moves.sum() < LEAST_WINDOWS:
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


def _angles(rows: LogRows, wheel: int) -> tuple[Times, Array] | None:
    """Return how far a wheel has turned; by its speeds where it has no angle."""
    readings = rows[f"enc{wheel}_rad"]
    if len(readings) > 1:
        return readings.t_ns, readings.value
    readings = rows[f"speed{wheel}_rad_s"]
    if len(readings) < 2:
        return None
    steps = 0.5 * (readings.value[1:] + readings.value[:-1]) * np.diff(readings.t_ns) / 1e9
    return readings.t_ns, np.concatenate(([0.0], np.cumsum(steps)))


def _speed_findings(rows: LogRows) -> Iterator[str]:
    """Yield wheels whose speed is not the change of their angle."""
    wheel = 0
    while f"speed{(wheel := wheel + 1)}_rad_s" in rows:
        speed, angle = rows[f"speed{wheel}_rad_s"], rows[f"enc{wheel}_rad"]
        if len(angle) < LEAST_WINDOWS or len(speed) < LEAST_WINDOWS:
            continue
        edges_ns = np.arange(angle.t_ns[0], angle.t_ns[-1], WINDOW_S * 1e9)
        if len(edges_ns) <= LEAST_WINDOWS:
            continue
        turned = np.diff(np.interp(edges_ns, angle.t_ns, angle.value))
        steps = 0.5 * (speed.value[1:] + speed.value[:-1]) * np.diff(speed.t_ns) / 1e9
        said = np.diff(np.interp(edges_ns, speed.t_ns, np.concatenate(([0.0], np.cumsum(steps)))))
        square = float(turned @ turned)
        if square == 0.0 or not said.any():
            continue
        factor = float(said @ turned) / square
        left = math.sqrt(float(np.sum((said - factor * turned) ** 2)) / float(said @ said))
        if left <= AGREES and not SPEED_SCALES[0] <= factor <= SPEED_SCALES[1]:
            why = "its sign" if abs(factor + 1.0) <= SAME_UNIT else _unit_of(abs(factor))
            yield f"wheel {wheel - 1}: its speed is {factor:.4g} times the change of its angle: {why}"
