"""`rover-hil tune logs`: search for better filter noise by replay of logs."""

from pathlib import Path
from typing import Annotated

import typer

from drivers.clock import wall_time_text
from drivers.errors import ConfigError
from rover_hil.console.options import ClusterOption, ForceOption, JsonOption, log_at
from rover_hil.console.steps import show_steps
from rover_hil.drives.formats.described_rover import is_log
from rover_hil.parallel.executor import open_executor
from rover_hil.terminal import Terminal
from rover_hil.tune.command import (
    STUDY_NAME,
    MinutesOption,
    StudyOption,
    StudyOutOption,
    TrialsOption,
    prepare_folder,
    search,
    search_kept,
    tell_result,
)
from rover_hil.tune.comparison import compare_by
from rover_hil.tune.logs.described_rover import tuned_rover
from rover_hil.tune.logs.judged_log import read_judged_logs, split
from rover_hil.tune.logs.objective import evaluate_logs
from rover_hil.tune.logs.results import log_sentence, summarise_logs, write_log_results
from rover_hil.tune.logs.study import LogStudy, replays_on
from rover_hil.tune.parameters import MISSING_LOGS, check_log_parameters, start_values
from rover_hil.tune.tuned_config import tuned_text


def tune_by_logs(
    config_name: Annotated[
        str,
        typer.Argument(
            help="Configuration of the rover, or a file of columns; or the first log, which knows its rover.",
            metavar="CONFIG",
        ),
    ],
    logs: Annotated[
        list[Path] | None, typer.Argument(help="Logs of this rover, or folders of its runs.")
    ] = None,
    *,
    held_out: Annotated[
        list[Path] | None,
        typer.Option(help="Compare on these logs [default: every third, not searched].", metavar="LOG..."),
    ] = None,
    study: StudyOption,
    trials: TrialsOption = 60,
    minutes: MinutesOption = None,
    out: StudyOutOption = None,
    cluster: ClusterOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Search for better filter noise by replay of logs; compare with the old on logs it did not use.

    Exit code 1: no values were acceptable, the old ones included.

    Example: `rover-hil tune logs noisy.toml noise/*.mcap --study noise`

    Data: `rover-hil sample noise` writes configuration and logs; yours needs `[tune.logs]`. Logs alone
    have the noise of their sensors tuned; docs/how-to/tune_from_logs.md.
    """
    held_out = held_out or []
    logs = [*([Path(config_name)] if is_log(config_name) else []), *(logs or [])]
    if not logs:
        raise ConfigError(f"tune logs {config_name}: name logs of this rover")
    config, text = tuned_rover(config_name)
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
        with search_kept(folder, text, start, settings, attempts), show_steps("comparing on held-out logs"):
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
