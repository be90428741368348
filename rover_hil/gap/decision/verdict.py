"""The verdict on a machine and its sentence."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict

from rover_hil.gap.decision.analysis import MachineFindings
from rover_hil.gap.decision.decide import Decision
from rover_hil.gap.evidence.error_budget import ChannelError
from rover_hil.gap.evidence.evidence import MachineFit
from rover_hil.gap.evidence.score import Score, one_sided_z
from rover_hil.gap.evidence.sizes import Size, near, size_of
from rover_hil.gap.fit.base_parameters import HALF_WIDTHS
from rover_hil.gap.fit.holdout import Holdout
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.search.drafts import DraftTerm
from rover_hil.gap.search.orders import order_at_ports
from rover_hil.gap.search.residual_equations import Equation
from rover_hil.gap.search.search import best_shapes, ranked_scores
from rover_hil.gap.verdict import Answer, FoundEffect, FoundParameter, Verdict
from sim_backends.models.interface import Parameter
from sim_backends.models.parameter_key import ParameterKey
from sim_backends.state_model.model import StateModel, has_ports

DRAFT_KEYS = (
    "coefficient", "low", "high", "unit", "code", "closure", "improved", "is_confirmed",
)  # fmt: skip
"""What `verdict.json` states of a draft, besides its term."""


def decide_machine(findings: MachineFindings) -> Verdict:
    """Return the verdict on the findings."""
    answer, reasons = _answer(findings)
    is_named = answer.is_name
    members = _members(findings, answer)
    return Verdict(
        verdict=answer,
        sentence=_sentence(findings, answer, reasons) + _draft_failure(findings),
        p_gap=findings.p_gap,
        where=_where(findings),
        effects=_effects(findings, answer) if is_named else [],
        confidence_set=members,
        probabilities=_probabilities(findings),
        order=_order(findings, answer) if is_named else {},
        rejected=_rejected(findings, answer),
        unnamed=_unnamed(findings, answer),
        detectable=_detectable(findings),
        gap=_gap(findings, answer),
        error_budget=_budget(findings),
        draft=[
            {"term": one.equation, **{key: getattr(one, key) for key in DRAFT_KEYS}}
            for one in _drafts(findings, answer)
        ],
        weightings=_weightings(findings) if is_named else {},
        warnings=_warnings(findings) if is_named else [],
    )


def _draft_failure(findings: MachineFindings) -> str:
    if not findings.draft_failure:
        return ""
    return f" The search of a missing term did not end ({findings.draft_failure}): the rest is complete."


def _drafts(findings: MachineFindings, answer: Answer) -> Sequence[DraftTerm]:
    """Return the terms that are missing in the model with what is named."""
    return (findings.drafts_alone if answer is Answer.UNNAMED else ()) or findings.drafts


def _unnamed(findings: MachineFindings, answer: Answer) -> list[dict[str, str | float | None]]:
    """Return what no effect explains as equations."""
    return [
        {
            "equation": text,
            "unit": one.unit,
            "closest": one.closest,
            "cosine": round(one.cosine, 3),
            "closure": one.closure,
            "is_confirmed": one.is_confirmed,
        }
        for text, one in _missing(_drafts(findings, answer), findings.equations)
    ]


def _where(findings: MachineFindings) -> list[dict[str, str | float | int]]:
    return [
        {"channel": one.channel, "condition": one.condition, "size": one.size, "unit": one.unit, "n": one.n}
        for one in findings.locations
    ]


def _answer(findings: MachineFindings) -> tuple[Answer, list[str]]:
    if findings.p_gap > MACHINES.tests.alpha or findings.is_tolerable:
        contradicting = _on_test_runs(findings, findings.base_holdout)
        if contradicting:
            return Answer.UNNAMED, contradicting
        unsure = [one for one in findings.budget_before if not one.is_good_enough]
        if unsure and findings.base.evidence.has_budget:
            return Answer.NOT_IDENTIFIABLE, [one.sentence() for one in unsure]
        unjudged = _unjudged(findings)
        if unjudged:
            return Answer.NOT_IDENTIFIABLE, [unjudged]
        return Answer.NO_GAP, _scatter_words(findings) if findings.p_gap <= MACHINES.tests.alpha else []
    decision = findings.decision
    if decision is None or not findings.best.names or findings.holdout is None:
        return _without_name(findings)
    certainty = min(decision.probability(name) for name in findings.best.names)
    objections = _objections(findings)
    members = decision.members()
    is_listed = all(one.is_listed for one in members)
    is_whole = decision.none <= 1.0 - MACHINES.decide.named
    if certainty >= MACHINES.decide.named and is_whole and not objections:
        return Answer.NAMED, []
    is_few = is_listed and 1 < len(members) <= MACHINES.verdict.most_members
    if is_few and is_whole and all(one.names for one in members) and not objections:
        return Answer.NAMED_SET, []
    reasons = [*_doubts(decision, findings.best.names), *objections]
    if _named_part(findings):
        return Answer.PARTLY_NAMED, reasons
    if is_listed and len(members) > MACHINES.verdict.most_members:
        return Answer.NOT_IDENTIFIABLE, ["more than four explanations fit the runs equally well"]
    return Answer.UNNAMED, [f"the best, {_join(findings.best.names)}, is not certain: {'; '.join(reasons)}"]


def _named_part(findings: MachineFindings) -> list[str]:
    """Return the effects of the best explanation that are named with a reservation.

    None where one of them is far larger than declared: it imitates something else, and the others were
    fitted beside it.
    """
    decision, best = findings.decision, findings.best
    if decision is None:
        return []
    is_rest_large = not all(one.is_good_enough for one in findings.budget_after)
    if is_rest_large and _confirmed(findings, ()):
        return []  # what remains is a law at a port, and the effects may imitate a part of it
    if any(_is_too_large(findings, name) for name in best.names):
        return []
    return [name for name in best.names if decision.probability(name) >= MACHINES.decide.partly]


def _members(findings: MachineFindings, answer: Answer) -> list[list[str]]:
    """Return the explanations of the verdict, the most probable first."""
    decision = findings.decision
    if decision is None or not answer.is_name:
        return []
    if answer is Answer.PARTLY_NAMED:
        return [_named_part(findings)]
    if answer is Answer.NAMED:
        return [list(findings.best.names)]
    return [list(one.names) for one in decision.members()]


def _order(findings: MachineFindings, answer: Answer) -> dict[str, list[str]]:
    """Return the named effects that act at one place, in their order."""
    machine = findings.machine
    return order_at_ports(machine, _names(findings, answer)) if isinstance(machine, StateModel) else {}


def _names(findings: MachineFindings, answer: Answer) -> Sequence[str]:
    """Return the effects whose sizes the verdict states."""
    return _named_part(findings) if answer is Answer.PARTLY_NAMED else findings.best.names


def _order_words(findings: MachineFindings, answer: Answer) -> str:
    """Return the order of the effects in words, and whether the runs decide it."""
    order, decision = _order(findings, answer), findings.decision
    if not order or decision is None:
        return ""
    own = sum(share for share, one in decision.ranked() if one.machine is findings.machine)
    all_ = sum(share for share, one in decision.ranked() if one.names == findings.best.names)
    sure = "" if own >= MACHINES.decide.named * all_ else ", which the runs do not decide"
    return "".join(f" Order at {port}: {', then '.join(names)}{sure}." for port, names in order.items())


def _probabilities(findings: MachineFindings) -> list[dict[str, float | list[str]]]:
    """Return the probability of each explanation; one without effects is that none of them is right."""
    decision = findings.decision
    if decision is None:
        return []
    found: list[dict[str, float | list[str]]] = [
        {"effects": list(one.names), "probability": share} for share, one in decision.ranked()
    ]
    return [*found, {"effects": ["none of these"], "probability": decision.none}]


def _doubts(decision: Decision, names: Sequence[str]) -> list[str]:
    """Return what else is probable, in words."""
    found = []
    for share, one in decision.ranked():
        if one.names != names and share > 1.0 - MACHINES.decide.named:
            law = "" if one.is_listed else "the term "
            alone = " alone" if set() < set(one.names) < set(names) else ""
            what = f"{law}{_join(one.names) or 'no effect'}{alone}"
            found.append(f"{what} has a probability of {share:.0%}")
    if decision.none > 1.0 - MACHINES.decide.named:
        found.append(f"that none of these is right has a probability of {decision.none:.0%}")
    return found


def _objections(findings: MachineFindings) -> list[str]:
    """Return what speaks against a name although it is probable; each can only lower the verdict."""
    decision, best = findings.decision, findings.best
    found: list[str] = []
    if decision is not None and decision.units.count < MACHINES.decide.least_units:
        count, kind = decision.units.count, decision.units.kind
        found.append(f"{count} {kind} are too few for a name, {MACHINES.decide.least_units} are needed")
    found += _on_test_runs(findings, findings.holdout)
    least_z = math.sqrt(best.evidence.least_gain or 0.0)
    at = f", at {least_z:.2g} standard deviations," if least_z else ""
    members = [] if decision is None else decision.members()
    rivals = [one.fit for one in members if one.is_listed and one.names != best.names]
    # Of a set it is enough that one is clear: the others may imitate it.
    is_clear = any(one.names and not _unclear(findings, one, least_z) for one in rivals)
    found += [
        f"the interval of {item.name} of {name}{at} contains its value without the effect"
        for name, item in ([] if is_clear else _unclear(findings, best, least_z))
    ]
    found += [
        f"{item.name} of {name} is more than ten times as large as declared"
        for name, item in _strengths(findings, best)
        if _is_too_large(findings, name)
    ]
    if _leaves_error(findings):
        found.append("a model error remains")
    found += [f"the term {name} explains as much" for name in findings.rival_terms[:2]]
    confirmed = _confirmed(findings, findings.equations)
    if confirmed and findings.structure > MACHINES.decide.structure:
        found.append(f"the test runs confirm that {confirmed[0]} is missing too")
    return found


def _strengths(findings: MachineFindings, explanation: MachineFit) -> list[tuple[str, Parameter]]:
    """Return each effect of an explanation with its size."""
    cards = {card.name: card for card in findings.machine.effects}
    return [(name, cards[name].parameters[0]) for name in explanation.names]


def _unclear(
    findings: MachineFindings, explanation: MachineFit, least_z: float
) -> list[tuple[str, Parameter]]:
    """Return the effects of an explanation whose intervals contain the null."""
    return [
        (name, item)
        for name, item in _strengths(findings, explanation)
        if _contains(size_of(explanation, ParameterKey(effect=name, name=item.name)), item.nominal, least_z)
    ]


def _is_too_large(findings: MachineFindings, name: str) -> bool:
    """Return whether an effect is more than ten times as large as declared."""
    item = dict(_strengths(findings, findings.best))[name]
    change = findings.size(name, item.name).value - item.nominal
    return abs(change) > MACHINES.decide.most_sizes * item.prior_sd


def _confirmed(findings: MachineFindings, equations: Sequence[Equation]) -> list[str]:
    """Return the terms that the test runs confirm; more of a law that is in the answer is no other law."""
    names, missing = findings.best.names, _missing(findings.drafts, equations)
    return [text for text, one in missing if one.is_confirmed and not one.is_law_of(names)]


def _contains(size: Size, null: float, least_z: float) -> bool:
    """Return True where the runs do not exclude the null of a size.

    Where no tolerance decides between explanations, the interval is as wide as the gain that is asked of an
    effect, in standard deviations.
    """
    wider = max(least_z / HALF_WIDTHS, 1.0)
    low, high = (size.value + wider * (end - size.value) for end in (size.low, size.high))
    return low <= null <= high


def _leaves_error(findings: MachineFindings) -> bool:
    """Return True where an error of the model remains that is neither chance nor noise that is slow."""
    is_large = not all(one.is_good_enough for one in findings.budget_after)
    is_structured = findings.structure > MACHINES.decide.structure
    return findings.p_remaining <= MACHINES.tests.alpha and (is_structured or is_large)


def _on_test_runs(findings: MachineFindings, holdout: Holdout | None) -> list[str]:
    """Return the channels whose error on the test runs is above the tolerance."""
    if holdout is None or not findings.best.evidence.has_budget:
        return []
    found = []
    for one in findings.budget_after:
        channel = holdout.channels.get(one.channel)
        if channel is None:
            continue
        error = math.sqrt(max(channel.after**2 - channel.noise_floor**2, 0.0))
        # The noise below it is known to a tenth, and so is what is left above it.
        if error > (1.0 + MACHINES.tests.sigma_uncertainty) * one.tolerance:
            unit = "" if one.unit == "1" else f" {one.unit}"
            found.append(
                f"an error of {error:.3g}{unit} of {one.channel} remains on the test runs, more than the "
                f"tolerance of {one.tolerance:.3g}{unit}"
            )
    return found


def _without_name(findings: MachineFindings) -> tuple[Answer, list[str]]:
    """Return the answer where no effect is named, with the reason."""
    for differ in _scatter_words(findings):
        if all(one.is_good_enough for one in findings.budget_before):
            return Answer.NO_GAP, [differ]
        # The file of a model can declare the scatter, the configuration of a rover cannot.
        advice = ": give them a `scatter_sd`" if isinstance(findings.machine, StateModel) else ""
        return Answer.UNNAMED, [f"{differ}, which explains it{advice}"]
    decision = findings.decision
    withdrawn = () if decision is None or findings.holdout is None else decision.chosen.names
    unjudged = _unjudged(findings)
    if unjudged:
        return Answer.NOT_IDENTIFIABLE, [unjudged]
    if withdrawn:
        return Answer.UNNAMED, [f"the best, {_join(withdrawn)}, {_on_locked_runs(findings)}"]
    return Answer.UNNAMED, [] if decision is None else _doubts(decision, ())


def _scatter_words(findings: MachineFindings) -> list[str]:
    """Return that parameters of single runs explain the gap, where they do."""
    if findings.p_within_runs <= MACHINES.tests.alpha:
        return []
    which = findings.scatter.sentence({one.name: one.unit for one in findings.machine.parameters})
    return [f"parameters differ between runs ({which})" if which else "parameters differ between runs"]


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


def _sentence(findings: MachineFindings, answer: Answer, reasons: Sequence[str]) -> str:
    before, after = _error_words(findings)
    if answer is Answer.NO_GAP:
        return _agreement(findings, before, reasons)
    if not findings.best.names and answer is Answer.NOT_IDENTIFIABLE:
        return f"No gap was found, but these runs cannot exclude one: {'; '.join(reasons)}."
    if is_gap_in_tests_alone(findings, answer):
        tests = ", ".join(run.name for run in findings.locked)
        return (
            f"There is a gap in the test runs alone ({tests}): {'; '.join(reasons)}. The other runs agree "
            "with the model and do not show what is missing: make more runs like these."
        )
    head = f"There is a gap ({before})"
    if answer is Answer.UNNAMED:
        why = f"; {reasons[0]}" if reasons else "; the runs do not agree on a cause"
        if all(one.is_good_enough for one in findings.budget_after):
            why += "; the error is below the tolerance of the model"
        return f"{_draft_words(findings, answer)}{head}{why}."
    if answer is Answer.NOT_IDENTIFIABLE:
        return f"{head}; {'; '.join(reasons)}."
    sets = [_join(one) for one in _members(findings, answer)]
    names = sets[0] if len(sets) == 1 else f"{' or '.join(sets)}, which these runs do not distinguish"
    verb = "Missing" if answer is not Answer.PARTLY_NAMED else "Probably missing"
    closure = None if findings.holdout is None else findings.holdout.closure
    unsure = [name for name in findings.best.names if name not in _names(findings, answer)]
    it = f"Together with {_join(unsure)}, which are not certain, it" if unsure else "It"
    closed = "" if closure is None else f" {it} closes {closure:.0%} of the gap on locked runs."
    if closure is not None and closure < 0.0:
        closed = f" {it} does not close the gap on locked runs."
    sizes = "; ".join(_size_text(one) for one in _effects(findings, answer))
    rest = f" Afterwards {after}."
    but = f" But {'; '.join(reasons)}." if reasons else ""
    releases = {card.name: card.releases for card in findings.machine.effects}
    # The base parameter that an effect releases has taken the gap on itself: nothing seems to be missing.
    before = "" if all(releases[name] for name in findings.best.names) else f" Before, {before}."
    return f"{verb}: {names} ({sizes}).{_order_words(findings, answer)}{closed}{before}{rest}{but}"


def _draft_words(findings: MachineFindings, answer: Answer) -> str:
    """Return the first missing term, as the beginning of a sentence without a name; empty for none."""
    missing = _missing(_drafts(findings, answer), findings.equations)
    if not missing:
        return ""
    text, first = missing[0]
    is_beside = findings.best.names and not findings.drafts_alone
    beside = f" beside {_join(findings.best.names)}, which are not certain" if is_beside else ""
    closed = "" if first.closure is None else f", it closes {first.closure:.0%} of the gap on the test runs"
    sure = "is probably missing" if first.is_confirmed else "may be missing"
    doubt = "" if first.is_confirmed else ", which the test runs do not confirm"
    return f"A term that is in no list {sure}{beside}: {text}{doubt}{closed}. "


def _missing(
    drafts: Sequence[DraftTerm], equations: Sequence[Equation]
) -> list[tuple[str, DraftTerm | Equation]]:
    """Return terms that are missing in the equations, or at the outputs, each with its text."""
    of_ports = [(_equation(one.equation, one.coefficient, one.unit), one) for one in drafts]
    return [*of_ports, *((one.text, one) for one in equations)]


def _agreement(findings: MachineFindings, before: str, reasons: Sequence[str]) -> str:
    name = findings.machine.name
    if not reasons and findings.p_gap <= MACHINES.tests.alpha:
        return (
            f"No gap above the tolerance: the error of {name} is more than chance, but below it ({before})."
        )
    if reasons:
        return f"No common gap: {reasons[0]}, and the error of {name} is below its tolerance ({before})."
    return (
        f"No gap: {name} agrees with {findings.problem.observations.run_count} runs within the noise of the "
        f"sensors ({before}; p = {findings.p_gap:.2g})."
    )


def _error_words(findings: MachineFindings) -> tuple[str, str]:
    """Return the error before and afterwards in words.

    A noise that was learned contains the error of the model: there the errors on the test runs are stated.
    """
    holdout = findings.holdout
    if holdout is None or not findings.base.evidence.is_learned:
        return _errors(findings.budget_before), _errors(findings.budget_after, findings.budget_before)
    units = {one.channel: "" if one.unit == "1" else f" {one.unit}" for one in findings.budget_after}
    closed = {
        name: (one.before**2 - one.after**2) / one.noise_floor**2 for name, one in holdout.channels.items()
    }
    name = max(closed, key=lambda one: closed[one])
    sizes = (holdout.channels[name].before, holdout.channels[name].after)
    before, after = (f"{name} errs by {one:.3g}{units[name]} on the test runs" for one in sizes)
    return before, after


def _errors(budget: Sequence[ChannelError], before: Sequence[ChannelError] = ()) -> str:
    """Return the greatest error in words, or that of the channel where it was greatest before.

    The page has those of all channels.
    """
    greatest = max(before or budget, key=lambda error: error.model_error / error.sensor_noise).channel
    shown = next(one for one in budget if one.channel == greatest)
    if before:
        above = [one.channel for one in budget if one.model_error > one.tolerance and one is not shown]
        return f"{shown.sentence()}{f'; {_join(above)} above the tolerance' if above else ''}"
    of_all = f", the greatest of {len(budget)} channels" if len(budget) > 1 else ""
    return f"{shown.sentence()}{of_all}"


def _effects(findings: MachineFindings, answer: Answer) -> list[FoundEffect]:
    cards = {card.name: card for card in findings.machine.effects}
    found = []
    for name in _names(findings, answer):
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
    kept = set(_names(findings, answer)) if answer.is_name else set()
    unsure = set(findings.best.names) - kept
    if findings.found is None:
        return [{"name": card.name, "why": "there is no gap to explain"} for card in findings.machine.effects]
    if findings.decision is not None and answer is Answer.NAMED_SET:
        kept |= {name for one in findings.decision.members() for name in one.names}
    withdrawn = set(findings.found.best.names) - kept
    objections = {
        **findings.found.objections,
        **dict.fromkeys(withdrawn, f"withdrawn: {_on_locked_runs(findings)}"),
        **dict.fromkeys(unsure, "not certain"),
    }
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


def is_gap_in_tests_alone(findings: MachineFindings, answer: Answer) -> bool:
    """Return whether only the test runs contradict the model."""
    return findings.base_holdout is not None and answer is Answer.UNNAMED


def _gap(
    findings: MachineFindings, answer: Answer
) -> dict[str, Mapping[str, float | Sequence[float] | None]]:
    tests = findings.base_holdout if is_gap_in_tests_alone(findings, answer) else findings.holdout
    return {} if tests is None else {name: asdict(one) for name, one in tests.channels.items()}


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
        key.text: {
            "output_error": findings.size(key.effect, key.name).value,
            "random_force": near(key, value, findings.size(key.effect, key.name).value),
        }
        for key, value in findings.other_weighting.items()
        if key in findings.best.fit.point
    }


def _warnings(findings: MachineFindings) -> list[str]:
    warnings = []
    if findings.tracked is None and has_ports(findings.machine):
        warnings.append(
            "no random force keeps the machine on its runs: sizes are not compared with a second weighting"
        )
    if _leaves_error(findings):
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
        other = near(key, value, size.value)
        if not size.low <= other <= size.high:
            warnings.append(
                f"{key.name} of {key.effect} depends on the weighting: {size.value:.3g} by the output error, "
                f"{value:.3g} with random forces at the ports"
            )
    return warnings


def _equation(equation: str, coefficient: float, unit: str) -> str:
    return equation.replace("+= c ", f"+= ({coefficient:.3g} {unit}) * ")


def _join(names: Sequence[str]) -> str:
    return " and ".join(names)
