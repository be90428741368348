"""Result of a tuning: as JSON, as a page, and as a new configuration."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic_core import to_json

from drivers.errors import ConfigError
from drivers.files import parse_json, read_text
from rover_hil.config import Config
from rover_hil.config.tune_settings import ChangeRecord, ProvenanceRecord, StabilitySettings, TuneSettings
from rover_hil.pages.add_page import add_page
from rover_hil.pages.atomic_write import write_file, write_files
from rover_hil.pages.render import render
from rover_hil.tune.comparison import Comparison, Verdict
from rover_hil.tune.figures import TuningData, draw_report
from rover_hil.tune.importance import importance
from rover_hil.tune.journal import Attempt
from rover_hil.tune.objective import describe
from rover_hil.tune.parameters import start_values
from rover_hil.tune.robustness import ChangedRover
from rover_hil.tune.scenarios import held_out_seeds, ranking_seeds, train_seeds
from rover_hil.tune.simulated_mission import SimulatedMission
from rover_hil.tune.tuned_config import tuned_text

CONFIG_NAME = "tuned.toml"
RESULT_NAME = "tuning.json"
REPORT_NAME = "report.html"
SEARCH_NAME = "best_trial.toml"
RESULT_NAMES = (CONFIG_NAME, RESULT_NAME, REPORT_NAME)
GRADES = {Verdict.IMPROVED: "good", Verdict.CONFIRMED: "neutral", Verdict.NONE_ACCEPTABLE: "bad"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """A measured value over the held-out cases: median, and the quantile that the objective takes."""

    median: float
    quantile: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """The same on both sides of the comparison; None where gains were refused or not all cases driven."""

    before: Spread | None
    after: Spread | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """What every tuning gives.

    Attributes:
        start: The configuration it started from.
        trials: Finished trials; of these, `refused` were unstable or their values rejected.
        cost_before, cost_after: On what was held out; None where the values were rejected.
        start_refused: Why the old values are rejected; empty when they are acceptable.
        values: Every tunable value, changed or not.
        declined: Candidates that were compared on what was held out, and not taken, with the reason.
        importance: See `importance`.
    """

    study: str
    verdict: Verdict
    date: str
    start: str
    trials: int
    refused: int
    objective: str
    cost_before: float | None
    cost_after: float | None
    start_refused: str
    values: dict[str, ChangeRecord]
    declined: tuple[str, ...]
    importance: dict[str, float]

    @property
    def changes(self) -> dict[str, ChangeRecord]:
        """The values that are not the old ones."""
        return {key: change for key, change in self.values.items() if change.after != change.before}

    def sentence(self, held_out: str, better: str = "") -> str:
        """Return the result in one sentence.

        Args:
            held_out: What it was compared on.
            better: How many of these are better, where that is known.
        """
        where = f"on {held_out} after {self.trials} trials"
        if self.cost_after is None:
            return f"No acceptable values {where}: the old ones are refused ({self.start_refused})"
        if self.verdict is Verdict.CONFIRMED:
            return f"Nothing better than the old values {where}: they are kept, cost {self.cost_after:.3g}"
        if self.cost_before is None:
            return f"Cost {self.cost_after:.3g} {where}; the old values were refused ({self.start_refused})"
        return f"Cost {self.cost_before:.3g} before, {self.cost_after:.3g} now {where}{better}"

    def provenance(self, **origin: object) -> ProvenanceRecord | None:
        """Return what the new configuration notes; None where there is none.

        Args:
            origin: The seeds or logs that were searched and held out.
        """
        if self.cost_after is None:
            return None
        return ProvenanceRecord.model_validate(
            {
                "study": self.study,
                "date": self.date,
                "start": self.start,
                "trials": self.trials,
                "objective": self.objective,
                "held_out_cost_before": self.cost_before,
                "held_out_cost_after": self.cost_after,
                "changes": self.changes,
                **origin,
            }
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningResult(Result):
    """Result of a tuning on the simulated rover.

    Attributes:
        given_up: Trials that were certain not to be better.
        held_out: Measured values on the held-out cases, by the objective's names.
        changed_rovers: Costs on rovers that are not quite the simulated one.
        drives: Recorded drives whose intervals the scenarios are drawn from; none without.
    """

    given_up: int
    quantile: float
    stability: StabilitySettings
    train_seeds: tuple[int, int]
    ranking_seeds: tuple[int, int]
    held_out_seeds: tuple[int, int]
    held_out: dict[str, Change]
    changed_rovers: tuple[ChangedRover, ...]
    drives: tuple[str, ...] | None


def changes_of(
    start: Mapping[str, float], values: Mapping[str, float], tune: TuneSettings
) -> dict[str, ChangeRecord]:
    """Return every tunable value before and after."""
    return {
        key: ChangeRecord(before=start[key], after=values[key], unit=parameter.unit)
        for key, parameter in tune.parameters.items()
    }


def summarise(
    study: str,
    start: str,
    date: str,
    config: Config,
    attempts: Sequence[Attempt],
    comparison: Comparison[SimulatedMission],
    changed_rovers: tuple[ChangedRover, ...] = (),
) -> TuningResult:
    """Return the numbers of a tuning."""
    tune = config.tune
    if tune is None:
        raise ConfigError("the configuration has no [tune]: add it")
    before, quantile = start_values(config, tune), tune.objective.quantile
    found = config.require_simulation().found
    train, ranking, held_out = (
        (seeds[0], seeds[-1])
        for seeds in (train_seeds(tune.cases), ranking_seeds(tune.cases), held_out_seeds(tune.cases))
    )
    first = next((attempt for attempt in attempts if attempt.is_start), None)
    old, new = (
        _spreads(side.runs if side.cost is not None else (), quantile)
        for side in (comparison.start, comparison.tuned)
    )
    return TuningResult(
        study=study,
        verdict=comparison.verdict,
        date=date,
        start=start,
        trials=len(attempts),
        refused=sum(1 for attempt in attempts if attempt.refused),
        given_up=sum(1 for attempt in attempts if attempt.cost is None and not attempt.refused),
        objective=describe(tune.objective),
        quantile=quantile,
        stability=tune.stability,
        train_seeds=train,
        ranking_seeds=ranking,
        held_out_seeds=held_out,
        cost_before=comparison.start.cost,
        cost_after=comparison.tuned.cost,
        start_refused=comparison.start.refused,
        values=changes_of(before, comparison.values, tune),
        held_out={
            name: Change(before=old.get(name), after=new.get(name)) for name in dict.fromkeys((*old, *new))
        },
        declined=tuple(
            f"trial {attempt.number}: cost {_cost(attempt)} in the search, start {_cost(first)}: {reason}"
            for attempt, reason in comparison.declined
        ),
        importance=importance(attempts, tune),
        changed_rovers=changed_rovers,
        drives=None if found is None else found.drives,
    )


def write_results(
    folder: Path,
    config_text: str,
    config: Config,
    attempts: Sequence[Attempt],
    comparison: Comparison[SimulatedMission],
    result: TuningResult,
) -> str:
    """Write result, report, and, unless nothing was acceptable, the new configuration into `folder`.

    Returns:
        The result as JSON text, as in the file.

    Raises:
        ConfigError: The folder cannot be written to, or the configuration's text cannot be edited.
    """
    if config.tune is None or config.mission is None:
        raise ConfigError("the configuration has no [tune] or no [mission]: add them")
    data = TuningData(
        tune=config.tune, corners=config.mission.corners(), attempts=attempts, comparison=comparison
    )
    provenance = result.provenance(
        train_seeds=result.train_seeds,
        ranking_seeds=result.ranking_seeds,
        held_out_seeds=result.held_out_seeds,
        drives=result.drives,
    )
    return write_files_of(
        folder,
        config_text,
        result,
        lambda: render(
            "tune/report.html",
            result=result,
            grade=GRADES[result.verdict],
            sentence=sentence(result),
            pictures=draw_report(data),
        ),
        provenance,
    )


def write_search(
    folder: Path,
    config_text: str,
    start: Mapping[str, float],
    tune: TuneSettings,
    attempts: Sequence[Attempt],
) -> None:
    """Write what a search found as `best_trial.toml`, before its comparison, which takes long.

    It goes when the result of the comparison is written.

    Raises:
        ConfigError: The folder cannot be written to, or the configuration's text cannot be edited.
    """
    known = [(attempt.cost, attempt.number, attempt) for attempt in attempts if attempt.cost is not None]
    if not known:
        return
    cost, number, best = min(known, key=lambda each: each[:2])
    changed = {
        key: each.after
        for key, each in changes_of(start, best.values, tune).items()
        if each.after != each.before
    }
    note = (
        f"# The best of {len(attempts)} trials: trial {number}, cost {cost:.3g} in the search. It was not\n"
        "# compared with the old values on cases that the search did not use: the same command does that.\n"
    )
    write_file(folder / SEARCH_NAME, note + tuned_text(config_text, changed, None))


def write_files_of(
    folder: Path,
    config_text: str,
    result: Result,
    make_page: Callable[[], str],
    provenance: ProvenanceRecord | None,
) -> str:
    """Write the result and the new configuration, then the page; without provenance no configuration.

    Returns:
        The result as JSON text, as in the file.

    Raises:
        ConfigError: The folder cannot be written to, or the configuration's text cannot be edited.
    """
    result_json = to_json(result, indent=2, inf_nan_mode="null").decode()
    texts = {RESULT_NAME: result_json}
    if provenance is None:
        write_files(folder, texts)
        (folder / CONFIG_NAME).unlink(missing_ok=True)
    else:
        changed = {key: change.after for key, change in result.changes.items()}
        write_files(folder, {**texts, CONFIG_NAME: tuned_text(config_text, changed, provenance)})
    (folder / SEARCH_NAME).unlink(missing_ok=True)
    add_page(folder / REPORT_NAME, make_page)
    return result_json


def study_of(folder: Path) -> str:
    """Return the name of the study whose results a folder holds; empty where it holds none."""
    try:
        result = parse_json(read_text(folder / RESULT_NAME))
    except (OSError, ValueError):
        return ""
    return str(result.get("study", "")) if isinstance(result, dict) else ""


def sentence(result: TuningResult) -> str:
    """Return the result in one sentence."""
    scenarios = result.held_out_seeds[1] - result.held_out_seeds[0] + 1
    drawn = f", drawn from what these drives show: {', '.join(result.drives)}" if result.drives else ""
    return result.sentence(f"{scenarios} held-out scenarios{drawn}")


def _cost(attempt: Attempt | None) -> str:
    return "refused" if attempt is None or attempt.cost is None else f"{attempt.cost:.3g}"


def _spreads(missions: Sequence[SimulatedMission], quantile: float) -> dict[str, Spread]:
    if not missions:
        return {}
    terms = {name: [mission.terms[name] for mission in missions] for name in missions[0].terms}
    return {
        name: Spread(median=float(np.median(values)), quantile=float(np.quantile(values, quantile)))
        for name, values in terms.items()
    }
