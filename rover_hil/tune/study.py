"""The search: optuna proposes values, all cores simulate them, a journal file records every trial."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drivers.errors import ConfigError
from rover_hil.config import Config
from rover_hil.config.tune_settings import TuneSettings
from rover_hil.tune.objective import Evaluation, MissionRunner, case_cost, evaluate
from rover_hil.tune.parameters import rounded, start_values, with_values
from rover_hil.tune.scenarios import train_seeds

try:
    import optuna
    from optuna.distributions import BaseDistribution, FloatDistribution
    from optuna.samplers import TPESampler
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend
    from optuna.trial import FrozenTrial, TrialState
except ModuleNotFoundError as missing:
    raise ConfigError("tuning needs optuna: install rover-hil[tune]") from missing

CANDIDATES = 5
SETTING = "setting"
REFUSED = "refused"
IS_START = "is_start"
HARDEST_FIRST = "hardest_first"


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt:
    """One finished trial.

    Attributes:
        cost: On the training cases; None where the values were rejected or given up.
        at_least: Lower bound of the cost, where it was given up.
        refused: Why the values are rejected; empty when they are acceptable.
        is_start: These are the values that the study started from.
    """

    number: int
    values: dict[str, float]
    cost: float | None
    at_least: float
    refused: str
    is_start: bool


class Study:
    """A study in a file; opening it again continues where it ended.

    Args:
        path: The journal file.
        name: Of the study.
        config: The configuration to start from.
        tune: Its [tune].

    Raises:
        ConfigError: The file belongs to another configuration, or is damaged.
    """

    def __init__(self, path: Path, name: str, config: Config, tune: TuneSettings) -> None:
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        self._config = config
        self._tune = tune
        self._distributions: dict[str, BaseDistribution] = {
            key: FloatDistribution(parameter.low, parameter.high, log=parameter.scale == "log")
            for key, parameter in tune.parameters.items()
        }
        _drop_torn_line(path)
        try:
            storage = JournalStorage(JournalFileBackend(str(path)))
            self._study = optuna.create_study(storage=storage, study_name=name, load_if_exists=True)
        except (ValueError, KeyError) as error:
            raise ConfigError(f"{path} is no study, or damaged: choose another --out") from error
        setting = _setting(config)
        if self._study.user_attrs.setdefault(SETTING, setting) != setting:
            raise ConfigError(f"{path} was begun with another configuration: choose another --study")
        self._study.set_user_attr(SETTING, setting)

    def attempts(self) -> list[Attempt]:
        """Return the finished trials in their order."""
        states = (TrialState.COMPLETE, TrialState.PRUNED)
        return [
            _attempt(trial, self._tune) for trial in self._study.get_trials(deepcopy=False, states=states)
        ]

    def candidates(self) -> list[Attempt]:
        """Return the best trials except the start, the best first."""
        found = [attempt for attempt in self.attempts() if not attempt.is_start]
        return _cheapest(found)

    def search(
        self,
        drive: MissionRunner,
        trials: int,
        should_stop: Callable[[], bool],
        report_progress: Callable[[], None],
    ) -> None:
        """Try values until the study holds `trials` trials; the first trial has the present values.

        Args:
            drive: Drives cases.
            trials: Finished trials in all, those of earlier sessions included.
            should_stop: Asked between trials.
            report_progress: Called after every trial.
        """
        while (count := len(self.attempts())) < trials and not should_stop():
            self._try_next(drive, is_first=count == 0)
            report_progress()

    def _try_next(self, drive: MissionRunner, *, is_first: bool) -> None:
        study = self._study
        if is_first:
            study.enqueue_trial(start_values(self._config, self._tune), user_attrs={IS_START: True})
        # Each trial has a generator of its own, so that an interrupted study continues as it would have.
        study.sampler = TPESampler(seed=len(study.get_trials(deepcopy=False)))
        trial = study.ask(self._distributions)
        attempt = _attempt(study.get_trials(deepcopy=False)[trial.number], self._tune)
        config = self._config if attempt.is_start else with_values(self._config, attempt.values)
        objective = self._tune.objective
        evaluation = evaluate(drive, config, self._hardest_first(), objective, self._hopeless_cost())
        if is_first:
            costs = {each.seed: case_cost(each, objective) for each in evaluation.missions}
            study.set_user_attr(HARDEST_FIRST, sorted(costs, key=lambda seed: -costs[seed]))
        trial.set_user_attr(REFUSED, evaluation.refused)
        if evaluation.cost is not None:
            study.tell(trial, evaluation.cost)
        else:
            trial.report(evaluation.at_least, step=_rank(evaluation))
            study.tell(trial, state=TrialState.PRUNED)

    def _hardest_first(self) -> list[int]:
        """Return the training seeds, those with the highest cost of the start first."""
        known: list[int] = self._study.user_attrs.get(HARDEST_FIRST, [])
        return [*known, *(seed for seed in train_seeds(self._tune.cases) if seed not in known)]

    def _hopeless_cost(self) -> float:
        """Return the cost above which values cannot become candidates."""
        costs = [attempt.cost for attempt in self.candidates() if attempt.cost is not None]
        return costs[-1] if len(costs) == CANDIDATES else float("inf")


def _cheapest(attempts: list[Attempt]) -> list[Attempt]:
    known = [(attempt.cost, attempt.number, attempt) for attempt in attempts if attempt.cost is not None]
    return [attempt for _, _, attempt in sorted(known)[:CANDIDATES]]


def _rank(evaluation: Evaluation) -> int:
    """Return the rank of values without a known cost: rejected ones below those given up."""
    return 0 if evaluation.refused else len(evaluation.missions)


def _attempt(trial: FrozenTrial, tune: TuneSettings) -> Attempt:
    is_start = bool(trial.user_attrs.get(IS_START, False))
    return Attempt(
        number=trial.number,
        values=dict(trial.params) if is_start else rounded(trial.params, tune),
        cost=trial.value if trial.state is TrialState.COMPLETE else None,
        at_least=max(trial.intermediate_values.values(), default=0.0),
        refused=str(trial.user_attrs.get(REFUSED, "")),
        is_start=is_start,
    )


def _setting(config: Config) -> str:
    """Return everything that the costs depend on."""
    return config.model_dump_json(by_alias=True, exclude={"tune": {"provenance"}})


def _drop_torn_line(path: Path) -> None:
    """Remove a last line that was not completely written."""
    if path.exists():
        text = path.read_bytes()
        os.truncate(path, text.rfind(b"\n") + 1)
