"""Rules that turn findings into a verdict and its sentence."""

import math
from collections.abc import Sequence

from scipy import stats

from rover_hil.gap.data.problem import Key
from rover_hil.gap.explain.candidates import Candidate, is_visible
from rover_hil.gap.explain.gap_test import GapTest
from rover_hil.gap.explain.naming import Naming, unexplained_cost
from rover_hil.gap.explain.next_run import propose, watch
from rover_hil.gap.explain.parameters import EXPLAIN
from rover_hil.gap.explain.search import Explanation
from rover_hil.gap.findings import Findings
from rover_hil.gap.machines.error_budget import ChannelError, error_budget
from rover_hil.gap.statistics.fit import Fit
from rover_hil.gap.statistics.jackknife import jackknife
from rover_hil.gap.statistics.score import one_sided_z
from rover_hil.gap.verdict import Answer, FoundEffect, FoundParameter, Verdict


def refuse(answer: Answer, reason: str) -> Verdict:
    """Return the verdict on unusable data."""
    head = "The data cannot be used" if answer is Answer.BAD_DATA else "The data cannot decide"
    return Verdict(verdict=answer, sentence=f"{head}: {reason}.")


def decide(findings: Findings) -> Verdict:
    """Return the verdict on findings."""
    if findings.gap.p > EXPLAIN.gap.alpha:
        return _no_gap(findings)
    answer = _answer(findings)
    named = is_named(answer)
    best = findings.best if named else None
    validation = findings.validation
    return Verdict(
        verdict=answer,
        sentence=_sentence(findings, answer),
        p_gap=findings.gap.p,
        where=_where(findings),
        effects=[] if best is None else found_effects(findings, best),
        confidence_set=[list(one.names) for one in findings.naming.members]
        if named or answer is Answer.NOT_IDENTIFIABLE
        else [],
        rejected=_rejected(findings, answer),
        unnamed=[
            {"equation": one.text, "unit": one.unit, "closest": one.closest, "cosine": round(one.cosine, 3)}
            for one in findings.equations
        ],
        next_run=_next_run(findings),
        detectable=_detectable(findings.naming),
        gap={}
        if validation is None
        else {
            name: {
                "before": one.before,
                "after": one.after,
                "noise_floor": one.noise_floor,
                "closure": one.closure,
                "ci95": one.ci95,
            }
            for name, one in validation.channels.items()
        },
        controls={"retuned": None, "placebo": None, "rival": None}
        if validation is None
        else validation.controls,
    )


def _no_gap(findings: Findings) -> Verdict:
    observations = findings.prepared.problem.observations
    detectable = _detectable(findings.naming)
    too_large = [one for one in series_budget(findings) if not one.is_good_enough]
    if too_large:
        return Verdict(
            verdict=Answer.UNNAMED,
            sentence=f"There is a gap: {'; '.join(one.sentence() for one in too_large)}; the runs do not "
            "agree on a cause, and it resembles slow errors of each run.",
            p_gap=findings.gap.p,
            rejected=_rejected(findings, Answer.UNNAMED),
            detectable=detectable,
        )
    return Verdict(
        verdict=Answer.NO_GAP,
        sentence=f"No gap: {findings.prepared.problem.model.name} agrees with {observations.run_count} runs "
        f"within their scatter and what its parameters are known to (p = {findings.gap.p:.2g}).",
        p_gap=findings.gap.p,
        rejected=_rejected(findings, Answer.NO_GAP),
        next_run=watch(findings.naming.scores),
        detectable=detectable,
    )


def series_budget(findings: Findings) -> tuple[ChannelError, ...]:
    """Return the error budget of series whose sensors declare their noise; empty for others.

    The noise model of series learns slow misfits as noise; only a declared noise tells them apart.
    """
    problem, start = findings.prepared.problem, findings.prepared.start
    observations = problem.observations
    if observations.is_steady or not all(one.sigma for one in observations.channels):
        return ()
    residual = observations.values - problem.predict(start.point)
    return error_budget(observations, residual, len(start.free))


