"""Constraints that wheels put on the motion of a rover, and what is wrong with a set of wheels.

A wheel at (x, y) that rolls in the direction b (steering included) has a contact point with the velocity
(v_x - w y, v_y + w x). Two equations hold for an ordinary wheel without slip. Source: Muir and Neuman,
Kinematic modeling of wheeled mobile robots, J. Robotic Systems 4, 1987; Campion, Bastin and d'Andrea-Novel,
Structural properties and classification of kinematic and dynamic models of wheeled mobile robots, IEEE
Trans. Robotics and Automation 12, 1996, section II (fixed and centred orientable wheels):

    cos(b) (v_x - w y) + sin(b) (v_y + w x) = r omega      rolling
    -sin(b) (v_x - w y) + cos(b) (v_y + w x) = 0           no side slip

A wheel with rollers leaves its contact point free across the roller's axle. Only the component along that
axle is bound (the latter's Swedish wheel). With the axle at the angle g from the wheel's own axle, divided by
-sin(g):

    [cos(b) + cot(g) sin(b)] (v_x - w y) + [sin(b) - cot(g) cos(b)] (v_y + w x) = r omega

Which motions the fixed wheels allow is the null space of their side constraints (the latter's degree of
mobility).
"""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from controllers.matrices import product, singular_values
from controllers.motion.body_motion import BodyMotion
from controllers.motion.wheel_settings import WheelSettings

Matrix = NDArray[np.float64]

CLOSEST_M = 0.005
"""Two contact points that are closer are one."""
SAME_DIRECTION = 1e-6
LEAST_CONTROL = 0.02
"""Least singular value, over the greatest, of what motors and steering control; lengths over the rover's."""
TEST_MOTIONS = ((0.9, 0.31, 0.27), (-0.2, 0.8, 0.7), (0.5, -0.6, -1.1))
"""Ordinary motions (length 1) at which control is tested: no wheel is at rest in them by chance."""


def contact_velocity(wheel: WheelSettings, motion: BodyMotion) -> tuple[float, float]:
    """Return the velocity of the contact point along x and y of the body, in m/s."""
    x, y, turn = motion
    return x + 0.0 - turn * wheel.y_m, y + 0.0 + turn * wheel.x_m


def rolling_row(wheel: WheelSettings, steering_rad: float = 0.0) -> BodyMotion:
    """Return r omega per body velocity (m/s per m/s, m/s, rad/s)."""
    direction_rad = math.radians(wheel.angle_deg) + steering_rad
    cosine, sine = math.cos(direction_rad), math.sin(direction_rad)
    if wheel.roller_deg is not None:
        # A right angle has no cotangent in floats: 6e-17 instead of 0.
        cotangent = 0.0 if abs(wheel.roller_deg) == 90.0 else 1.0 / math.tan(math.radians(wheel.roller_deg))
        cosine, sine = cosine + cotangent * sine, sine - cotangent * cosine
    return _contact_row(wheel, cosine, sine)


def side_row(wheel: WheelSettings, steering_rad: float = 0.0) -> BodyMotion:
    """Return the side slip velocity of an ordinary wheel per body velocity (m/s per m/s, m/s, rad/s)."""
    direction_rad = math.radians(wheel.angle_deg) + steering_rad
    return _contact_row(wheel, -math.sin(direction_rad), math.cos(direction_rad))


def _contact_row(wheel: WheelSettings, along: float, aside: float) -> BodyMotion:
    """Return the velocity of the contact point in a direction per body velocity."""
    # 0.0 is added so that no zero has a sign, which numpy's sums have not either.
    return along + 0.0, aside + 0.0, along * -wheel.y_m + aside * wheel.x_m + 0.0


def is_fixed(wheel: WheelSettings) -> bool:
    """Return whether the wheel neither steers nor has rollers."""
    return wheel.steering is None and wheel.roller_deg is None


def skids_in_turns(wheels: Sequence[WheelSettings]) -> bool:
    """Return whether the fixed wheels must slip sideways in every turn: their axles are not in one line."""
    rows = [side_row(wheel) for wheel in wheels if is_fixed(wheel)]
    return len(rows) > 1 and int((singular_values(np.array(rows))[1] > CLOSEST_M).sum()) > 1


def null_space(rows: Matrix) -> Matrix:
    """Return an orthonormal basis, shape (3, n), of the body velocities for which all `rows` are zero."""
    if not len(rows):
        return np.eye(3)
    _, values, right = singular_values(rows)
    return right[:, values <= SAME_DIRECTION * max(float(values[0]), 1.0)]


def allowed_motions(wheels: Sequence[WheelSettings]) -> Matrix:
    """Return a basis, shape (3, n), of the body velocities that the wheels that do not steer allow.

    The fixed wheels of a rover that skids count as one axle in their middle.
    """
    fixed = [wheel for wheel in wheels if is_fixed(wheel)]
    if not fixed:
        return np.eye(3)
    rows = np.array([side_row(wheel) for wheel in fixed])
    return null_space(np.mean(_in_one_direction(rows), axis=0)[None, :] if skids_in_turns(wheels) else rows)


