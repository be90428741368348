"""Write the pages of recorded figures.

    python -m benchmarks.results

Writes the Markdown page of each CSV file in this folder. To add a figure, add a row to the CSV file of its
subject and run this command; a new file needs its title in `TITLES`.
"""

import argparse
import sys

from benchmarks.results import TITLES
from benchmarks.results.pages import FOLDER, ResultsError, page


def main() -> int:
    """Write every page; returns the exit code."""
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    for name in TITLES:
        try:
            (FOLDER / f"{name}.md").write_text(page(name), encoding="utf-8")
        except (OSError, ResultsError) as error:
            print(f"results: {error}", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
