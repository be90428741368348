"""One run of `gap` against its answer, from the documented output alone (docs/reference/gap_verdict.md)."""

import ast
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rover_hil.gap import effects
from tests.nature.hidden_machines.verdicts import FEW

NAMING = ("NAMED", "NAMED_SET")
NONE = ["none of these"]


@dataclass(frozen=True)
class Outcome:
    """What was hidden, and what was answered; a line of the results."""

    case: str
    variant: int
    kind: str
    machine: str
    runs: int
    ratio: float
    ratio_with_best_other: float
    hidden: list[str]
    """Names of the effects that are in the user's list."""
    expected: str
    accepted: list[str]
    verdict: str
    named: list[str]
    sets: list[list[str]]
    sizes: list[dict[str, Any]]
    """Of each hidden effect that was named: `name`, true `size`, and `value`, `low`, `high` or None."""
    draft_place: int
    """Place of the first right draft, from 1; 0: none; -1: no term is right."""
    probabilities: list[tuple[list[str], float]]
    seconds: float
    """Processor time."""
    exit_code: int
    message: str = ""
    drafts: list[str] = field(default_factory=list)
    equations: list[str] = field(default_factory=list)
    """Right terms of a hidden effect that is in no list."""

    def is_right(self, names: list[str]) -> bool:
        """Return whether an explanation is the hidden one; none is right where less than the noise shows."""
        if not names:
            return self.ratio <= 1.0
        if self.hidden:
            return sorted(names) == sorted(self.hidden)
        return all(any(_is_equation(name, one) for one in self.equations) for name in names)

    @property
    def is_named_right(self) -> bool:
        """Return whether the verdict is one explanation, and it is the hidden one."""
        return self.verdict == "NAMED" and bool(self.hidden) and sorted(self.named) == sorted(self.hidden)

    @property
    def is_in_set(self) -> bool:
        """Return whether the hidden explanation was named, or is one of the set."""
        members = [sorted(member) for member in self.sets]
        is_member = self.verdict == "NAMED_SET" and bool(self.hidden) and sorted(self.hidden) in members
        return self.is_named_right or is_member

    @property
    def is_wrong(self) -> bool:
        """Return whether every explanation of a name or a set contains what is not hidden."""
        if self.verdict not in NAMING:
            return False
        explanations = [self.named] if self.verdict == "NAMED" else self.sets or [self.named]
        return all(set(explanation) - set(self.hidden) for explanation in explanations)

    @property
    def is_sought(self) -> bool:
        """Return whether the documents promise an answer: visible above the tolerance, and enough runs."""
        return bool(self.hidden) and self.expected in NAMING and self.runs >= FEW

    def line(self) -> str:
        """Return the run in one line."""
        mark = "WRONG" if self.is_wrong else "right" if self.verdict in self.accepted else "-"
        names = " | ".join(" + ".join(member) for member in self.sets) or " + ".join(self.named)
        hidden = " + ".join(self.hidden) or "-"
        head = f"{self.case}/{self.variant} {self.machine} ({self.runs} runs, {self.ratio:.1f} noises)"
        return f"{head}: {hidden} -> {self.verdict} {names} [{mark}, {self.seconds:.0f} s] {self.message}"


def outcome_of(
    answer: Mapping[str, Any], variant: int, verdict: Mapping[str, Any], seconds: float, code: int, said: str
) -> Outcome:
    """Compare an answer with the output of a run; `verdict` is empty where nothing was written."""
    hidden = [effect for effect in answer["effects"] if effect["is_listed"]]
    kept = ("machine", "runs", "ratio", "ratio_with_best_other", "expected", "accepted", "case")
    codes = [draft["code"] for draft in verdict.get("draft", [])]
    return Outcome(
        **{key: answer[key] for key in kept},
        kind=answer["class"],
        variant=variant,
        hidden=[effect["name"] for effect in hidden],
        verdict=verdict.get("verdict", "BAD_DATA" if code == 1 else "CRASH"),
        named=named_of(verdict),
        sets=[as_listed(member, verdict) for member in verdict.get("confidence_set", [])],
        sizes=[entry for effect in hidden for entry in size_of(effect, verdict)],
        draft_place=draft_place(answer["terms"], codes) if answer["terms"] else -1,
        probabilities=probabilities_of(verdict),
        seconds=seconds,
        exit_code=code,
        message="" if verdict else said,
        drafts=codes,
        equations=equations_of(answer["terms"]),
    )