def find_wheel_conflicts(wheels: Sequence[WheelSettings]) -> Iterator[str]:
    """Yield why a rover cannot drive on these wheels, the first cause first."""
    for (first, one), (second, other) in combinations(enumerate(wheels), 2):
        if math.dist((one.x_m, one.y_m), (other.x_m, other.y_m)) < CLOSEST_M:
            yield (
                f"wheels {first} and {second} are at one place ({one.x_m:g}, {one.y_m:g}) m: "
                "correct x_m or y_m of one of them"
            )
    if not any(wheel.driven for wheel in wheels):
        yield "no wheel is driven: set driven = true for the wheels with a motor"
        return
    yield from _find_crossed_axles(wheels)
    motions = allowed_motions(wheels)
    yield from _find_idle_wheels(wheels, motions)
    yield from _find_missing_control(wheels, motions)
    yield from _find_missing_encoders(wheels, motions)


def size_m(wheels: Sequence[WheelSettings]) -> float:
    """Return the greatest distance of a wheel from the origin, at least 0.01 m."""
    return max(0.01, *(math.hypot(wheel.x_m, wheel.y_m) for wheel in wheels))


def _find_crossed_axles(wheels: Sequence[WheelSettings]) -> Iterator[str]:
    fixed = [(index, wheel) for index, wheel in enumerate(wheels) if is_fixed(wheel)]
    for index, wheel in fixed[1:]:
        first, reference = fixed[0]
        if abs(math.sin(math.radians(wheel.angle_deg - reference.angle_deg))) > SAME_DIRECTION:
            yield (
                f"these wheels cannot drive: wheels {first} and {index} roll in different directions, and "
                "neither steers nor has rollers: correct angle_deg, or add steering or roller_deg"
            )
            return


def _find_idle_wheels(wheels: Sequence[WheelSettings], motions: Matrix) -> Iterator[str]:
    for index, wheel in enumerate(wheels):
        if wheel.driven or wheel.steering is not None:
            continue
        rolled = product(np.array([rolling_row(wheel)]), motions)
        if float(np.max(np.abs(rolled), initial=0.0)) < SAME_DIRECTION:
            yield (
                f"wheel {index} is turned by nothing: no motor drives it, and no motion that the other "
                "wheels allow rolls it: correct its place or angle_deg, or leave it out"
            )


def _find_missing_control(wheels: Sequence[WheelSettings], motions: Matrix) -> Iterator[str]:
    if float(np.max(np.abs(null_space(motions.T)[0]), initial=0.0)) > SAME_DIRECTION:
        yield (
            "these wheels cannot drive: they do not allow straight motion along x: correct angle_deg of "
            "the wheels that neither steer nor have rollers"
        )
        return
    controlled = min(_determined(wheels, motions, lambda wheel: wheel.driven))
    if controlled < motions.shape[1]:
        yield (
            f"these wheels cannot drive: they allow {motions.shape[1]} independent motions, but motors "
            f"and steering control {controlled}: drive or steer more wheels, or add fixed wheels"
        )


def _find_missing_encoders(wheels: Sequence[WheelSettings], motions: Matrix) -> Iterator[str]:
    if all(wheel.measured for wheel in wheels):
        return
    if not any(wheel.measured for wheel in wheels):
        yield "no wheel is measured: remove measured = false of those that have an encoder"
        return
    # Only in a turn about the one wheel with an encoder is nothing seen: that is no ordinary motion.
    known = max(_determined(wheels, motions, lambda wheel: wheel.measured))
    if known < motions.shape[1]:
        yield (
            f"these wheels do not show the motion: they allow {motions.shape[1]} independent motions, but "
            f"encoders and steering angles determine {known}: measure more wheels"
        )


def _determined(
    wheels: Sequence[WheelSettings], motions: Matrix, rolls: Callable[[WheelSettings], bool]
) -> list[int]:
    """Return how many independent motions steering and rolling wheels determine, in each test motion."""
    # Orthonormal where the yaw rate counts as the speed of the outermost wheel.
    unit = np.array([1.0, 1.0, 1.0 / size_m(wheels)])
    orthonormal = singular_values(motions / unit[:, None])[0]
    counts: list[int] = []
    for ordinary in TEST_MOTIONS:
        motion = unit * product(orthonormal, product(orthonormal.T, np.array(ordinary)))
        x, y, turn = motion.tolist()
        rows = product(_known_rows(wheels, (x, y, turn), rolls), unit[:, None] * orthonormal)
        values = singular_values(rows)[1]
        counts.append(int(np.sum(values >= LEAST_CONTROL * values[0])))
    return counts


def _known_rows(
    wheels: Sequence[WheelSettings], motion: BodyMotion, rolls: Callable[[WheelSettings], bool]
) -> Matrix:
    """Return constraints by steering and rolling, shape (n, 3), with the steering angles for `motion`."""
    rows = []
    for wheel in wheels:
        steering_rad = 0.0
        if wheel.steering is not None:
            along, aside = contact_velocity(wheel, motion)
            steering_rad = math.atan2(aside, along) - math.radians(wheel.angle_deg)
            rows.append(side_row(wheel, steering_rad))
        if rolls(wheel):
            rows.append(rolling_row(wheel, steering_rad))
    return np.array(rows)


def _in_one_direction(rows: Matrix) -> Matrix:
    """Return parallel rows with the same sign."""
    signs = np.sign(product(rows[:, :2], rows[0, :2]))
    turned: Matrix = rows * signs[:, None]
    return turned
