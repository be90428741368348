"""Of mutants drawn from all packages, how many the tests of `make test` kill: here, and in another state.

    python -m benchmarks.program.mutants FOLDER OF ANOTHER STATE [--seed 20] [--more N]

Drawn is from functions whose text is the same in both states, so that the same mutants meet the tests of
then and of now; compiled functions are left out, no trace shows who calls them. Each mutant is tried in a
copy of its state with the unmarked tests of its package's folder that call its function, as
`benchmarks.program.branch_coverage` has found in the other state: the quickest files of tests, `BUDGET_S`
of processor time together. One that lives in a single state meets all of them there. What was tried is kept
in `build/mutants`. Exits with 1 where fewer are killed here.
"""

import argparse
import ast
import hashlib
import importlib
import json
import os
import random
import shutil
import sys
import tempfile
import textwrap
from dataclasses import dataclass
from pathlib import Path

import coverage
import pytest
from mutmut.mutation.file_mutation import create_mutations

from benchmarks.program.branch_coverage import FOLDER, PACKAGES, UNMARKED

OF_EACH_PACKAGE = 15
BUDGET_S = 12.0
FOLDERS = {package: (f"tests/{package}/",) for package in PACKAGES} | {
    "drivers": ("tests/drivers/", "tests/conformance/")
}
MEASURED = {package: (package,) for package in PACKAGES} | {"rover_hil": ("folders", "commands", "runs")}
"""Parts of `benchmarks.program.branch_coverage` that run these folders."""
COMPILED = ("_compiled", "compiled(", "njit(")
NOT_COPIED = shutil.ignore_patterns(".git", ".venv", ".cache", "build")
TRIED = Path("build/mutants")
LIBRARIES = (
    "scipy.stats", "scipy.signal", "scipy.optimize", "scipy.interpolate", "scipy.ndimage",
    "scipy.spatial.transform", "numba", "cv2", "matplotlib.figure", "pandas", "pydantic", "typer",
    "rich.console", "pyarrow.parquet", "cantools",
)  # fmt: skip
"""What most tests load."""


@dataclass(frozen=True)
class Function:
    """A function with its file and lines, counted from 1; the last one included."""

    path: str
    name: str
    first_line: int
    last_line: int


@dataclass(frozen=True)
class Mutant:
    """A function by its text, and what it becomes."""

    package: str
    text: str
    mutated: str

    @property
    def key(self) -> str:
        """Return a name that depends on nothing but the mutant."""
        return hashlib.sha256((self.text + self.mutated).encode()).hexdigest()[:12]


