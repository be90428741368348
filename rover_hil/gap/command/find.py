"""`rover-hil gap`: where model and measurement disagree, what is missing, and the proof."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from drivers.clock import wall_time_text
from drivers.errors import ConfigError, LogError
from rover_hil.console.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.console.json_text import print_json_text
from rover_hil.console.options import check_inputs
from rover_hil.console.steps import show_steps
from rover_hil.gap.checks import object_to, slower_channels
from rover_hil.gap.data.cut import cut_runs, without_warm_up
from rover_hil.gap.data.load import check_model, load_model, name_model_errors, read_runs
from rover_hil.gap.findings import Analysis
from rover_hil.gap.model_checks.linter import LintReport, lint, require_changes
from rover_hil.gap.model_checks.model_trial import try_model
from rover_hil.gap.next_run.allowed import Allowed, read_allowed
from rover_hil.gap.output.extended_machine import extend_model
from rover_hil.gap.output.model_file import read_model_file
from rover_hil.gap.output.results import (
    PLAN_NAME,
    REPORT_NAME,
    RESULT_NAMES,
    plan_text,
    verdict_text,
    write_report,
    write_results,
)
from rover_hil.gap.plan import Plan, TooFewRunsError, require_runs
from rover_hil.gap.verdict import Answer, refuse
from rover_hil.gap.workflow import analyse
from rover_hil.pages.atomic_write import refuse_overwrite, unfinished
from rover_hil.terminal import Terminal
from sim_backends.models.interface import Machine, Model, Run


@dataclass(frozen=True, slots=True, kw_only=True)
class Shortening:
    """How records become runs.

    Attributes:
        cut_s: Length of the runs that long records are cut into, s; None to leave them whole.
        warm_up_s: Beginning of each record that is not compared, s.
    """

    cut_s: float | None = None
    warm_up_s: float = 0.0

    def apply(self, model: Model, runs: list[Run]) -> list[Run]:
        """Return the runs of records.

        Raises:
            ConfigError: The model cannot begin in the middle of a record, or too little of a run is left.
        """
        if self.warm_up_s > 0.0:
            runs = without_warm_up(model, runs, self.warm_up_s)
        return runs if self.cut_s is None else cut_runs(model, runs, self.cut_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """A model, and where its measured runs come from.

    Attributes:
        name: How the user names the model.
        data: Files and folders of measured runs.
        make: Returns the model.
        read: Returns its measured runs.
        warnings: What the verdict must state about the model.
    """

    name: str
    data: Sequence[Path]
    make: Callable[[], Model]
    read: Callable[[Model], list[Run]]
    warnings: tuple[str, ...] = ()


def named_model(name: str, data: Path) -> Subject:
    """Return a model by its name."""
    return Subject(
        name=name, data=[data], make=partial(load_model, name), read=lambda model: read_runs(model, data)
    )


def find_gap(
    subject: Subject,
    *,
    out: Path,
    extended: Path | None,
    confirm: str,
    seed: int,
    as_json: bool,
    force: bool = False,
    shortening: Shortening | None = None,
    allowed: Path | None = None,
) -> int:
    """Analyse data against a model and write the results, unless the data is bad; returns the exit code.

    Raises:
        ConfigError: No such model or data, a model with an error, a wrong expression, or a folder that
            cannot be written to or holds results.
    """
    refuse_overwrite(*(out / name for name in RESULT_NAMES), force=force)
    check_inputs(*subject.data)
    next_runs = None if allowed is None else read_allowed(allowed)
    with name_model_errors(_file_of(subject.name)), unfinished(out / PLAN_NAME) as plan_path:
        analysis = _analyse(
            subject, extended, seed, confirm, plan_path, shortening or Shortening(), next_runs
        )
        is_bad = analysis.verdict.verdict is Answer.BAD_DATA
        if is_bad:
            plan_path.unlink(missing_ok=True)
        else:
            write_results(out, analysis, subject.name, wall_time_text())
    if not is_bad:
        write_report(out, analysis)
    if as_json:
        print_json_text(verdict_text(analysis))
    else:
        _print(analysis, out)
    return EXIT_NO if is_bad else EXIT_OK


def check_effects(model_name: str, data: Path, *, as_json: bool, shortening: Shortening | None = None) -> int:
    """Print what the inputs of the runs can show of each effect; returns the exit code.

    Raises:
        ConfigError: No such model or data, no machine, or a model with an error.
    """
    check_inputs(data)
    with name_model_errors(_file_of(model_name)):
        model = load_model(model_name)
        if not isinstance(model, Machine):
            raise ConfigError(
                f"gap check: {model_name} is no StateModel and no mock-up unit; use `rover-hil gap`"
            )
        report = _lint(model, data, shortening or Shortening())
    _print_report(report, as_json=as_json)
    return EXIT_NO if report.problems else EXIT_OK


def _lint(model: Machine, data: Path, shortening: Shortening) -> LintReport:
    try:
        runs = read_runs(model, data)
    except (ConfigError, LogError) as error:
        return LintReport(problems=(str(error),))
    runs = shortening.apply(model, runs)
    objection = object_to(model, runs)
    if objection is not None:
        return LintReport(problems=(objection.reason,))
    with show_steps("trying the model") as step:
        notes = (*slower_channels(model, runs), *try_model(model, runs))
        for note in notes:
            say(f"Note: {note}")
        step("checking the effects")
        return lint(model.refined(runs), runs)


def _print_report(report: LintReport, *, as_json: bool) -> None:
    if as_json:
        print_json_text(report.as_json())
        return
    console = Terminal(soft_wrap=True)
    for line in report.lines():
        console.print(line)


def _file_of(model_name: str) -> Path:
    return Path(model_name.rpartition(":")[0])


def _print(analysis: Analysis, out: Path) -> None:
    console = Terminal(soft_wrap=True)
    for line in analysis.verdict.lines():
        console.print(line)
    if analysis.verdict.verdict is not Answer.BAD_DATA:
        console.print(str(out / REPORT_NAME))


def say(words: str) -> None:
    """Print a sentence beside the results."""
    Terminal(stderr=True, soft_wrap=True).print(f"{words}.")


def _objection(model: Model, runs: Sequence[Run]) -> str:
    """Return why runs cannot be used; empty where they can."""
    try:
        require_runs(runs)
    except TooFewRunsError as error:
        return str(error)
    objection = object_to(model, runs)
    return "" if objection is None else objection.reason


def _analyse(
    subject: Subject,
    extended: Path | None,
    seed: int,
    confirm: str,
    plan_path: Path,
    shortening: Shortening,
    allowed: Allowed | None,
) -> Analysis:
    base = subject.make()
    if allowed is not None:
        if not isinstance(base, Machine):
            raise ConfigError(
                f"--allowed: {subject.name} is no StateModel and no functional mock-up unit; "
                "leave out --allowed"
            )
        allowed.require_names(base)
    file = None if extended is None else read_model_file(extended)
    try:
        runs = subject.read(base)
    except (ConfigError, LogError) as error:
        verdict = refuse(Answer.BAD_DATA, str(error))
        return Analysis(model=base, verdict=verdict, runs=(), plan=None)
    runs = shortening.apply(base, runs)
    # Only after reading: what a model predicts may depend on what was measured.
    model: Model = base if file is None else extend_model(base, file)

    def on_plan(plan: Plan) -> None:
        plan_path.write_text(plan_text(plan), "utf-8")

    with show_steps("checking the model") as advance:
        _check(model, runs)
        analysis = analyse(
            model,
            runs,
            seed=seed,
            confirm=confirm,
            allowed=allowed,
            on_plan=on_plan,
            advance=advance,
            announce=say,
        )
    warnings = (*subject.warnings, *analysis.verdict.warnings)
    return replace(analysis, verdict=replace(analysis.verdict, warnings=warnings))


def _check(model: Model, runs: Sequence[Run]) -> None:
    """Check a model on its runs.

    Raises:
        ConfigError: The model has an error.
    """
    if not isinstance(model, Machine):
        check_model(model, runs)
    # The verdict names what is wrong with runs; a model cannot be tried on them.
    elif not _objection(model, runs):
        for note in (*slower_channels(model, runs), *try_model(model, runs)):
            say(f"Note: {note}")
        check_model(model, runs)
        require_changes(model, runs)
