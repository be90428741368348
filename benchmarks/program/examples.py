"""Run the examples of docs/reference/examples.md and `--help` unchanged, with the samples that they name.

python -m benchmarks.program.examples [WORD...]

Prints each example with its time and exit code; with words, only examples that contain one of them. Examples
that wait for a rover or a browser, and `tune`, which takes an hour, are listed, not run. Ends with 1 if one
of the others does.
"""

import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

from typer.core import TyperGroup
from typer.main import get_command

from drivers.clock import seconds, stopwatch_ns
from rover_hil.app.app import app

ROOT = Path(__file__).parents[2]
WAITS = ("init", "simulate", "bench", "doctor", "tune", "run my_rover.toml`", "--live")
LIMIT_S = 600


def main(words: list[str]) -> int:
    """Run the examples; returns the exit code."""
    with tempfile.TemporaryDirectory() as folder:
        failed = [line for line, sample in _examples() if not _is_good(line, sample, words, Path(folder))]
    print(f"{len(failed)} failed: {failed}")
    return 1 if failed else 0


def _examples() -> list[tuple[str, str]]:
    """Return command lines and the samples that they need."""
    group = get_command(app)
    assert isinstance(group, TyperGroup)
    samples = [(line, sample) for text in _helps(group) for line, sample in _of_help(" ".join(text.split()))]
    page = (ROOT / "docs/reference/examples.md").read_text("utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| ")]
    for row in rows:
        cells = [cell.strip(" `") for cell in row.strip("|").split("|")]
        if len(cells) == 4 and cells[1].startswith("rover-hil "):
            samples.append((cells[1], cells[3] if " " not in cells[3] else ""))
    return list(dict.fromkeys(samples))


def _helps(group: TyperGroup) -> list[str]:
    texts = []
    for item in group.commands.values():
        texts += _helps(item) if isinstance(item, TyperGroup) else [item.help or ""]
    return texts


def _of_help(text: str) -> list[tuple[str, str]]:
    examples = re.findall(r"Example: `(rover-hil [^`]*)`", text)
    samples = re.findall(r"`rover-hil sample (\w+)`", text.partition("Data: ")[2])
    return [(line, samples[0] if samples else "") for line in examples]


def _is_good(line: str, sample: str, words: list[str], folder: Path) -> bool:
    if words and not any(word in line for word in words):
        return True
    if any(word in f"{line}`" for word in WAITS):
        print(f"not run: {line}")
        return True
    if sample:
        run_line(f"rover-hil sample {sample}", folder)
    duration_s, code, error = run_line(line, folder)
    if "never overwritten" in error:  # another example has written the same file
        duration_s, code, error = run_line(f"{line} --force", folder)
    print(f"{duration_s:6.1f} s  exit code {code}  {line}{'' if code == 0 else f'  {error}'}", flush=True)
    return code == 0


def run_line(line: str, folder: Path) -> tuple[float, int, str]:
    """Run a command line in a folder; return its time in s, its exit code, and the end of its errors."""
    begin_ns = stopwatch_ns()
    program = "from rover_hil.app.program import main; main()"
    arguments = [part for word in shlex.split(line)[1:] for part in _globbed(word, folder)]
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        cwd=folder, capture_output=True, text=True, check=False, timeout=LIMIT_S,
    )  # fmt: skip
    return seconds(stopwatch_ns() - begin_ns), done.returncode, done.stderr[-300:]


def _globbed(word: str, folder: Path) -> list[str]:
    if "*" not in word:
        return [word]
    return [str(path.relative_to(folder)) for path in sorted(folder.glob(word))]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
