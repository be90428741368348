"""Files of an analysis: verdict, plan, model and report, in one folder."""

import json
from pathlib import Path

from pydantic_core import to_json

from rover_hil.gap.evidence.sizes import size_of
from rover_hil.gap.findings import Analysis
from rover_hil.gap.output.draft_file import DRAFT_NAME, draft_text
from rover_hil.gap.output.model_file import ModelFile, Provenance, describe_model, model_file_text, with_found
from rover_hil.gap.output.next_run_file import NEXT_RUN_NAME, next_run_text
from rover_hil.gap.output.report import report_text
from rover_hil.gap.plan import Plan
from rover_hil.pages.add_page import add_page
from rover_hil.pages.atomic_write import write_files

VERDICT_NAME = "verdict.json"
MODEL_NAME = "model.toml"
REPORT_NAME = "report.html"
PLAN_NAME = "plan.json"
RESULT_NAMES = (VERDICT_NAME, PLAN_NAME, MODEL_NAME, REPORT_NAME, DRAFT_NAME, NEXT_RUN_NAME)


def plan_text(plan: Plan) -> str:
    """Return a plan as JSON, with its hash."""
    return json.dumps(plan.content(), indent=2) + "\n"


def verdict_text(analysis: Analysis) -> str:
    """Return the verdict as JSON."""
    return to_json(analysis.verdict, indent=2, inf_nan_mode="null").decode()


def write_results(folder: Path, analysis: Analysis, base: str, date: str) -> None:
    """Write `verdict.json` and `model.toml`, and why there is no plan where there is none.

    Missing terms that were found in the equations of a machine are written to `draft_effects.py`, its next
    run to `next_run.csv`; without them a file of an earlier analysis is removed.

    The plan itself is written before the analysis.

    Raises:
        ConfigError: The folder cannot be written to. No half-written file is left behind.
    """
    texts = {
        VERDICT_NAME: verdict_text(analysis) + "\n",
        MODEL_NAME: _model_text(analysis, base, date),
    }
    if analysis.verdict.draft:
        texts[DRAFT_NAME] = draft_text(analysis.verdict)
    if analysis.proposal is not None:
        texts[NEXT_RUN_NAME] = next_run_text(analysis.proposal)
    if analysis.plan is None:
        texts[PLAN_NAME] = json.dumps({"reason": analysis.verdict.sentence}) + "\n"
    write_files(folder, texts)
    for name in (DRAFT_NAME, NEXT_RUN_NAME):
        if name not in texts:
            (folder / name).unlink(missing_ok=True)


def write_report(folder: Path, analysis: Analysis) -> None:
    """Write `report.html` beside the results of an analysis.

    Raises:
        ConfigError: The folder cannot be written to.
    """
    add_page(folder / REPORT_NAME, lambda: report_text(analysis))


def _model_text(analysis: Analysis, base: str, date: str) -> str:
    plan, verdict = analysis.plan, analysis.verdict
    provenance = Provenance(
        date=date,
        verdict=str(verdict.verdict),
        data_sha256=plan.data_sha256 if plan is not None else "",
        plan_sha256=str(plan.content()["plan_sha256"]) if plan is not None else "",
        seed=plan.seed if plan is not None else 0,
        alternatives=tuple(tuple(names) for names in verdict.confidence_set[1:])
        if verdict.verdict.is_name
        else (),
    )
    return model_file_text(model_file_of(analysis, base, provenance))


def model_file_of(analysis: Analysis, base: str, provenance: Provenance) -> ModelFile:
    """Return the model file with what was named; the unknowns of single runs are left out."""
    sizes = {}
    if analysis.verdict.effects and analysis.machine is not None:
        best = analysis.machine.best
        sizes = {item.key: size_of(best, item.key) for item in best.fit.free if not item.key.run}
    file = describe_model(analysis.model, base, provenance, sizes)
    order = tuple(name for names in analysis.verdict.order.values() for name in names)
    file = file.model_copy(update={"order": order})
    return file if sizes else with_found(file, analysis.verdict.base_parameters)
