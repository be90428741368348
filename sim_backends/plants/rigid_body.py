"""Plane motion of a rigid body in its own frame: momentum of a step, and the equations for the next twist."""

import numpy as np

from sim_backends.arrays import Array
from sim_backends.jit import compiled

_compiled = compiled()


@_compiled
def momentum_over_step(twist: Array, mass: Array, step_s: float) -> Array:
    """Return the momentum over the length of a step, with the terms of the rotating frame.

    Args:
        twist: Velocity x, y in m/s and yaw rate in rad/s, shape (3,).
        mass: Mass matrix in kg, kg m and kg m^2, (3, 3).
        step_s: Length of the step.

    Returns:
        Forces in N and a yaw moment in N m, (3,). Source: Newton and Euler in a rotating frame.
    """
    momentum = np.empty(3)
    for i in range(3):
        momentum[i] = mass[i, 0] * twist[0] + mass[i, 1] * twist[1] + mass[i, 2] * twist[2]
    result = momentum / step_s
    result[0] += twist[2] * momentum[1]
    result[1] -= twist[2] * momentum[0]
    result[2] -= twist[0] * momentum[1] - twist[1] * momentum[0]
    return result


@_compiled
def solve(matrix: Array, right: Array, solution: Array) -> None:
    """Solve three equations by elimination, without pivots: the matrix is symmetric and positive definite."""
    for k in range(3):
        for i in range(k + 1, 3):
            factor = matrix[i, k] / matrix[k, k]
            right[i] -= factor * right[k]
            for j in range(k, 3):
                matrix[i, j] -= factor * matrix[k, j]
    for i in range(2, -1, -1):
        residual = right[i]
        for j in range(i + 1, 3):
            residual -= matrix[i, j] * solution[j]
        solution[i] = residual / matrix[i, i]
