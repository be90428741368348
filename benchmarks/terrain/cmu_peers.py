"""Published models of the CMU smooth wheel, written anew from their equations, to compare with.

Pavlov and Johnson's model (GitHub robomechanics/3d-terramechanics, terramechanics/): plate law with an
exponent that grows in skid, greatest stress and exit angle tuned for each slip angle, side wall by
bulldozing of a wedge (`wedge`) or after Ishigami 2007 (`ishigami`). Without the soil-flow part, which
changes the exit angle only. Its slip ratio takes the total speed, not the forward one.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from rover_hil.terrain.fit_data import WheelTests

Array = NDArray[np.float64]
RADIUS_M, WIDTH_M = 0.058, 0.05
SHEARING_RADIUS_M = 1.02 * RADIUS_M
MODULUS_PA, COHESION_PA, SHEAR_MODULUS_M = 8.0e6, 1000.0, 0.01
FRICTION_RAD = np.radians(29.0)
UNIT_WEIGHT = 1330.0 * 9.8
EXPONENT, EXPONENT_SLIP, EXPONENT_SKID = 1.4, 0.01, 0.55
COTANGENT = 1 / np.tan(np.pi / 4 - FRICTION_RAD / 2)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)
PUBLISHED: dict[float, tuple[float, ...]] = {
    0.0: (0.37, 0.50, -0.17, -0.01),
    15.0: (0.41, 0.46, -0.18, -0.01),
    30.0: (0.60, 0.21, -0.12, -0.15),
    45.0: (0.66, 0.17, -0.14, -0.21),
    60.0: (0.76, 0.12, -0.32, -0.10),
    75.0: (0.84, 0.09, -0.48, -0.08),
    90.0: (0.91, 0.07, -0.99, -0.01),
}
"""a_0, a_1, b_0, b_1 of the smooth wheel at each slip angle in degrees: start values of the source's tuning;
the tuned ones are stored in a binary file that was not at hand."""
REFERENCE_RIM_SPEED = 8.0
"""Commanded rim speed of the trial whose load sets the angles in skid, mm/s."""


class PeerForces(NamedTuple):
    """Prediction; arrays of one length."""

    sinkage_m: Array
    drawbar_n: Array
    side_n: Array


def predict(tests: WheelTests, tuned: dict[float, tuple[float, ...]], side: str) -> PeerForces:
    """Return what the model predicts at measured loads.

    Args:
        tests: Cell means.
        tuned: a_0, a_1, b_0, b_1 for each slip angle in degrees.
        side: `wedge` or `ishigami`.
    """
    predicted = np.full((3, len(tests.cell)), np.nan)
    for angle, numbers in tuned.items():
        row = tests.slip_angle_deg == angle
        if row.any():
            predicted[:, row] = _one_angle(tests.only(row), numbers, side)
    return PeerForces(*predicted)


def retuned(tests: WheelTests, side: str) -> dict[float, tuple[float, ...]]:
    """Return a_0, a_1, b_0, b_1 for each slip angle, tuned to forces and sinkage of these tests."""
    lower, upper = (0.0, -0.5, -1.0, -0.5), (0.95, 1.0, 0.0, 0.5)
    result = {}
    for angle, start in PUBLISHED.items():
        row = tests.only(tests.slip_angle_deg == angle)

        def misfit(numbers: Array, row: WheelTests = row) -> Array:
            sinkage, drawbar, side_n = _one_angle(row, tuple(numbers), side)
            return np.concatenate(
                [drawbar - row.drawbar_n, side_n - row.side_n, 400.0 * (sinkage - row.sinkage_m)]
            )

        begin = np.clip(start, np.array(lower) + 0.01, np.array(upper) - 0.01)
        solution = optimize.least_squares(misfit, begin, bounds=(lower, upper), diff_step=1e-3, max_nfev=40)
        result[angle] = tuple(float(x) for x in solution.x)
    return result


def _one_angle(tests: WheelTests, numbers: tuple[float, ...], side: str) -> Array:
    nearest = int(np.argmin(np.abs(tests.rim_speed_mm_s - REFERENCE_RIM_SPEED)))
    rolling = tests.only(np.arange(len(tests.cell)) == nearest)
    speed = np.hypot(rolling.motion.forward_m_s, rolling.motion.sideways_m_s)
    matched = rolling.motion._replace(rim_speed_m_s=speed * RADIUS_M / SHEARING_RADIUS_M * (1 + 1e-9))
    rolling = rolling._replace(motion=matched)
    entry = np.arccos(1 - _sinkage(rolling, numbers, (0.0, 0.0), side) / SHEARING_RADIUS_M)
    in_skid = (float(numbers[0] * entry[0]), float(numbers[2] * entry[0]))
    sinkage = _sinkage(tests, numbers, in_skid, side)
    forces = _forces(tests, sinkage, numbers, in_skid, side)
    return np.stack([sinkage, forces[0], -forces[1]])


def _sinkage(tests: WheelTests, numbers: tuple[float, ...], in_skid: tuple[float, float], side: str) -> Array:
    low = np.full(len(tests.cell), 1e-4)
    high = np.full(len(tests.cell), 1.5 * RADIUS_M)
    for _ in range(30):
        middle = 0.5 * (low + high)
        light = ~(_forces(tests, middle, numbers, in_skid, side)[2] >= tests.load_n)
        low, high = np.where(light, middle, low), np.where(light, high, middle)
    return np.asarray(0.5 * (low + high))


def _forces(
    tests: WheelTests, sinkage: Array, numbers: tuple[float, ...], in_skid: tuple[float, float], side: str
) -> tuple[Array, Array, Array]:
    """Return force forward, force against sliding, force up."""
    forward, sideways = tests.motion.forward_m_s, tests.motion.sideways_m_s
    turning = np.maximum(tests.motion.rim_speed_m_s / RADIUS_M, 1e-9)
    rim, travel = turning * SHEARING_RADIUS_M, np.hypot(forward, sideways)
    slips = rim >= travel
    slip = np.where(slips, (rim - travel) / np.maximum(rim, 1e-12), (rim - travel) / travel)
    entry = np.arccos(1 - sinkage / SHEARING_RADIUS_M)
    greatest = np.where(
        slips, entry * (numbers[0] + numbers[1] * slip), np.minimum(in_skid[0], 0.999 * entry)
    )
    leaving = np.where(slips, entry * (numbers[2] + numbers[3] * slip), in_skid[1])
    exponent = np.where(slips, EXPONENT + EXPONENT_SLIP * slip, EXPONENT - EXPONENT_SKID * slip)[:, None]
    total = np.zeros((3, len(sinkage)))
    for start, end in ((leaving, greatest), (greatest, entry)):
        angle = 0.5 * (start + end)[:, None] + 0.5 * (end - start)[:, None] * NODES
        piece = 0.5 * (end - start)[:, None] * WEIGHTS
        share = (angle - leaving[:, None]) / np.maximum(greatest - leaving, 1e-9)[:, None]
        behind = entry[:, None] - share * (entry - greatest)[:, None]
        like = np.where(angle >= greatest[:, None], angle, behind)
        depth = SHEARING_RADIUS_M * np.maximum(np.cos(like) - np.cos(entry)[:, None], 0.0)
        normal = MODULUS_PA * depth**exponent
        tangential, lateral = _shear(angle, normal, entry, (forward, sideways, turning), slips, travel)
        wall = _wall(angle, entry, leaving, sideways / travel, side)
        area = piece * SHEARING_RADIUS_M * WIDTH_M
        total[0] += np.sum(area * (tangential * np.cos(angle) - normal * np.sin(angle)), axis=1)
        total[1] += np.sum(area * lateral + piece * wall, axis=1)
        total[2] += np.sum(area * (normal * np.cos(angle) + tangential * np.sin(angle)), axis=1)
    return total[0], total[1], total[2]


def _shear(
    angle: Array,
    normal: Array,
    entry: Array,
    speeds: tuple[Array, Array, Array],
    slips: NDArray[np.bool_],
    travel: Array,
) -> tuple[Array, Array]:
    forward, sideways, turning = (values[:, None] for values in speeds)
    rim = turning * SHEARING_RADIUS_M
    first = entry[:, None]
    # In skid the soil ahead of a transition angle moves with the wheel (Wong and Reece).
    transition = first + (rim - travel[:, None]) / travel[:, None] * first / 2
    ahead = ~slips[:, None] & (angle > transition)
    per_turn = forward / turning
    rolling = RADIUS_M * (first - angle) - per_turn * (np.sin(first) - np.sin(angle))
    rear = RADIUS_M * (transition - angle) - per_turn * (np.sin(transition) - np.sin(angle))
    span = np.maximum(first - transition, 1e-9)
    chord = (np.sin(first) - np.sin(transition)) / span
    front = per_turn * ((first - angle) * chord - (np.sin(first) - np.sin(angle)))
    shift = np.where(slips[:, None], rolling, np.where(ahead, front, rear))
    speed = rim - forward * np.cos(angle) + np.where(ahead, chord * forward - rim, 0.0)
    across = (first - angle) * sideways / turning
    strength = COHESION_PA + normal * np.tan(FRICTION_RAD)
    stress = strength * -np.expm1(-np.hypot(shift, across) / SHEAR_MODULUS_M)
    total = np.maximum(np.hypot(speed, sideways), 1e-12)
    return np.sign(shift) * np.abs(speed) / total * stress, sideways / total * stress


def _wall(angle: Array, entry: Array, leaving: Array, sine: Array, side: str) -> Array:
    entry, leaving, sine = entry[:, None], leaving[:, None], sine[:, None]
    depth = SHEARING_RADIUS_M * (np.cos(angle) - np.cos(entry))
    if side == "ishigami":
        first = COTANGENT + 1 / np.tan(np.pi / 4 - FRICTION_RAD / 2)
        second = COTANGENT + COTANGENT**2 * np.tan(FRICTION_RAD)
        push = first * (COHESION_PA * depth + second * UNIT_WEIGHT * depth**2 / 2)
        return np.asarray(push * (SHEARING_RADIUS_M - depth * np.cos(angle)) * sine)
    chord = (np.sin(angle) - np.sin(leaving)) / np.maximum(np.sin(entry) - np.sin(leaving), 1e-9)
    line = chord * (np.cos(leaving) - np.cos(entry)) - (np.cos(leaving) - np.cos(angle))
    depth = SHEARING_RADIUS_M * np.minimum(2 * np.cos(angle), line)
    push = 0.5 * UNIT_WEIGHT * depth**2 * COTANGENT**2 * (1 + COTANGENT * np.tan(FRICTION_RAD) / 2)
    push = (push + 2 * depth * COHESION_PA * COTANGENT) * sine
    push = np.where(np.abs(angle) > np.pi / 2, 0.0, push)
    return np.asarray(push * SHEARING_RADIUS_M * np.cos(angle) * sine)
