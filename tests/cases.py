"""Parametrized tests of which every `make test` runs the first case, and `make test-nightly` the others."""

from collections.abc import Iterable
from typing import Any

import pytest


def first_often(cases: Iterable[Any]) -> list[Any]:
    """Return the cases; all but the first are marked nightly.

    Args:
        cases: Values of `pytest.mark.parametrize`; tuples for several arguments.
    """
    first, *others = cases
    marked = [
        pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.nightly)
        for case in others
    ]
    return [first, *marked]
