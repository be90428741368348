"""How well does each slip map predict the distance? All maps beside the paper's, on measured runs.

    python -m benchmarks.robotino.slip_maps ../shared/data/robotino_2023

Prints as JSON the distance error as a fraction of encoder distance, rms over runs (BrOleg5/
research-wheel-slippage), of maps trained on every other run on one surface: on the other half, on the runs
over two surfaces, and on a surface that was left out of training. `linear_m` is the map of paper 003.
`not_valid` is the share of the distance that the map itself marks as not valid; `rms_by_training` is the
rms with each set of training runs alone; the difference is the scatter.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TypedDict

from controllers.slip.effort.motor_model import MotorSettings
from rover_hil.identify.slip.camera_scale import find_scale
from rover_hil.identify.slip.identification import fit_maps, read_all
from rover_hil.identify.slip.run_data import RunWindows
from rover_hil.identify.slip.runs import find_runs
from rover_hil.identify.slip.scores import RunError, Score, score_runs

BARS = (
    ("other_half", "best", 0.12),
    ("two_surfaces", "best", 0.095),
    ("other_half", "best_known_surface", 0.043),
)
"""What the maps must reach: table, map, rms."""


class Row(TypedDict):
    """Errors of one map over n runs, as a fraction of encoder distance."""

    rms: float
    rms_by_training: list[float]
    bias: float
    n: int
    not_valid: float


def main() -> int:
    """Print the table; exit code 1 when a bar is missed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", type=Path)
    data = parser.parse_args().data
    one_surface = _read(data / "one_surface_type")
    two = _read(data / "two_surface_types")
    first, second = _halves(one_surface)
    # The two ways to split are one sample: their errors are put together.
    tables = {
        "other_half": _scores([(first, second), (second, first)]),
        "two_surfaces": _scores([(first, two), (second, two)]),
    }
    names = sorted({run.surface for run in one_surface})
    scale = find_scale(one_surface)
    unseen = {
        name: _scores(
            [([r for r in one_surface if r.surface != name], [r for r in one_surface if r.surface == name])],
            scale.m_per_px,
        )
        for name in names
    }
    print(json.dumps({"scale_mm_per_px": scale.mm_per_px, **tables, "unseen_surface": unseen}, indent=2))
    return 0 if all(tables[table][name]["rms"] <= bar for table, name, bar in BARS) else 1


def _read(folder: Path) -> list[RunWindows]:
    return read_all(find_runs([folder]).files, MotorSettings(), lambda: None)


def _halves(runs: Sequence[RunWindows]) -> tuple[list[RunWindows], list[RunWindows]]:
    """Part the runs by the parity of half their number: the shared set holds the even ones."""
    first = [run for run in runs if _number(run.path) % 4 < 2]
    return first, [run for run in runs if _number(run.path) % 4 >= 2]


def _number(path: Path) -> int:
    return int(path.name.removeprefix("exp").split(".")[0])


def _scores(
    splits: Sequence[tuple[list[RunWindows], list[RunWindows]]], m_per_px: float | None = None
) -> dict[str, Row]:
    errors: dict[str, list[RunError]] = {}
    by_training: dict[str, list[float]] = {}
    for train, test in splits:
        scale = find_scale(train).m_per_px if m_per_px is None else m_per_px
        for name, run_errors in score_runs(fit_maps(train, scale), test, scale).items():
            errors.setdefault(name, []).extend(run_errors)
            by_training.setdefault(name, []).append(round(Score.of(run_errors).rms, 4))
    scores = {name: Score.of(run_errors) for name, run_errors in errors.items() if run_errors}
    return {
        name: {
            "rms": round(score.rms, 4),
            "rms_by_training": by_training[name],
            "bias": round(score.bias, 4),
            "n": score.n,
            "not_valid": round(score.invalid, 3),
        }
        for name, score in scores.items()
    }


if __name__ == "__main__":
    sys.exit(main())
