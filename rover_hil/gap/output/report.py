"""The report: one self-contained page."""

from collections.abc import Sequence

from rover_hil.gap.base_parameters import headline
from rover_hil.gap.explain.localise_residuals import by_place
from rover_hil.gap.findings import Analysis
from rover_hil.gap.output.answer_style import GRADES, TAGS
from rover_hil.gap.output.figures import draw_report
from rover_hil.gap.output.machines.report import machine_report_text
from rover_hil.pages.render import render


def report_text(analysis: Analysis) -> str:
    """Return the report as HTML."""
    if analysis.machine is not None:
        return machine_report_text(analysis, analysis.machine)
    findings = analysis.findings
    cards = {card.name: card for card in analysis.model.effects}
    return render(
        "gap/output/report.html",
        filters={"number": _number},
        model=analysis.model,
        verdict=analysis.verdict,
        grade=GRADES[analysis.verdict.verdict],
        tag=TAGS[analysis.verdict.verdict],
        plan=analysis.plan.content() if analysis.plan is not None else None,
        headline=headline(analysis.verdict),
        findings=findings,
        cards=cards,
        locations=findings.locations if findings is not None else (),
        in_model=by_place(findings.naming.scores) if findings is not None else (),
        pictures=draw_report(analysis),
        harmed=findings.validation.harmed if findings is not None and findings.validation is not None else (),
        left_out=findings.prepared.left_out if findings is not None else (),
    )


def _number(value: float | Sequence[float] | None) -> str:
    if value is None:
        return "–"
    if isinstance(value, Sequence):
        return " to ".join(_number(one) for one in value)
    return f"{value:.3g}"
