"""`rover-hil tune`: search for better gains on the virtual rover."""

import re
import signal
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeElapsedColumn

from drivers.clock import SystemClock, nanoseconds, wall_time_text
from drivers.errors import ConfigError
from rover_hil.config import Config, load_config, read_config_text
from rover_hil.config.tune_settings import TuneSettings
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.console.json_text import print_json_text
from rover_hil.console.options import (
    ClusterOption,
    ConfigArgument,
    ForceOption,
    JsonOption,
    number_option,
    out_option,
)
from rover_hil.console.steps import show_progress
from rover_hil.pages.atomic_write import refuse_overwrite
from rover_hil.terminal import Terminal, words_column
from rover_hil.tune.comparison import Comparison, Verdict, compare
from rover_hil.tune.journal import Attempt
from rover_hil.tune.objective import MissionRunner, Runner, RunT
from rover_hil.tune.parallel_missions import open_missions
from rover_hil.tune.parameters import TUNE_CHECKS, check_parameters, start_values, with_values
from rover_hil.tune.results import (
    CONFIG_NAME,
    REPORT_NAME,
    RESULT_NAMES,
    SEARCH_NAME,
    sentence,
    study_of,
    summarise,
    write_results,
    write_search,
)
from rover_hil.tune.robustness import try_changed_rovers
from rover_hil.tune.simulated_mission import SimulatedMission
from rover_hil.tune.study import MissionStudy, Study
from rover_hil.tune.tuned_config import tuned_text

STUDY_NAME = "study.jsonl"
StudyOption = Annotated[str, typer.Option(help="Name of the study; an existing one is continued.")]
TrialsOption = Annotated[int, number_option("Trials in all, earlier sessions included.", "trials", 1, 1e6)]
MinutesOption = Annotated[float | None, number_option("End the search after this time.", "min", 0.01, 1e5)]
StudyOutOption = Annotated[Path | None, out_option("Folder of the study [default: tuning/STUDY].")]


def tune(
    config_name: ConfigArgument,
    *,
    study: StudyOption,
    trials: TrialsOption = 60,
    minutes: MinutesOption = None,
    out: StudyOutOption = None,
    cluster: ClusterOption = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
) -> int:
    """Search for better gains on the simulated rover; compare with the old on sites it did not use.

    `rover-hil tune my_rover.toml --study gains` is the same. Exit code 1: no values were acceptable, the old
    ones included.

    Example: `rover-hil tune gains my_rover.toml --study gains`

    Data: `rover-hil sample rover` writes this configuration; yours needs `[tune]`;
    docs/how-to/bench_tuning.md.
    """
    config, text = load_config(config_name, TUNE_CHECKS), read_config_text(config_name)
    settings = check_parameters(config)
    start = start_values(config, settings)
    tuned_text(text, start, None)  # to fail now rather than after the search
    folder = prepare_folder(study, out, force=force)
    trial_store = MissionStudy(folder / STUDY_NAME, study, config, settings)
    messages = Terminal(stderr=True)
    with open_missions(cluster, has_camera=config.roles.camera is not None) as drive:
        search(trial_store, drive, trials, minutes, messages)
        attempts = trial_store.attempts()
        with search_kept(folder, text, start, settings, attempts):
            comparison = _compare(config, settings, trial_store.candidates(), drive)
        result = summarise(study, config_name, wall_time_text(), config, attempts, comparison)
        result_json = write_results(folder, text, config, attempts, comparison, result)
        if comparison.verdict is Verdict.IMPROVED:
            tuned = with_values(config, comparison.values)
            changed_rovers = try_changed_rovers(config, tuned, settings, drive)
            result = replace(result, changed_rovers=changed_rovers)
            result_json = write_results(folder, text, config, attempts, comparison, result)
    return tell_result(folder, result.verdict, sentence(result), result_json if as_json else None)


@contextmanager
def search_kept(
    folder: Path, text: str, start: Mapping[str, float], settings: TuneSettings, attempts: Sequence[Attempt]
) -> Iterator[None]:
    """Write what a search found before the comparison that follows; report where it is if that fails."""
    write_search(folder, text, start, settings, attempts)
    try:
        yield
    except BaseException:
        if (folder / SEARCH_NAME).exists():
            Terminal(stderr=True).print(
                f"the comparison did not end; the best trial is {folder / SEARCH_NAME}, and the same command "
                "goes on with the comparison",
                soft_wrap=True,
            )
        raise


