"""A study whose cases are logs."""

import json
from collections.abc import Generator, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from pathlib import Path

from rover_hil.config import Config
from rover_hil.config.tune_settings import LogObjectiveSettings, TuneSettings
from rover_hil.tune.logs.judged_log import JudgedLog
from rover_hil.tune.logs.objective import evaluate_logs
from rover_hil.tune.logs.replayed_log import ReplayErrors, replay_with
from rover_hil.tune.objective import Evaluation, Runner
from rover_hil.tune.parallel_missions import results_in_order
from rover_hil.tune.study import Study, setting_of


class LogStudy(Study[ReplayErrors]):
    """A study whose cases are logs, by their index.

    Args:
        path, name, config, tune: See `Study`.
        objective: The cost.
        logs: The training logs.
    """

    def __init__(
        self,
        path: Path,
        name: str,
        config: Config,
        tune: TuneSettings,
        objective: LogObjectiveSettings,
        logs: Sequence[JudgedLog],
    ) -> None:
        settings = [setting_of(config), [log.setting for log in logs]]
        super().__init__(path, name, json.dumps(settings), config, tune)
        self._objective = objective
        self._count = len(logs)

    @property
    def _cases(self) -> Sequence[int]:
        return range(self._count)

    def _evaluate(
        self, results: Iterable[ReplayErrors], count: int, limit: float, rival_costs: Mapping[int, float]
    ) -> Evaluation[ReplayErrors]:
        return evaluate_logs(results, self._objective)


def replays_on(executor: Executor, logs: Sequence[JudgedLog]) -> Runner[ReplayErrors]:
    """Return what replays logs, by their index, on an executor."""
    return partial(_replay, executor, logs)


def _replay(
    executor: Executor, logs: Sequence[JudgedLog], config: Config, cases: Sequence[int]
) -> Generator[ReplayErrors, None, None]:
    return results_in_order([executor.submit(replay_with, logs[case], config) for case in cases])
