"""Products and inverses of small matrices whose bits are the same on every processor.

numpy gives products to BLAS and inverses to LAPACK, whose kernels differ in the last bits from processor to
processor: a log would replay exactly only on the kind of computer that made it. Here every product is
rounded, and the sums have one order. For matrices of up to about twenty rows.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

SWEEPS = 30
"""Far more than rotations of three columns need; each sweep squares what is left."""
WELL_CONDITIONED = 1e-4
"""Least eigenvalue over the sum of all, from which on the normal equations lose four digits at most."""
ROUNDING = 4.0 * float(np.finfo(float).eps)


def product(left: Array, right: Array) -> Array:
    """Return the product of a matrix, shape (n, k), with a matrix (k, m) or a vector (k,)."""
    terms: Array = left * right if right.ndim == 1 else left[:, :, None] * right
    total: Array = terms.sum(axis=1)
    return total


def complex_product(values: ComplexArray, factor: complex) -> ComplexArray:
    """Return complex numbers times a complex number: numpy's own product is fused on some processors."""
    result = np.empty_like(values)
    result.real = values.real * factor.real - values.imag * factor.imag
    result.imag = values.real * factor.imag + values.imag * factor.real
    return result


def solve(matrix: Array, right: Array) -> Array:
    """Return x of `matrix` x = `right`, shapes (n, n) and (n, m), by elimination with pivoting.

    Raises:
        ZeroDivisionError: The matrix is singular.
    """
    size = len(matrix)
    rows = [[*left, *values] for left, values in zip(matrix.tolist(), right.tolist(), strict=True)]
    for column in range(size):
        pivot = max(range(column, size), key=lambda index: abs(rows[index][column]))
        rows[column], rows[pivot] = rows[pivot], rows[column]
        chosen = rows[column] = [value / rows[column][column] for value in rows[column]]
        for index, row in enumerate(rows):
            share = row[column]
            if index != column and share != 0.0:
                rows[index] = [value - share * less for value, less in zip(row, chosen, strict=True)]
    return np.array(rows)[:, size:]


def inverse(matrix: Array) -> Array:
    """Return the inverse of a square matrix.

    Raises:
        ZeroDivisionError: The matrix is singular.
    """
    return solve(matrix, np.eye(len(matrix)))


def is_positive_definite(matrix: Array) -> bool:
    """Return whether all pivots of a symmetric matrix are greater than zero."""
    rows = matrix.tolist()
    for column, row in enumerate(rows):
        pivot = row[column]
        if not pivot > 0.0:
            return False
        for later in rows[column + 1 :]:
            share = later[column]
            if share != 0.0:
                share /= pivot
                for index in range(column + 1, len(rows)):
                    later[index] -= share * row[index]
    return True


def singular_values(matrix: Array) -> tuple[Array, Array, Array]:
    """Return u, s and v of `matrix` = u diag(s) v^T, shapes (n, k), (k,) and (k, k), greatest value first.

    One-sided Jacobi rotations. A column of u is zero where its singular value is.
    """
    left: list[Array] = [np.array(column) for column in matrix.T]
    right: list[Array] = list(np.eye(len(left)))
    for _ in range(SWEEPS):
        turned = False
        for first in range(len(left)):
            for second in range(first + 1, len(left)):
                turned |= _make_orthogonal(left, right, first, second)
        if not turned:
            break
    values = [math.sqrt(float((column * column).sum())) for column in left]
    order = sorted(range(len(values)), key=lambda index: -values[index])
    unit = [left[i] / values[i] if values[i] > 0.0 else left[i] for i in order]
    rows = len(matrix)
    return (
        np.array(unit).reshape(len(order), rows).T,
        np.array([values[i] for i in order]),
        np.array([right[i] for i in order]).reshape(len(order), len(order)).T,
    )


def _make_orthogonal(left: list[Array], right: list[Array], first: int, second: int) -> bool:
    """Rotate two columns so that they are orthogonal; return whether they were not."""
    a, b = left[first], left[second]
    aa, bb, ab = float((a * a).sum()), float((b * b).sum()), float((a * b).sum())
    if abs(ab) <= ROUNDING * math.sqrt(aa * bb):
        return False
    half = (bb - aa) / (2.0 * ab)
    tangent = math.copysign(1.0, half) / (abs(half) + math.sqrt(1.0 + half * half))
    cosine = 1.0 / math.sqrt(1.0 + tangent * tangent)
    sine = cosine * tangent
    for columns in (left, right):
        a, b = columns[first], columns[second]
        columns[first], columns[second] = cosine * a - sine * b, sine * a + cosine * b
    return True


def rank(matrix: Sequence[Sequence[float]], tolerance: float) -> int:
    """Return the number of pivots above a tolerance in elimination with full pivoting."""
    rows = list(matrix)
    found = 0
    while rows:
        sizes = [max(map(abs, row)) for row in rows]
        size = max(sizes)
        if size <= tolerance:
            break
        found += 1
        pivot = rows.pop(sizes.index(size))
        column = list(map(abs, pivot)).index(size)
        shares = [row[column] / pivot[column] for row in rows]
        rows = [
            [value - share * less for value, less in zip(row, pivot, strict=True)]
            for share, row in zip(shares, rows, strict=True)
        ]
    return found


def pseudo_inverse(matrix: Array, relative_tolerance: float) -> Array:
    """Return the Moore-Penrose inverse, shape (k, n); singular values below the tolerance count as zero.

    Args:
        matrix: Shape (n, k), with few columns.
        relative_tolerance: Of the greatest singular value.
    """
    gram = product(matrix.T, matrix)
    smallest = WELL_CONDITIONED * float(np.trace(gram)) * np.eye(len(gram))
    if len(gram) and is_positive_definite(gram - smallest):
        return solve(gram, matrix.T)
    u, values, v = singular_values(matrix)
    kept = values > relative_tolerance * values.max(initial=0.0)
    return product(v[:, kept] / values[kept], u[:, kept].T)
