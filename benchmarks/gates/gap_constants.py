"""Every number of `gap` and its state models: what it decides, its source, and what a change by 20 % does.

    python -m benchmarks.gates.gap_constants > rows.md
    python -m benchmarks.gates.gap_constants --measure --only rover_hil.gap.fit.descent

Prints a row for each number of the folders, as in docs/contributing/gap_constants.md. What it decides is the
comment or text at the number itself. With `--measure` the figures of `benchmarks.sensitivity machines` on
one small cart (`cart:1`) are computed at 0.8 and 1.2 of it; two seconds each.
"""

import argparse
import ast
import io
import sys
import tokenize
from collections.abc import Iterator, Mapping
from functools import cache

from benchmarks.gates.constants import ROOT, Number, changed, numbers
from benchmarks.sensitivity.gap import prepare
from benchmarks.sensitivity.table import FACTORS
from drivers.clock import wall_time_text
from drivers.errors import RoverHilError

FOLDERS = ("rover_hil/gap", "sim_backends/state_model")
CASE = "cart:1"
NOT_MEASURED = "-"
LEAST_CHANGE = 1e-3
"""Smallest relative change of a figure that is reported."""
COMPILED = "sim_backends.state_model.tape_kernel"
BY_KIND = {
    "definition": "HALF_WIDTHS NORMAL_95 CLEAR_T MINUTE_S VOTE",
    "arithmetic": "ROUNDING RIDGE LARGEST FAR FAR_NOISES STILL NULL_TOLERANCE CLOSE SATURATED LEAST_SPREAD "
    "FLOOR_SHARE MOST_DIGITS",
    "memory": "VALUES_AT_ONCE POINTS_AT_ONCE VALUES_TOGETHER POINTS_OF_A_DESCENT MOST_DENSE "
    "LEAST_WORK LEAST_LANES BLOCK",
    "layout": "SHOWN MOST_LINES MOST_PAIRS WIDTH_IN MOST_CHANNELS MOST_RUNS BAND_SD TIME_BINS MANY "
    "LEAST_SCALE MOST_INPUTS",
    "calibration": "NOMINAL_M_PER_PX",
}
"""Sources other than "hand"; `layout` changes no verdict."""


def meaning(number: Number) -> str:
    """Return what a number decides: its text or comment, without both what its class is for."""
    text = (ROOT / number.module.replace(".", "/")).with_suffix(".py").read_text(encoding="utf-8")
    body = ast.parse(text).body
    owner = next((one for one in body if isinstance(one, ast.ClassDef) and one.name == number.owner), None)
    statements = body if owner is None else owner.body
    place = next(index for index, one in enumerate(statements) if _name(one) == number.name)
    after = statements[place + 1] if place + 1 < len(statements) else None
    if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
        return " ".join(str(after.value.value).split())
    comment = _comment(text, statements[place])
    about = (ast.get_docstring(owner) or "").splitlines()[0] if owner else ""
    return f"{comment[:1].upper()}{comment[1:]}" if comment else about


def _name(node: ast.stmt) -> str:
    target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
    return target.id if isinstance(target, ast.Name) else ""


def _comment(text: str, node: ast.stmt) -> str:
    """Return the comment at the end of a statement, and that above it."""
    comments = _comments(text)
    found = [comments[line][1] for line in (node.end_lineno or 0,) if line in comments]
    line = node.lineno - 1
    while comments.get(line, (False, ""))[0]:
        found.insert(0, comments[line][1])
        line -= 1
    return " ".join(found)


@cache
def _comments(text: str) -> Mapping[int, tuple[bool, str]]:
    """Return each comment by its line, with True where it stands alone."""
    return {
        token.start[0]: (token.line.lstrip().startswith("#"), token.string.removeprefix("#").strip())
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type == tokenize.COMMENT
    }


def source(number: Number) -> str:
    """Return where the value of a number is from."""
    return next((kind for kind, names in BY_KIND.items() if number.name in names.split()), "hand")


@cache
def usual_figures() -> Mapping[str, float]:
    """Return the figures as shipped."""
    return prepare([CASE])()


def change(number: Number) -> str:
    """Return the relative changes of the figures at 0.8 / 1.2 of a number; `0 / 0` below a thousandth."""
    usual, found = usual_figures(), []
    if number.module == COMPILED:
        return NOT_MEASURED
    for factor in FACTORS:
        try:
            with changed(number, factor):
                found.append(prepare([CASE])())
        except (RoverHilError, TypeError, ValueError, IndexError, ArithmeticError):
            return "refused"
    parts = {
        name: [(one[name] - value) / (abs(value) or 1.0) for one in found] for name, value in usual.items()
    }
    told = [
        f"{name} {' / '.join(f'{each:+.1%}' for each in both)}"
        for name, both in parts.items()
        if max(map(abs, both)) >= LEAST_CHANGE
    ]
    return "; ".join(told) or "0 / 0"


def rows(begins: tuple[str, ...], *, is_measured: bool) -> Iterator[str]:
    """Yield the rows of the table."""
    day = wall_time_text()
    today = f"{day[:4]}-{day[4:6]}-{day[6:8]}"
    for number in numbers(folders=FOLDERS):
        if number.title.startswith(begins):
            found = change(number) if is_measured else NOT_MEASURED
            cells = (number.title, number.text, meaning(number), source(number), found, today)
            yield f"| {' | '.join(cells)} |"


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", action="append", help="rows whose names begin so; default: all")
    parser.add_argument("--measure", action="store_true", help="compute what a change does")
    arguments = parser.parse_args()
    print("| number | value | what it decides | source | change at 0.8 / 1.2 | date |")
    print("|---|---|---|---|---|---|")
    for row in rows(tuple(arguments.only or ("",)), is_measured=arguments.measure):
        print(row, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
