"""The table of a file of results."""

import itertools
import json
import statistics
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from benchmarks.gap_machines.record import Record
from benchmarks.gap_machines.truth import mentioned, variables

NAMED = ("NAMED", "NAMED_SET", "PARTLY_NAMED")
LEAST_SNR = 3.0
Test = Callable[[Record], bool]


def read_records(path: Path) -> list[Record]:
    """Return the records of a file; none where it does not exist."""
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line]


def print_summary(records: Sequence[Record]) -> None:
    """Print one column per family and one for all."""
    families = list(dict.fromkeys(record["family"] for record in records))
    columns = [[record for record in records if record["family"] == family] for family in families]
    columns = [*columns, list(records)] if len(families) > 1 else columns
    heads = [*families, "all"] if len(families) > 1 else families
    print(f"{'':44}" + "".join(f"{head:>13}" for head in heads))
    rows = [_rows(column) for column in columns]
    for index, (label, _) in enumerate(rows[0] if rows else ()):
        print(f"{label:44}" + "".join(f"{row[index][1]:>13}" for row in rows))


def _rows(records: Sequence[Record]) -> list[tuple[str, str]]:
    answered = [record for record in records if not record["error"]]
    none, single = _of(answered, "none"), _of(answered, "single")
    outside, broad = _of(answered, "outside"), _of(answered, "broad")
    large = [record for record in [*broad, *single, *outside] if record["snr_after_refit"] >= LEAST_SNR]
    seen = [record for record in single if record["snr_after_refit"] >= LEAST_SNR]
    pairs = [record for record in _of(answered, "pair") if record["snr_after_refit"] >= LEAST_SNR]
    unknown = [record for record in [*outside, *broad] if record["snr_after_refit"] >= LEAST_SNR]
    sizes = [one for record in single if record["snr"] >= LEAST_SNR for one in _sizes(record)]
    return [
        ("cases", str(len(records))),
        ("errors", _share(records, lambda record: bool(record["error"]))),
        ("none: named", _share(none, _is_named)),
        ("none: any gap", _share(none, lambda record: not _is_no_gap(record))),
        ("NO_GAP of broad, single, outside, refit >= 3", _share(large, _is_no_gap)),
        ("single, refit >= 3: truth in set", _share(seen, _is_in_set)),
        ("single, refit >= 3: exactly the truth", _share(seen, _is_exact)),
        ("single, refit >= 3: wrong name", _share(seen, _is_wrong)),
        ("pair, refit >= 3: both in set", _share(pairs, _is_in_set)),
        ("outside: wrong NAMED or NAMED_SET", _share(outside, _is_wrongly_named)),
        ("broad: wrong NAMED or NAMED_SET", _share(broad, _is_wrongly_named)),
        ("outside or broad, refit >= 3: UNNAMED", _share(unknown, _is_unnamed)),
        ("outside or broad, refit >= 3: draft form", _share(unknown, _has_draft)),
        ("outside, refit >= 3: draft in right variable", _share(_of(unknown, "outside"), _is_right_draft)),
        ("... in exactly its variables", _share(_of(unknown, "outside"), _is_exact_draft)),
        ("single, snr >= 3: coverage of sizes", _share(sizes, lambda one: one["is_covered"])),
        ("single, snr >= 3: median error of size", _median([one["error"] for one in sizes])),
        ("single, snr >= 3: median interval / size", _median([one["width"] for one in sizes])),
        ("single, snr >= 3: median width / oracle", _median(_ratios(sizes))),
        ("single, snr >= 3: mean interval score / size", _mean([one["score"] for one in sizes])),
        ("median closure", _median([one for record in answered for one in _closures(record)])),
        ("median seconds", _median([record["seconds"] for record in records], "{:.1f}")),
        ("longest seconds", f"{max((record['seconds'] for record in records), default=0.0):.1f}"),
    ]


def _of(records: Sequence[Record], kind: str) -> list[Record]:
    return [record for record in records if record["kind"] == kind]


def _share(records: Sequence[Record], test: Test) -> str:
    return f"{sum(test(record) for record in records)}/{len(records)}"


def _median(values: Sequence[float], form: str = "{:.3f}") -> str:
    return form.format(statistics.median(values)) if values else "-"


def _mean(values: Sequence[float]) -> str:
    return f"{statistics.fmean(values):.3f}" if values else "-"


def _is_no_gap(record: Record) -> bool:
    return bool(record["verdict"] == "NO_GAP")


def _is_named(record: Record) -> bool:
    return record["verdict"] in NAMED


def _is_wrongly_named(record: Record) -> bool:
    return record["verdict"] in ("NAMED", "NAMED_SET")


def _is_unnamed(record: Record) -> bool:
    return bool(record["verdict"] == "UNNAMED")


def _answers(record: Record) -> list[frozenset[str]]:
    """Return the explanations that an answer allows."""
    if not _is_named(record):
        return []
    return [frozenset(record["effects"]), *(frozenset(names) for names in record["confidence_set"])]


def _is_in_set(record: Record) -> bool:
    return frozenset(record["cards"]) in _answers(record)


def _is_exact(record: Record) -> bool:
    return set(_answers(record)) == {frozenset(record["cards"])}


def _is_wrong(record: Record) -> bool:
    return _is_named(record) and not _is_in_set(record)


def _has_draft(record: Record) -> bool:
    return bool(record["draft"])


def _is_right_draft(record: Record) -> bool:
    """Return True where a draft mentions every variable of the hidden term."""
    return any(hidden <= found for hidden, found in _hidden_and_found(record))


def _is_exact_draft(record: Record) -> bool:
    """Return True where a draft mentions every variable of the hidden term, and no other."""
    return any(hidden == found for hidden, found in _hidden_and_found(record))


def _hidden_and_found(record: Record) -> Iterator[tuple[set[str], set[str]]]:
    hidden = [variables(term["variables"]) for term in record["terms"]]
    found = [mentioned(record["family"], str(one["term"])) for one in record["draft"]]
    return itertools.product(hidden, found)


def _sizes(record: Record) -> Iterator[Record]:
    """Return, for each hidden effect that was named, the error of its size and its interval."""
    for name, parameters in record["cards"].items():
        label, true = next(iter(parameters.items()))
        found = record["effects"].get(name, {}).get(label)
        if found is None or not _is_named(record) or None in (found["value"], *found["ci95"]):
            continue
        low, high = found["ci95"]
        yield {
            "is_covered": low <= true <= high,
            "error": abs(found["value"] - true) / abs(true),
            "width": (high - low) / abs(true),
            "score": _interval_score(low, high, true) / abs(true),
            "oracle": record.get("oracle", {}).get(name, 0.0) / abs(true),
        }


def _interval_score(low: float, high: float, true: float) -> float:
    """Return the score of a 95 % interval (Gneiting and Raftery 2007): width, and 40 times what it misses."""
    return high - low + 2.0 / 0.05 * max(low - true, true - high, 0.0)


def _ratios(sizes: Sequence[Record]) -> list[float]:
    return [one["width"] / one["oracle"] for one in sizes if one["oracle"] > 0.0]


def _closures(record: Record) -> Iterator[float]:
    for one in record["gap"].values():
        if one.get("closure") is not None:
            yield one["closure"]
