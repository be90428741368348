"""The first call of the linear algebra, made while nothing can be hurt yet.

OpenBLAS allocates its working memory at its first call and keeps it. With little memory left that call tries
again for ever inside C, holding the interpreter's lock, so that no other thread runs and no signal is
answered; other builds end the process. NumPy and SciPy bring a library each.
"""

import numpy as np

from drivers.safety_event import Outcome, SafetyEvent

EVENTS = (
    SafetyEvent(
        Outcome.CONTINUES,
        "Little memory is left when the loop computes for the first time.",
        "no effect: NumPy and SciPy have allocated before a port is opened",
        (
            "tests/rover_hil/test_linear_algebra.py::"
            "test_the_working_memory_is_allocated_before_the_drive_opens",
        ),
    ),
)
"""Rows of the reference page of safety."""


def allocate_linear_algebra() -> None:
    """Let the libraries of the loop's linear algebra allocate now; called before any port is opened."""
    from scipy.linalg.lapack import dpotrf  # a second to load, which only a run needs

    matrix = np.eye(2)
    np.linalg.solve(matrix, matrix)
    dpotrf(matrix)
