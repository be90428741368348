"""When a base parameter far from its nominal value is the finding.

Premises, tested on the runs: the interval, by the runs alone, has no value in common with the prior's; with
the nominal value neither the other base parameters, nor an effect, nor a free term explains the runs as well;
on locked runs the fitted value closes the gap that the nominal one leaves.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import NormalDist

from rover_hil.gap.evidence.fit import Fit
from rover_hil.gap.parameters import MACHINES
from rover_hil.gap.verdict import Answer, FittedBase, Verdict

FAR_SD = 3.0
"""Distance of a value from its nominal one, in prior standard deviations, from which it is reported."""
HALF_WIDTHS = NormalDist().inv_cdf(0.975)
"""Half of a 95 % interval of a normal distribution, in standard deviations."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """What the runs say of one base parameter, compared with its nominal value.

    Attributes:
        equals: Explanations with the nominal value that explain the runs as well, as names of effects and
            terms; an empty one means the other base parameters alone.
        closure: Share of the gap of the nominal value on locked runs that the fitted one closes; None where
            there is no gap.
        improved: Share of the locked runs that the fitted value improves.
        sizes: Of these explanations, those with their sizes, in words.
    """

    equals: tuple[tuple[str, ...], ...]
    closure: float | None
    improved: float
    sizes: Mapping[tuple[str, ...], str] = field(default_factory=dict)

    def is_proven(self) -> bool:
        """Return True where the locked runs show that the nominal value is wrong."""
        return (
            self.closure is not None
            and self.closure >= MACHINES.verdict.half
            and self.improved >= MACHINES.search.agreeing_share
        )


def far_parameters(fit: Fit) -> list[str]:
    """Return the base parameters that a fit moves far from what was known of them."""
    return [
        item.key.name
        for item, pull in zip(fit.free, fit.pull, strict=True)
        if item.key.is_base and abs(float(pull)) > FAR_SD
    ]


def judged(rows: Sequence[FittedBase], trial_of: Callable[[str], Trial]) -> list[FittedBase]:
    """Return base parameters, those far from their nominal value with what the runs prove of them."""
    return [_judged(one, trial_of) if _is_far(one) else one for one in rows]


def _judged(row: FittedBase, trial_of: Callable[[str], Trial]) -> FittedBase:
    (low, high), known = row.ci95, HALF_WIDTHS * row.prior_sd
    if low <= row.nominal + known and high >= row.nominal - known:
        return replace(row, why="not decided, its interval and what was known before have values in common")
    trial = trial_of(row.name)
    if () in trial.equals:
        return replace(row, why="other base parameters explain the runs as well")
    if trial.equals:
        own = f"{row.name} ({row.value:.4g}, {low:.4g} to {high:.4g})"
        names = ", ".join((own, *(trial.sizes.get(one) or " and ".join(one) for one in trial.equals)))
        row = replace(row, why=f"not decided, these explain the runs equally: {names}")
        return replace(row, equals=list(trial.equals)) if trial.is_proven() else row
    if trial.closure is None:
        return replace(row, why="the gap on the locked runs is too small to prove it")
    if not trial.is_proven():
        weak = (
            f"closes {trial.closure:.0%} of the gap on the locked runs"
            if trial.closure < MACHINES.verdict.half
            else f"improves {trial.improved:.0%} of the locked runs"
        )
        return replace(row, why=f"it {weak} only")
    return replace(row, is_named=True)


def doubted(rows: Sequence[FittedBase], probability_of: Callable[[str], float]) -> list[FittedBase]:
    """Return base parameters; those that something else replaces too often are not the finding."""
    return [_doubted(row, probability_of(row.name)) if _is_far(row) else row for row in rows]


def _doubted(row: FittedBase, probability: float) -> FittedBase:
    row = replace(row, probability=probability)
    if probability >= MACHINES.decide.partly:
        return row
    why = f"{row.why or 'not decided'}; its probability is {probability:.0%}"
    return replace(row, is_named=False, equals=(), why=why)


def _contradicted(rows: Sequence[FittedBase]) -> list[FittedBase]:
    """Return base parameters where a gap remains on the test runs: what is missing there may move them."""
    why = "not decided, a gap remains on the test runs"
    return [replace(row, is_named=False, equals=(), why=why) if _is_far(row) else row for row in rows]


def far(rows: Sequence[FittedBase]) -> list[FittedBase]:
    """Return the base parameters that must be reported, the farthest first."""
    return sorted(filter(_is_far, rows), key=lambda one: -abs(one.pull))


def _is_far(row: FittedBase) -> bool:
    """Return True where a value is far from nominal, and the runs exclude the nominal one."""
    return abs(row.pull) > FAR_SD and not row.ci95[0] <= row.nominal <= row.ci95[1]


def with_base_parameters(
    verdict: Verdict, rows: Sequence[FittedBase], *, has_gap_in_tests: bool = False
) -> Verdict:
    """Return a verdict on effects with the base parameters in it.

    Args:
        verdict: On the effects.
        rows: The base parameters.
        has_gap_in_tests: Only the test runs contradict the model; then no base parameter is the finding.
    """
    if has_gap_in_tests:
        rows = _contradicted(rows)
    verdict = replace(verdict, base_parameters=list(rows))
    reported = far(rows)
    if not reported:
        return verdict
    named, open_ = [one for one in reported if one.is_named], [one for one in reported if not one.is_named]
    answer, members = _answer(verdict, named, open_)
    head = _head(named, open_)
    if named and answer is not Answer.NAMED:
        head = head.replace("Wrong", "Probably wrong", 1)
    sentences = [head, verdict.sentence if has_gap_in_tests else _rest(verdict, named)]
    is_open = verdict.verdict is Answer.UNNAMED and (has_gap_in_tests or not _is_tolerable(verdict))
    if (verdict.unnamed or is_open) and not named:
        sentences.reverse()  # the gap is the finding, and what is missing may have moved the value
    return replace(verdict, verdict=answer, confidence_set=members, sentence=" ".join(sentences))


def _answer(
    verdict: Verdict, named: Sequence[FittedBase], open_: Sequence[FittedBase]
) -> tuple[Answer, list[list[str]]]:
    """Return the answer with base parameters far from nominal, and the explanations that are left."""
    members = [list(names) for names in verdict.confidence_set]
    own = [one.name for one in named]
    is_agreement = verdict.verdict is Answer.NO_GAP
    if verdict.effects:
        # A base parameter may be pulled by what the effects lack: then neither is certain.
        return Answer.PARTLY_NAMED, [[*names, *own] for names in members]
    if verdict.verdict is Answer.NOT_IDENTIFIABLE and members:
        return verdict.verdict, members
    if open_:
        rivals = dict.fromkeys(tuple(sorted(names)) for one in open_ for names in one.equals)
        is_few = 0 < len(rivals) < MACHINES.verdict.most_members
        is_whole = is_agreement and len(open_) == 1
        if is_few and (is_whole or named):
            shared = [one.name for one in open_ if one.equals]
            answer = Answer.NAMED_SET if is_whole else Answer.PARTLY_NAMED
            return answer, [[*own, *shared], *([*own, *names] for names in rivals)]
        if not named:
            return (Answer.NOT_IDENTIFIABLE, []) if is_agreement else (verdict.verdict, members)
    is_sure = all(one.probability is None or one.probability >= MACHINES.decide.named for one in named)
    is_whole = not open_ and is_sure and (is_agreement or _is_tolerable(verdict))
    return (Answer.NAMED if is_whole else Answer.PARTLY_NAMED), [own]


def _is_tolerable(verdict: Verdict) -> bool:
    """Return True where no effect is named, and what is left is below the tolerance, as beside an effect."""
    sizes = [(one["upper_after"], one["tolerance"]) for one in verdict.error_budget.values()]
    is_small = [
        isinstance(upper, float) and isinstance(most, float) and upper <= most for upper, most in sizes
    ]
    return verdict.verdict is Answer.UNNAMED and bool(is_small) and all(is_small)


def _head(named: Sequence[FittedBase], open_: Sequence[FittedBase]) -> str:
    """Return the finding in one sentence."""
    if named:
        more = [f"{one.name} is wrong too" for one in named[1:]]
        more += [f"also far from nominal: {one.name}, {one.why}" for one in open_ if one.equals]
        unsure = ", ".join(one.name for one in open_ if not one.equals)
        more += [f"also far from nominal, but not decided: {unsure}"] if unsure else []
        return "; ".join([f"Wrong in the model: {named[0].sentence()}", *more]) + "."
    others = ", ".join(one.name for one in open_[1:])
    also = f"; also far from nominal: {others}" if others else ""
    why = open_[0].why
    return f"Perhaps wrong in the model: {open_[0].sentence()}; {why}{also}."


def _rest(verdict: Verdict, named: Sequence[FittedBase]) -> str:
    """Return what the verdict says of the effects, so that it does not contradict the finding."""
    text = verdict.sentence
    if verdict.effects and verdict.verdict in (Answer.NAMED, Answer.NAMED_SET):
        text += " But what pulls a value that far may be something else that is missing."
    if verdict.verdict is Answer.NO_GAP or _is_tolerable(verdict):
        own = "this value" if len(named) == 1 else "the fitted values"
        return f"With {own}: {text[0].lower()}{text[1:]}"
    return f"Probably m{text[1:]}" if text.startswith("Missing") else text


def headline(verdict: Verdict) -> str:
    """Return the answer in a sentence of at most two lines."""
    told = far(verdict.base_parameters)
    named = [one for one in told if one.is_named]
    if named and not verdict.effects:
        more = f" and {len(named) - 1} more" if len(named) > 1 else ""
        return f"Wrong in the model: {named[0].sentence()}{more}."
    text = _of_effects(verdict, [" and ".join(names) for names in verdict.confidence_set])
    if not told:
        return text
    return f"{text} {told[0].name} is {abs(told[0].pull):.1f} prior deviations from its nominal value."


def _of_effects(verdict: Verdict, sets: Sequence[str]) -> str:
    several = bool(verdict.confidence_set) and len(verdict.confidence_set[0]) > 1
    verb = "are" if several else "is"
    match verdict.verdict:
        case Answer.NO_GAP:
            return "The model agrees with the runs."
        case Answer.BAD_DATA:
            return "The data cannot be used."
        case Answer.UNNAMED:
            sure = [one["equation"] for one in verdict.unnamed if one["is_confirmed"]]
            term = f" Probably missing: {sure[0]}." if sure else ""
            return f"There is a gap, and no effect explains it.{term}"
        case Answer.NAMED | Answer.NAMED_SET | Answer.PARTLY_NAMED:
            names = " or ".join(sets)
            missing = "missing in the model" if verdict.effects else "wrong in the model"
            probably = "probably " if verdict.verdict is Answer.PARTLY_NAMED else ""
            return f"{names} {verb} {probably}{missing}."
        case _ if verdict.p_gap is not None and verdict.gap:
            return "There is a gap; these runs do not show which effect causes it."
        case _:
            return "No gap was found, but these runs cannot exclude one."
