"""`rover-hil gap`: where model and measurement disagree, what is missing, and the proof."""

from pathlib import Path

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from drivers.clock import wall_time_text
from drivers.errors import ConfigError, LogError
from rover_hil.gap import verdict_rules
from rover_hil.gap.data.load import check_model, load_model, read_runs
from rover_hil.gap.findings import Analysis
from rover_hil.gap.output.model_file import ExtendedModel, read_model_file
from rover_hil.gap.output.results import PLAN_NAME, REPORT_NAME, plan_text, write_results
from rover_hil.gap.plan import Plan
from rover_hil.gap.verdict import Answer
from rover_hil.gap.workflow import analyse
from rover_hil.report.write import write_all
from sim_backends.models.interface import Model, Run

EXIT_OK = 0
EXIT_NO = 1


def find_gap(
    model_name: str, data: Path, *, out: Path, extended: Path | None, confirm: str, seed: int, as_json: bool
) -> int:
    """Analyse data against a model and write the results; returns the exit code.

    Args:
        model_name: A shipped model, or `file.py:factory`.
        data: File or folder of measured runs.
        out: Folder for the results.
        extended: Model file of an earlier analysis, or None.
        confirm: Expression that selects the runs to lock; empty to draw them.
        seed: Of all random numbers.
        as_json: Print the verdict as JSON.

    Raises:
        ConfigError: No such model or data, a wrong expression, or results that cannot be written.
    """
    base = load_model(model_name)
    file = None if extended is None else read_model_file(extended)
    if not data.exists():
        raise ConfigError(f"there is no {data}: give the file or folder of measured runs")
    messages = Console(stderr=True)
    try:
        runs = read_runs(base, data)
    except (ConfigError, LogError) as error:
        verdict = verdict_rules.refuse(Answer.BAD_DATA, str(error))
        analysis = Analysis(model=base, verdict=verdict, runs=(), plan=None, findings=None)
    else:
        # Only after reading: what a model predicts may depend on what was measured.
        model: Model = base if file is None else ExtendedModel(base, file)
        check_model(model, runs)
        analysis = _analyse(model, runs, seed, confirm, out, messages)
    verdict_json = write_results(out, analysis, model_name, wall_time_text())
    if as_json:
        Console().out(verdict_json)
    else:
        _print(analysis, out)
    return EXIT_NO if analysis.verdict.verdict is Answer.BAD_DATA else EXIT_OK


def _print(analysis: Analysis, out: Path) -> None:
    console = Console(highlight=False)
    for line in analysis.verdict.lines():
        console.print(line, soft_wrap=True, markup=False)
    console.print(str(out / REPORT_NAME), soft_wrap=True, markup=False)


def _analyse(
    model: Model, runs: list[Run], seed: int, confirm: str, out: Path, messages: Console
) -> Analysis:
    def on_plan(plan: Plan) -> None:
        write_all(out, {PLAN_NAME: plan_text(plan)})

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=messages, transient=True) as progress:
        task = progress.add_task("reading", total=None)
        return analyse(
            model,
            runs,
            seed=seed,
            confirm=confirm,
            on_plan=on_plan,
            advance=lambda words: progress.update(task, description=words),
        )
