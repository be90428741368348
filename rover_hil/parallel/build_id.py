"""A text that is the same on two computers only where both compute the same numbers."""

from rover_hil.recording.made_with import C_LIBRARY, PROCESSOR, made_with

NOT_COMPARED = (C_LIBRARY, PROCESSOR)
"""Computers that differ in these alone give the same bits: `benchmarks.tuning.other_processors`."""


def build_id() -> str:
    """Return a text that differs where a call could give other numbers: source, Python, numeric packages."""
    return ", ".join(f"{name} {fact}" for name, fact in made_with().items() if name not in NOT_COMPARED)
