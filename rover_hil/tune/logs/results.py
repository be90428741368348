"""Result of a tuning by logs: as JSON, as a page, and as a new configuration."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rover_hil.config.tune_settings import LogObjectiveSettings, TuneSettings
from rover_hil.pages.render import render
from rover_hil.tune.comparison import Comparison
from rover_hil.tune.importance import importance
from rover_hil.tune.journal import Attempt
from rover_hil.tune.logs.figures import LogTuningData, draw_log_report
from rover_hil.tune.logs.judged_log import JudgedLog
from rover_hil.tune.logs.objective import describe_logs, log_cost, pooled_terms
from rover_hil.tune.logs.replayed_log import ReplayErrors
from rover_hil.tune.objective import Evaluation
from rover_hil.tune.results import GRADES, Result, changes_of, write_files_of


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
class LogTuningResult(Result):
    """Result of a tuning by logs.

    Attributes:
        terms_before, terms_after: Measured values on all held-out logs, by the objective's names.
        held_out: Costs of each held-out log.
    """

    train_logs: tuple[str, ...]
    held_out_logs: tuple[str, ...]
    terms_before: dict[str, float]
    terms_after: dict[str, float]
    held_out: tuple[LogCost, ...]


def summarise_logs(
    study: str,
    start: str,
    date: str,
    tune: TuneSettings,
    objective: LogObjectiveSettings,
    start_values: dict[str, float],
    logs: tuple[Sequence[JudgedLog], Sequence[JudgedLog]],
    attempts: Sequence[Attempt],
    comparison: Comparison[ReplayErrors],
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
        values=changes_of(start_values, comparison.values, tune),
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
    comparison: Comparison[ReplayErrors],
    result: LogTuningResult,
) -> str:
    """Write result, report, and, unless nothing was acceptable, the new configuration into `folder`.

    Returns:
        The result as JSON text, as in the file.

    Raises:
        ConfigError: The folder cannot be written to, or the configuration's text cannot be edited.
    """
    data = LogTuningData(tune=tune, attempts=attempts, comparison=comparison)
    provenance = result.provenance(train_logs=result.train_logs, held_out_logs=result.held_out_logs)
    return write_files_of(
        folder,
        config_text,
        result,
        lambda: render(
            "tune/logs/report.html",
            result=result,
            grade=GRADES[result.verdict],
            sentence=log_sentence(result),
            pictures=draw_log_report(data),
        ),
        provenance,
    )


def log_sentence(result: LogTuningResult) -> str:
    """Return the result in one sentence."""
    count = len(result.held_out_logs)
    better = sum(1 for log in result.held_out if _is_better(log))
    logs = f"{count} held-out log{'s' if count > 1 else ''}"
    return result.sentence(logs, f"; better in {better} of {count}")


def _is_better(log: LogCost) -> bool:
    return log.after is not None and (log.before is None or log.after < log.before)


def _costs(side: Evaluation[ReplayErrors], objective: LogObjectiveSettings) -> dict[str, float]:
    return {
        log.name: log_cost(pooled_terms([log]), objective)
        for log in side.runs
        if not log.refused and len(log.position_m)
    }
