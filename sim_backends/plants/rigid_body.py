"""Plane motion of a rigid body in its own frame: momentum of a step, and the equations for the next twist."""

from sim_backends.arrays import Array
from sim_backends.jit import compiled

_compiled = compiled()


@_compiled
def momentum_over_step(twist: Array, mass: Array, step_s: float, result: Array) -> None:
    """Compute the momentum over the length of a step, with the terms of the rotating frame.

    Args:
        twist: Velocity x, y in m/s and yaw rate in rad/s, shape (3,).
        mass: Mass matrix in kg, kg m and kg m^2, (3, 3).
        step_s: Length of the step.
        result: Forces in N and a yaw moment in N m, (3,). Source: Newton and Euler in a rotating frame.
    """
    x = mass[0, 0] * twist[0] + mass[0, 1] * twist[1] + mass[0, 2] * twist[2]
    y = mass[1, 0] * twist[0] + mass[1, 1] * twist[1] + mass[1, 2] * twist[2]
    turn = mass[2, 0] * twist[0] + mass[2, 1] * twist[1] + mass[2, 2] * twist[2]
    result[0] = x / step_s + twist[2] * y
    result[1] = y / step_s - twist[2] * x
    result[2] = turn / step_s - (twist[0] * y - twist[1] * x)


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
