"""The verdict on a machine and its sentence."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict

from rover_hil.gap.decision.analysis import MachineFindings
from rover_hil.gap.evidence.error_budget import ChannelError
from rover_hil.gap.evidence.score import Score, one_sided_z
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.search.search import best_shapes, ranked_scores
from rover_hil.gap.verdict import Answer, FoundEffect, FoundParameter, Verdict
from sim_backends.state_model.model import has_ports

DRAFT_KEYS = (
    "coefficient", "low", "high", "unit", "code", "force_before", "force_after", "force_unit", "is_confirmed",
)  # fmt: skip
"""What `verdict.json` states of a draft, besides its term."""


def decide_machine(findings: MachineFindings) -> Verdict:
    """Return the verdict on the findings."""
    answer, reasons = _answer(findings)
    is_named = answer.is_name
    found = findings.found
    members = [findings.best.names] if is_named else []
    if is_named and found is not None:
        members += [one.names for one in found.alternatives]
    return Verdict(
        verdict=answer,
        sentence=_sentence(findings, answer, reasons) + _draft_failure(findings),
        p_gap=findings.p_gap,
        where=_where(findings),
        effects=_effects(findings) if is_named else [],
        confidence_set=[list(names) for names in members],
        rejected=_rejected(findings, answer),
        unnamed=_unnamed(findings),
        detectable=_detectable(findings),
        gap=_gap(findings),
        error_budget=_budget(findings),
        draft=[
            {"term": one.equation, **{key: getattr(one, key) for key in DRAFT_KEYS}}
            for one in findings.drafts
        ],
        weightings=_weightings(findings) if is_named else {},
        warnings=_warnings(findings) if is_named else [],
    )


def _draft_failure(findings: MachineFindings) -> str:
    if not findings.draft_failure:
        return ""
    return f" The search of a missing term did not end ({findings.draft_failure}): the rest is complete."


def _unnamed(findings: MachineFindings) -> list[dict[str, str | float]]:
    """Return what no effect explains as equations."""
    found: list[tuple[str, str, str, float]] = [
        (_equation(one.equation, one.coefficient, one.unit), one.unit, one.closest, one.cosine)
        for one in findings.drafts
    ]
    found += [(one.text, one.unit, one.closest, one.cosine) for one in findings.equations]
    return [
        {"equation": text, "unit": unit, "closest": closest, "cosine": round(cosine, 3)}
        for text, unit, closest, cosine in found
    ]


def _where(findings: MachineFindings) -> list[dict[str, str | float | int]]:
    return [
        {"channel": one.channel, "condition": one.condition, "size": one.size, "unit": one.unit, "n": one.n}
        for one in findings.locations
    ]


def _answer(findings: MachineFindings) -> tuple[Answer, list[str]]:
    if findings.p_gap > MACHINES.tests.alpha:
        unsure = [one for one in findings.budget_before if not one.is_good_enough]
        if unsure and findings.base.evidence.has_budget:
            return Answer.NOT_IDENTIFIABLE, [one.sentence() for one in unsure]
        unjudged = _unjudged(findings)
        return (Answer.NOT_IDENTIFIABLE, [unjudged]) if unjudged else (Answer.NO_GAP, [])
    found, holdout = findings.found, findings.holdout
    if found is None or not findings.best.names or holdout is None:
        return _without_name(findings)
    share = _explained(findings)
    if share < MACHINES.verdict.half:
        sizes = "; ".join(_size_text(one) for one in _effects(findings))
        return Answer.UNNAMED, [
            f"the best, {_join(findings.best.names)} ({sizes}), explains {share:.0%} of it"
        ]
    reasons = _reservations(findings)
    if len(found.alternatives) + 1 > MACHINES.verdict.most_members:
        return Answer.NOT_IDENTIFIABLE, ["more than four explanations fit the runs equally well"]
    if reasons:
        return Answer.PARTLY_NAMED, reasons
    return (Answer.NAMED_SET if found.alternatives else Answer.NAMED), []


def _explained(findings: MachineFindings) -> float:
    """Return the share of the gap that the best explains, on locked runs where that is defined."""
    closure = None if findings.holdout is None else findings.holdout.closure
    return findings.best.evidence.share_of_gap(closure, findings.share, findings.p_remaining)


def _without_name(findings: MachineFindings) -> tuple[Answer, list[str]]:
    """Return the answer where no effect is named, with the reason."""
    if findings.p_within_runs > MACHINES.tests.alpha:
        units = {one.name: one.unit for one in findings.machine.parameters}
        differ = f"parameters differ between runs ({findings.scatter.sentence(units)})"
        if all(one.is_good_enough for one in findings.budget_before):
            return Answer.NO_GAP, [differ]
        return Answer.UNNAMED, [f"{differ}, which explains it: give them a `scatter_sd`"]
    withdrawn = () if findings.found is None else findings.found.best.names
    unjudged = _unjudged(findings)
    if unjudged:
        return Answer.NOT_IDENTIFIABLE, [unjudged]
    if withdrawn:
        return Answer.UNNAMED, [f"the best, {_join(withdrawn)}, {_on_locked_runs(findings)}"]
    return Answer.UNNAMED, []


def _unjudged(findings: MachineFindings) -> str:
    """Return why agreement cannot be judged; empty where it can."""
    slow = findings.base.evidence.slow
    if not slow:
        return ""
    return (
        f"agreement cannot be judged without sigma: the errors of {', '.join(slow)} are slow, and may be "
        "those of the sensor or of the model; declare sigma of the sensor"
    )


def _on_locked_runs(findings: MachineFindings) -> str:
    improved = 0.0 if findings.holdout is None else findings.holdout.improved
    if improved >= 0.5:
        return "leaves errors on the locked runs that lean towards the model without it"
    return f"improves {improved:.0%} of the locked runs only"


def _reservations(findings: MachineFindings) -> list[str]:
    """Return why the names are not certain or not complete."""
    reasons: list[str] = []
    holdout = findings.holdout
    is_rest_small = all(one.is_good_enough for one in findings.budget_after)
    closure = None if holdout is None else holdout.closure
    is_on_locked = findings.best.evidence.has_budget
    if closure is None and is_on_locked:
        reasons.append("the gap on the locked runs is too small to prove it")
    elif closure is not None and is_on_locked and closure < MACHINES.verdict.whole and not is_rest_small:
        reasons.append(f"it closes {closure:.0%} of the gap on locked runs only")
    elif findings.p_remaining <= MACHINES.tests.alpha and not is_rest_small:
        reasons.append("a model error remains")
    reasons += [f"the term {name} explains as much" for name in findings.rival_terms[:2]]
    return reasons


def _sentence(findings: MachineFindings, answer: Answer, reasons: Sequence[str]) -> str:
    before = _errors(findings.budget_before)
    if answer is Answer.NO_GAP:
        return _agreement(findings, before, reasons)
    if not findings.best.names and answer is Answer.NOT_IDENTIFIABLE:
        return f"No gap was found, but these runs cannot exclude one: {'; '.join(reasons)}."
    head = f"There is a gap ({before})"
    if answer is Answer.UNNAMED:
        why = f"; {reasons[0]}" if reasons else "; the runs do not agree on a cause"
        if all(one.is_good_enough for one in findings.budget_after):
            why += "; the error is below the tolerance of the model"
        draft = f". A missing term would be: {findings.drafts[0].equation}" if findings.drafts else ""
        return f"{head}{why}{draft}."
    if answer is Answer.NOT_IDENTIFIABLE:
        return f"{head}; {'; '.join(reasons)}."
    names = _join(findings.best.names)
    if findings.found is not None and findings.found.alternatives:
        others = [_join(one.names) for one in findings.found.alternatives]
        names = f"{' or '.join([names, *others])}, which these runs do not distinguish"
    verb = "Missing" if answer is not Answer.PARTLY_NAMED else "Probably missing"
    closure = None if findings.holdout is None else findings.holdout.closure
    closed = "" if closure is None else f" It closes {closure:.0%} of the gap on locked runs."
    sizes = "; ".join(_size_text(one) for one in _effects(findings))
    rest = f" Afterwards {_errors(findings.budget_after)}."
    but = f" But {'; '.join(reasons)}." if reasons else ""
    releases = {card.name: card.releases for card in findings.machine.effects}
    # The base parameter that an effect releases has taken the gap on itself: nothing seems to be missing.
    before = "" if all(releases[name] for name in findings.best.names) else f" Before, {before}."
    return f"{verb}: {names} ({sizes}).{closed}{before}{rest}{but}"


def _agreement(findings: MachineFindings, before: str, reasons: Sequence[str]) -> str:
    name = findings.machine.name
    if reasons:
        return f"No common gap: {reasons[0]}, and the error of {name} is below its tolerance ({before})."
    return (
        f"No gap: {name} agrees with {findings.problem.observations.run_count} runs within the noise of the "
        f"sensors ({before}; p = {findings.p_gap:.2g})."
    )


def _errors(budget: Sequence[ChannelError]) -> str:
    """Return the greatest error, in its noise, in words; the page has those of all channels."""
    greatest = max(budget, key=lambda error: error.model_error / error.sensor_noise)
    of_all = f", the greatest of {len(budget)} channels" if len(budget) > 1 else ""
    return f"{greatest.sentence()}{of_all}"


def _effects(findings: MachineFindings) -> list[FoundEffect]:
    cards = {card.name: card for card in findings.machine.effects}
    found = []
    for name in findings.best.names:
        parameters = {}
        for item in cards[name].parameters:
            size = findings.size(name, item.name)
            parameters[item.name] = FoundParameter(
                value=size.value, unit=item.unit, ci95=(size.low, size.high)
            )
        found.append(FoundEffect(name=name, parameters=parameters))
    return found


def _size_text(effect: FoundEffect) -> str:
    parts = []
    for name, one in effect.parameters.items():
        unit = "" if one.unit == "1" else f" {one.unit}"
        parts.append(f"{name} {one.value:.3g}{unit}, {one.ci95[0]:.3g} to {one.ci95[1]:.3g}")
    return f"{effect.name}: {'; '.join(parts)}"


def _rejected(findings: MachineFindings, answer: Answer) -> list[dict[str, str]]:
    kept = set(findings.best.names)
    if findings.found is None:
        return [{"name": card.name, "why": "there is no gap to explain"} for card in findings.machine.effects]
    kept |= {name for one in findings.found.alternatives for name in one.names}
    withdrawn = set(findings.found.best.names) - kept
    objections = {
        **findings.found.objections,
        **dict.fromkeys(withdrawn, f"withdrawn: {_on_locked_runs(findings)}"),
    }
    if answer is Answer.UNNAMED:
        weak = f"explains only a part of the gap: {_explained(findings):.0%}"
        objections |= dict.fromkeys(kept, weak)
        kept = set()
    scores = {one.direction.name: one for one in best_shapes(findings.scores)}
    return [
        {"name": card.name, "why": objections.get(card.name) or _unscored(scores.get(card.name))}
        for card in findings.machine.effects
        if card.name not in kept
    ]


def _unscored(score: Score | None) -> str:
    if score is not None and one_sided_z(score) == 0.0 and score.z:
        return f"the data supports only the impossible sign ({score.z:+.1f} standard deviations)"
    if score is None:
        return "not visible in these runs: it changes no prediction, or base parameters imitate it"
    return "other effects explain more on left-out runs"


def _detectable(findings: MachineFindings) -> list[dict[str, str | float]]:
    return [
        {
            "name": one.direction.name,
            "size": MACHINES.verdict.power_z * one.standard_error,
            "unit": one.direction.unit,
        }
        for one in ranked_scores(findings.scores)
    ]


def _gap(findings: MachineFindings) -> dict[str, Mapping[str, float | Sequence[float] | None]]:
    if findings.holdout is None:
        return {}
    return {name: asdict(one) for name, one in findings.holdout.channels.items()}


def _budget(findings: MachineFindings) -> dict[str, dict[str, float | str | None]]:
    return {
        before.channel: {
            "unit": before.unit,
            "sensor_noise": before.sensor_noise,
            "tolerance": before.tolerance,
            "run_scatter": after.run_scatter,
            "model_error_before": before.model_error,
            "upper_before": before.upper,
            "model_error_after": after.model_error,
            "upper_after": after.upper,
        }
        for before, after in zip(findings.budget_before, findings.budget_after, strict=True)
    }


def _weightings(findings: MachineFindings) -> dict[str, dict[str, float]]:
    return {
        key.text: {"output_error": findings.best.fit.point[key], "random_force": value}
        for key, value in findings.other_weighting.items()
        if key in findings.best.fit.point
    }


def _warnings(findings: MachineFindings) -> list[str]:
    warnings = []
    if findings.tracked is None and has_ports(findings.machine):
        warnings.append(
            "no random force keeps the machine on its runs: sizes are not compared with a second weighting"
        )
    if findings.p_remaining <= MACHINES.tests.alpha:
        warnings.append(
            "a model error remains: intervals hold for the model as it is, sizes may be off by more"
        )
    channels = {} if findings.holdout is None else findings.holdout.channels
    units = {one.channel: one.unit for one in findings.budget_after}
    warnings += [
        f"errors of {name} on locked runs, {one.after:.3g} {units[name]}, are far smaller than its noise, "
        f"{one.noise_floor:.3g} {units[name]}: this noise is too large, and the gap is larger than reported"
        for name, one in channels.items()
        if one.after**2 < MACHINES.verdict.half * one.noise_floor**2
    ]
    for key, value in findings.other_weighting.items():
        if key not in findings.best.fit.point:
            continue
        size = findings.size(key.effect, key.name)
        if not size.low <= value <= size.high:
            warnings.append(
                f"{key.name} of {key.effect} depends on the weighting: {size.value:.3g} by the output error, "
                f"{value:.3g} with random forces at the ports"
            )
    return warnings


def _equation(equation: str, coefficient: float, unit: str) -> str:
    return equation.replace("+= c ", f"+= ({coefficient:.3g} {unit}) * ")


def _join(names: Sequence[str]) -> str:
    return " and ".join(names)
