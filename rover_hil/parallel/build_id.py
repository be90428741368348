"""A text that is the same on two computers only where both compute the same numbers."""

from rover_hil.recording.made_with import BLAS_KERNEL, C_LIBRARY, PROCESSOR, made_with

NOT_COMPARED = (C_LIBRARY, PROCESSOR)
"""Computers that differ in these alone give the same bits: `benchmarks.tuning.other_processors`."""


def build_id(*, uses_blas: bool = True) -> str:
    """Return a text that differs where a call could give other numbers: source, Python, numeric packages.

    Args:
        uses_blas: Whether the calls multiply matrices by BLAS, as fits and the evaluation of pictures do. The
            control cycle and the simulated rovers do not.
    """
    left_out = NOT_COMPARED if uses_blas else (*NOT_COMPARED, BLAS_KERNEL)
    return ", ".join(f"{name} {fact}" for name, fact in made_with().items() if name not in left_out)
