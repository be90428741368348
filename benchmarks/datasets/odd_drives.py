"""Does an import report the one fault of each recorded drive, and none of a sound one?

    python -m tests.nature.odd_drives FOLDER --first SEED
    python -m benchmarks.datasets.odd_drives FOLDER --record record.json

Each folder holds an input and `answer.json`, written before any import. The import runs as a user runs
it, one at a time. A refusal, a data-quality finding that changed something, and a contradiction are
statements. What a drive cannot show, and empty cells, are none. The cause is reported if a statement
matches one of `words`. It is first if the first data-quality finding or the first contradiction does.
`--judge record.json` prints the table of an earlier run again. Exit code 1: a drive is silently wrong,
fewer than 85 % of the causes are reported first, or a sound drive has a finding.
"""

import argparse
import json
import math
import re
import subprocess
import sys
from collections import Counter
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from mcap.reader import make_reader
from numpy.typing import NDArray

Array = NDArray[np.float64]

BAR = 0.85
LIMIT_S = 300.0
MOST_SIGMA = 3.0
MOST_SHARE = 0.1
UNDETECTABLE = "cannot be seen"
NO_READING = "no measurement"
# Rows without a position, and ground truth beside the drive, are no fault of a drive.
INFORMATIVE = ("no usable numbers", "true poses before the first or behind the last row")
# A text that leaves open which of several unlike causes it is does not report one that the drive decides.
UNDECIDED = (
    "no signal, wrong axis",
    "or left and right exchanged",
    "more than one wheel reversed or exchanged",
)
PROGRESS = re.compile(r"^\s*\d+\.\d s  .*$", re.MULTILINE)
FIRST, LATER, SILENT, REGION = "first", "later", "silent, right", "in the region"
UNREPORTED, OTHER, BLAME, WRONG = "not reported", "other finding", "wrong blame", "silently wrong"
VERDICTS = (FIRST, LATER, SILENT, REGION, UNREPORTED, OTHER, BLAME, WRONG)
RIGHT = (FIRST, SILENT, REGION)


@dataclass(kw_only=True)
class Imported:
    """What one import reported, and the first and last estimate of its log (x, y, yaw; covariance)."""

    refusal: str = ""
    oddities: list[str] = field(default_factory=list)
    undetectable: list[str] = field(default_factory=list)
    findings: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    start: list[float] = field(default_factory=list)
    end: list[float] = field(default_factory=list)
    covariance: list[float] = field(default_factory=list)

    def heads(self) -> list[str]:
        """Return the statements that a user reads first."""
        return [texts[0] for texts in ([self.refusal], self.oddities, self.findings) if texts and texts[0]]

    def statements(self) -> list[str]:
        """Return all statements in the order in which they are printed."""
        return [text for text in (self.refusal, *self.oddities, *self.findings, *self.doubts) if text]


def _command(folder: Path, arguments: list[str], log: Path) -> list[str]:
    """Return the command line of an import; its files are those of the folder."""
    paths = [str(folder / text) if (folder / text).exists() else text for text in arguments[1:]]
    program = str(Path(sys.executable).with_name("rover-hil"))
    return [program, "import", arguments[0], *paths, "--out", str(log), "--json"]


def run_import(folder: Path, arguments: list[str]) -> Imported:
    """Import the drive of a folder. Return what was reported."""
    with TemporaryDirectory() as scratch:
        log = Path(scratch) / "drive.mcap"
        command = _command(folder, arguments, log)
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
        except subprocess.TimeoutExpired:
            return Imported(refusal=f"no end within {LIMIT_S:g} s")
        if done.returncode:
            text = PROGRESS.sub("", done.stderr + done.stdout)
            return Imported(refusal=" ".join(text.replace(str(folder), "").split()))
        imported = _reported(json.loads(done.stdout))
        _read_log(log, imported)
        return imported


def _reported(result: Any) -> Imported:
    """Return the statements in the result of an import."""
    drive = result[0] if isinstance(result, list) else result
    imported = Imported(
        findings=[_text(entry) for entry in drive.get("findings", [])],
        doubts=[_text(entry) for entry in drive.get("doubts", [])],
        notes=[_text(entry) for entry in drive.get("notes", [])],
    )
    for oddity in drive.get("oddities", []):
        text = f"{oddity['what']} ({oddity['where']}; {oddity['count']}; {oddity['done']})"
        if oddity["done"].startswith(UNDETECTABLE):
            imported.undetectable.append(text)
        elif oddity["done"] == NO_READING or text.startswith(INFORMATIVE):
            imported.notes.append(text)
        else:
            imported.oddities.append(text)
    return imported