def tell_result(folder: Path, verdict: Verdict, words: str, result_json: str | None) -> int:
    """Print the result and the names of its files, or its JSON; returns the exit code."""
    is_acceptable = verdict is not Verdict.NONE_ACCEPTABLE
    if result_json is not None:
        print_json_text(result_json)
    else:
        console = Terminal()
        console.print(words, soft_wrap=True)
        for name in (CONFIG_NAME, REPORT_NAME) if is_acceptable else (REPORT_NAME,):
            if (folder / name).exists():
                console.print(str(folder / name), soft_wrap=True)
    return EXIT_OK if is_acceptable else EXIT_NO


def prepare_folder(study: str, out: Path | None, *, force: bool) -> Path:
    """Make the folder of a study.

    Raises:
        ConfigError: Its name is none, it cannot be made, or it holds results of another study.
    """
    if not re.fullmatch(r"\w[\w.-]*", study):
        raise ConfigError(f"--study '{study}' is no name for a folder: use letters, digits, _, - and .")
    folder = out or Path("tuning") / study
    if not (folder / STUDY_NAME).exists() or study_of(folder) != study:
        refuse_overwrite(*(folder / name for name in RESULT_NAMES), force=force)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(
            f"cannot make the folder {folder}: {error.strerror}; choose another --out"
        ) from error
    return folder


def search(
    study: Study[RunT],
    drive: Runner[RunT],
    trials: int,
    minutes: float | None,
    messages: Terminal,
) -> None:
    """Search until a number of trials, a time in minutes, or ctrl-C; show the progress."""
    clock = SystemClock()
    end_ns = None if minutes is None else clock.now_ns() + nanoseconds(60.0 * minutes)
    with _progress() as progress, _stop_by_signal(messages) as is_stopped:
        task = progress.add_task("", total=trials)

        def report_progress() -> None:
            attempts = study.attempts()
            progress.update(task, completed=len(attempts), description=_progress_text(attempts))

        def should_stop() -> bool:
            return is_stopped() or (end_ns is not None and clock.now_ns() >= end_ns)

        report_progress()
        study.search(drive, trials, should_stop, report_progress)


def _compare(
    config: Config,
    settings: TuneSettings,
    candidates: Sequence[Attempt],
    drive: MissionRunner,
) -> Comparison[SimulatedMission]:
    with _progress() as progress:
        missions = len(candidates) * settings.cases.ranking + 2 * settings.cases.held_out
        task = progress.add_task("comparing the best trials and the start", total=missions)

        def counted(config: Config, seeds: Sequence[int]) -> Generator[SimulatedMission, None, None]:
            with closing(drive(config, seeds)) as results:
                for mission in results:
                    progress.advance(task)
                    yield mission

        return compare(config, settings, candidates, counted)


def _progress_text(attempts: Sequence[Attempt]) -> str:
    start = next((attempt for attempt in attempts if attempt.is_start), None)
    if start is None:
        return "trying the current values"
    known = [(attempt.cost, attempt.number) for attempt in attempts if attempt.cost is not None]
    refused = sum(1 for attempt in attempts if attempt.refused)
    before = "refused" if start.cost is None else f"{start.cost:.3g}"
    best = "none yet" if not known else "{:.3g} (trial {})".format(*min(known))
    return f"best {best}, start {before}, {refused} refused"


def _progress() -> AbstractContextManager[Progress]:
    return show_progress(words_column(), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())


@contextmanager
def _stop_by_signal(messages: Terminal) -> Iterator[Callable[[], bool]]:
    """Let ctrl-C or SIGTERM end the search after the running trial; a second one ends the program at once."""
    is_stopped = False

    def on_signal(signal_number: int, frame: FrameType | None) -> None:
        nonlocal is_stopped
        is_stopped = True
        messages.print(
            "ending the search after this trial; once more to leave at once, the study is kept",
            soft_wrap=True,
        )
        signal.signal(signal_number, previous[signal.Signals(signal_number)])

    previous = {number: signal.signal(number, on_signal) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: is_stopped
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