def named_of(verdict: Mapping[str, Any]) -> list[str]:
    """Return the named effects; a base parameter that is proven wrong counts as `wrong_NAME`."""
    effects = [effect["name"] for effect in verdict.get("effects", [])]
    wrong = [number["name"] for number in verdict.get("base_parameters", []) if number["is_named"]]
    return list(dict.fromkeys(as_listed([*effects, *wrong], verdict)))


def as_listed(names: list[str], verdict: Mapping[str, Any]) -> list[str]:
    """Return names as the user's list has them: the output names a wrong base parameter by itself."""
    numbers = {number["name"] for number in verdict.get("base_parameters", [])}
    return [f"wrong_{name}" if name in numbers else name for name in names]


def size_of(effect: Mapping[str, Any], verdict: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the size that was answered, in a list; empty where the effect is not named."""
    for named in verdict.get("effects", []):
        if named["name"] == effect["name"]:
            number = named["parameters"].get(effect["parameter"], {})
            low, high = number.get("ci95", [None, None])
            answered = {"value": number.get("value"), "low": low, "high": high}
            return [{"name": effect["name"], "size": effect["size"], **answered}]
    for number in verdict.get("base_parameters", []):
        if number["is_named"] and effect["name"] == f"wrong_{number['name']}":
            nominal, (low, high) = number["nominal"], number["ci95"]
            answered = {"value": number["value"] - nominal, "low": low - nominal, "high": high - nominal}
            return [{"name": effect["name"], "size": effect["size"], **answered}]
    return []


def draft_place(terms: list[dict[str, Any]], codes: list[str]) -> int:
    """Return the place of the first draft that is a right term; 0: none."""
    for place, code in enumerate(codes, start=1):
        port, sources, form = read_draft(code)
        for term in terms:
            is_source = sorted(sources) == sorted(term["sources"])
            if port == term["port"] and is_source and form in term["forms"]:
                return place
    return 0


def read_draft(code: str) -> tuple[str, list[str], str]:
    """Return port, sources and form of a line of `draft_effects.py`."""
    call = ast.parse(code, mode="eval").body
    if not isinstance(call, ast.Call) or not isinstance(call.func, ast.Attribute):
        return "", [], ""
    given = {word.arg: word.value for word in call.keywords}
    port = str(ast.literal_eval(call.args[0])) if call.args else ""
    form = call.func.attr if "form" not in given else str(ast.literal_eval(given["form"]))
    if "sources" in given:
        return port, [str(source) for source in ast.literal_eval(given["sources"])], form
    return port, [str(ast.literal_eval(given["source"]))] if "source" in given else [], form


def probabilities_of(verdict: Mapping[str, Any]) -> list[tuple[list[str], float]]:
    """Return each explanation and its probability; "none of these" is no explanation."""
    return [
        (as_listed(entry["effects"], verdict), float(entry["probability"]))
        for entry in verdict.get("probabilities", [])
        if entry["effects"] != NONE
    ]


def _is_equation(name: str, right: str) -> bool:
    """Return whether an explanation is a right term; factors may stand in any order."""
    return sorted(name.split()) == sorted(right.split()) or ("max(" in right and name.startswith(f"{right} "))


def equations_of(terms: list[dict[str, Any]]) -> list[str]:
    """Return the equations of right terms as the output writes them; of a threshold, up to its place."""
    units: defaultdict[str, str] = defaultdict(lambda: "1")
    found = []
    for term in terms:
        for form in term["forms"]:
            port, sources = term["port"], tuple(term["sources"])
            if form == "product":
                found.append(effects.product(port, sources=sources, size=1.0).build(units).name)
            elif form == "threshold":
                found.append(f"{port} += c max({' - '.join(sources)}")
            else:
                one = effects.term(port, source=" - ".join(sources), form=form, size=1.0, scale=1.0)
                found.append(one.build(units).name)
    return found
