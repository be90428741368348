"""The table of the issue: what was asked, how many, the figure, its bar."""

from collections import Counter, defaultdict
from collections.abc import Iterable
from statistics import median

from scipy.stats import binom

from benchmarks.gap.hidden_judgement import Outcome
from benchmarks.wilson import share_text
from tests.nature.hidden_machines.verdicts import FEW, FEWEST, HIDDEN, SHOWN

Row = tuple[str, int, str, str]
LOW, HIGH = 0.5, 0.9
"""Probabilities whose calibration is examined."""


def band(total: int, share: float) -> str:
    """Return the counts between which a binomial number lies with 95 %."""
    low, high = binom.interval(0.95, total, share)
    return f"{low:.0f} to {high:.0f}"


def _share(what: str, hits: Iterable[bool], bar: str) -> Row:
    listed = list(hits)
    return what, len(listed), share_text(sum(listed), len(listed)) if listed else "-", bar


def verdict_rows(outcomes: list[Outcome]) -> list[Row]:
    """Return wrong and right names."""
    sought = [outcome for outcome in outcomes if outcome.is_sought]
    single = [outcome for outcome in sought if outcome.kind == "catalogue"]
    pairs = [outcome for outcome in sought if outcome.kind == "order"]
    small = [outcome for outcome in outcomes if outcome.expected == "NO_GAP" and outcome.kind != "none"]
    small = [outcome for outcome in small if outcome.accepted == ["NO_GAP"]]
    plain = [outcome for outcome in outcomes if outcome.kind == "none" and outcome.runs >= FEWEST]
    few = [o for o in outcomes if o.hidden and o.ratio >= SHOWN and FEWEST <= o.runs < FEW]
    names = [outcome.verdict in {"NAMED", "NAMED_SET"} for outcome in small]
    rests = [o.ratio_with_best_other for o in outcomes if o.is_wrong and o.kind != "none"]
    wrong, similar = sum(outcome.is_wrong for outcome in outcomes), sum(rest < HIDDEN for rest in rests)
    return [
        _share("wrong NAMED or NAMED_SET", [o.is_wrong for o in outcomes], "at most 2 %"),
        *(
            _share(f"of these, {kind}", [o.is_wrong for o in outcomes if o.kind == kind], "")
            for kind in ("catalogue", "order", "outside", "none")
        ),
        ("of these, a similar effect of the list fits within the tolerance", wrong, f"{similar}", ""),
        _share("in the catalogue: named or in the set", [o.is_in_set for o in sought], "90 %"),
        _share("in the catalogue: NAMED", [o.is_named_right for o in sought], "70 %"),
        _share("one effect: named or in the set", [o.is_in_set for o in single], ""),
        _share("two effects: named or in the set", [o.is_in_set for o in pairs], ""),
        _share("four or five runs: named or in the set", [o.is_in_set for o in few], ""),
        _share("no gap: NO_GAP", [o.verdict == "NO_GAP" for o in plain], ""),
        _share("below the tolerance: any name", names, "0"),
        _share("verdict that a sensible person accepts", [o.verdict in o.accepted for o in outcomes], ""),
        _share("a crash, an error of the call or no end", [o.verdict == "CRASH" for o in outcomes], "0"),
    ]


def size_rows(outcomes: list[Outcome]) -> list[Row]:
    """Return how often intervals contain the true size, of right names and sets."""
    sizes = [size for outcome in outcomes if outcome.is_in_set for size in outcome.sizes]
    known = [size for size in sizes if size["low"] is not None]
    inside = sum(size["low"] <= size["size"] <= size["high"] for size in known)
    bar = band(len(known), 0.95) if known else "-"
    return [
        ("intervals that contain the true size", len(known), f"{inside}", bar),
        ("right names without the interval that the documents promise", len(sizes) - len(known), "", "0"),
    ]


def draft_rows(outcomes: list[Outcome]) -> list[Row]:
    """Return how often the right term is first or second among the drafts."""
    sought = [o for o in outcomes if o.kind == "outside" and o.draft_place >= 0 and "UNNAMED" in o.accepted]
    sought = [o for o in sought if o.ratio >= SHOWN and o.runs >= FEW]
    return [
        _share("outside: right term first or second", [o.draft_place in {1, 2} for o in sought], "75 %"),
        _share("outside: right term first", [o.draft_place == 1 for o in sought], ""),
    ]


def sameness_rows(outcomes: list[Outcome]) -> list[Row]:
    """Return how often noise drawn anew and permuted runs leave the verdict the same."""
    by_case: dict[str, list[Outcome]] = defaultdict(list)
    for outcome in outcomes:
        by_case[outcome.case].append(outcome)
    repeated = [same for same in by_case.values() if len(same) > 1]
    if not repeated:
        return [("same case, noise drawn anew, runs permuted (--variants 5)", 0, "-", "90 %")]
    most = [Counter(o.verdict for o in same).most_common(1)[0][1] for same in repeated]
    total = sum(len(same) for same in repeated)
    names = [{tuple(sorted(o.named)) for o in same if o.verdict == "NAMED"} for same in repeated]
    return [
        (
            "variants with the most frequent verdict of their case",
            total,
            share_text(sum(most), total),
            "90 %",
        ),
        _share(
            "cases with the same verdict in all variants",
            [count == len(same) for count, same in zip(most, repeated, strict=True)],
            "",
        ),
        ("cases with two different names", len(repeated), f"{sum(len(n) > 1 for n in names)}", "1"),
    ]


def calibration_rows(outcomes: list[Outcome]) -> list[Row]:
    """Return how often explanations of a probability of 0.5 to 0.9 are right."""
    judged = [
        (probability, outcome.is_right(names))
        for outcome in outcomes
        for names, probability in outcome.probabilities
        if LOW <= probability <= HIGH
    ]
    if not judged:
        return [("probability 0.5 to 0.9: right", 0, "-", "")]
    mean = sum(probability for probability, _ in judged) / len(judged)
    right = sum(is_right for _, is_right in judged)
    what = f"probability 0.5 to 0.9 (mean {mean:.2f}): right"
    return [(what, len(judged), f"{right}", band(len(judged), mean))]


def time_rows(outcomes: list[Outcome]) -> list[Row]:
    """Return processor times, s."""
    used = [outcome.seconds for outcome in outcomes]
    count = len(used)
    return [
        ("processor time, median, s", count, f"{median(used):.0f}", ""),
        ("processor time, longest, s", count, f"{max(used):.0f}", "180"),
    ]


def table(outcomes: list[Outcome]) -> str:
    """Return the table, and a line per wrong name."""
    rovers = sum("rover" in outcome.machine or "sand" in outcome.machine for outcome in outcomes)
    rows = [
        *verdict_rows(outcomes),
        *size_rows(outcomes),
        *draft_rows(outcomes),
        *sameness_rows(outcomes),
        *calibration_rows(outcomes),
        *time_rows(outcomes),
    ]
    lines = [
        f"{len(outcomes)} runs, {rovers} of rovers",
        "",
        "| what | of | figure | bar |",
        "|---|---|---|---|",
    ]
    lines += [f"| {what} | {total} | {figure} | {bar} |" for what, total, figure, bar in rows]
    wrong = [outcome.line() for outcome in outcomes if outcome.is_wrong]
    crashed = [outcome.line() for outcome in outcomes if outcome.verdict == "CRASH"]
    return "\n".join([*lines, "", "Wrong names:", *wrong, "", "Crashes:", *crashed]) + "\n"
