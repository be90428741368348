"""The report: one self-contained page."""

from collections.abc import Sequence

from rover_hil.gap.explain.localise_residuals import by_place
from rover_hil.gap.findings import Analysis
from rover_hil.gap.output.figures import draw_report
from rover_hil.gap.verdict import Answer
from rover_hil.pages.render import render

GRADES = {
    Answer.NO_GAP: "good",
    Answer.NAMED: "good",
    Answer.NAMED_SET: "attention",
    Answer.PARTLY_NAMED: "attention",
    Answer.UNNAMED: "attention",
    Answer.NOT_IDENTIFIABLE: "attention",
    Answer.BAD_DATA: "bad",
}
TAGS = {
    Answer.NO_GAP: "no gap",
    Answer.NAMED: "named",
    Answer.NAMED_SET: "named, with alternatives",
    Answer.PARTLY_NAMED: "partly named",
    Answer.UNNAMED: "unexplained gap",
    Answer.NOT_IDENTIFIABLE: "not identifiable",
    Answer.BAD_DATA: "bad data",
}


def report_text(analysis: Analysis) -> str:
    """Return the report as HTML."""
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
