"""What `rover-hil gap rover` answers on the drives, in one sentence."""

from collections.abc import Callable, Sequence
from pathlib import Path

from drivers.errors import RoverHilError
from rover_hil.config import Config
from rover_hil.gap.data.described_wheels import wheels_by_geometry
from rover_hil.gap.data.rover_logs import read_rover_runs
from rover_hil.gap.workflow import analyse

MOST_ANALYSED = 6
"""More drives are not analysed: time."""


def gap_answer(logs: Sequence[Path], config: Config, advance: Callable[[str], None]) -> str:
    """Return the verdict on the model of the wheels with its warnings, or why there is none.

    Args:
        logs: Drives with known places, the longest first; the first `MOST_ANALYSED` are analysed.
        config: Of the rover, with the corrected wheels where these are accepted.
        advance: Called with the current step.
    """
    used = logs[:MOST_ANALYSED]
    if not used:
        return "not asked: no drive has known places to compare with"
    try:
        described = wheels_by_geometry(str(used[0]), config)
        model = described.model
        verdict = analyse(model, read_rover_runs(model, used), advance=advance).verdict
    except RoverHilError as error:
        return f"not asked: {error}"
    of = f" ({MOST_ANALYSED} of {len(logs)} drives)" if len(used) < len(logs) else ""
    assumed = [described.assumed] if described.assumed else []
    warnings = "".join(f" Warning: {text}." for text in (*assumed, *verdict.warnings))
    return f"{verdict.verdict}{of}: {verdict.sentence}{warnings}"
