"""The result of a slip identification, for people and for scripts."""

import math
from collections.abc import Mapping, Sequence

from rich.table import Column, Table

from rover_hil.identify.slip.identification import Errors, SlipIdentification
from rover_hil.identify.slip.scores import RunError, Score
from rover_hil.terminal import Terminal

SECTOR_DEG = 60
DIGITS = 4

Record = dict[str, object]


def result_record(
    identification: SlipIdentification, tests: Mapping[str, Errors], notes: Sequence[str]
) -> Record:
    """Return what `--json` prints."""
    counts: dict[str, int] = {}
    for run in identification.trained_on:
        counts[run.surface] = counts.get(run.surface, 0) + 1
    return {
        "scale_mm_per_px": identification.scale.mm_per_px,
        "scale_error": identification.scale.is_scale_error,
        "scale_verdict": identification.scale.verdict,
        "camera_yaw_deg": None
        if identification.scale.drift_rad is None
        else _degrees(identification.scale.drift_rad),
        "trained_on": counts,
        "notes": list(notes),
        "cross_validation": errors_record(identification.cross_validation),
        "tests": {name: errors_record(errors) for name, errors in tests.items()},
    }


def errors_record(errors: Errors) -> Record:
    """Return rms, bias, n and invalid share of each map, over all runs and per surface."""
    return {
        name: {
            **_score_record(Score.of(run_errors)),
            "per_surface": {
                surface: _score_record(Score.of(part)) for surface, part in _by_surface(run_errors).items()
            },
        }
        for name, run_errors in errors.items()
    }


def print_result(
    console: Terminal, identification: SlipIdentification, tests: Mapping[str, Errors], notes: Sequence[str]
) -> None:
    """Print the result for people."""
    console.print(identification.scale.verdict)
    for note in notes:
        console.print(f"Note: {note}")
    console.print(
        "\nDistance error as a fraction of encoder distance, per run: rms (bias). "
        "'not valid' is the share of the distance for which the map flags its own slip."
    )
    console.print(
        _surface_table("Cross-validation within the training runs", identification.cross_validation)
    )
    console.print(_direction_table(identification.cross_validation))
    for name, errors in tests.items():
        console.print(_surface_table(f"Test: {name}", errors))


def _surface_table(title: str, errors: Errors) -> Table:
    surfaces = sorted({item.surface for run_errors in errors.values() for item in run_errors})
    heads = ("runs", "all", *surfaces, "not valid")
    table = Table(Column("map", no_wrap=True), *heads, title=title, title_justify="left")
    for name, run_errors in errors.items():
        parts = _by_surface(run_errors)
        score = Score.of(run_errors)
        cells = [_cell(Score.of(parts.get(surface, []))) for surface in surfaces]
        invalid = "-" if math.isnan(score.invalid) else f"{score.invalid:.0%}"
        table.add_row(name, str(score.n), _cell(score), *cells, invalid)
    return table


def _direction_table(errors: Errors) -> Table:
    sectors = range(-180, 180, SECTOR_DEG)
    half = SECTOR_DEG // 2
    title = f"Cross-validation per direction of travel, ± {half} degrees: rms"
    heads = [str(sector + half) for sector in sectors]
    table = Table(Column("map", no_wrap=True), *heads, title=title, title_justify="left")
    for name, run_errors in errors.items():
        parts: dict[int, list[RunError]] = {}
        for item in run_errors:
            sector = math.floor(math.degrees(item.direction_rad) / SECTOR_DEG) * SECTOR_DEG
            parts.setdefault(min(sector, sectors[-1]), []).append(item)
        scores = [Score.of(parts.get(sector, [])) for sector in sectors]
        table.add_row(name, *(f"{score.rms:.3f}" if score.n else "-" for score in scores))
    return table


def _by_surface(run_errors: Sequence[RunError]) -> dict[str, list[RunError]]:
    names = sorted({item.surface for item in run_errors})
    return {name: [item for item in run_errors if item.surface == name] for name in names}


def _cell(score: Score) -> str:
    return f"{score.rms:.3f} ({score.bias:+.3f})" if score.n else "-"


def _degrees(angle_rad: float) -> float:
    return round(math.degrees(angle_rad), DIGITS)


def _score_record(score: Score) -> Record:
    numbers = {"rms": score.rms, "bias": score.bias, "invalid": score.invalid}
    record: Record = {
        key: None if math.isnan(value) else round(value, DIGITS) for key, value in numbers.items()
    }
    return {**record, "n": score.n}
