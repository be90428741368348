"""`python -m docs.generate FOLDER`: write the generated reference pages into a folder."""

import sys
from pathlib import Path

from docs.generate.commands_page import commands_page
from docs.generate.configuration_page import configuration_page

PAGES = {"configuration.md": configuration_page, "commands.md": commands_page}


def write_pages(folder: Path) -> None:
    """Write every generated page."""
    for name, make_page in PAGES.items():
        (folder / name).write_text(make_page(), "utf-8")


if __name__ == "__main__":
    write_pages(Path(sys.argv[1]))