def _answer(findings: Findings) -> Answer:
    naming, best, validation = findings.naming, findings.best, findings.validation
    if best is None or validation is None:
        hidden = not any(is_visible(item) for item in naming.scores)
        return Answer.NOT_IDENTIFIABLE if naming.scores and hidden else Answer.UNNAMED
    share = (
        1.0
        if findings.remaining_gap is None or findings.remaining_gap.p > EXPLAIN.gap.alpha
        else explained_share(findings)
    )
    if not validation.is_confirmed or share < EXPLAIN.verdict.half_share:
        return Answer.UNNAMED
    if len(naming.members) > EXPLAIN.verdict.most_members:
        return Answer.NOT_IDENTIFIABLE
    is_single = len(naming.members) == 1
    whole = (
        EXPLAIN.verdict.whole_share
        if findings.prepared.problem.observations.is_steady
        else EXPLAIN.verdict.whole_share_of_series
    )
    if share < whole or (is_single and findings.alternatives):
        return Answer.PARTLY_NAMED
    return Answer.NAMED if is_single else Answer.NAMED_SET


def explained_share(findings: Findings) -> float:
    """Return the share of the explainable gap that the chosen effects explain, 0..1."""
    best, remaining_gap = findings.best, findings.remaining_gap
    if best is None or remaining_gap is None:
        return 0.0
    gain = max(findings.prepared.start.cost - best.fit.cost, 0.0)
    problem = findings.prepared.problem
    remaining = (
        max(unexplained_cost(problem, best), 0.0)
        if problem.observations.is_steady
        else _asked_by_terms(remaining_gap)
    )
    return gain / (gain + remaining) if gain > 0.0 else 0.0


def _asked_by_terms(remaining_gap: GapTest) -> float:
    """Return the cost that the best free-form term of each channel would still explain."""
    by_channel: dict[str, float] = {}
    for score in remaining_gap.free:
        if one_sided_z(score) >= remaining_gap.threshold:
            channel = score.direction.name.split(": ", 1)[0]
            by_channel[channel] = max(by_channel.get(channel, 0.0), one_sided_z(score) ** 2)
    return sum(by_channel.values())


def interval_factor(findings: Findings) -> float:
    """Return the half width of a 95 % interval in standard errors, wider where a gap remains."""
    freedom = findings.prepared.noise.freedom
    factor = float(stats.t.ppf(0.975, freedom)) if math.isfinite(freedom) else 1.96
    return factor * math.sqrt(findings.naming.inflation)


def is_named(answer: Answer) -> bool:
    """Return True for verdicts with effects."""
    return answer in (Answer.NAMED, Answer.NAMED_SET, Answer.PARTLY_NAMED)


def intervals(findings: Findings, fitted: Fit) -> dict[Key, tuple[float, float]]:
    """Return the 95 % interval of every fitted parameter; of series, wider where runs scatter."""
    prepared, factor = findings.prepared, interval_factor(findings)
    keys = [item.key for item in fitted.free]
    widenings = [1.0 for _ in keys]
    if not prepared.problem.observations.is_steady:
        widenings = [found.widening for found in jackknife(fitted, prepared.noise, keys)]
    found = {}
    for item, widening in zip(fitted.free, widenings, strict=True):
        value, error = fitted.value(item.key), widening * fitted.standard_error(item.key)
        found[item.key] = (max(value - factor * error, item.lower), min(value + factor * error, item.upper))
    return found


def found_effects(findings: Findings, best: Explanation) -> list[FoundEffect]:
    """Return the effects of an explanation with intervals."""
    cards = {card.name: card for card in findings.prepared.problem.model.effects}
    ci95 = intervals(findings, best.fit)
    effects = []
    for name in best.names:
        parameters = {
            item.name: FoundParameter(
                value=best.fit.value((name, item.name)), unit=item.unit, ci95=ci95[name, item.name]
            )
            for item in cards[name].parameters
        }
        effects.append(FoundEffect(name=name, parameters=parameters))
    return effects


