"""The first call of the linear algebra, made while nothing can be hurt yet.

OpenBLAS allocates its working memory at its first call and keeps it. With little memory left that call tries
again for ever inside C, holding the interpreter's lock, so that no other thread runs and no signal is
answered; other builds end the process. NumPy and SciPy bring a library each.
"""

import numpy as np


def allocate_linear_algebra() -> None:
    """Let the libraries of the loop's linear algebra allocate now; called before any port is opened."""
    from scipy.linalg.lapack import dpotrf  # a second to load, which only a run needs

    matrix = np.eye(2)
    np.linalg.solve(matrix, matrix)
    dpotrf(matrix)