def _text(entry: Any) -> str:
    """Return the text of a finding or a note."""
    return str(entry["text"]) if isinstance(entry, dict) else str(entry)


def _read_log(log: Path, imported: Imported) -> None:
    """Read the first and the last estimate of a log."""
    with log.open("rb") as stream:
        reader = make_reader(stream)
        first = json.loads(next(reader.iter_messages(["/estimate"]))[2].data)["estimate"]
        last = json.loads(next(reader.iter_messages(["/estimate"], reverse=True))[2].data)["estimate"]
    imported.start = [first["x_m"], first["y_m"], first["yaw_rad"]]
    imported.end = [last["x_m"], last["y_m"], last["yaw_rad"]]
    imported.covariance = list(last["covariance"])


def relative_to(start: Array, end: Array) -> Array:
    """Return the end position in the frame of the pose at the start."""
    step = end[:2] - start[:2]
    cosine, sine = math.cos(start[2]), math.sin(start[2])
    return np.array([cosine * step[0] + sine * step[1], cosine * step[1] - sine * step[0]])


@dataclass(frozen=True, kw_only=True)
class EndError:
    """Error of the end position: in standard deviations, as a share of the distance; and its greatest sd."""

    sigmas: float
    share: float
    sd_share: float
    """Greatest standard deviation over the farthest distance from the start."""

    @property
    def is_wrong(self) -> bool:
        """Return whether the region of the end does not contain the true end."""
        return self.sigmas > MOST_SIGMA and self.share > MOST_SHARE


def end_error(imported: Imported, answer: dict[str, Any]) -> EndError | None:
    """Return the error of the end of the path; None for a refused drive."""
    if not imported.end:
        return None
    path = np.array(answer["true_path"])
    start, end = np.array(imported.start), np.array(imported.end)
    error = relative_to(start, end) - relative_to(path[0, 1:], path[-1, 1:])
    xx, xy, _, yy, *_ = imported.covariance
    covariance = np.array([[xx, xy], [xy, yy]])
    cosine, sine = math.cos(start[2]), math.sin(start[2])
    turn = np.array([[cosine, sine], [-sine, cosine]])
    covariance = turn @ covariance @ turn.T + 1e-12 * np.eye(2)
    distance = float(np.hypot(*np.diff(path[:, 1:3], axis=0).T).sum())
    extent = float(np.hypot(*(path[:, 1:3] - path[0, 1:3]).T).max())
    return EndError(
        sigmas=math.sqrt(float(error @ np.linalg.solve(covariance, error))),
        share=float(np.hypot(*error)) / distance,
        sd_share=math.sqrt(float(np.linalg.eigvalsh(covariance)[-1])) / max(extent, 1e-3),
    )


def matches(text: str, patterns: list[str]) -> bool:
    """Return whether one of the regular expressions is in the text."""
    return any(re.search(pattern, text, re.IGNORECASE) for pattern in patterns)


def reports(text: str, answer: dict[str, Any]) -> bool:
    """Return whether a text reports the cause of a drive."""
    is_undecided = answer["decidable"] and any(phrase in text for phrase in UNDECIDED)
    return not is_undecided and matches(text, answer["words"])


def verdict(imported: Imported, answer: dict[str, Any]) -> str:
    """Return what became of a drive with a fault."""
    statements = imported.statements()
    if any(reports(text, answer) for text in imported.heads()):
        return FIRST
    if any(reports(text, answer) for text in statements):
        return LATER
    error = end_error(imported, answer)
    if not answer["decidable"] and _is_honest(imported, answer["words"], error):
        return REGION
    if any(_is_blame(text, answer) for text in statements):
        return BLAME
    is_wrong = error is not None and error.is_wrong
    if statements:
        return OTHER
    if is_wrong:
        return WRONG
    return SILENT if answer["silent_is_right"] else UNREPORTED


def _is_honest(imported: Imported, words: list[str], error: EndError | None) -> bool:
    """Return whether the region has the true end and is smaller than the drive, or the limit is stated."""
    if any(matches(text, words) for text in imported.undetectable):
        return True
    return error is not None and error.sigmas <= MOST_SIGMA and error.sd_share < 0.5


