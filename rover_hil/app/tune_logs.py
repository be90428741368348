"""`tune --logs`: search for better filter noise by replay of logs."""

from collections.abc import Sequence
from pathlib import Path

from drivers.clock import wall_time_text
from drivers.errors import ConfigError
from rover_hil.app.tune import STUDY_NAME, prepare_folder, search, tell_result
from rover_hil.config import load_config, read_config_text
from rover_hil.console.options import log_at
from rover_hil.console.steps import show_steps
from rover_hil.parallel.executor import open_executor
from rover_hil.run.checks import ROVER_CHECKS
from rover_hil.terminal import Terminal
from rover_hil.tune.comparison import compare_by
from rover_hil.tune.logs.judged_log import read_judged_logs, split
from rover_hil.tune.logs.objective import evaluate_logs
from rover_hil.tune.logs.results import log_sentence, summarise_logs, write_log_results
from rover_hil.tune.logs.study import LogStudy, replays_on
from rover_hil.tune.parameters import MISSING_LOGS, check_log_parameters, start_values
from rover_hil.tune.tuned_config import tuned_text


def tune_by_logs(
    config_name: str,
    *,
    logs: Sequence[Path],
    held_out: Sequence[Path],
    study: str,
    trials: int,
    minutes: float | None,
    out: Path | None,
    as_json: bool,
    force: bool = False,
    cluster: str | None = None,
) -> int:
    """Search, compare with the start on held-out logs, write the results; returns the exit code.

    Args:
        config_name: A configuration with [tune.logs].
        logs: Logs of this rover, or folders of its runs.
        held_out: Logs that the search does not use; without any, every third of `logs`.
        study: Its name; an existing one is continued.
        trials: Finished trials in all, those of earlier sessions included.
        minutes: End the search after this time, or None.
        out: Folder of the study; by default `tuning/STUDY`.
        as_json: Print the result as JSON.
        force: Replace results of another study.
        cluster: Address of the Dask scheduler that replays the logs; None for this machine.

    Raises:
        ConfigError: Bad configuration, too few logs, a log of another rover, or a study or results of
            another one.
        LogError: A log cannot be read, or has nothing to judge an estimate by.
    """
    if not logs:
        raise ConfigError("--held-out gives logs to compare on, but there are none to search: add --logs")
    config, text = load_config(config_name, ROVER_CHECKS), read_config_text(config_name)
    settings = check_log_parameters(config)
    by_logs = settings.logs
    if by_logs is None:
        raise ConfigError(MISSING_LOGS)
    start = start_values(config, settings)
    tuned_text(text, start, None)  # to fail now rather than after the search
    with show_steps("reading the logs"):
        paths = [log_at(path) for path in (*logs, *held_out)]
        judged = read_judged_logs(paths, config, by_logs.withheld_s)
        train, held = (judged[: len(logs)], judged[len(logs) :]) if held_out else split(judged)
    folder = prepare_folder(study, out, force=force)
    trial_store = LogStudy(folder / STUDY_NAME, study, config, settings, by_logs.objective, train)
    with open_executor(cluster) as executor:
        search(trial_store, replays_on(executor, train), trials, minutes, Terminal(stderr=True))
        attempts = trial_store.attempts()
        drive = replays_on(executor, held)
        with show_steps("comparing on held-out logs"):
            comparison = compare_by(
                lambda values, _: evaluate_logs(drive(values, range(len(held))), by_logs.objective),
                config,
                start,
                trial_store.candidates(),
            )
    result = summarise_logs(
        study,
        config_name,
        wall_time_text(),
        settings,
        by_logs.objective,
        start,
        (train, held),
        attempts,
        comparison,
    )
    result_json = write_log_results(folder, text, settings, attempts, comparison, result)
    return tell_result(folder, result.verdict, log_sentence(result), result_json if as_json else None)
