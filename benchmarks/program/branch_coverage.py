"""What the tests of `make test` run: branch coverage of each folder, here and in another state.

    python -m benchmarks.program.branch_coverage [FOLDER OF ANOTHER STATE] [--part NAME]

A part is a set of folders of tests, run in one process of its own; what was measured stays in
`build/coverage` of its state, and is measured again with `--part`. `benchmarks.program.mutants` reads from it
which files of tests run a line. Exits with 1 where a folder of the second level lost more than a point.
"""

import argparse
import contextlib
import json
import os
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Generator
from pathlib import Path

import coverage
import pytest

PACKAGES = ("drivers", "controllers", "sim_backends", "rover_hil")
PARTS = {
    "drivers": ("tests/drivers", "tests/conformance", "tests/hil", "tests/kernel"),
    "controllers": ("tests/controllers",),
    "sim_backends": ("tests/sim_backends", "tests/nature", "tests/rear_scene"),
    "folders": ("tests/rover_hil/*/",),
    "commands": ("tests/rover_hil/test_[a-k]*.py",),
    "runs": ("tests/rover_hil/test_[l-z]*.py", "tests/test_*.py"),
}
UNMARKED = "not slow and not nightly"
ALLOWED_POINTS = 1.0
FOLDER = Path("build/coverage")


class ByFile:
    """Reports to coverage which file of tests runs, and sums up its processor time."""

    def __init__(self, measured: coverage.Coverage) -> None:
        self._measured = measured
        self.used_s: dict[str, float] = defaultdict(float)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        """Switch to the file of a test before its fixtures are made."""
        file = item.nodeid.split("::")[0]
        self._measured.switch_context(file)
        start_s = time.process_time()
        result = yield
        self.used_s[file] += time.process_time() - start_s
        return result


def main() -> int:
    """Measure what is missing and print the table; return 1 if a folder lost too much."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("other", nargs="?", type=Path, help="folder of another state, which is compared")
    parser.add_argument("--part", choices=PARTS, action="append", help="measure again")
    parser.add_argument("--inside", choices=PARTS, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.inside:
        return measure_here(asked.inside)
    states = [Path.cwd(), *([asked.other.resolve()] if asked.other else [])]
    for state in states:
        for part in PARTS:
            if not (state / FOLDER / part).exists() or part in (asked.part or ()):
                measure(state, part)
    return report([covered(state) for state in states])


def measure(state: Path, part: str) -> None:
    """Run a part of the tests of a state."""
    # `-P`: modules of this folder are not importable by their last names.
    subprocess.run(
        [sys.executable, "-P", str(Path(__file__).resolve()), "--inside", part],
        cwd=state,
        env=os.environ | {"PYTHONPATH": str(state)},
        check=True,
    )


def measure_here(part: str) -> int:
    """Run a part of the tests in this process."""
    files = [
        str(path)
        for pattern in PARTS[part]
        for path in sorted(Path().glob(pattern))
        if path.name != "__pycache__"
    ]
    FOLDER.mkdir(parents=True, exist_ok=True)
    data = FOLDER / part
    data.unlink(missing_ok=True)
    measured = coverage.Coverage(
        data_file=str(data) + ".part", branch=True, source=list(PACKAGES), config_file=False
    )
    measured.erase()
    by_file = ByFile(measured)
    measured.start()
    code = pytest.main(
        ["-q", "-n", "0", "-m", UNMARKED, "-o", "timeout=900", "-p", "no:cacheprovider", *files],
        plugins=[by_file],
    )
    measured.stop()
    measured.save()
    data.with_suffix(".json").write_text(json.dumps(by_file.used_s), "utf-8")
    Path(str(data) + ".part").rename(data)
    return 0 if code in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED) else int(code)


def covered(state: Path) -> dict[str, tuple[int, int]]:
    """Return branches that ran, and all, of each folder of the second level."""
    table = state / FOLDER / "table.json"
    with contextlib.chdir(state):  # names of files are relative to it
        whole = coverage.Coverage(data_file=str(FOLDER / "whole"), branch=True, config_file=False)
        whole.combine([str(FOLDER / part) for part in PARTS], keep=True)
        whole.json_report(outfile=str(table))
    counts: dict[str, tuple[int, int]] = {}
    for name, file in json.loads(table.read_text("utf-8"))["files"].items():
        folder = "/".join(Path(name).parts[:2])
        ran, every = counts.get(folder, (0, 0))
        counts[folder] = (ran + file["summary"]["covered_branches"], every + file["summary"]["num_branches"])
    return counts


def report(states: list[dict[str, tuple[int, int]]]) -> int:
    """Print the share of branches that ran; return 1 if a folder lost more than is allowed."""
    lost = []
    here, *others = states
    for folder in sorted(set().union(*states)):
        cells = [f"{percent(*each[folder]):6.1f} %" if folder in each else "       –" for each in states]
        print(f"{folder:40s}{'  '.join(cells)}  {here.get(folder, (0, 0))[1]:6d} branches")
        if all(folder in each for each in states) and others:
            points = percent(*others[0][folder]) - percent(*here[folder])
            if points > ALLOWED_POINTS:
                lost.append(f"{folder}: {points:.1f} points less")
    print(*lost, sep="\n")
    return 1 if lost else 0


def percent(ran: int, every: int) -> float:
    """Return a share in percent; of nothing everything ran."""
    return 100.0 * ran / every if every else 100.0


if __name__ == "__main__":
    sys.exit(main())
