"""`rover-hil gap`: where model and measurement disagree, what is missing, and the proof."""

from pathlib import Path

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from drivers.clock import wall_time_text
from drivers.errors import ConfigError, LogError
from rover_hil.app.exit_codes import EXIT_NO, EXIT_OK
from rover_hil.app.options import check_inputs
from rover_hil.gap import verdict_rules
from rover_hil.gap.data.load import check_model, load_model, name_model_errors, read_runs
from rover_hil.gap.findings import Analysis
from rover_hil.gap.output.model_file import ExtendedModel, read_model_file
from rover_hil.gap.output.results import (
    PLAN_NAME,
    REPORT_NAME,
    RESULT_NAMES,
    plan_text,
    verdict_text,
    write_results,
)
from rover_hil.gap.plan import Plan
from rover_hil.gap.verdict import Answer
from rover_hil.gap.workflow import analyse
from rover_hil.pages.atomic_write import refuse_overwrite, unfinished
from sim_backends.models.interface import Model


def find_gap(
    model_name: str,
    data: Path,
    *,
    out: Path,
    extended: Path | None,
    confirm: str,
    seed: int,
    as_json: bool,
    force: bool = False,
) -> int:
    """Analyse data against a model and write the results, unless the data is bad; returns the exit code.

    Args:
        model_name: A shipped model, or `file.py:factory`.
        data: File or folder of measured runs.
        out: Folder for the results.
        extended: Model file of an earlier analysis, or None.
        confirm: Expression that selects the runs to lock; empty to draw them.
        seed: Of all random numbers.
        as_json: Print the verdict as JSON.
        force: Replace earlier results.

    Raises:
        ConfigError: No such model or data, a model file with an error, a wrong expression, or a folder that
            cannot be written to or holds results.
    """
    refuse_overwrite(*(out / name for name in RESULT_NAMES), force=force)
    check_inputs(data)
    with name_model_errors(Path(model_name.rpartition(":")[0])), unfinished(out / PLAN_NAME) as plan_path:
        analysis = _analyse(model_name, data, extended, seed, confirm, plan_path)
        is_bad = analysis.verdict.verdict is Answer.BAD_DATA
        if is_bad:
            plan_path.unlink(missing_ok=True)
        else:
            write_results(out, analysis, model_name, wall_time_text())
    if as_json:
        Console().out(verdict_text(analysis))
    else:
        _print(analysis, out)
    return EXIT_NO if is_bad else EXIT_OK


def _print(analysis: Analysis, out: Path) -> None:
    console = Console(highlight=False, soft_wrap=True)
    for line in analysis.verdict.lines():
        console.print(line, markup=False)
    if analysis.verdict.verdict is not Answer.BAD_DATA:
        console.print(str(out / REPORT_NAME), markup=False)


def _analyse(
    model_name: str, data: Path, extended: Path | None, seed: int, confirm: str, plan_path: Path
) -> Analysis:
    base = load_model(model_name)
    file = None if extended is None else read_model_file(extended)
    try:
        runs = read_runs(base, data)
    except (ConfigError, LogError) as error:
        verdict = verdict_rules.refuse(Answer.BAD_DATA, str(error))
        return Analysis(model=base, verdict=verdict, runs=(), plan=None, findings=None)
    # Only after reading: what a model predicts may depend on what was measured.
    model: Model = base if file is None else ExtendedModel(base, file)
    check_model(model, runs)

    def on_plan(plan: Plan) -> None:
        plan_path.write_text(plan_text(plan), "utf-8")

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("reading", total=None)
        return analyse(
            model,
            runs,
            seed=seed,
            confirm=confirm,
            on_plan=on_plan,
            advance=lambda words: progress.update(task, description=words),
        )
