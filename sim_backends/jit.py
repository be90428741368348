"""Compilation with numba that keeps the signatures of the functions for type checkers."""

from collections.abc import Callable
from typing import Literal, TypeVar, cast

import numba

FunctionT = TypeVar("FunctionT", bound=Callable[..., object])


def compiled(
    *, fastmath: bool | set[str] = False, error_model: Literal["python", "numpy"] = "python"
) -> Callable[[FunctionT], FunctionT]:
    """Return numba's `njit` decorator with these options and its cache on disk."""

    def decorate(function: FunctionT) -> FunctionT:
        return cast("FunctionT", numba.njit(cache=True, fastmath=fastmath, error_model=error_model)(function))

    return decorate
