"""Compilation with numba that keeps the signatures of the functions for type checkers."""

from collections.abc import Callable
from typing import Literal, TypeVar, cast

import numba

FunctionT = TypeVar("FunctionT", bound=Callable[..., object])


def compiled(
    *,
    fastmath: bool | set[str] = False,
    error_model: Literal["python", "numpy"] = "python",
    is_parallel: bool = False,
) -> Callable[[FunctionT], FunctionT]:
    """Return numba's `njit` decorator with these options and its cache on disk.

    Args:
        fastmath: See numba.
        error_model: See numba.
        is_parallel: Other threads may run meanwhile.
    """

    def decorate(function: FunctionT) -> FunctionT:
        options = numba.njit(cache=True, fastmath=fastmath, error_model=error_model, nogil=is_parallel)
        return cast("FunctionT", options(function))

    return decorate
