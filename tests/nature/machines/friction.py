"""Dry friction that really sticks: modes of one sliding contact."""

import math

from numba import njit, types

FREE = 0
FORWARD = 1
BACKWARD = -1
STUCK = 2


@njit(
    types.float64(types.int64, types.float64, types.float64, types.float64, types.float64, types.float64),
    cache=True,
)
def dry_force(
    mode: int, speed: float, forward: float, backward: float, extra: float, speed_scale: float
) -> float:
    """Return the friction of a sliding contact; it points against the motion.

    Args:
        mode: `FREE` and `STUCK` give no force: a stuck contact is held by its constraint.
        speed: Of the contact.
        forward: Friction when it slides forward fast.
        backward: Friction when it slides backward fast.
        extra: More friction at rest.
        speed_scale: Speed at which `extra` has fallen to 1/e.
    """
    if extra > 0.0:
        extra *= math.exp(-((speed / speed_scale) ** 2))
    if mode == FORWARD:
        return -(forward + extra)
    return backward + extra if mode == BACKWARD else 0.0


@njit(types.float64(types.int64, types.float64, types.float64, types.float64, types.float64), cache=True)
def contact_guard(mode: int, speed: float, push: float, forward: float, backward: float) -> float:
    """Return a number that is negative once the contact leaves its mode.

    Args:
        mode: Of the contact.
        speed: Of the contact.
        push: Force on the contact without its friction.
        forward: Friction that holds it against a push forward.
        backward: Friction that holds it against a push backward.
    """
    if mode == FREE:
        return 1.0
    if mode == STUCK:
        return min(forward - push, push + backward)
    return speed * mode


@njit(types.int64(types.float64, types.float64, types.float64, types.float64), cache=True)
def contact_mode(speed: float, push: float, forward: float, backward: float) -> int:
    """Return the mode of a contact from its speed and, if it rests, from the push on it."""
    if forward == 0.0 and backward == 0.0:
        return FREE
    if speed != 0.0:
        return FORWARD if speed > 0.0 else BACKWARD
    if push > forward:
        return FORWARD
    return BACKWARD if push < -backward else STUCK