def _sentence(findings: Findings, answer: Answer) -> str:
    best, validation = findings.best, findings.validation
    where = f" Clearest in {findings.locations[0].sentence()}." if findings.locations else ""
    if answer is Answer.UNNAMED or best is None or validation is None:
        why = "no effect of the catalogue explains it"
        if best is not None and validation is not None and not validation.is_confirmed:
            why = f"{_join(best.names)} explains it on the runs of the search only, not on the locked runs"
        elif best is not None:
            why = f"the best, {_join(best.names)}, explains only {explained_share(findings):.0%} of it"
        if answer is Answer.NOT_IDENTIFIABLE:
            why = "these runs do not distinguish any effect from errors of the base parameters"
        return f"There is a gap (p = {findings.gap.p:.2g}), and {why}.{where}"
    if answer is Answer.NOT_IDENTIFIABLE:
        names = ", ".join(_join(one.names) for one in findings.naming.members)
        return f"There is a gap, and these runs do not distinguish {names}.{where}"
    closed = (
        ""
        if validation.closure is None
        else f"; it closes {validation.closure:.0%} of the gap on locked runs"
    )
    values = _join([_values(effect) for effect in found_effects(findings, best)])
    if len(findings.naming.members) > 1:
        names = " or ".join(_join(one.names) for one in findings.naming.members)
        values = f"{names}, which these runs do not distinguish; best fit {values}"
    text = f"Missing: {values}{closed}"
    if answer is Answer.PARTLY_NAMED:
        text = f"Probably missing: {values}{closed}{_unsure(findings)}"
    harm = f" Worse than before: {', '.join(validation.harmed)}." if validation.harmed else ""
    return f"{text}.{where}{harm}"


def _unsure(findings: Findings) -> str:
    """Return why the names are not certain."""
    text = ""
    if findings.remaining_gap is not None and findings.remaining_gap.p <= EXPLAIN.gap.alpha:
        text = f"; {1 - explained_share(findings):.0%} remains unexplained"
    for name, alternative in findings.alternatives.items():
        channel, term = alternative.split(": ", 1)
        text += f"; a term {term} in {channel} explains as much as {name}"
    return text


def _values(effect: FoundEffect) -> str:
    parts = []
    for name, one in effect.parameters.items():
        unit = "" if one.unit == "1" else f" {one.unit}"
        parts.append(f"{name} {one.value:.3g}{unit}, {one.ci95[0]:.3g} to {one.ci95[1]:.3g}")
    return f"{effect.name} ({'; '.join(parts)})"


def _join(names: Sequence[str]) -> str:
    return " and ".join(names)


def _where(findings: Findings) -> list[dict[str, str | float | int]]:
    return [
        {"channel": one.channel, "condition": one.condition, "size": one.size, "unit": one.unit, "n": one.n}
        for one in findings.locations
    ]


def _rejected(findings: Findings, answer: Answer) -> list[dict[str, str]]:
    naming = findings.naming
    kept = {name for one in naming.members for name in one.names}
    if answer in (Answer.UNNAMED, Answer.NO_GAP):
        kept = set()
    return [
        {"name": item.card.name, "why": _why(item, naming)}
        for item in naming.scores
        if item.card.name not in kept
    ]


def _why(item: Candidate, naming: Naming) -> str:
    name, score = item.card.name, item.score
    if name in naming.absorbed and one_sided_z(score) < naming.threshold:
        return f"not visible in these runs: {naming.absorbed[name]} imitates it"
    if one_sided_z(score) == 0.0:
        return f"the data supports only the impossible sign ({score.z:+.1f} standard deviations)"
    if one_sided_z(score) < naming.threshold:
        return (
            f"not significant: {one_sided_z(score):.1f} standard deviations, {naming.threshold:.1f} required"
        )
    single = naming.tried.get((name,))
    if naming.best is not None and single is not None and name not in naming.best.names:
        worse = single.cost - naming.best.cost
        return f"{_join(naming.best.names)} explains more: {worse:.1f} in -2 log-likelihood"
    return "explains too little of the gap, or does not hold on the locked runs"


def _detectable(naming: Naming) -> list[dict[str, str | float]]:
    return [
        {
            "name": item.card.name,
            "size": (naming.threshold + EXPLAIN.verdict.power_z) * item.score.standard_error,
            "unit": item.score.direction.unit,
        }
        for item in naming.scores
    ]


def _next_run(findings: Findings) -> str:
    naming, best = findings.naming, findings.best
    if best is None:
        return watch(naming.scores)
    if len(naming.members) > 1:
        return propose(findings.prepared, naming.members[0], naming.members[1])
    alternatives = [
        one for key, one in naming.tried.items() if key != best.names and len(key) == len(best.names)
    ]
    if not alternatives:
        return watch(naming.scores)
    return propose(findings.prepared, best, min(alternatives, key=lambda one: one.cost))