def sound_findings(imported: Imported) -> list[str]:
    """Return the findings of a drive; data-quality notes of what was left out or repaired are none."""
    return [text for text in (imported.refusal, *imported.findings) if text]


@dataclass(kw_only=True)
class Table:
    """Verdicts by class, and one line for each miss."""

    counts: dict[str, Counter[str]] = field(default_factory=dict)
    misses: list[str] = field(default_factory=list)
    blames: list[str] = field(default_factory=list)
    sound: int = 0
    false: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    wrong_paths: list[str] = field(default_factory=list)

    def add(self, name: str, imported: Imported, answer: dict[str, Any]) -> None:
        """Judge one drive."""
        error = end_error(imported, answer)
        off = f"{error.share:.0%} of the distance, {error.sigmas:.1f} sd" if error else ""
        if error is not None and error.is_wrong:
            self.wrong_paths.append(f"{name}: end off by {off}; {len(imported.statements())} statements")
        if answer["class"] == "sound":
            self._add_sound(name, imported)
            return
        result = verdict(imported, answer)
        self.counts.setdefault(answer["class"], Counter())[result] += 1
        reported = " | ".join(imported.statements()) or f"nothing; notes: {' | '.join(imported.notes)}"
        if result not in RIGHT:
            self.misses.append(f"[{result}] {name}: {answer['cause']} -> {reported}")
        blames = [text for text in imported.statements() if _is_blame(text, answer)]
        if blames:
            self.blames.append(f"{name}: {' | '.join(blames)}")

    def _add_sound(self, name: str, imported: Imported) -> None:
        """Judge a drive without a fault."""
        self.sound += 1
        false = sound_findings(imported)
        if false:
            self.false.append(f"{name}: {' | '.join(false)}")
        if imported.oddities or imported.doubts:
            self.notes.append(f"{name}: {' | '.join([*imported.oddities, *imported.doubts])}")

    def total(self) -> Counter[str]:
        """Return the verdicts of all classes."""
        return sum(self.counts.values(), Counter())

    def print(self) -> bool:
        """Print everything. Return whether all bars hold."""
        print(f"{'class':24}{'drives':>8}" + "".join(f"{name:>16}" for name in VERDICTS))
        for group, counts in [*self.counts.items(), ("all", self.total())]:
            cells = "".join(f"{counts[name] or '':>16}" for name in VERDICTS)
            print(f"{group:24}{counts.total():8}{cells}")
        for title, lines in (
            ("misses", self.misses),
            ("statements that blame something else, in any drive", self.blames),
            (f"findings of {self.sound} sound drives", self.false),
            ("repairs and warnings of sound drives, not counted", self.notes),
            (f"end off by {MOST_SIGMA:g} sd and {MOST_SHARE:.0%} of the distance", self.wrong_paths),
        ):
            print(f"\n{title}: {len(lines)}")
            for line in lines:
                print(f"  {line}")
        total = self.total()
        share = sum(total[name] for name in RIGHT) / max(total.total(), 1)
        print(f"\nright: {share:.1%}")
        return share >= BAR and not total[WRONG] and not self.false


def _is_blame(text: str, answer: dict[str, Any]) -> bool:
    """Return whether a statement blames something else, and does not report the cause."""
    return matches(text, answer["not_words"]) and not reports(text, answer)


def main() -> int:
    """Import and judge all drives of a folder. Return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--record", type=Path, help="file for what was reported")
    parser.add_argument("--judge", type=Path, help="judge this record; import nothing")
    arguments = parser.parse_args()
    recorded = json.loads(arguments.judge.read_text()) if arguments.judge else {}
    table = Table()
    for folder in sorted(path.parent for path in arguments.folder.glob("*/answer.json")):
        answer = json.loads((folder / "answer.json").read_text())
        if not arguments.judge:
            recorded[folder.name] = asdict(run_import(folder, answer["import"]))
            print(f"imported {folder.name}", file=sys.stderr, flush=True)
            if arguments.record:
                arguments.record.write_text(json.dumps(recorded, indent=1) + "\n")
        table.add(folder.name, Imported(**recorded[folder.name]), answer)
    return 0 if table.print() else 1


if __name__ == "__main__":
    raise SystemExit(main())
