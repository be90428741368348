"""The report on a machine: one self-contained page."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import matplotlib as mpl
from matplotlib.figure import Figure

from rover_hil.gap.decision.analysis import MachineFindings
from rover_hil.gap.findings import Analysis
from rover_hil.gap.fit.base_parameters import headline
from rover_hil.gap.output import figures, force_figures
from rover_hil.gap.output.answer_style import STYLES
from rover_hil.gap.output.draft_file import draft_lines, tested_words
from rover_hil.gap.output.error_source import channel_sources, force_sources
from rover_hil.gap.output.next_run_figures import draw_next_run
from rover_hil.gap.output.series import ForceTrace, Trace, forces, traces
from rover_hil.gap.output.words import lead, next_steps
from rover_hil.gap.verdict import Answer, Verdict
from rover_hil.pages.picture import Drawing, draw_pictures
from rover_hil.pages.render import render

OPTIONAL = (
    "evident",
    "has_effects",
    "is_steady",
    "steps",
    "sizes",
    "evidence",
    "run_rows",
    "budget_pictures",
    "trace_pictures",
    "map_pictures",
    "force_pictures",
    "channel_sources",
    "force_sources",
    "proposal",
    "next_run_pictures",
    "drafts",
)
"""Parts of the page that data which cannot be analysed do not have."""


class SizeRow(NamedTuple):
    """A size of a named effect."""

    effect: str
    parameter: str
    value: float
    unit: str
    ci95: Sequence[float]
    other: float | None
    is_outside: bool


class RunRow(NamedTuple):
    """The fitted unknowns of one run: value and pull by name."""

    run: str
    values: dict[str, tuple[float, float]]


def report_text(analysis: Analysis) -> str:
    """Return the report as HTML."""
    findings, verdict = analysis.machine, analysis.verdict
    if findings is None:
        return _page(analysis)
    shown = traces(findings)
    pushed = forces(findings)
    steady = findings.problem.observations.is_steady
    budgets = list(draw_pictures(_budget_drawings(findings)))
    errors = list(draw_pictures((_steady_drawings if steady else _trace_drawings)(findings, shown)))
    force = list(draw_pictures(_force_drawings(findings, pushed)))
    # With a name the error that falls, without one the force that a missing law would exert.
    budgets.sort(key=lambda one: one.title != f"Error budget of {_worst_channel(findings)}")
    is_force = bool(force) and not findings.best.names
    evident = [errors.pop(0)] if errors else []
    evident += [force.pop()] if is_force else [budgets.pop(0)] if budgets else []
    return _page(
        analysis,
        grade=_grade(findings, verdict),
        lead=lead(findings),
        has_effects=bool(findings.best.names),
        steps=next_steps(findings, verdict),
        cards={card.name: card for card in findings.machine.effects},
        sizes=_sizes(verdict),
        evidence=findings.evidence if verdict.effects else (),
        run_units={one.name: one.unit for one in findings.machine.run_parameters},
        run_rows=_run_rows(findings),
        evident=evident,
        budget_pictures=budgets,
        is_steady=steady,
        trace_pictures=errors,
        map_pictures=() if steady else draw_pictures(_map_drawings(findings, shown)),
        force_pictures=force,
        channel_sources=_sources(findings, shown),
        force_sources=force_sources(findings, pushed),
        proposal=analysis.proposal,
        next_run_pictures=draw_pictures(_next_run_drawings(analysis)),
        drafts=list(zip(verdict.draft, draft_lines(verdict), strict=True)),
    )


def _worst_channel(findings: MachineFindings) -> str:
    """Return the channel with the greatest model error before, in its noise."""
    return max(findings.budget_before, key=lambda one: one.model_error / one.sensor_noise).channel


def _page(analysis: Analysis, **parts: object) -> str:
    verdict = analysis.verdict
    grade, tag = STYLES[verdict.verdict]
    none = {**dict.fromkeys(OPTIONAL, ()), "cards": {}, "run_units": {}, "lead": "", "grade": grade}
    return render(
        "gap/output/report.html",
        filters={"number": _number, "interval": _interval, "tested": tested_words},
        model=analysis.model,
        verdict=verdict,
        tag=tag,
        headline=headline(verdict),
        plan=analysis.plan.content() if analysis.plan is not None else None,
        **{**none, **parts},
    )


def _sources(findings: MachineFindings, shown: Sequence[Trace]) -> list[str]:
    """Return what the errors follow: signals and time, or conditions."""
    if findings.locations:
        return [f"{one.sentence()}." for one in findings.locations]
    return channel_sources(findings, shown) if findings.found is not None else []


def _grade(findings: MachineFindings, verdict: Verdict) -> str:
    """Return the colour; green without a gap only where the error budget is below the tolerance."""
    is_good = all(one.is_good_enough for one in findings.budget_before)
    if verdict.verdict is Answer.NO_GAP and not is_good:
        return "attention"
    return STYLES[verdict.verdict][0]


def _sizes(verdict: Verdict) -> list[SizeRow]:
    rows = []
    for effect in verdict.effects:
        for name, one in effect.parameters.items():
            other = verdict.weightings.get(f"{effect.name}.{name}", {}).get("random_force")
            is_outside = other is not None and not one.ci95[0] <= other <= one.ci95[1]
            rows.append(SizeRow(effect.name, name, one.value, one.unit, one.ci95, other, is_outside))
    return rows


def _run_rows(findings: MachineFindings) -> list[RunRow]:
    by_run: dict[str, dict[str, tuple[float, float]]] = {}
    found = findings.best.fit
    for item, pull in zip(found.free, found.pull, strict=True):
        if item.key.run:
            by_run.setdefault(item.key.run, {})[item.key.shared.text] = (found.point[item.key], float(pull))
    return [RunRow(run, values) for run, values in by_run.items()]


def _sized(title: str, draw: Callable[[], Figure | None]) -> Drawing:
    """Return a drawing with text for a picture as wide as a phone."""

    def small() -> Figure | None:
        with mpl.rc_context(figures.SMALL):
            return draw()

    return Drawing(title, "", small)


def _budget_drawings(findings: MachineFindings) -> list[Drawing]:
    pairs = zip(findings.budget_before, findings.budget_after, strict=True)
    return [
        _sized(
            f"Error budget of {before.channel}",
            partial(figures.draw_budget, before, after if findings.best.names else None),
        )
        for before, after in pairs
    ]


def _trace_drawings(findings: MachineFindings, shown: Sequence[Trace]) -> list[Drawing]:
    return [
        _sized(f"{one.channel.name} in run {one.run}", partial(figures.draw_trace, one))
        for row in figures.chosen_traces(findings, shown)
        for one in row
    ]


def _steady_drawings(findings: MachineFindings, shown: Sequence[Trace]) -> list[Drawing]:
    return [
        _sized(
            f"{channel.name}, measured against simulated",
            partial(figures.draw_agreement, [one for one in shown if one.channel.name == channel.name]),
        )
        for channel in findings.problem.observations.channels
    ]


def _map_drawings(findings: MachineFindings, shown: Sequence[Trace]) -> list[Drawing]:
    drawings = []
    for row in figures.chosen_traces(findings, shown):
        channel = row[0].channel.name
        own = [one for one in shown if one.channel.name == channel]
        for is_after in (False, True):
            title = f"Error of {channel} by run and time, {'after' if is_after else 'before'}"
            drawings.append(_sized(title, partial(figures.draw_map, own, is_after=is_after)))
    return drawings


def _force_drawings(findings: MachineFindings, pushed: Sequence[ForceTrace]) -> list[Drawing]:
    drawings = []
    for port in dict.fromkeys(one.port for one in pushed):
        own = [one for one in pushed if one.port == port]
        if not any(one.force.any() for one in own):
            continue
        drawings.append(
            _sized(f"Unknown force at {port} over time", partial(force_figures.draw_force_over_time, own))
        )
        drawings += [
            _sized(
                f"Unknown force at {port} against {state}",
                partial(force_figures.draw_force_by_state, own, state, unit),
            )
            for state, unit in findings.machine.states.items()
        ]
    return drawings


def _next_run_drawings(analysis: Analysis) -> list[Drawing]:
    proposal = analysis.proposal
    if proposal is None:
        return []
    return [
        _sized(f"{one.name} in the next run", partial(draw_next_run, proposal, one))
        for one in analysis.model.channels[: figures.MOST_CHANNELS]
        if one.name in proposal.options[0].planned.run.measured
    ]


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"


def _interval(values: Sequence[float] | None) -> str:
    return "–" if values is None else f"{values[0]:.3g} to {values[1]:.3g}"
