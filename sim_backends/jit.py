"""Compilation with numba that keeps the signatures of the functions for type checkers."""

from collections.abc import Callable
from typing import Any, Literal, TypeVar, cast

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


def specialised(function: FunctionT, *arguments: object) -> FunctionT:
    """Return a compiled function for arguments of exactly the types of `arguments`.

    numba otherwise finds out the types of all arguments in every call, which takes longer than a short
    integration when they are tuples of arrays. Types are not checked: other ones give nonsense.

    Args:
        function: A function that `compiled` has decorated.
        arguments: All of its arguments in order; it is not called.
    """
    dispatcher: Any = function
    types = tuple(numba.typeof(argument) for argument in arguments)  # type: ignore[no-untyped-call]
    dispatcher.compile(types)
    return cast("FunctionT", dispatcher.overloads[types].entry_point)
