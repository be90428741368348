"""What the rules have found wrong with a drive, each once."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

from controllers.fault import WHEELS_CONTRADICTED
from controllers.safety.drive_check import Finding

MOST_FINDINGS = 20
MOST_CONSEQUENCES = 3
DOUBT = "doubt"
_NUMBER = re.compile(r"[+-]?\d+(\.\d+)?")


@dataclass(slots=True, kw_only=True)
class FoundFinding:
    """A finding of a drive.

    Attributes:
        name: Of what is wrong, the same each time.
        t_s: When it was found first, since the start; None for what the whole drive shows.
        text: What, where, with the numbers of the first time, and what would explain it.
        count: How often it was found.
        consequences: What else was found because of it.
        harm: Share of the motion that is wrong because of it, 0 to 1: of a finding in a part of the drive the
            share of that part; None where it is not known.
    """

    name: str
    t_s: float | None
    text: str
    count: int = 1
    consequences: list["FoundFinding"] = field(default_factory=list)
    harm: float | None = None


class FindingList:
    """The findings of a drive, in the order in which they came first.

    Attributes:
        found: One for each name and text, whatever the numbers in it; at most `MOST_FINDINGS`.
        doubts: The same of what widened the estimate although it may happen to a healthy rover.
    """

    def __init__(self) -> None:
        self.found: list[FoundFinding] = []
        self.doubts: list[FoundFinding] = []
        self._known: dict[tuple[str, str], FoundFinding] = {}
        self._doubt = ""

    def take(self, t_s: float, findings: Iterable[Finding], suspicion: str = "") -> None:
        """Take the findings of a cycle, and what is suspected in it: a doubt where it is no finding."""
        for finding in findings:
            self._add(self.found, t_s, finding)
        text = _NUMBER.sub("", suspicion)
        if text not in ("", self._doubt) and (WHEELS_CONTRADICTED, text) not in self._known:
            self._add(self.doubts, t_s, Finding(cause=DOUBT, text=suspicion))
        self._doubt = text

    def _add(self, findings: list[FoundFinding], t_s: float, finding: Finding) -> None:
        key = (finding.cause, _NUMBER.sub("", finding.text))
        if key in self._known:
            self._known[key].count += 1
            return
        self._known[key] = FoundFinding(name=finding.cause, t_s=t_s, text=finding.text)
        if len(findings) < MOST_FINDINGS:
            findings.append(self._known[key])


def finding_lines(finding: FoundFinding) -> list[str]:
    """Return a finding, or a suspected fault, as lines for the user: its consequences stand below it."""
    word = "doubt" if finding.name == DOUBT else "finding"
    lines = [f"{word} {_when(finding)}: {finding.text}"]
    lines += [
        f"  consequence {_when(each)}: {each.text}" for each in finding.consequences[:MOST_CONSEQUENCES]
    ]
    if (more := len(finding.consequences) - MOST_CONSEQUENCES) > 0:
        lines.append(f"  and {more} more consequences, all of them with --json")
    return lines


def _when(finding: FoundFinding) -> str:
    times = "" if finding.count == 1 else f" ({finding.count} times)"
    return ("in the whole drive" if finding.t_s is None else f"at {finding.t_s:.1f} s") + times
