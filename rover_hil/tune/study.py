"""A study: batches of trials are proposed, driven and written down."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Generic

from rover_hil.config import Config
from rover_hil.config.tune_settings import TuneSettings
from rover_hil.tune import search
from rover_hil.tune.journal import Attempt, Journal
from rover_hil.tune.objective import NO_RIVAL, Evaluation, Runner, RunT, evaluate_results
from rover_hil.tune.parameters import rounded, start_values, with_values
from rover_hil.tune.scenarios import train_seeds
from rover_hil.tune.search import Proposer
from rover_hil.tune.simulated_mission import SimulatedMission

CANDIDATES = 5


class Study(ABC, Generic[RunT]):
    """A study in a file; opening it again continues where it ended.

    Trials are proposed in batches, the first of which is the start alone. A proposal, and the cost above
    which a trial is given up, depend on the trials of earlier batches only. So the same number of trials
    gives the same study, whatever the number of workers and wherever it was interrupted.

    Args:
        path: The journal file.
        name: Of the study.
        setting: Everything that costs and proposals depend on.
        config: The configuration to start from.
        tune: Parameters, and how they are searched.
        propose: Finds the values of a batch; None for the search with the seed of `tune`.
        is_raced: Give a trial up, too, when it loses against the best ones on the cases driven so far.

    Raises:
        ConfigError: The file belongs to another configuration, or is damaged.
    """

    def __init__(
        self,
        path: Path,
        name: str,
        setting: str,
        config: Config,
        tune: TuneSettings,
        propose: Proposer | None = None,
        *,
        is_raced: bool = True,
    ) -> None:
        self._config = config
        self._tune = tune
        self._search = propose or partial(search.propose, seed=tune.seed)
        self._is_raced = is_raced
        self._journal = Journal(path, name, setting)

    @property
    @abstractmethod
    def _cases(self) -> Sequence[int]:
        """All cases of a trial."""

    @abstractmethod
    def _evaluate(
        self, results: Iterable[RunT], count: int, limit: float, rival_costs: Mapping[int, float]
    ) -> Evaluation[RunT]:
        """Take results of `count` cases until the cost is known, or clear, see `evaluate_results`."""

    def attempts(self) -> list[Attempt]:
        """Return the finished trials in their order."""
        return self._journal.attempts()

    def candidates(self) -> list[Attempt]:
        """Return the best trials except the start, the best first."""
        return _cheapest(self.attempts())

    def search(
        self,
        drive: Runner[RunT],
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
        while not should_stop():
            finished = {attempt.number for attempt in self.attempts()}
            first = next(number for number in range(trials + 1) if number not in finished)
            if first == trials:
                return
            batch = self._batch_of(first)
            wanted = [number for number in batch if number < trials and number not in finished]
            self._try_batch(drive, batch, wanted, should_stop, report_progress)

    def _batch_of(self, number: int) -> range:
        """Return the numbers of the trials that are proposed together with a trial."""
        size = self._tune.at_once
        first = number - (number - 1) % size if number else 0
        return range(first, first + size) if number else range(1)

    def _try_batch(
        self,
        drive: Runner[RunT],
        batch: range,
        wanted: Sequence[int],
        should_stop: Callable[[], bool],
        report_progress: Callable[[], None],
    ) -> None:
        told = [attempt for attempt in self.attempts() if attempt.number < batch.start]
        proposals = self._propose(told, batch)
        cases, limit = self._hardest_first(told), _hopeless_cost(told)
        rivals = _cheapest(told)
        rival_costs = rivals[-1].case_costs if self._is_raced and len(rivals) == CANDIDATES else NO_RIVAL
        runs = {
            number: drive(self._with(number, proposals[number - batch.start]), cases) for number in wanted
        }
        for number, results in runs.items():
            with closing(results):
                evaluation = self._evaluate(results, len(cases), limit, rival_costs)
            self._journal.add(self._attempt(number, proposals[number - batch.start], evaluation))
            report_progress()
            if should_stop():
                break
        for results in runs.values():
            results.close()

    def _propose(self, told: Sequence[Attempt], batch: range) -> list[dict[str, float]]:
        start = start_values(self._config, self._tune)
        if not batch.start:
            return [start]
        return [
            rounded(values, self._tune)
            for values in self._search(self._tune.parameters, start, told, len(batch))
        ]

    def _with(self, number: int, values: dict[str, float]) -> Config:
        return with_values(self._config, values) if number else self._config

    def _attempt(self, number: int, values: dict[str, float], evaluation: Evaluation[RunT]) -> Attempt:
        return Attempt(
            number=number,
            values=values,
            cost=evaluation.cost,
            at_least=evaluation.at_least,
            refused=evaluation.refused,
            is_start=number == 0,
            case_costs=evaluation.case_costs,
            terms=evaluation.terms,
        )

    def _hardest_first(self, told: Sequence[Attempt]) -> list[int]:
        """Return the cases, those with the highest cost of the start first."""
        costs = told[0].case_costs if told else {}
        known = sorted(costs, key=lambda case: -costs[case])
        return [*known, *(case for case in self._cases if case not in known)]


class MissionStudy(Study[SimulatedMission]):
    """A study whose cases are simulated missions.

    Args:
        path, name, config, tune, propose, is_raced: See `Study`.
    """

    def __init__(
        self,
        path: Path,
        name: str,
        config: Config,
        tune: TuneSettings,
        propose: Proposer | None = None,
        *,
        is_raced: bool = True,
    ) -> None:
        super().__init__(path, name, setting_of(config), config, tune, propose, is_raced=is_raced)

    @property
    def _cases(self) -> Sequence[int]:
        return train_seeds(self._tune.cases)

    def _evaluate(
        self,
        results: Iterable[SimulatedMission],
        count: int,
        limit: float,
        rival_costs: Mapping[int, float],
    ) -> Evaluation[SimulatedMission]:
        return evaluate_results(results, count, self._tune.objective, limit, rival_costs)


def _hopeless_cost(told: Sequence[Attempt]) -> float:
    """Return the cost above which values cannot become candidates."""
    costs = [attempt.cost for attempt in _cheapest(told) if attempt.cost is not None]
    return costs[-1] if len(costs) == CANDIDATES else float("inf")


def _cheapest(attempts: Sequence[Attempt]) -> list[Attempt]:
    """Return the best attempts except the start, the best first."""
    known = [
        (attempt.cost, attempt.number, attempt)
        for attempt in attempts
        if attempt.cost is not None and not attempt.is_start
    ]
    return [attempt for _, _, attempt in sorted(known)[:CANDIDATES]]


def setting_of(config: Config) -> str:
    """Return everything that the costs depend on."""
    return config.model_dump_json(by_alias=True, exclude={"tune": {"provenance"}})
