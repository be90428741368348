"""Compilation with numba that keeps the signatures of the functions for type checkers."""

from collections.abc import Callable
from typing import TypeVar, cast

import numba

FunctionT = TypeVar("FunctionT", bound=Callable[..., object])


def compiled(**options: object) -> Callable[[FunctionT], FunctionT]:
    """Return the decorator `numba.njit(cache=True, **options)`."""

    def decorate(function: FunctionT) -> FunctionT:
        return cast("FunctionT", numba.njit(cache=True, **options)(function))

    return decorate