def main() -> int:
    """Draw, try and count; return 1 where fewer are killed here than in the other state."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("other", type=Path, help="folder of the other state")
    parser.add_argument("--seed", type=int, default=20)
    parser.add_argument("--more", type=int, default=sys.maxsize, help="try at most so many, go on later")
    asked = parser.parse_args()
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # as for all tests; before numpy is loaded
    for library in LIBRARIES:
        importlib.import_module(library)
    states = [Path.cwd(), asked.other.resolve()]
    functions = [{package: functions_of(state, package) for package in PACKAGES} for state in states]
    drawn = draw(functions[0], functions[1], asked.seed)
    more = asked.more
    for mutant in drawn:
        known = [each[mutant.package][mutant.text] for each in functions]

        def tried(state: Path, function: Function, budget_s: float) -> str:
            files = tests_of(states[1], known[1], mutant.package, budget_s)  # noqa: B023 - called at once
            return attempt(state, function, mutant, files)  # noqa: B023

        for state, function in zip(states, known, strict=True):
            if more and not read(state, mutant):
                more -= 1
                keep(state, mutant, tried(state, function, BUDGET_S))
        answers = [read(state, mutant) for state in states]
        if more and sorted(answers) == ["killed", "lives"]:
            more -= 1
            alive = answers.index("lives")
            answer = tried(states[alive], known[alive], float("inf"))
            keep(states[alive], mutant, answer if answer == "killed" else "lives with all")
    return report(states, functions[0], drawn)


def functions_of(state: Path, package: str) -> dict[str, Function]:
    """Return the functions of a package by their texts; texts that stand there twice are left out."""
    functions: dict[str, Function] = {}
    twice = set()
    for path in sorted((state / package).rglob("*.py")):
        source = path.read_text("utf-8")
        module = ast.parse(source)
        classes = [each for each in module.body if isinstance(each, ast.ClassDef)]
        for node in [*module.body, *(method for each in classes for method in each.body)]:
            if isinstance(node, ast.FunctionDef):
                first = min([node.lineno, *(each.lineno for each in node.decorator_list)])
                last = node.end_lineno or node.lineno
                text = "".join(source.splitlines(keepends=True)[first - 1 : last])
                if text in functions:
                    twice.add(text)
                name = path.relative_to(state).as_posix()
                functions[text] = Function(name, node.name, node.body[0].lineno, last)
    return {text: each for text, each in functions.items() if text not in twice}


def draw(
    here: dict[str, dict[str, Function]], there: dict[str, dict[str, Function]], seed: int
) -> list[Mutant]:
    """Return as many mutants of each package: a longer function is drawn more often."""
    print(f"seed {seed}")
    numbers = random.Random(seed)
    mutants: list[Mutant] = []
    for package in PACKAGES:
        texts = sorted(
            text
            for text in here[package].keys() & there[package].keys()
            if not text.lstrip().startswith(tuple(f"@{name}" for name in COMPILED))
        )
        print(f"{package}: {len(texts)} functions of {len(here[package])} are the same in both states")
        lines = [text.count("\n") for text in texts]
        keys: set[str] = set()
        while len(keys) < OF_EACH_PACKAGE:
            text = numbers.choices(texts, lines)[0]
            every = mutations(package, text)
            mutant = numbers.choice(every) if every else None
            if mutant and mutant.key not in keys:
                keys.add(mutant.key)
                mutants.append(mutant)
    return mutants


def mutations(package: str, text: str) -> list[Mutant]:
    """Return what mutmut makes of a function."""
    flat = textwrap.dedent(text)
    indent = text[: len(text) - len(text.lstrip())]
    if textwrap.indent(flat, indent) != text:
        return []  # a string over several lines, which would change
    module, mutants, _, _ = create_mutations("function.py", flat)
    codes = [module.deep_replace(each.original_node, each.mutated_node).code for each in mutants]
    return [Mutant(package, text, textwrap.indent(code, indent)) for code in codes]


def attempt(state: Path, function: Function, mutant: Mutant, files: list[str]) -> str:
    """Run files of tests on a mutant of a state; return "killed" or "lives"."""
    files = [file for file in files if (state / file).exists()]
    if not files:
        return "lives"
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "copy"
        shutil.copytree(state, copy, ignore=NOT_COPIED)
        (Path(folder) / "shared").symlink_to(state.parent / "shared")
        path = copy / function.path
        source = path.read_text("utf-8")
        path.write_text(source.replace(mutant.text, mutant.mutated), "utf-8")
        if passes(copy, files):
            return "lives"
        path.write_text(source, "utf-8")
        if not passes(copy, ["--last-failed", *files]):
            msg = f"a test of {', '.join(files)} fails without the mutant, too"
            raise RuntimeError(msg)
    return "killed"


def passes(copy: Path, arguments: list[str]) -> bool:
    """Run tests until the first one fails; one that takes too long has failed."""
    # A child that has the libraries already: to load them takes longer than most tests.
    child = os.fork()
    if child == 0:
        code = 1
        try:
            code = _run_here(copy, arguments)
        finally:
            os._exit(code)
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status) in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED)


def _run_here(copy: Path, arguments: list[str]) -> int:
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    os.chdir(copy)
    os.environ["PYTHONPATH"] = str(copy)
    sys.path[:] = [str(copy), *(path for path in sys.path if path)]
    for name in [*sys.modules]:
        if name.partition(".")[0] in (*PACKAGES, "benchmarks", "tests", "docs"):
            del sys.modules[name]
    return int(pytest.main(["-x", "-q", "-n", "0", "-m", UNMARKED, "-o", "timeout=60", *arguments]))


def tests_of(measured: Path, function: Function, package: str, budget_s: float) -> list[str]:
    """Return the files of tests that call a function: the quickest, one at least."""
    used_s: dict[str, float] = {}
    callers: set[str] = set()
    for part in MEASURED[package]:
        used_s |= json.loads((measured / FOLDER / part).with_suffix(".json").read_text("utf-8"))
        data = coverage.CoverageData(str(measured / FOLDER / part))
        data.read()
        for line, contexts in data.contexts_by_lineno(str(measured / function.path)).items():
            if function.first_line <= line <= function.last_line:
                callers |= set(contexts)
    chosen: list[str] = []
    for file in sorted(callers & used_s.keys(), key=used_s.__getitem__):
        if file.startswith(FOLDERS[package]) and (not chosen or used_s[file] <= budget_s):
            chosen.append(file)
            budget_s -= used_s[file]
    return chosen


def keep(state: Path, mutant: Mutant, answer: str) -> None:
    """Write what was found to a file of the state."""
    (state / TRIED).mkdir(parents=True, exist_ok=True)
    (state / TRIED / mutant.key).write_text(answer, "utf-8")
    print(f"{mutant.key} in {state.name}: {answer}", flush=True)


def read(state: Path, mutant: Mutant) -> str:
    """Return what was found, or nothing."""
    path = state / TRIED / mutant.key
    return path.read_text("utf-8") if path.exists() else ""


def report(states: list[Path], here: dict[str, dict[str, Function]], drawn: list[Mutant]) -> int:
    """Print what became of each mutant and how many were killed; return 1 where fewer are killed here."""
    for mutant in drawn:
        answers = [read(state, mutant) for state in states]
        function = here[mutant.package][mutant.text]
        print(f"{mutant.key} {function.path} {function.name}: {', '.join(answers)}")
    for package in PACKAGES:
        of_package = [each for each in drawn if each.package == package]
        cells = [sum(read(state, each) == "killed" for each in of_package) for state in states]
        print(f"{package}: {cells[0]} of {len(of_package)} killed here, {cells[1]} there")
    killed = [sum(read(state, each) == "killed" for each in drawn) for state in states]
    print(f"all: {killed[0]} of {len(drawn)} killed here, {killed[1]} there")
    return 1 if killed[0] < killed[1] else 0


if __name__ == "__main__":
    sys.exit(main())
