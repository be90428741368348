"""Small matrices: numpy's answers, and no call of BLAS or LAPACK in the cycle."""

import ast
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from controllers.matrices import (
    complex_product,
    inverse,
    is_positive_definite,
    product,
    pseudo_inverse,
    rank,
    singular_values,
    solve,
)

Array = NDArray[np.float64]

CONTROLLERS = Path(__file__).parents[2] / "controllers"
WITH_LINEAR_ALGEBRA = {
    "ftrace": "pictures: OpenCV's own arithmetic depends on the processor, too",
    "ground_motion": "pictures",
}
FORBIDDEN = ("dot", "matmul", "inner", "vdot", "tensordot", "linalg")

numbers = st.integers(-24, 24).map(lambda eighths: eighths / 8)


def matrices(rows: int, columns: int) -> st.SearchStrategy[Array]:
    return arrays(np.float64, (rows, columns), elements=numbers)


@given(left=matrices(4, 3), right=matrices(3, 5), vector=arrays(np.float64, 3, elements=numbers))
def test_a_product_is_numpys(left: Array, right: Array, vector: Array) -> None:
    assert product(left, right) == pytest.approx(left @ right, abs=1e-13)
    assert product(left, vector) == pytest.approx(left @ vector, abs=1e-13)


def test_the_product_of_nothing_is_zero() -> None:
    assert product(np.ones((2, 0)), np.ones((0, 3))).tolist() == np.zeros((2, 3)).tolist()


@given(
    values=arrays(np.complex128, 4, elements=st.complex_numbers(max_magnitude=9.0, allow_subnormal=False)),
    factor=st.complex_numbers(max_magnitude=9.0, allow_subnormal=False),
)
def test_a_complex_product_is_pythons_to_the_last_bit(
    values: NDArray[np.complex128], factor: complex
) -> None:
    assert complex_product(values, factor).tolist() == [value * factor for value in values.tolist()]


@given(root=matrices(4, 4), right=matrices(4, 2))
def test_equations_and_inverses_are_solved(root: Array, right: Array) -> None:
    matrix = root @ root.T + 0.1 * np.eye(4)
    assert matrix @ solve(matrix, right) == pytest.approx(right, abs=1e-9)
    assert matrix @ inverse(matrix) == pytest.approx(np.eye(4), abs=1e-9)


def test_a_singular_matrix_has_no_inverse() -> None:
    with pytest.raises(ZeroDivisionError):
        inverse(np.ones((2, 2)))


def test_rows_are_exchanged_where_a_pivot_is_zero() -> None:
    swap = np.array([[0.0, 2.0], [4.0, 0.0]])
    assert inverse(swap).tolist() == [[0.0, 0.25], [0.5, 0.0]]


@given(root=matrices(4, 4), shift=st.floats(-1.0, 1.0))
def test_positive_definite_is_what_the_eigenvalues_say(root: Array, shift: float) -> None:
    matrix = 0.5 * (root + root.T) + shift * np.eye(4)
    least = float(np.linalg.eigvalsh(matrix)[0])
    if abs(least) > 1e-9:
        assert is_positive_definite(matrix) is (least > 0.0)


def test_a_matrix_that_is_not_a_number_is_not_positive_definite() -> None:
    assert not is_positive_definite(np.array([[np.nan]]))
    assert not is_positive_definite(np.zeros((1, 1)))


@given(matrix=st.one_of(matrices(6, 3), matrices(2, 3), matrices(3, 3)))
def test_singular_values_and_vectors_give_the_matrix_again(matrix: Array) -> None:
    u, values, v = singular_values(matrix)
    assert (u * values) @ v.T == pytest.approx(matrix, abs=1e-12)
    assert v.T @ v == pytest.approx(np.eye(3), abs=1e-12)
    expected = np.r_[np.linalg.svd(matrix, compute_uv=False), 0.0][:3]
    assert values == pytest.approx(expected, abs=1e-12)
    assert np.all(np.diff(values) <= 0.0)


@given(
    matrix=st.one_of(matrices(6, 3), matrices(2, 3)),
    is_dependent=st.booleans(),
)
def test_a_pseudo_inverse_is_numpys(matrix: Array, is_dependent: bool) -> None:
    if is_dependent:
        matrix = matrix.copy()
        matrix[:, 2] = matrix[:, 0] - 0.5 * matrix[:, 1]
    assert pseudo_inverse(matrix, 1e-9) == pytest.approx(np.linalg.pinv(matrix, rcond=1e-9), abs=1e-9)


def test_the_pseudo_inverse_of_no_column_is_empty() -> None:
    assert pseudo_inverse(np.ones((4, 0)), 1e-9).shape == (0, 4)


@given(
    left=arrays(np.int_, (5, 2), elements=st.integers(-3, 3)),
    right=arrays(np.int_, (2, 4), elements=st.integers(-3, 3)),
)
def test_the_rank_is_numpys(left: NDArray[np.int_], right: NDArray[np.int_]) -> None:
    matrix = (left @ right).astype(float)
    assert rank(matrix.tolist(), 1e-9) == np.linalg.matrix_rank(matrix)


def _linear_algebra(source: str) -> list[str]:
    """Return what of a source goes to BLAS or LAPACK."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.MatMult):
            found.append(f"line {node.lineno}: @")
        if isinstance(node, ast.Attribute) and node.attr in FORBIDDEN:
            found.append(f"line {node.lineno}: {node.attr}")
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(("filterpy", "scipy.linalg")):
            found.append(f"line {node.lineno}: {node.module}")
    return found


def test_the_cycle_calls_no_blas_and_no_lapack() -> None:
    found = {
        name: calls
        for path in sorted(CONTROLLERS.rglob("*.py"))
        if (name := path.relative_to(CONTROLLERS).as_posix())
        and not name.startswith(tuple(WITH_LINEAR_ALGEBRA))
        and (calls := _linear_algebra(path.read_text()))
    }
    assert found == {}


@pytest.mark.parametrize("line", ["a @ b", "a @= b", "np.dot(a, b)", "a.dot(b)", "np.linalg.inv(a)"])
def test_the_search_for_linear_algebra_finds_it(line: str) -> None:
    assert _linear_algebra(line)
