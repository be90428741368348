"""Result of a tuning by logs: as JSON, as a page, and as a new configuration."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic_core import to_json

from rover_hil.config.tune_settings import (
    ChangeRecord,
    LogObjectiveSettings,
    ProvenanceRecord,
    TuneSettings,
)
from rover_hil.pages.render import render
from rover_hil.tune.comparison import Comparison, Verdict
from rover_hil.tune.importance import importance
from rover_hil.tune.journal import Attempt
from rover_hil.tune.logs.figures import LogTuningData, draw_log_report
from rover_hil.tune.logs.judged_log import JudgedLog
from rover_hil.tune.logs.objective import describe_logs, log_cost, pooled_terms
from rover_hil.tune.logs.replayed_log import ReplayedLog
from rover_hil.tune.objective import Evaluation
from rover_hil.tune.results import GRADES, REPORT_NAME, RESULT_NAME, write_files_of


@dataclass(frozen=True, slots=True, kw_only=True)
class LogCost:
    """Costs of one held-out log alone; None where the values are rejected.

    Attributes:
        judge: What its estimates were compared with.
    """

    log: str
    judge: str
    before: float | None
    after: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LogTuningResult:
    """Result of a tuning by logs.

    Attributes:
        start: The configuration it started from.
        trials: Finished trials; of these, `refused` were rejected.
        cost_before, cost_after: On all held-out logs; None where the values were rejected.
        start_refused: Why the old values are rejected; empty when they are acceptable.
        values: Every tunable value, changed or not.
        terms_before, terms_after: Measured values on all held-out logs, by the objective's names.
        held_out: Costs of each held-out log.
        declined: Candidates that were compared on the held-out logs and not taken.
        importance: See `rover_hil.tune.importance`.
    """

    study: str
    verdict: Verdict
    date: str
    start: str
    trials: int
    refused: int
    objective: str
    train_logs: tuple[str, ...]
    held_out_logs: tuple[str, ...]
    cost_before: float | None
    cost_after: float | None
    start_refused: str
    values: dict[str, ChangeRecord]
    terms_before: dict[str, float]
    terms_after: dict[str, float]
    held_out: tuple[LogCost, ...]
    declined: tuple[str, ...]
    importance: dict[str, float]


def summarise_logs(
    study: str,
    start: str,
    date: str,
    tune: TuneSettings,
    objective: LogObjectiveSettings,
    start_values: dict[str, float],
    logs: tuple[Sequence[JudgedLog], Sequence[JudgedLog]],
    attempts: Sequence[Attempt],
    comparison: Comparison[ReplayedLog],
) -> LogTuningResult:
    """Return the numbers of a tuning; `logs` are those of training and those held out."""
    train, held_out = logs
    before, after = (_costs(side, objective) for side in (comparison.start, comparison.tuned))
    return LogTuningResult(
        study=study,
        verdict=comparison.verdict,
        date=date,
        start=start,
        trials=len(attempts),
        refused=sum(1 for attempt in attempts if attempt.refused),
        objective=describe_logs(objective),
        train_logs=tuple(log.name for log in train),
        held_out_logs=tuple(log.name for log in held_out),
        cost_before=comparison.start.cost,
        cost_after=comparison.tuned.cost,
        start_refused=comparison.start.refused,
        values={
            key: ChangeRecord(before=start_values[key], after=comparison.values[key], unit=parameter.unit)
            for key, parameter in tune.parameters.items()
        },
        terms_before=comparison.start.terms,
        terms_after=comparison.tuned.terms,
        held_out=tuple(
            LogCost(log=log.name, judge=log.source, before=before.get(log.name), after=after.get(log.name))
            for log in held_out
        ),
        declined=tuple(f"trial {attempt.number}: {reason}" for attempt, reason in comparison.declined),
        importance=importance(attempts, tune),
    )


def write_log_results(
    folder: Path,
    config_text: str,
    tune: TuneSettings,
    attempts: Sequence[Attempt],
    comparison: Comparison[ReplayedLog],
    result: LogTuningResult,
) -> str:
    """Write result, report, and, unless nothing was acceptable, the new configuration into `folder`.

    Returns:
        The result as JSON text, as in the file.

    Raises:
        ConfigError: The folder cannot be written to, or the configuration's text cannot be edited.
    """
    data = LogTuningData(tune=tune, attempts=attempts, comparison=comparison)
    page = render(
        "tune/logs/report.html",
        result=result,
        grade=GRADES[result.verdict],
        sentence=log_sentence(result),
        pictures=draw_log_report(data),
    )
    result_json = to_json(result, indent=2, inf_nan_mode="null").decode()
    changed = {key: change for key, change in result.values.items() if change.after != change.before}
    provenance = (
        None
        if result.cost_after is None
        else ProvenanceRecord(
            study=result.study,
            date=result.date,
            start=result.start,
            trials=result.trials,
            objective=result.objective,
            train_logs=result.train_logs,
            held_out_logs=result.held_out_logs,
            held_out_cost_before=result.cost_before,
            held_out_cost_after=result.cost_after,
            changes=changed,
        )
    )
    write_files_of(
        folder,
        {RESULT_NAME: result_json, REPORT_NAME: page},
        config_text,
        {key: change.after for key, change in changed.items()},
        provenance,
    )
    return result_json


def log_sentence(result: LogTuningResult) -> str:
    """Return the result in one sentence."""
    count = len(result.held_out_logs)
    where = f"on {count} held-out log{'s' if count > 1 else ''} after {result.trials} trials"
    if result.cost_after is None:
        return f"No acceptable values {where}: the old ones are refused ({result.start_refused})"
    if result.verdict is Verdict.CONFIRMED:
        return f"Nothing better than the old values {where}: they are kept, cost {result.cost_after:.3g}"
    if result.cost_before is None:
        return f"Cost {result.cost_after:.3g} {where}; the old values were refused ({result.start_refused})"
    better = sum(1 for log in result.held_out if _is_better(log))
    return (
        f"Cost {result.cost_before:.3g} before, {result.cost_after:.3g} now {where}; better in {better} of "
        f"{count}"
    )


def _is_better(log: LogCost) -> bool:
    return log.after is not None and (log.before is None or log.after < log.before)


def _costs(side: Evaluation[ReplayedLog], objective: LogObjectiveSettings) -> dict[str, float]:
    return {
        log.name: log_cost(pooled_terms([log]), objective)
        for log in side.runs
        if not log.refused and len(log.position_m)
    }
