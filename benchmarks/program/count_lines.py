"""Count the lines of the product: code and strings of .py, all lines of .js, .html, .toml and .json.

    python -m benchmarks.program.count_lines [FOLDER OF ANOTHER STATE]

Left out are what a command generates, and the models of `gap`: they change for other reasons. Prints each
package, and with another state the difference.
"""

import sys
import tokenize
from collections import Counter
from pathlib import Path

PACKAGES = ("rover_hil", "drivers", "controllers", "sim_backends")
LEFT_OUT = (
    "rover_hil/gap/",
    "sim_backends/state_model/",
    "sim_backends/models/",
    "sim_backends/fmu/",
    "sim_backends/wheels_model/",
    "rover_hil/config/shipped/configs/rover-hil-config.schema.json",
)
TEXTS = (".js", ".html", ".toml", ".json")
NO_CODE = (
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENCODING,
    tokenize.ENDMARKER,
)


def main() -> None:
    """Print the lines of this state, and of another one."""
    counts = [count(Path(folder)) for folder in (".", *sys.argv[1:2])]
    for package in sorted(counts[0] | counts[-1]):
        print(f"{package:40s}{'  '.join(f'{each[package]:7d}' for each in counts)}")
    print(f"{'all':40s}{'  '.join(f'{sum(each.values()):7d}' for each in counts)}")


def count(root: Path) -> Counter[str]:
    """Return the lines of each package of the second level."""
    lines: Counter[str] = Counter()
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*")):
            name = path.relative_to(root).as_posix()
            if path.is_file() and not name.startswith(LEFT_OUT):
                lines["/".join(name.split("/")[:2])] += lines_of(path)
    return lines


def lines_of(path: Path) -> int:
    """Return the lines of a file that count; strings over several lines count with all of them."""
    if path.suffix in TEXTS:
        return len(path.read_text("utf-8").splitlines())
    if path.suffix != ".py":
        return 0
    used: set[int] = set()
    with path.open("rb") as stream:
        for token in tokenize.tokenize(stream.readline):
            if token.type not in NO_CODE:
                used |= set(range(token.start[0], token.end[0] + 1))
    return len(used)


if __name__ == "__main__":
    main()
