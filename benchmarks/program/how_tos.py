"""Run the how-to pages as a new user would: in an empty folder, with the data that they name.

python -m benchmarks.program.how_tos [PAGE...]

A block of commands runs as it stands if its first command is `rover-hil sample` or `--virtual`; each has an
empty folder of its own. Prints each command with its time and exit code; with names of pages, only those.
Ends with 1 if a command fails. `commission` may end with 1: that is a verdict on the rover.
"""

import re
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.program.examples import ROOT, run_line

PAGES = ROOT / "docs" / "how-to"


def blocks_of(text: str) -> list[list[str]]:
    """Return the command lines of each block of a page that runs as it stands."""
    fenced = re.findall(r"(?ms)^```(\w*)\n(.*?)^```$", text.replace("\\\n", " "))
    blocks = [block for language, block in fenced if not language]
    all_blocks = [
        [line.partition("  #")[0] for line in block.splitlines() if line.strip()] for block in blocks
    ]
    return [lines for lines in all_blocks if _runs(lines)]


def _runs(lines: list[str]) -> bool:
    """Return whether a block needs nothing and ends; what is simulated for others does not end."""
    first = next(iter(lines), "")
    begins = first.startswith("rover-hil sample ") or (
        first.startswith("rover-hil ") and "--virtual" in first
    )
    return begins and not any(line.startswith("rover-hil simulate ") for line in lines)


def main(names: list[str]) -> int:
    """Run the pages; returns the exit code."""
    failed = []
    for page in sorted(PAGES.glob("*.md")):
        if names and page.stem not in names:
            continue
        for block in blocks_of(page.read_text("utf-8")):
            print(f"{page.stem}:", flush=True)
            with TemporaryDirectory() as folder:
                failed += [line for line in block if not _is_good(line, Path(folder))]
    print(f"{len(failed)} failed: {failed}")
    return 1 if failed else 0


def _is_good(line: str, folder: Path) -> bool:
    duration_s, code, error = run_line(line, folder)
    print(f"{duration_s:8.1f} s  exit code {code}  {line}{'' if code == 0 else f'  {error}'}", flush=True)
    return code == 0 or (code == 1 and line.startswith("rover-hil commission "))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
